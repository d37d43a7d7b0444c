"""Tasking and estimation in a closed loop (Paul & Fan, sections 4 and 5.2).

At every tasking epoch the estimates are carried to the next measurement time, the information of
all pairs is computed and observers are assigned; until the next epoch the assigned targets are
measured at every step. One call runs many seeds of one cell.

Assumptions and limitations
---------------------------
- An observer whose best pairing brings no information stays idle until the next epoch.
- The paper judges information "at" the epoch; here it is that of the first measurement after it,
  from the covariance predicted to that time.
- The truth has the filter's reflection model in form. Shapes, materials, inertia, noise, torque and
  force model may differ (`cislunar.tasking.simulation.TruthModel`).
- The Cramer-Rao bound is that of an estimator that knows the truth's model, without process noise,
  whatever the estimator of the run supposes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import EstimatorFactory, InitialEstimate
from cislunar.estimation.registry import estimator_named
from cislunar.evaluation.cramer_rao import CramerRaoBound
from cislunar.evaluation.metrics import Evaluation, TrackingMetrics
from cislunar.observation.measurement import DETECTED, NOT_TASKED, measure
from cislunar.observation.records import constant_schedule, highest, rows_of
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.tasking.assignment import assign
from cislunar.tasking.information import pair_information
from cislunar.tasking.preselection import assign_preselected, preselects
from cislunar.tasking.recording import Recorder, Records
from cislunar.tasking.settings import LoopSettings
from cislunar.tasking.simulation import (
    ESTIMATOR,
    TASKING,
    TruthModel,
    draw_truth,
    estimation_errors,
    initial_estimate,
    stream,
)

Array = NDArray[np.float64]

USED = DETECTED + 1
"""Fate of a look whose measurement was used, beyond those of `cislunar.observation.measurement`."""

FATE_NAMES = ("not_tasked", "faint", "excluded", "occulted", "rejected", "used")
"""Names of the fates; "rejected" was out of the field of view, or the estimate had failed."""


@dataclass(frozen=True)
class LoopResult:
    """What became of all seeds of a cell. Targets are numbered within the monitored set.

    Attributes
    ----------
    assignment : ndarray of int16, shape (seed, epoch, observer)
        Target of each observer, or -1.
    information : ndarray, shape (seed, epoch)
        Information of the tasking, nats.
    evaluations : ndarray of int, shape (seed, epoch)
        Taskings tried.
    elapsed_s : ndarray, shape (time,)
        Times of `error`, `sigma` and `bound` since the start, s.
    error, sigma : ndarray of float32, shape (seed, time, target, 12)
        Truth less estimate, and standard deviation: attitude error (GRP), angular velocity
        (rad/s), position and velocity (nondimensional). NaN after the end of a failed estimate.
    bound : ndarray of float32, shape (seed, time, target, 12)
        Standard deviations of the posterior Cramer-Rao bound of the measurements used, as `sigma`;
        see `cislunar.evaluation.cramer_rao`.
    fate : ndarray of uint8, shape (seed, step, target)
        Index into `FATE_NAMES`, at every step; the best of the looks at a target.
    metrics : TrackingMetrics
        Arrays with a leading axis over seeds.
    failed : ndarray of uint8, shape (seed, target)
        0, or why an estimate came to an end.
    counters : ndarray of int, shape (seed, target, 4)
        Updates, measurements out of the field of view, dark sigma points, failed Cholesky
        factorisations.
    pair_information : ndarray, shape (seed, epoch, observer, target), or None
        Information of all pairs, if it was to be kept.
    records : Records
        What ``settings.record`` asked for.
    """

    assignment: NDArray[np.int16]
    information: Array
    evaluations: NDArray[np.int64]
    elapsed_s: Array
    error: NDArray[np.float32]
    sigma: NDArray[np.float32]
    bound: NDArray[np.float32]
    fate: NDArray[np.uint8]
    metrics: TrackingMetrics
    failed: NDArray[np.uint8]
    counters: NDArray[np.int64]
    pair_information: Array | None
    records: Records

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Whether a measurement was used, shape (seed, step, target)."""
        return self.fate == USED

    @property
    def final_attitude_error_deg(self) -> Array:
        """Root mean square attitude error over the final hours, shape (seed, target)."""
        return self.metrics.final_attitude_error_deg


