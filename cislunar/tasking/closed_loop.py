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
- The Cramer-Rao bound is that of an estimator that knows the truth's model, but for what the one of
  the run estimates of the targets, without process noise, whatever that one supposes.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.dynamics.bounds import require_nondimensional
from cislunar.dynamics.cr3bp import CR3BP, EARTH_MOON
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import UPDATES, EstimatorFactory, InitialEstimate
from cislunar.estimation.registry import estimator_named
from cislunar.evaluation.metrics import TrackingMetrics
from cislunar.observation.body_spread import BodySpread
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.observation.sensor import Sensor, sensors_of
from cislunar.tasking.fates import counted, report_fates, report_unknowns
from cislunar.tasking.realization import USED, Realization, World, begun, interval
from cislunar.tasking.recording import Piece, Records, gathered, joined
from cislunar.tasking.settings import LoopSettings
from cislunar.tasking.simulation import TruthModel, initial_estimate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LoopResult:
    """What became of all seeds of a cell. Targets are numbered within the monitored set.

    Histories are None where ``settings.histories`` leaves them out.

    Attributes
    ----------
    assignment : ndarray of int16, shape (seed, epoch, observer)
        Target of each observer, or -1; shape (seed, epoch, slot, observer) with slots.
    information : ndarray, shape (seed, epoch)
        Information of the tasking, nats.
    evaluations : ndarray of int, shape (seed, epoch)
        Taskings tried; with slots, taskings of one slot.
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
    records : Records
        What ``settings.record`` asked for.
    pair_information : ndarray, shape (seed, epoch, observer, target), or None
        Information of all pairs, if it was to be kept.
    brightness_offset, brightness_offset_sigma : ndarray of float32 or None
        Each target's magnitude less the sphere's after the looks of each interval, and its standard
        deviation, shape (seed, epoch, target), if detection is learned; see
        `cislunar.tasking.planning.detection`.
    planning_gap : ndarray, shape (seed, epoch), or None
        By how much, relative to its worth, the choice for a slot may fall short of the best one,
        if several observers may look at a target, or with `bound_steps` that for all slots.
    departure_error, departure_sigma : ndarray of float32, shape (seed, epoch, target, n), or None
        What is estimated of the targets besides their motion after each interval: truth less
        estimate, and standard deviation, as of `cislunar.observation.body_spread.BodySpread.named`.
    searches : ndarray of int32, shape (seed, epoch, target), or None
        Searches of the fits by then, if something is.
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
    records: Records
    pair_information: Array | None
    brightness_offset: NDArray[np.float32] | None
    brightness_offset_sigma: NDArray[np.float32] | None
    planning_gap: Array | None
    departure_error: NDArray[np.float32] | None
    departure_sigma: NDArray[np.float32] | None
    searches: NDArray[np.int32] | None

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Whether a measurement was used, shape (seed, step, target)."""
        return self.fate == USED

    @property
    def final_attitude_error_deg(self) -> Array:
        """Root mean square attitude error over the final hours, shape (seed, target)."""
        return self.metrics.final_attitude_error_deg


_KEPT = (
    *("assignment", "information", "evaluations", "error", "sigma", "bound", "fate"),
    *("pair_information", "brightness_offset", "brightness_offset_sigma", "planning_gap"),
    *("departure_error", "departure_sigma", "searches"),
)
"""Attributes that are gathered from pieces."""


class State(NamedTuple):
    """How far a run has come: what a checkpoint has to hold.

    `done` counts the tasking epochs of all seeds, `looks` the rows kept of looks; `ends` has the
    `Realization.end` of every seed that is done, `current` the one at work.
    """

    done: int = 0
    looks: int = 0
    ends: tuple = ()
    current: Realization | None = None


