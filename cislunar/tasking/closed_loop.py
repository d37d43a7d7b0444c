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

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import Estimator, EstimatorFactory, InitialEstimate
from cislunar.estimation.registry import estimator_named
from cislunar.evaluation.cramer_rao import cramer_rao_bound
from cislunar.evaluation.metrics import TrackingMetrics, evaluate
from cislunar.observation.measurement import DETECTED, measure
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.tasking.assignment import IDLE, assign
from cislunar.tasking.information import pair_information
from cislunar.tasking.settings import LoopSettings
from cislunar.tasking.simulation import (
    ESTIMATOR,
    TASKING,
    Truth,
    TruthModel,
    draw_truth,
    estimation_errors,
    initial_estimate,
    stream,
)

Array = NDArray[np.float64]

USED = DETECTED + 1
"""Fate of a measurement that was used, beyond those of `cislunar.observation.measurement`."""

JUDGED_TOGETHER = 128
"""Targets whose whole run is judged at a time, which keeps the memory of doing so small."""

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
        Index into `FATE_NAMES`, at every step.
    metrics : TrackingMetrics
        Arrays with a leading axis over seeds.
    failed : ndarray of uint8, shape (seed, target)
        0, or why an estimate came to an end.
    counters : ndarray of int, shape (seed, target, 4)
        Updates, measurements out of the field of view, dark sigma points, failed Cholesky
        factorisations.
    pair_information : ndarray, shape (seed, epoch, observer, target), or None
        Information of all pairs, if it was to be kept.
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

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Whether a measurement was used, shape (seed, step, target)."""
        return self.fate == USED

    @property
    def final_attitude_error_deg(self) -> Array:
        """Root mean square attitude error over the final hours, shape (seed, target)."""
        return self.metrics.final_attitude_error_deg


def observers_of(target: NDArray[np.int64], n_targets: int) -> NDArray[np.int64]:
    """Observer of each target, or -1, from the target of each observer.

    Parameters
    ----------
    target : ndarray of int, shape (observer,)
        Target of each observer, or `IDLE`.
    n_targets : int
        Number of targets.

    Returns
    -------
    ndarray of int, shape (target,)
    """
    observer_of = np.full(n_targets, -1, dtype=np.int64)
    busy = np.flatnonzero(target != IDLE)
    observer_of[target[busy]] = busy
    return observer_of


class _Run:
    """One seed of a cell: estimator, truth, and the records of its epochs."""

    def __init__(
        self,
        scene: Scene,
        surfaces: TargetSurfaces,
        settings: LoopSettings,
        estimator: Estimator,
        truth: Truth,
        model: TruthModel,
        seed: int,
        forces: tuple,
    ) -> None:
        self.scene, self.surfaces, self.settings = scene, surfaces, settings
        self.estimator, self.truth, self.seed = estimator, truth, seed
        self.model, self.forces = model, forces
        n_targets, n_steps = truth.translation.shape[0], settings.n_steps
        n_observers, n_epochs = scene.observer_position.shape[0], settings.epochs.size
        self.error = np.empty((n_targets, n_steps, 12))
        self.sigma = np.empty((n_targets, n_steps, 12))
        self.fate = np.empty((n_targets, n_steps), dtype=np.uint8)
        self.used_by = np.empty((n_targets, n_steps), dtype=np.int64)
        self.assignment = np.empty((n_epochs, n_observers), dtype=np.int16)
        self.information = np.empty(n_epochs)
        self.evaluations = np.empty(n_epochs, dtype=np.int64)
        self.pairs: list[Array] = []

    def epoch(self, number: int) -> None:
        """Assign the observers and work through the interval that follows."""
        settings, start = self.settings, int(self.settings.epochs[number])
        stop = min(start + settings.steps_per_interval, settings.n_steps)
        pairs = pair_information(
            self.estimator.predict(),
            self.scene,
            self.surfaces,
            settings.sensor,
            settings.tasking,
            self.forces,
        )
        tasking = assign(
            pairs,
            settings.method,
            rng=stream(TASKING, self.seed, number),
            max_evaluations=settings.max_evaluations,
            early_stop=settings.early_stop,
        )
        self.assignment[number] = tasking.target
        self.information[number] = tasking.information
        self.evaluations[number] = tasking.history.size
        if settings.keep_information:
            self.pairs.append(pairs)
        observer_of = observers_of(tasking.target, self.fate.shape[0])
        first = start + 1  # index 0 of the scene is the start of the run, without a measurement
        measurements, fate = measure(
            first,
            stop - start,
            self.scene,
            self.model.surfaces,
            settings.sensor,
            observer_of,
            self.truth.translation,
            self.truth.quaternion,
            self.truth.noise,
            self.model.forces.mu,
        )
        estimates = self.estimator.advance(measurements, observer_of)
        fate[estimates.used] = USED
        window = slice(start, stop)
        self.fate[:, window] = fate
        self.used_by[:, window] = np.where(fate == USED, observer_of[:, None], -1)
        self.error[:, window] = estimation_errors(first, self.truth, estimates)
        self.sigma[:, window] = estimates.sigma

    def judge(self, initial_sigma: Array, bound: Array) -> TrackingMetrics:
        """Metrics of the run; the Cramer-Rao bound at the recorded steps goes into `bound`."""
        parts = []
        for start in range(0, self.fate.shape[0], JUDGED_TOGETHER):
            some = slice(start, start + JUDGED_TOGETHER)
            least = cramer_rao_bound(
                self.scene,
                self.model.surfaces.of(some),
                self.model.noise,
                self.truth.translation[some],
                self.truth.quaternion[some],
                self.truth.angular_velocity[some],
                self.used_by[some],
                initial_sigma,
                forces=self.model.forces,
            )
            used = self.fate[some] == USED
            parts.append(
                evaluate(self.error[some], self.sigma[some], used, self.settings.step_s, least)
            )
            bound[:, some] = least[:, self.settings.recorded].swapaxes(0, 1)
        return TrackingMetrics(*(np.concatenate(column) for column in zip(*parts, strict=True)))


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
    recorded = settings.recorded
    n_epochs, n_targets = settings.epochs.size, ids.size
    shape = (len(seeds), recorded.size, n_targets, 12)
    error, sigma, bound = (np.empty(shape, np.float32) for _ in range(3))
    fate = np.empty((len(seeds), settings.n_steps, n_targets), np.uint8)
    runs, metrics = [], []
    for s, seed in enumerate(seeds):
        motion = draw_truth(
            initial,
            scene,
            truth.noise,
            seed,
            ids,
            forces=truth.forces,
            inertia=truth.surfaces.inertia,
            angular_acceleration=truth.angular_acceleration,
        )
        own = factory(scene, surfaces, settings.sensor, initial, stream(ESTIMATOR, seed), forces)
        run = _Run(scene, surfaces, settings, own, motion, truth, seed, forces)
        for number in range(n_epochs):
            run.epoch(number)
            if progress is not None:
                progress(s * n_epochs + number + 1, len(seeds) * n_epochs)
        metrics.append(run.judge(initial.sigma, bound[s]))
        error[s] = run.error[:, recorded].swapaxes(0, 1)
        sigma[s] = run.sigma[:, recorded].swapaxes(0, 1)
        fate[s] = run.fate.T
        # Only the small records of a run are kept, so memory does not grow with the seeds.
        runs.append(
            (run.assignment, run.information, run.evaluations, own.failed, own.counters, run.pairs)
        )
    assignment, information, evaluations, failed, counters, pairs = zip(*runs, strict=True)
    return LoopResult(
        np.array(assignment),
        np.array(information),
        np.array(evaluations),
        settings.step_s * (recorded + 1.0),
        error,
        sigma,
        bound,
        fate,
        TrackingMetrics(*(np.array(column) for column in zip(*metrics, strict=True))),
        np.array(failed),
        np.array(counters),
        np.array(pairs) if settings.keep_information else None,
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
