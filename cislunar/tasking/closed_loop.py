"""Tasking and estimation in a closed loop (Paul & Fan, sections 4 and 5.2).

At every tasking epoch the estimates are propagated to the next measurement time, the information of
all pairs is computed and observers are assigned. Until the next epoch the assigned targets are
measured at every step. One call runs many realizations of one cell.

Assumptions and limitations
---------------------------
- An observer whose best pair has no information is idle until the next epoch.
- The paper evaluates information "at" the epoch. Here it is that of the first measurement after it,
  from the covariance predicted to that time.
- The truth has the reflection model of the filter in form. Shapes, materials, inertia, noise,
  torque and force model may differ (`cislunar.tasking.truth.TruthModel`).
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.dynamics import CR3BP, EARTH_MOON, require_nondimensional
from cislunar.errors import ConfigurationError
from cislunar.estimation import UPDATES, EstimatorFactory, InitialEstimate, estimator_named
from cislunar.evaluation import CharacterizedTargets, TrackingMetrics
from cislunar.observation import Scene, Sensor, TargetSurfaces, sensors_of
from cislunar.runtime import Array, array_of, count_of, logger, require_kind, shortened_interval
from cislunar.tasking.detection_outcomes import (
    count_outcomes,
    report_estimated_parameters,
    report_outcomes,
)
from cislunar.tasking.histories import (
    HISTORIES,
    ManeuverLog,
    ObservationLog,
    RecoveredLog,
    histories_text,
)
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.realization import USED, advance_interval, start_realization
from cislunar.tasking.recording import Piece, collect, concatenate
from cislunar.tasking.settings import LoopSettings
from cislunar.tasking.state import Realization, SimulationInputs
from cislunar.tasking.truth import TruthModel


@dataclass(frozen=True)
class LoopResult:
    """Result of all realizations. Targets have the order of the arguments of `run_closed_loop`.

    Each history of `cislunar.tasking.histories.HISTORIES` is an attribute as well, an array or None
    where the settings leave it out. The components of the state are attitude error (GRP), angular
    velocity (rad/s), position and velocity (nondimensional, propagation frame). Values after the
    end of a failed estimate are NaN.

    Attributes
    ----------
    elapsed_s : ndarray, shape (time,)
        Recorded times since the start of the run, s.
    histories : dict of str to ndarray
        Histories that were kept, by name.
    metrics : TrackingMetrics
        Arrays with a leading axis over seeds.
    failed : ndarray of uint8, shape (seed, target)
        0, or the reason for which an estimate ended.
    counters : ndarray of int, shape (seed, target, 4)
        Updates, measurements outside the field of view, undetectable sigma points, failed Cholesky
        factorizations.
    observations : ObservationLog or None
        All observations, if ``settings.record`` has "measurements".
    characterized : CharacterizedTargets or None
        What the light curves tell of the targets at the end of the run, arrays with a leading axis
        over seeds; None unless the estimator chooses between models of the bodies.
    maneuvers : ManeuverLog or None
        All true maneuvers, if ``settings.record`` has "truth".
    recovered_maneuvers : RecoveredLog or None
        All estimated maneuvers, if the estimator estimates them.
    """

    elapsed_s: Array
    histories: dict[str, NDArray]
    metrics: TrackingMetrics
    failed: NDArray[np.uint8]
    counters: NDArray[np.int64]
    observations: ObservationLog | None
    characterized: CharacterizedTargets | None = None
    maneuvers: ManeuverLog | None = None
    recovered_maneuvers: RecoveredLog | None = None

    def __getattr__(self, name: str) -> NDArray | None:
        if name in HISTORIES:
            return self.histories.get(name)
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *HISTORIES})

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Whether a measurement was used, shape (seed, step, target)."""
        return self.outcome == USED

    @property
    def final_attitude_error_deg(self) -> Array:
        """Root mean square attitude error over the final hours, shape (seed, target)."""
        return self.metrics.final_attitude_error_deg


if LoopResult.__doc__:  # None under python -OO
    LoopResult.__doc__ = f"{LoopResult.__doc__.rstrip()}\n{histories_text()}\n    "


class State(NamedTuple):
    """Progress of a run, which a checkpoint stores. `done` counts the tasking epochs of all
    realizations, `observations` the logged observations; `ends` has the `End` of every completed
    realization, `current` the one in progress."""

    done: int = 0
    observations: int = 0
    ends: tuple = ()
    current: Realization | None = None