class ClosedLoop:
    """All seeds of one cell, piece by piece.

    Between two pieces the loop can be left and taken up again, by another process too: `state` is
    all that it carries. It changes as the loop goes on, so that one to be kept has to be copied
    (pickled).

    Parameters
    ----------
    scene, surfaces, epoch_state, target_ids, seeds, settings, estimator, initial, truth, forces
        As of `run_closed_loop`.

    Attributes
    ----------
    world : World
        What does not change.
    seeds, numbers : list of int
        Seeds of the realizations, and the index of each in the pieces.
    state : State
        How far it has come.

    Raises
    ------
    ConfigurationError
        As `run_closed_loop` does.
    """

    def __init__(
        self,
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
    ) -> None:
        settings = LoopSettings() if settings is None else settings
        factory = estimator_named(estimator) if isinstance(estimator, str) else estimator
        ids = np.asarray(target_ids, dtype=np.int64)
        if isinstance(forces, CR3BP):
            require_nondimensional("epoch_state", epoch_state)
        if initial is None:
            initial = initial_estimate(epoch_state, settings.initial.components())
        if truth is None:
            each = sensors_of(settings.sensor, scene.observer_position.shape[0])
            plain = isinstance(settings.sensor, Sensor) and settings.sensor.plain
            own = None if plain else each
            truth = TruthModel(surfaces, each[0].noise, np.zeros(3), forces, sensor=own)
        _require_consistency(scene, surfaces, truth, initial, ids, seeds, settings)
        self.world = World(scene, surfaces, settings, factory, initial, truth, ids, forces)
        self.seeds = [int(seed) for seed in seeds]
        self.numbers = list(range(len(self.seeds)))
        self.state = State()

    @property
    def unknowns(self) -> dict[str, float]:
        """What the estimator does not know of the targets besides motion: prior deviations."""
        n_facets = int(np.diff(self.world.surfaces.first).max(initial=0))
        return getattr(self.world.factory, "unknowns", BodySpread()).named(n_facets)

    @property
    def lengths(self) -> dict[str, int]:
        """Length of the run along what the values of a `Piece` are."""
        settings = self.world.settings
        counts = settings.epochs.size, settings.n_steps, settings.recorded.size
        return dict(zip(("epoch", "step", "time"), counts, strict=True))

    def pieces(self, progress: Callable[[int, int], None] | None = None) -> Iterator[Piece]:
        """What is kept from where the loop stands on, a day or the rest of a seed at a time.

        `progress` is called with (epochs done, epochs in all seeds).
        """
        n_epochs = self.lengths["epoch"]
        a_day = max(1, round(24.0 * 60.0 / self.world.settings.interval_minutes))
        while self.state.done < len(self.seeds) * n_epochs:
            number, epoch = divmod(self.state.done, n_epochs)
            current = self.state.current
            if current is None:
                current = begun(self.world, self.numbers[number], self.seeds[number])
            parts = []
            for each in range(epoch, min(epoch + a_day, n_epochs)):
                parts.append(interval(self.world, current, each))
                if progress is not None:
                    progress(number * n_epochs + each + 1, len(self.seeds) * n_epochs)
            piece = joined(parts)
            looks = self.state.looks + (0 if piece.looks is None else piece.looks.step.size)
            done, ends = self.state.done + len(parts), self.state.ends
            if done % n_epochs:
                self.state = State(done, looks, ends, current)
            else:
                self.state = State(done, looks, (*ends, current.end))
            yield piece

    def apart(self) -> list[ClosedLoop]:
        """A loop for each realization, from its beginning, which keeps its number."""
        loops = [copy.copy(self) for _ in self.seeds]
        for k, loop in enumerate(loops):
            loop.seeds, loop.numbers = [self.seeds[k]], [self.numbers[k]]
            loop.state = State()
        return loops

    def gather(self, loops: Sequence[ClosedLoop]) -> None:
        """Stand where the loops of `apart`, all of them done, have come to."""
        states = [loop.state for loop in loops]
        ends = tuple(end for state in states for end in state.ends)
        self.state = State(
            sum(state.done for state in states), sum(state.looks for state in states), ends
        )

    def ends(self) -> tuple[TrackingMetrics, NDArray[np.uint8], NDArray[np.int64]]:
        """Metrics, why estimates failed and counters of a run that is done, by seed first."""
        metrics, failed, counters = zip(*self.state.ends, strict=True)
        each = (np.array(column) for column in zip(*metrics, strict=True))
        return TrackingMetrics(*each), np.array(failed), np.array(counters)


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

    What became of the looks is logged to ``cislunar``, with a warning where more than 30 % of them
    found their target too faint or excluded.

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
        If scene, targets and settings do not fit together, there are no seeds, or a state can only
        be in km.
    """
    loop = ClosedLoop(
        scene,
        surfaces,
        epoch_state,
        target_ids,
        seeds,
        settings,
        estimator=estimator,
        initial=initial,
        truth=truth,
        forces=forces,
    )
    kept, looks = gathered(loop.pieces(progress), len(loop.seeds), loop.lengths)
    metrics, failed, counters = loop.ends()
    own = {name: kept.pop(name, None) for name in _KEPT}
    report_fates(counted(own["fate"]), loop.world)
    report_unknowns(own["departure_sigma"], loop.unknowns, counters[..., UPDATES])
    settings = loop.world.settings
    return LoopResult(
        elapsed_s=settings.step_s * (settings.recorded + 1.0),
        metrics=metrics,
        failed=failed,
        counters=counters,
        records=Records(**kept, looks=looks),
        **own,
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
        "surfaces": surfaces.inertia.shape[0],
        "truth.surfaces": truth.surfaces.inertia.shape[0],
        "target_ids": ids.size,
    }
    if len(set(counts.values())) != 1 or ids.size == 0:
        raise ConfigurationError(f"targets: their numbers disagree or are zero: {counts}")
    if np.unique(ids).size != ids.size:
        raise ConfigurationError("target_ids: an identity occurs twice")
