"""Inputs and state of a realization."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.association.tracks import TrackStatus
from cislunar.errors import ConfigurationError, placed
from cislunar.estimation.estimator import (
    Abilities,
    Estimator,
    EstimatorFactory,
    InitialEstimate,
    abilities_of,
)
from cislunar.estimation.light_curves.row_blocks import TIME
from cislunar.estimation.maneuvers import SEARCHING, RecoveredManeuvers
from cislunar.evaluation import CharacterizedTargets, CramerRaoBound, characterized_targets
from cislunar.evaluation.metrics import Evaluation, TrackingMetrics
from cislunar.observation import Scene, TargetSurfaces
from cislunar.runtime import Array, array_of
from cislunar.tasking.communication.reception import Reception
from cislunar.tasking.histories import ManeuverLog, Outputs
from cislunar.tasking.initial_conditions import CHARACTERIZATION, stream
from cislunar.tasking.observer_truth import ObserverTruth
from cislunar.tasking.planning.detection import LearnedDetection
from cislunar.tasking.settings import LoopSettings
from cislunar.tasking.truth import TrueMotion, TruthModel


def _checked_truth(truth: TruthModel) -> TruthModel:
    """The same truth with arrays. ConfigurationError if noise, torque or errors are no finite
    numbers of the right shape, or the noise is negative; the message names the field."""
    noise = array_of("truth.noise", truth.noise, (3,))
    if noise.min() < 0.0:
        raise ConfigurationError(f"truth.noise = {noise.tolist()}: give no negative deviations")
    n_targets = truth.surfaces.inertia.shape[0]
    forced = array_of("truth.angular_acceleration", truth.angular_acceleration)
    if forced.shape not in ((3,), (n_targets, 3)):
        raise ConfigurationError(
            f"truth.angular_acceleration has shape {forced.shape}; give (3,) or ({n_targets}, 3)"
        )
    errors, start = truth.observer_errors, truth.start
    if errors is not None:
        errors = array_of("truth.observer_errors", errors, ("observer", 6))
    if start is not None:
        with placed("truth.start"):
            start = start.checked()
    return truth._replace(
        noise=noise, angular_acceleration=forced, observer_errors=errors, start=start
    )


class SimulationInputs(NamedTuple):
    """Common inputs of all realizations of a cell; see `cislunar.tasking.closed_loop`."""

    scene: Scene
    surfaces: TargetSurfaces
    settings: LoopSettings
    factory: EstimatorFactory
    initial: InitialEstimate
    truth: TruthModel
    ids: NDArray[np.int64]
    forces: tuple

    def checked(self) -> SimulationInputs:
        """The same. ConfigurationError if scene, targets and settings disagree, or the truth is
        impossible."""
        scene, settings, initial, ids = self.scene, self.settings, self.initial, self.ids
        n_times = scene.sun_position.shape[0]
        if n_times != settings.n_steps + 1 or abs(scene.step_s - settings.step_s) > 1e-9:
            raise ConfigurationError(
                f"scene: {n_times} times every {scene.step_s} s do not fit duration_hours = "
                f"{settings.duration_hours} with step_s = {settings.step_s}, which needs "
                f"{settings.n_steps + 1} times"
            )
        counts = {
            "epoch_state": initial.translation.shape[0],
            "surfaces": self.surfaces.inertia.shape[0],
            "truth.surfaces": self.truth.surfaces.inertia.shape[0],
            "truth.start": len((self.truth.start or initial).translation),
            "target_ids": ids.size,
        }
        if len(set(counts.values())) != 1 or ids.size == 0:
            raise ConfigurationError(f"targets: their numbers disagree or are zero: {counts}")
        values, times = np.unique(ids, return_counts=True)
        if values.size != ids.size:
            raise ConfigurationError(
                f"target_ids: {values[times > 1][0]} occurs twice; give each target its own"
            )
        return self._replace(truth=_checked_truth(self.truth))

    @property
    def records_maneuvers(self) -> bool:
        """Whether the true maneuvers are recorded, if there are any."""
        several = self.truth.maneuvers.target.size > 0 or len(self.truth.drawn_maneuvers) > 0
        return several and "truth" in self.settings.record

    @property
    def abilities(self) -> Abilities:
        """What the estimators do besides estimating motion."""
        return abilities_of(self.factory)

    @property
    def divisible(self) -> bool:
        """Whether the steps of an interval may be simulated in parts, since nothing refers to it as
        a whole. The class of the estimator must have `divisible` = True as well: several calls of
        its `advance` give the estimates of one."""
        settings = self.settings
        return not (
            settings.communication.late
            or settings.association.in_field
            or settings.eclipse
            or settings.tasking.detection is not None
            or "visibility" in settings.record
        )

    @property
    def outputs(self) -> Outputs:
        """What the estimators return besides the motion."""
        own = self.abilities
        return Outputs(bool(own.estimated_parameters), own.reports_status, own.tests_maneuvers)

    def true_motion(self, truth: TruthModel, seed: int) -> TrueMotion:
        """The true motion of a realization from the epoch on, given its sampled truth."""
        settings, scene = self.settings, self.scene
        least = SEARCHING if self.abilities.searches_field else 1
        return TrueMotion(
            self.initial if truth.start is None else truth.start,
            scene,
            truth.noise if truth.sensor is None else np.ones(3),
            seed,
            self.ids,
            forces=truth.forces,
            inertia=truth.surfaces.inertia,
            angular_acceleration=truth.angular_acceleration,
            torque=truth.torque,
            surfaces=truth.surfaces,
            observations=(
                max(settings.schedule.observers_per_target, least)
                if not settings.association.in_field
                else scene.observer_position.shape[0]
            ),
            maneuvers=truth.all_maneuvers(seed, self.ids, settings.duration_hours),
        )


class End(NamedTuple):
    """What remains of a completed realization: metrics, reasons of failed estimates, counters, the
    characterization of the targets, None if no models of bodies are chosen, the true maneuvers, and
    the estimated ones, None unless they are estimated."""

    metrics: TrackingMetrics
    failed: NDArray[np.uint8]
    counters: NDArray[np.int64]
    characterized: CharacterizedTargets | None
    maneuvers: ManeuverLog
    recovered: RecoveredManeuvers | None


class Realization(NamedTuple):
    """State of one realization; its objects change in place. `variance` is that of the true noise
    (3,). If the truth has sensors of its own, it is the excess of each observer's true variance
    (observer, 3) over the variance that measurements state. `observers` are their true errors, if
    there are any."""

    number: int
    seed: int
    truth: TruthModel
    variance: Array
    motion: TrueMotion
    estimator: Estimator
    bound: CramerRaoBound
    evaluation: Evaluation
    detection: LearnedDetection | None
    pointing: NDArray[np.int64]
    reception: Reception | None
    tracks: TrackStatus | None
    observers: ObserverTruth | None

    def scene(self, inputs: SimulationInputs) -> Scene:
        """The scene with the true positions of the observers."""
        return inputs.scene if self.observers is None else self.observers.scene(inputs.scene)

    def end(self, inputs: SimulationInputs) -> End:
        """Results of the completed realization."""
        found = self._characterized(inputs) if inputs.abilities.chooses_models else None
        result, own = self.evaluation.result(), self.estimator
        recovered = own.recovered_maneuvers() if inputs.abilities.maneuvers_per_day else None
        return End(result, own.failed, own.counters, found, self._maneuvers(), recovered)

    def _characterized(self, inputs: SimulationInputs) -> CharacterizedTargets:
        """What the light curves tell of the targets. The true motion is computed once more, since
        only its end is kept."""
        own = self.estimator
        found = own.characterizations([stream(CHARACTERIZATION, self.seed, j) for j in inputs.ids])
        rows = [own.light_curve(j)[0] for j in range(inputs.ids.size)]
        steps = [np.rint(each[:, TIME] / inputs.scene.step_s).astype(np.int64) for each in rows]
        attitudes = [np.empty((each.size, 4)) for each in steps]
        motion, settings = inputs.true_motion(self.truth, self.seed), inputs.settings
        for start in settings.epochs.tolist():
            stop = min(start + settings.steps_per_interval, settings.n_steps)
            moved = motion.advance(stop - start)
            if start == 0:
                quaternion, omega = moved.quaternion[:, 0], moved.angular_velocity[:, 0]
            for j, step in enumerate(steps):
                here = (step > start) & (step <= stop)
                attitudes[j][here] = moved.quaternion[j, step[here] - start]
        return characterized_targets(found, rows, attitudes, quaternion, omega, self.truth.surfaces)

    def _maneuvers(self) -> ManeuverLog:
        """The maneuvers of this realization, by start and target."""
        given = self.motion.maneuvers
        order = np.lexsort((given.target, given.start_s))
        columns = given.target, given.start_s, given.duration_s, self.motion.velocity_changes_m_s
        number = np.full(order.size, self.number)
        return ManeuverLog(number, *(column[order] for column in columns))
