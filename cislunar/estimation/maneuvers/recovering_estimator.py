"""An estimator whose targets are tested for maneuvers, and whose orbits are estimated anew after an
alarm by a bank of maneuver times."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.dynamics.forces import of_targets
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import (
    Estimates,
    Estimator,
    OrbitEstimates,
    Prediction,
)
from cislunar.estimation.maneuvers.bank import (
    UNKNOWN_MANEUVER,
    AngleRows,
    EstimatedManeuver,
    ManeuverBank,
)
from cislunar.estimation.maneuvers.detection_settings import ManeuverDetection
from cislunar.estimation.maneuvers.likelihood_ratio import ManeuverTest
from cislunar.estimation.maneuvers.monitored_estimator import MonitoredEstimator
from cislunar.estimation.maneuvers.search import ReachableSearch
from cislunar.estimation.track_arrays import remaining_tracks
from cislunar.observation.records import Measurements, rows_of
from cislunar.observation.scene import Scene
from cislunar.runtime import Array, Indices

_BEFORE_HOURS = 6.0
"""Time between the orbit from which a bank begins and the maneuver of the test, h."""

_AROUND_HOURS = 1.5
"""Half the extent of the first hypothesized times about the maneuver of the test, h."""

_BETWEEN = 8
"""Largest number of observations after which a maneuver is hypothesized first."""

_GROWTH = 1.1
"""Factor by which the number of observations has grown when a bank is solved again."""


class RecoveredManeuvers(NamedTuple):
    """Maneuvers that have been estimated, in the order of their alarms; arrays, shape (maneuver,
    ...).

    Attributes
    ----------
    target : ndarray of int
    alarm_s : ndarray
        Time of the observation with the alarm, since the start of the run, s.
    time_s, time_sigma_s, velocity_m_s, covariance, probability : ndarray
        See `cislunar.estimation.maneuvers.bank.EstimatedManeuver`.
    """

    target: Indices
    alarm_s: Array
    time_s: Array
    time_sigma_s: Array
    velocity_m_s: Array
    covariance: Array
    probability: Array


class _Span(NamedTuple):
    """Orbits before some steps, and the observations that were used at them: target, and what
    `AngleRows` has."""

    orbits: OrbitEstimates
    target: Indices
    rows: AngleRows


class _Recovery(NamedTuple):
    """A target after an alarm at an index of the scene. `begin` is the index of its bank's first
    orbit, `number` that of its maneuver among the estimates."""

    bank: ManeuverBank
    begin: int
    alarm: int
    number: int


class RecoveringEstimator(MonitoredEstimator):
    """A `MonitoredEstimator` that replaces orbits after an alarm.

    Until the first alarm of a target its estimates are those of the inner estimator, bit for bit.
    From then on until `window_hours` later, the orbit at the end of an interval with observations
    is that of its `ManeuverBank`; attitudes stay.

    Parameters
    ----------
    inner : Estimator
    test : ManeuverTest
    threshold : float
    model : tuple
        Scene, force model, and process noise (6, 6) of a step.
    settings : ManeuverDetection
    search : ReachableSearch, optional
        Search for targets that may have left the field of view, whose predictions are NaN; none if
        omitted.
    """

    def __init__(
        self,
        inner: Estimator,
        test: ManeuverTest,
        threshold: float,
        model: tuple[Scene, tuple, Array],
        settings: ManeuverDetection,
        search: ReachableSearch | None = None,
    ) -> None:
        super().__init__(inner, test, threshold)
        self._search = search
        self._model, self._settings = model, settings
        self._spans: list[_Span] = []
        self._open: dict[int, _Recovery] = {}
        self._solved: dict[int, int] = {}  # rows of the last solution, by target
        self._estimated: list[tuple[int, int, EstimatedManeuver]] = []

    def advance(
        self,
        measurements: Measurements,
        *,
        covariance: bool = False,
        final: bool = True,
        histories: bool = True,
    ) -> Estimates:
        """See `Estimator.advance`. The last step of an interval reports replaced orbits."""
        del histories  # see `MonitoredEstimator.advance`
        start = self._inner.orbits()
        target, step = rows_of(measurements)
        found = self._advance(start.index + 1, measurements, final)
        used = found.used
        self._spans.append(
            _Span(
                start,
                target[used],
                AngleRows(
                    start.index + 1 + step[used],
                    measurements.observer[used],
                    measurements.value[used, 1:],
                    measurements.variance[used, 1:],
                ),
            )
        )
        if found.translation.shape[1] > 0:
            self._open_recoveries()
            if self._search is not None:
                self._begin_searches(start.index, found.translation.shape[1])
            self._replace(start.index + found.translation.shape[1], found)
        return found if covariance else found._replace(covariance=found.covariance[:, :0])

    def _advance(self, first: int, measurements: Measurements, final: bool) -> Estimates:
        """Process steps from the index `first` on, without observations of targets that are
        searched for. Those that show their target count as used."""
        search = self._search
        if search is None or not search.lost:
            found = super().advance(measurements, covariance=True, final=final)
            if search is not None:
                search.note(measurements, found.used, first)
            return found
        of_lost, shown = search.shown(measurements, first)
        others = measurements.where(~of_lost)
        found = super().advance(others, covariance=True, final=final)
        search.note(others, found.used, first)
        used = shown.copy()
        used[~of_lost] = found.used
        return found._replace(used=used)

    def predict(self) -> Prediction:
        """See `Estimator.predict`. Targets that are searched for are NaN."""
        found = self._inner.predict()
        if self._search is None or not self._search.lost:
            return found
        translation, covariance = found.translation.copy(), found.covariance.copy()
        lost = list(self._search.lost)
        translation[lost], covariance[lost] = np.nan, np.nan
        return found._replace(translation=translation, covariance=covariance)

    def command_search(self, n_steps: int) -> Indices:
        """Observations of the next steps that search for targets: step, observer and target of
        each, shape (n, 3)."""
        if self._search is None or not self._search.lost:
            return np.empty((0, 3), dtype=np.int64)
        return self._search.command(self._inner.orbits().index, n_steps)

    def _begin_searches(self, start: int, n_steps: int) -> None:
        """End the searches for targets that have been found, and begin those for targets that have
        probably gone."""
        search, last, now = self._search, self._spans[-1], start + n_steps
        for j in [j for j in search.lost if np.any(last.target == j)]:
            rows = AngleRows(*(column[last.target == j] for column in last.rows))
            seen = int(search.seen[j].max())
            first = int(rows.time[0]), int(rows.observer[0]), rows.value[0]
            starts = search.end(j, first)
            times = np.linspace(seen, first[0] - 1, 9).astype(np.int64)
            self._begin_recovery(j, seen, first[0], np.append(times, list(starts)), starts)
        for j in search.gone(now).tolist():
            room = len(search.lost) < search.rounds(n_steps)
            if room and j not in self._open and not self._inner.failed[j]:
                seen = int(search.seen[j].max())
                orbits = self._orbits_before(seen)
                search.begin(j, (orbits.index, orbits.translation[j]), now)

    def _orbits_before(self, index: int) -> OrbitEstimates:
        """The last orbits that are kept of a time up to an index, or the first ones."""
        early = [span.orbits for span in self._spans if span.orbits.index <= index]
        return early[-1] if early else self._spans[0].orbits

    def recovered_maneuvers(self) -> RecoveredManeuvers:
        """All maneuvers that have been estimated so far."""
        step_s = self._model[0].step_s
        columns = [
            (target, step_s * alarm, *estimate) for target, alarm, estimate in self._estimated
        ]
        shapes = (), (), (), (), (3,), (3, 3), ()
        empty = [np.empty((0, *shape)) for shape in shapes]
        target, *others = map(np.array, zip(*columns, strict=True)) if columns else empty
        return RecoveredManeuvers(target.astype(np.int64), *others)

    def _steps(self, hours: float) -> int:
        return round(3600.0 * hours / self._model[0].step_s)

    def _open_recoveries(self) -> None:
        """Open a recovery for each target with a new alarm."""
        largest = self._largest
        for j in np.flatnonzero(largest.statistic > self.maneuver_threshold).tolist():
            if j in self._open or self._inner.failed[j]:
                continue
            found, alarm = int(largest.index[j]), int(largest.tested[j])
            begin = self._orbits_before(found - self._steps(_BEFORE_HOURS)).index
            seen = self._rows(j, begin).time
            # in the gap before the alarm and between observations, where large changes are, and
            # about the test's
            gap = np.array([seen[seen < alarm].max(initial=begin), alarm - 1])
            around = found + self._steps(_AROUND_HOURS) * np.linspace(-1.0, 1.0, 5)
            between = seen[(seen >= around[0]) & (seen < alarm)]
            some = np.linspace(0, between.size - 1, min(between.size, _BETWEEN), dtype=int)
            times = np.rint(np.concatenate([np.linspace(*gap, 4), around, between[some]]))
            times = np.minimum(times.astype(np.int64), alarm - 1)
            self._begin_recovery(j, found, alarm, times, {})

    def _begin_recovery(
        self, j: int, found: int, alarm: int, times: Indices, starts: dict[int, Array]
    ) -> None:
        """Open the recovery of a target, from about the time `found` of its maneuver."""
        orbits = self._orbits_before(found - self._steps(_BEFORE_HOURS))
        base = orbits.index, orbits.translation[j], orbits.covariance[j]
        bank = ManeuverBank(
            *self._model, j, base, np.maximum(times, base[0]),
            self._settings.maneuvers_per_target_day, starts,
        )  # fmt: skip
        self._open[j] = _Recovery(bank, orbits.index, alarm, len(self._estimated))
        self._estimated.append((j, alarm, UNKNOWN_MANEUVER))

    def _rows(self, target: int, begin: int) -> AngleRows:
        """Observations of a target after an index of the scene."""
        spans = [span for span in self._spans if span.orbits.index >= begin]
        parts = [AngleRows(*(c[span.target == target] for c in span.rows)) for span in spans]
        return AngleRows(*map(np.concatenate, zip(*parts, strict=True)))

    def _replace(self, now: int, found: Estimates) -> None:
        """Solve the banks of targets that have been observed since the previous call, replace their
        orbits at the present step, and close old recoveries."""
        replaced, states, covariances = [], [], []
        for j, recovery in list(self._open.items()):
            rows = self._rows(j, recovery.begin)
            if rows.time.size == 0 or self._inner.failed[j]:
                continue
            if rows.time.size > _GROWTH * self._solved.get(j, 0):
                self._solved[j] = rows.time.size
                solution = recovery.bank.solve(rows, now)
                if _is_definite(solution.covariance):
                    self._estimated[recovery.number] = j, recovery.alarm, solution.maneuver
                    replaced.append(j)
                    states.append(solution.translation)
                    covariances.append(solution.covariance)
            if now - recovery.alarm >= self._steps(self._settings.window_hours):
                del self._open[j], self._solved[j]
        if replaced:
            self._inner.replace_orbits(replaced, np.array(states), np.array(covariances))
            self._test.restart(replaced)
            # the estimator has rounded
            orbits = self._inner.orbits()
            found.translation[replaced, -1] = orbits.translation[replaced]
            found.covariance[replaced, -1] = orbits.covariance[replaced]
            deviations = np.sqrt(np.diagonal(orbits.covariance[replaced], axis1=1, axis2=2))
            found.sigma[replaced, -1, 6:] = deviations
        kept = now - self._steps(self._settings.window_hours + _BEFORE_HOURS)
        kept = min([kept, *(each.begin for each in self._open.values())])
        while len(self._spans) > 1 and self._spans[1].orbits.index <= kept:
            del self._spans[0]

    def _added(self, n_new: int, forces: tuple | None) -> None:
        """See `WrappedEstimator`. Recoveries begin anew with the next alarm."""
        super()._added(n_new, forces)
        scene, known, process = self._model
        self._begin_anew((scene, known if forces is None else forces, process))

    def remove(self, targets: ArrayLike) -> None:
        """See `Estimator.remove`. Recoveries begin anew with the next alarm."""
        left = remaining_tracks(len(self._inner.failed), targets)
        super().remove(targets)
        scene, forces, process = self._model
        self._begin_anew((scene, of_targets(forces, left), process))
        number = {int(j): k for k, j in enumerate(left)}
        self._estimated = [(number[j], *rest) for j, *rest in self._estimated if j in number]

    def _begin_anew(self, model: tuple[Scene, tuple, Any]) -> None:
        self._model, self._spans = model, []
        if self._search is not None:
            raise ConfigurationError(
                "tracks cannot be added or removed while targets are searched for"
            )
        self._open, self._solved = {}, {}


def _is_definite(covariance: Array) -> bool:
    """Whether a covariance is finite and, within rounding, positive definite."""
    scale = np.sqrt(np.abs(np.diag(covariance)))
    if not np.all(np.isfinite(covariance)) or np.any(scale == 0.0):
        return False
    return bool(np.linalg.eigvalsh(covariance / np.outer(scale, scale))[0] > 0.0)