class _Histories(NamedTuple):
    """What is kept of a run; `error`, `sigma` and `bound` at the recorded steps only."""

    assignment: NDArray[np.int16]
    information: Array
    evaluations: NDArray[np.int64]
    error: NDArray[np.float32]
    sigma: NDArray[np.float32]
    bound: NDArray[np.float32]
    fate: NDArray[np.uint8]
    pairs: Array

    @classmethod
    def empty(
        cls, settings: LoopSettings, n_seeds: int, n_observers: int, n_targets: int
    ) -> _Histories:
        """Room for all seeds, the first axis."""
        epochs = (n_seeds, settings.epochs.size)
        states = (n_seeds, settings.recorded.size, n_targets, 12)
        pairs = (*epochs, n_observers, n_targets) if settings.keep_information else (n_seeds, 0)
        return cls(
            np.empty((*epochs, n_observers), np.int16),
            np.empty(epochs),
            np.empty(epochs, np.int64),
            *(np.empty(states, np.float32) for _ in range(3)),
            np.empty((n_seeds, settings.n_steps, n_targets), np.uint8),
            np.empty(pairs),
        )


class _Run:
    """One seed of a cell: truth, estimator, bound and metrics, from epoch to epoch."""

    def __init__(
        self,
        scene: Scene,
        surfaces: TargetSurfaces,
        settings: LoopSettings,
        factory: EstimatorFactory,
        initial: InitialEstimate,
        truth: TruthModel,
        ids: NDArray[np.int64],
        seed: int,
        forces: tuple,
        kept: _Histories,
        recorder: Recorder,
    ) -> None:
        self.scene, self.surfaces, self.settings, self.truth = scene, surfaces, settings, truth
        self.seed, self.forces, self.kept, self.recorder = seed, forces, kept, recorder
        self.motion = draw_truth(
            initial,
            scene,
            truth.noise,
            seed,
            ids,
            forces=truth.forces,
            inertia=truth.surfaces.inertia,
            angular_acceleration=truth.angular_acceleration,
        )
        own = stream(ESTIMATOR, seed)
        self.estimator = factory(scene, surfaces, settings.sensor, initial, own, forces)
        self.bound = CramerRaoBound(scene, truth.surfaces, initial.sigma, forces=truth.forces)
        self.evaluation = Evaluation(settings.step_s)

    def epoch(self, number: int) -> None:
        """Assign the observers and work through the interval that follows."""
        settings, start = self.settings, int(self.settings.epochs[number])
        stop = min(start + settings.steps_per_interval, settings.n_steps)
        known = (
            self.estimator.predict(),
            self.scene,
            self.surfaces,
            settings.sensor,
            settings.tasking,
            self.forces,
        )
        n_pairs = self.kept.assignment.shape[1] * self.kept.fate.shape[1]
        if not settings.keep_information and preselects(settings.tasking, settings.method, n_pairs):
            tasking = assign_preselected(*known)
        else:
            pairs = pair_information(*known)
            tasking = assign(
                pairs,
                settings.method,
                rng=stream(TASKING, self.seed, number),
                max_evaluations=settings.max_evaluations,
                early_stop=settings.early_stop,
            )
        self.kept.assignment[number] = tasking.target
        self.kept.information[number] = tasking.information
        self.kept.evaluations[number] = tasking.history.size
        if settings.keep_information:
            self.kept.pairs[number] = pairs
        self._observe(start, stop, tasking.target)

    def _observe(self, start: int, stop: int, target: NDArray[np.int64]) -> None:
        """Measure, estimate and judge the steps start .. stop - 1."""
        n_targets = self.kept.fate.shape[1]
        first = start + 1  # index 0 of the scene is the start of the run, without a measurement
        motion, truth = self.motion, self.truth
        measurements, fate = measure(
            first,
            constant_schedule(target, n_targets, stop - start),
            self.scene,
            truth.surfaces,
            self.settings.sensor,
            motion.translation,
            motion.quaternion,
            motion.noise,
            truth.forces.mu,
        )
        estimates = self.estimator.advance(
            measurements, covariance="covariance" in self.settings.record
        )
        fate[estimates.used] = USED
        error = estimation_errors(first, motion, estimates)
        used = measurements.where(estimates.used)
        times = slice(start, stop + 1)
        least = self.bound.advance(
            motion.translation[:, times],
            motion.quaternion[:, times],
            motion.angular_velocity[:, times],
            used._replace(variance=np.broadcast_to(truth.noise**2, used.variance.shape).copy()),
        )
        observed = np.isin(np.arange(n_targets), rows_of(used)[0])
        self.evaluation.update(error, estimates.sigma, observed, least)
        self.kept.fate[start:stop] = highest(measurements, fate, NOT_TASKED).T
        recorded = self.settings.recorded
        some = slice(*np.searchsorted(recorded, [start, stop]))
        for history, values in (
            (self.kept.error, error),
            (self.kept.sigma, estimates.sigma),
            (self.kept.bound, least),
        ):
            history[some] = values[:, recorded[some] - start].swapaxes(0, 1)
        self.recorder.interval(start, target, motion, estimates, measurements, fate)