class ClosedLoop:
    """All realizations of one cell, piece by piece.

    Between two pieces the loop can be interrupted and resumed, by another process too: `state` has
    all that it needs. The loop changes the state in place; to keep a state, copy (pickle) it.

    Parameters
    ----------
    scene, surfaces, epoch_state, target_ids, seeds, settings, estimator, initial, truth, forces
        See `run_closed_loop`.

    Attributes
    ----------
    inputs : SimulationInputs
        Constant inputs.
    seeds, numbers : list of int
        Seeds of the realizations, and the index of each in the pieces.
    state : State
        Progress of the run.

    Raises
    ------
    ConfigurationError
        If an argument is impossible; see `run_closed_loop`.
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
        for name, given, kind, remedy in (
            ("scene", scene, Scene, "give the Scene that make_scene returns"),
            ("surfaces", surfaces, TargetSurfaces, "give what target_surfaces returns"),
            ("settings", settings, LoopSettings, "give LoopSettings, or omit them"),
            ("initial", initial, InitialEstimate | None, "give an InitialEstimate, or omit it"),
            ("truth", truth, TruthModel | None, "give a TruthModel, or omit it"),
            ("forces", forces, tuple, "give a force model of cislunar.dynamics"),
            ("estimator", estimator, (str, Callable), "give a name or an EstimatorFactory"),
            ("seeds", seeds, Iterable, "give a sequence of whole numbers, such as [0, 1]"),
        ):
            require_kind(name, given, kind, remedy)
        array_of("scene.observer_position", scene.observer_position, ("observer", "time", 3))
        seeds = [count_of("seeds: each", seed, least=0) for seed in seeds]
        factory = estimator_named(estimator) if isinstance(estimator, str) else estimator
        ids = _identities(target_ids)
        states = array_of("epoch_state", epoch_state, ("target", 6))
        if initial is None:
            initial = initial_estimate(states, settings.initial.components())
        initial = initial.checked()
        if isinstance(forces, CR3BP):
            require_nondimensional("epoch_state", states)
            require_nondimensional("initial translation", initial.translation)
        if truth is None:
            each = sensors_of(settings.sensor, scene.observer_position.shape[0])
            plain = isinstance(settings.sensor, Sensor) and settings.sensor.plain
            own = None if plain else each
            truth = TruthModel(surfaces, each[0].noise, np.zeros(3), forces, sensor=own)
        if len(seeds) == 0:
            raise ConfigurationError("seeds: none is given; give at least one")
        self.inputs = SimulationInputs(
            scene, surfaces, settings, factory, initial, truth, ids, forces
        ).checked()
        self.seeds = seeds
        self.numbers = list(range(len(self.seeds)))
        self.state = State()

    @property
    def estimated_parameters(self) -> dict[str, float]:
        """Prior standard deviations of the estimated body parameters, by name."""
        n_facets = int(np.diff(self.inputs.surfaces.first).max(initial=0))
        return self.inputs.abilities.estimated_parameters.named(n_facets)

    @property
    def lengths(self) -> dict[str, int]:
        """Length of the run along the time axes of the histories."""
        settings = self.inputs.settings
        counts = settings.epochs.size, settings.n_steps, settings.recorded.size
        return dict(zip(("epoch", "step", "time"), counts, strict=True))

    def pieces(self, progress: Callable[[int, int], None] | None = None) -> Iterator[Piece]:
        """Run on from the present state, a day or the rest of a realization at a time. `progress`
        is called with (epochs done, epochs in all realizations)."""
        n_epochs = self.lengths["epoch"]
        a_day = max(1, round(24.0 * 60.0 / self.inputs.settings.interval_minutes))
        while self.state.done < len(self.seeds) * n_epochs:
            number, epoch = divmod(self.state.done, n_epochs)
            current = self.state.current
            if current is None:
                current = start_realization(self.inputs, self.numbers[number], self.seeds[number])
            intervals = []
            for each in range(epoch, min(epoch + a_day, n_epochs)):
                intervals.append(advance_interval(self.inputs, current, each))
                if progress is not None:
                    progress(number * n_epochs + each + 1, len(self.seeds) * n_epochs)
            piece = concatenate(intervals)
            observations = self.state.observations + (
                0 if piece.observations is None else piece.observations.step.size
            )
            done, ends = self.state.done + len(intervals), self.state.ends
            if done % n_epochs:
                self.state = State(done, observations, ends, current)
            else:
                self.state = State(done, observations, (*ends, current.end(self.inputs)))
            yield piece

    def split_by_realization(self) -> list[ClosedLoop]:
        """A loop for each realization from its start, which keeps its number."""
        loops = [copy.copy(self) for _ in self.seeds]
        for k, loop in enumerate(loops):
            loop.seeds, loop.numbers = [self.seeds[k]], [self.numbers[k]]
            loop.state = State()
        return loops

    def collect_states(self, loops: Sequence[ClosedLoop]) -> None:
        """Adopt the states of the completed loops of `split_by_realization`."""
        states = [loop.state for loop in loops]
        ends = tuple(end for state in states for end in state.ends)
        self.state = State(
            sum(state.done for state in states), sum(state.observations for state in states), ends
        )

    def ends(self) -> tuple[TrackingMetrics, NDArray[np.uint8], NDArray[np.int64]]:
        """Metrics, reasons of failed estimates and counters of a completed run, by seed first."""
        metrics, failed, counters, *_ = zip(*self.state.ends, strict=True)
        return _by_seed(metrics), np.array(failed), np.array(counters)

    def characterized(self) -> CharacterizedTargets | None:
        """What the light curves tell of the targets at the end of a completed run, by seed first;
        None unless the estimator chooses between models of the bodies."""
        found = [end.characterized for end in self.state.ends]
        return _by_seed(found) if self.inputs.abilities.chooses_models else None

    def maneuvers(self) -> ManeuverLog | None:
        """True maneuvers of a completed run, if it records the truth."""
        if "truth" not in self.inputs.settings.record:
            return None
        logs = [end.maneuvers for end in self.state.ends]
        return ManeuverLog(*map(np.concatenate, zip(*logs, strict=True)))

    def recovered(self) -> RecoveredLog | None:
        """Estimated maneuvers of a completed run, if they are estimated."""
        if not self.inputs.abilities.maneuvers_per_day:
            return None
        logs = [end.recovered for end in self.state.ends]
        number = np.repeat(self.numbers, [each.target.size for each in logs])
        return RecoveredLog(number, *map(np.concatenate, zip(*logs, strict=True)))


def _by_seed(found: Sequence[Any]) -> Any:
    """Named tuples of arrays as one, with a leading axis."""
    return type(found[0])(*(np.array(column) for column in zip(*found, strict=True)))


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
    """Run tasking and tracking in a closed loop, in one or several realizations.

    The shares of the detection outcomes are logged to ``cislunar``, with a warning if more than 30
    % of the observations found their target too faint or excluded.

    Parameters
    ----------
    scene : Scene
        Observers and Sun on the grid ``settings.elapsed_s``.
    surfaces : TargetSurfaces
        Assumed shapes, materials and inertia of the targets.
    epoch_state : array_like, shape (target, 6)
        Mean states at the start of the run, nondimensional, propagation frame.
    target_ids : array_like of int, shape (target,)
        Identity of each target, which with the seed selects its random numbers.
    seeds : sequence of int
        One realization of truth and noise for each.
    settings : LoopSettings, optional
        The paper's, if omitted.
    estimator : EstimatorFactory or str
        A factory, or one of `cislunar.estimation.registry.ESTIMATORS` without process noise.
    initial : InitialEstimate, optional
        Estimates at the start, instead of the paper's attitude and angular velocity for all
        targets, with `epoch_state` and ``settings.initial``.
    truth : TruthModel, optional
        True bodies, motion and noise, which estimator and scheduler do not know. If omitted they
        equal the assumed ones, without torque.
    forces : NamedTuple
        Assumed force model, see `cislunar.dynamics.forces`.
    progress : callable, optional
        Called with (epochs done, epochs in all realizations).

    Returns
    -------
    LoopResult

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, the estimator is unknown, scene, targets and settings
        disagree, there are no seeds, a position or state is not finite, or a state is evidently in
        km. The message names the first such target or observer.
    """
    require_kind("progress", progress, Callable | None, "give a function, or omit it")
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
    settings = loop.inputs.settings
    if shortened := shortened_interval(settings.duration_hours, settings.interval_minutes):
        logger.warning("warning: %s", shortened)
    kept, observations = collect(loop.pieces(progress), len(loop.seeds), loop.lengths)
    metrics, failed, counters = loop.ends()
    report_outcomes(count_outcomes(kept["outcome"]), loop.inputs)
    report_estimated_parameters(
        kept.get("parameter_sigma"), loop.estimated_parameters, counters[..., UPDATES]
    )
    elapsed_s = settings.step_s * (settings.recorded + 1.0)
    results = elapsed_s, kept, metrics, failed, counters, observations
    return LoopResult(*results, loop.characterized(), loop.maneuvers(), loop.recovered())


def _identities(target_ids: ArrayLike) -> NDArray[np.int64]:
    """Identities of the targets, whole numbers from 0 on."""
    given = array_of("target_ids", target_ids, ("target",))
    if np.any((given < 0.0) | (given != np.round(given))):
        raise ConfigurationError(f"target_ids = {given.tolist()} must be whole numbers from 0 on")
    return np.asarray(target_ids, dtype=np.int64)
