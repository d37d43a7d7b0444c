"""Measurements that reach the common estimate late, taken in exactly by going back.

A run is cut into spans, no longer than a tasking interval. Before a span of which anything is still
under way, all that estimator and bound carry is kept. Once something of it has come, they go back
to that epoch and work through the spans since then anew, with all that has been received by now.
What they know then is what they would know had it come in time, bit for bit, the random numbers of
the estimator included; and at every step the estimates are those of what had been taken in by then.
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
from cislunar.tasking.decision import Decision
from cislunar.tasking.planning.detection import LearnedDetection
from cislunar.tasking.planning.under_way import PlannedLooks
from cislunar.tasking.simulation import Truth

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

Work = Callable[[Truth, Measurements, Flags], tuple[Estimates, Array]]
"""Lets estimator and bound work through the steps of measurements. It gives the estimates, and the
bound at those of the steps, shape (step,), at which it is wanted."""


@dataclass
class _Span:
    """Steps from `first` on, what was measured in them, and what was known before.

    By row of the measurements: `arrival`, the step from which on it can be used, and whether it has
    been `given` to the estimator.
    """

    first: int
    motion: Truth
    measurements: Measurements
    arrival: Indices
    given: Flags
    before: list[dict[str, Any]] | None = None


class _Interval(NamedTuple):
    """What was decided at an epoch and what its looks found, by row; some of it is `learned`."""

    first: int
    decision: Decision
    target: Indices
    step: Indices
    observer: Indices
    found: NDArray[np.uint8]
    arrival: Indices
    learned: Flags


class Reception:
    """What of one realization's measurements has been received, and what is under way.

    Parameters
    ----------
    arrival : ndarray of int, shape (observer, step)
        As of `cislunar.tasking.communication.contact.arrivals`.
    span_steps : int
        Steps after which the estimate takes in what has come late.
    carried : sequence of objects
        Estimator and bound: what their attributes hold is kept and put back.
    shared : sequence of objects
        What these refer to and never change: scene, surfaces, forces.
    n_targets : int

    Attributes
    ----------
    observed : ndarray of bool, shape (target,)
        Whether a measurement of each target has been used so far.
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
        """Take in what has arrived before the step `now`, to which all steps have been done."""
        late = [np.any((span.arrival < now) & ~span.given) for span in self._spans]
        if any(late):
            oldest = late.index(True)
            self._put_back(self._spans[oldest].before)
            for span in self._spans[oldest:]:
                span.given |= span.arrival < now
                self._work_through(span, work, np.zeros(span.motion.noise.shape[1] - 1, bool))
        while self._spans and self._spans[0].given.all():
            del self._spans[0]

    def advance(
        self, first: int, motion: Truth, measurements: Measurements, wanted: Flags, work: Work
    ) -> tuple[Estimates, Array]:
        """Work through the steps from `first` on, with what is received meanwhile.

        Parameters
        ----------
        first : int
            The first step.
        motion : Truth
            From the time before it on.
        measurements : Measurements
            All looks, those that found nothing too.
        wanted : ndarray of bool, shape (step,)
            Where the bound is wanted.
        work : callable

        Returns
        -------
        estimates : Estimates
            At each step by what had been taken in; what is under way counts as `used`.
        bound : ndarray, shape (target, step, 12)
        """
        _, step = rows_of(measurements)
        arrival = self._arrival[measurements.observer, first + step]
        used, parts = np.ones(step.size, dtype=bool), []
        for start in range(0, wanted.size, self._span_steps):
            stop = min(start + self._span_steps, wanted.size)
            if start > 0:
                self.receive(first + start, work)
            rows = (step >= start) & (step < stop)
            own = measurements.where(rows)
            own = own._replace(offset=np.ascontiguousarray(own.offset[:, start : stop + 1]))
            given = arrival[rows] <= first + step[rows]
            moved = Truth(*(each[:, start : stop + 1] for each in motion))
            span = _Span(first + start, moved, own, arrival[rows], given)
            parts.append(self._work_through(span, work, wanted[start:stop]))
            used[np.flatnonzero(rows)[given]] = parts[-1][0].used
            if self._spans or not given.all():
                self._spans.append(span)
        several, least = zip(*parts, strict=True)
        *histories, _ = zip(*several, strict=True)
        joined = (np.concatenate(history, axis=1) for history in histories)
        return Estimates(*joined, used), np.concatenate(least, axis=1)

    def _work_through(self, span: _Span, work: Work, wanted: Flags) -> tuple[Estimates, Array]:
        """Go through a span with what has been received of it; its beginning is kept if needed."""
        in_time = span.arrival < self._arrival.shape[1]
        span.before = self._stored() if np.any(in_time & ~span.given) else None
        received = span.measurements.where(span.given)
        estimates, least = work(span.motion, received, wanted)
        self.observed[rows_of(received)[0][estimates.used]] = True
        return estimates, least

    def _stored(self) -> list[dict[str, Any]]:
        """A copy of what estimator and bound carry."""
        return self._copied([vars(each) for each in self._carried])

    def _copied(self, held: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return copy.deepcopy(held, {id(each): each for each in self._shared})

    def _put_back(self, held: list[dict[str, Any]]) -> None:
        for each, attributes in zip(self._carried, self._copied(held), strict=True):
            vars(each).clear()
            vars(each).update(attributes)

    def note(
        self, first: int, decision: Decision, measurements: Measurements, found: NDArray[np.uint8]
    ) -> None:
        """Remember what was decided at the epoch before the step `first`, and what came of it."""
        target, step = rows_of(measurements)
        observer = measurements.observer
        arrival, learned = self._arrival[observer, first + step], np.zeros(step.size, dtype=bool)
        self._intervals.append(
            _Interval(first, decision, target, step, observer, found, arrival, learned)
        )

    def learn(self, now: int, detection: LearnedDetection | None) -> None:
        """Let detection learn from what has arrived before the step `now`.

        The looks of an observer in an interval are one trial, of which nothing is said before its
        end has come.
        """
        for each in self._intervals:
            held_back = each.observer[each.arrival >= now]
            ready = ~each.learned & ~np.isin(each.observer, held_back)
            if detection is not None and ready.any():
                rows = (each.target, each.step, each.observer, each.found)
                each.decision.learn(detection, *(column[ready] for column in rows))
            each.learned[ready] = True
        self._intervals = [each for each in self._intervals if not each.learned.all()]

    def under_way(self, now: int, detection: LearnedDetection | None) -> PlannedLooks:
        """Looks taken before the step `now` of which nothing has been received."""
        parts = []
        for each in self._intervals:
            rows = each.arrival >= now
            target, observer = each.target[rows], each.observer[rows]
            chance = np.ones(target.size)
            if detection is not None:
                detects = each.decision.detects_at(target, each.step[rows], observer)
                chance = detection.chance(target, detects)
            parts.append((each.first + each.step[rows] + 1, target, observer, chance))
        if not parts:
            return PlannedLooks(*np.empty((3, 0), dtype=np.int64), np.empty(0))
        return PlannedLooks(*map(np.concatenate, zip(*parts, strict=True)))