def run_closed_loop(
    scene: Scene,
    surfaces: TargetSurfaces,
    epoch_state: ArrayLike,
    target_ids: ArrayLike,
    seeds: Sequence[int],
    settings: LoopSettings | None = None,
    *,
    estimator: EstimatorFactory | str = "mukf",
    initial: InitialEstimate | None = None,
    truth: TruthModel | None = None,
    forces: tuple = EARTH_MOON,
    progress: Callable[[int, int], None] | None = None,
) -> LoopResult:
    """Run all seeds of one cell.

    Parameters
    ----------
    scene : Scene
        Observers and Sun on the grid ``settings.elapsed_s``.
    surfaces : TargetSurfaces
        Shapes, materials and inertia of the monitored targets, as the estimator believes them.
    epoch_state : array_like, shape (target, 6)
        Mean states of the monitored targets at the epoch, nondimensional, rotating frame.
    target_ids : array_like of int, shape (target,)
        Identity of each target, which with the seed selects its random numbers.
    seeds : sequence of int
        One realisation of truth and noise for each.
    settings : LoopSettings, optional
        The paper's, if omitted.
    estimator : EstimatorFactory or str
        A factory, or one of `cislunar.estimation.registry.ESTIMATORS` without process noise; the
        paper's filter if omitted.
    initial : InitialEstimate, optional
        Estimates at the epoch, instead of the paper's attitude and angular velocity for all
        targets, with `epoch_state` and ``settings.initial``.
    truth : TruthModel, optional
        What the targets truly are, how they move and how noisy the measurements; as believed,
        without torque, if omitted. Neither estimator nor tasking knows it.
    forces : NamedTuple
        Force model the estimator believes in, see `cislunar.dynamics.forces`.
    progress : callable, optional
        Called with (epochs done, epochs in all seeds).

    Returns
    -------
    LoopResult

    Raises
    ------
    ConfigurationError
        If scene, targets and settings do not fit together, or there are no seeds.
    """
    settings = LoopSettings() if settings is None else settings
    factory = estimator_named(estimator) if isinstance(estimator, str) else estimator
    ids = np.asarray(target_ids, dtype=np.int64)
    if initial is None:
        initial = initial_estimate(epoch_state, settings.initial.components())
    if truth is None:
        truth = TruthModel(surfaces, settings.sensor.noise, np.zeros(3), forces)
    _require_consistency(scene, surfaces, truth, initial, ids, seeds, settings)
    n_epochs, n_observers = settings.epochs.size, scene.observer_position.shape[0]
    kept = _Histories.empty(settings, len(seeds), n_observers, ids.size)
    recorder, ends = Recorder(settings, scene), []
    for s, seed in enumerate(seeds):
        own = _Histories(*(part[s] for part in kept))
        recorder.next_seed()
        run = _Run(
            scene, surfaces, settings, factory, initial, truth, ids, seed, forces, own, recorder
        )
        for number in range(n_epochs):
            run.epoch(number)
            if progress is not None:
                progress(s * n_epochs + number + 1, len(seeds) * n_epochs)
        ends.append((*run.evaluation.result(), run.estimator.failed, run.estimator.counters))
    *metrics, failed, counters = (np.array(column) for column in zip(*ends, strict=True))
    return LoopResult(
        kept.assignment,
        kept.information,
        kept.evaluations,
        settings.step_s * (settings.recorded + 1.0),
        kept.error,
        kept.sigma,
        kept.bound,
        kept.fate,
        TrackingMetrics(*metrics),
        failed,
        counters,
        kept.pairs if settings.keep_information else None,
        recorder.result(),
    )


def _require_consistency(
    scene: Scene,
    surfaces: TargetSurfaces,
    truth: TruthModel,
    initial: InitialEstimate,
    ids: NDArray[np.int64],
    seeds: Sequence[int],
    settings: LoopSettings,
) -> None:
    """Refuse scenes, targets and settings that do not fit together."""
    if len(seeds) == 0:
        raise ConfigurationError("seeds: at least one is needed")
    n_times = scene.sun_position.shape[0]
    if n_times != settings.n_steps + 1 or abs(scene.step_s - settings.step_s) > 1e-9:
        raise ConfigurationError(
            f"scene: {n_times} times every {scene.step_s} s do not fit duration_hours = "
            f"{settings.duration_hours} with step_s = {settings.step_s}, which needs "
            f"{settings.n_steps + 1} times"
        )
    counts = {
        "epoch_state": initial.translation.shape[0],
        "surfaces": surfaces.material.shape[0],
        "truth.surfaces": truth.surfaces.material.shape[0],
        "target_ids": ids.size,
    }
    if len(set(counts.values())) != 1 or ids.size == 0:
        raise ConfigurationError(f"targets: their numbers disagree or are zero: {counts}")
    if np.unique(ids).size != ids.size:
        raise ConfigurationError("target_ids: an identity occurs twice")
