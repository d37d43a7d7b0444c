"""Late measurements, processed exactly by returning to their epoch (docs/tasking.md). A run is
divided into spans that are no longer than a tasking interval. The state of a filter after late
measurements equals, bit for bit, that with measurements in time. The batch estimator, for which the
estimates within a span that is processed again are not needed, fits light curves at its end only,
and propagates attitudes in longer steps.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.estimation.estimator import Estimates
from cislunar.observation.records import Measurements, rows_of
from cislunar.runtime import Array, Flags, Indices
from cislunar.tasking.decision import Decision
from cislunar.tasking.planning import LearnedDetection, PlannedObservations
from cislunar.tasking.truth import Truth

Work = Callable[[Truth, Measurements, Flags | None], tuple[Estimates, Array]]
"""Processes the steps of measurements with estimator and bound. It returns the estimates, and the
bound at the selected steps, shape (step,). None selects no step: neither histories of estimates nor
the bound are needed."""


@dataclass
class _Span:
    """Steps from `first` on, their measurements, and the states before. By row of the measurements:
    `arrival`, the step from which on it can be used, and whether it was `given` to the estimator.
    """

    first: int
    motion: Truth
    measurements: Measurements
    arrival: Indices
    given: Flags
    before: list[Any] | None = None


class _Interval(NamedTuple):
    """A decision at an epoch and the outcomes of its observations, by row; `learned` marks the
    outcomes that have been used."""

    first: int
    decision: Decision
    target: Indices
    step: Indices
    observer: Indices
    found: NDArray[np.uint8]
    arrival: Indices
    learned: Flags


class Reception:
    """Received and pending measurements of one realization.

    Parameters
    ----------
    arrival : ndarray of int, shape (observer, step)
        See `cislunar.tasking.communication.contact.arrivals`.
    span_steps : int
        Steps after which the estimate uses late measurements.
    carried, shared : sequence of objects
        Estimator and bound, whose attributes are stored and restored; constant objects to which
        these refer.
    n_targets : int
    """

    def __init__(
        self,
        arrival: Indices,
        span_steps: int,
        carried: Sequence[Any],
        shared: Sequence[Any],
        n_targets: int,
    ) -> None:
        self._arrival, self._span_steps = arrival, span_steps
        self._carried, self._shared = carried, shared
        self._spans: list[_Span] = []
        self._intervals: list[_Interval] = []
        self.observed = np.zeros(n_targets, dtype=bool)

    def receive(self, now: int, work: Work) -> None:
        """Process measurements that have arrived before the present step `now`."""
        late = [np.any((span.arrival < now) & ~span.given) for span in self._spans]
        if any(late):
            oldest = late.index(True)
            self._adopt(self._spans[oldest].before)
            for span in self._spans[oldest:]:
                span.given |= span.arrival < now
                self._process(span, work, None)
        while self._spans and self._spans[0].given.all():
            del self._spans[0]

    def advance(
        self, first: int, motion: Truth, measurements: Measurements, selected: Flags, work: Work
    ) -> tuple[Estimates, Array]:
        """Process the steps from `first` on, with the measurements received meanwhile. `motion` is
        the truth from the time before it on; `measurements` has all observations, including those
        that detected nothing; `selected` (step,) marks the steps at which the bound is computed.
        Returns the estimates at each step from the measurements received by then (pending
        measurements count as `used`) and the bound (target, step, 12)."""
        _, step = rows_of(measurements)
        arrival = self._arrival[measurements.observer, first + step]
        used, results = np.ones(step.size, dtype=bool), []
        for start in range(0, selected.size, self._span_steps):
            stop = min(start + self._span_steps, selected.size)
            if start > 0:
                self.receive(first + start, work)
            rows = (step >= start) & (step < stop)
            own = measurements.where(rows)
            own = own._replace(offset=np.ascontiguousarray(own.offset[:, start : stop + 1]))
            given = arrival[rows] <= first + step[rows]
            moved = Truth(*(each[:, start : stop + 1] for each in motion))
            span = _Span(first + start, moved, own, arrival[rows], given)
            results.append(self._process(span, work, selected[start:stop]))
            used[np.flatnonzero(rows)[given]] = results[-1][0].used
            if self._spans or not given.all():
                self._spans.append(span)
        several, least = zip(*results, strict=True)
        *histories, _ = zip(*several, strict=True)
        concatenated = (np.concatenate(history, axis=1) for history in histories)
        return Estimates(*concatenated, used), np.concatenate(least, axis=1)

    def _process(self, span: _Span, work: Work, selected: Flags | None) -> tuple[Estimates, Array]:
        """Process a span with its received measurements; its initial state is stored if needed."""
        in_time = span.arrival < self._arrival.shape[1]
        span.before = self._stored() if np.any(in_time & ~span.given) else None
        received = span.measurements.where(span.given)
        estimates, least = work(span.motion, received, selected)
        self.observed[rows_of(received)[0][estimates.used]] = True
        return estimates, least

    def _stored(self) -> list[Any]:
        """Copies of estimator and bound, without the constant objects."""
        return copy.deepcopy(list(self._carried), {id(each): each for each in self._shared})

    def _adopt(self, stored: list[Any]) -> None:
        """Give estimator and bound the states of stored copies, which are used up."""
        for each, kept in zip(self._carried, stored, strict=True):
            vars(each).clear()
            vars(each).update(vars(kept))

    def note(
        self, first: int, decision: Decision, measurements: Measurements, found: NDArray[np.uint8]
    ) -> None:
        """Record a decision at the epoch before the step `first`, and its detection outcomes."""
        target, step = rows_of(measurements)
        observer = measurements.observer
        arrival, learned = self._arrival[observer, first + step], np.zeros(step.size, dtype=bool)
        self._intervals.append(
            _Interval(first, decision, target, step, observer, found, arrival, learned)
        )

    def learn(self, now: int, detection: LearnedDetection | None) -> None:
        """Update the learned detection with outcomes that have arrived before the step `now`. The
        observations of an observer in an interval are one trial, which counts when the last outcome
        has arrived."""
        for each in self._intervals:
            outstanding = each.observer[each.arrival >= now]
            ready = ~each.learned & ~np.isin(each.observer, outstanding)
            if detection is not None and ready.any():
                rows = (each.target, each.step, each.observer, each.found)
                each.decision.learn(detection, *(column[ready] for column in rows))
            each.learned[ready] = True
        self._intervals = [each for each in self._intervals if not each.learned.all()]

    def expect(self, detection: LearnedDetection) -> None:
        """State the trials whose outcomes have not been learned to the learned detection."""
        trials = []
        for each in self._intervals:
            rows = each.target, each.step, each.observer
            trials.append(each.decision.trials(*(column[~each.learned] for column in rows)))
        detection.expect(trials)

    def pending(self, now: int, detection: LearnedDetection | None) -> PlannedObservations:
        """Observations made before the step `now` of which nothing has been received."""
        results = []
        for each in self._intervals:
            rows = each.arrival >= now
            target, observer = each.target[rows], each.observer[rows]
            probability = np.ones(target.size)
            if detection is not None:
                detects = each.decision.detects_at(target, each.step[rows], observer)
                probability = detection.probability_at(target, detects)
            results.append((each.first + each.step[rows] + 1, target, observer, probability))
        if not results:
            return PlannedObservations(*np.empty((3, 0), dtype=np.int64), np.empty(0))
        return PlannedObservations(*map(np.concatenate, zip(*results, strict=True)))
