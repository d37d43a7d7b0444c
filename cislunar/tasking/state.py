"""Inputs and state of a realization."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.association.tracks import TrackStatus
from cislunar.estimation.estimator import Estimator, EstimatorFactory, InitialEstimate
from cislunar.evaluation.cramer_rao import CramerRaoBound
from cislunar.evaluation.metrics import Evaluation, TrackingMetrics
from cislunar.observation.scene import Scene
from cislunar.observation.target_surfaces import TargetSurfaces
from cislunar.tasking.communication.reception import Reception
from cislunar.tasking.histories import ManeuverLog
from cislunar.tasking.observer_truth import ObserverTruth
from cislunar.tasking.planning.detection import LearnedDetection
from cislunar.tasking.settings import LoopSettings
from cislunar.tasking.truth import TrueMotion, TruthModel

Array = NDArray[np.float64]


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

    @property
    def end(self) -> tuple[TrackingMetrics, NDArray[np.uint8], NDArray[np.int64], ManeuverLog]:
        """Metrics, reasons of failed estimates, counters, and maneuvers."""
        result, estimator = self.evaluation.result(), self.estimator
        return result, estimator.failed, estimator.counters, self._maneuvers()

    def _maneuvers(self) -> ManeuverLog:
        """The maneuvers of this realization, by start and target."""
        given = self.motion.maneuvers
        order = np.lexsort((given.target, given.start_s))
        columns = given.target, given.start_s, given.duration_s, self.motion.velocity_changes_m_s
        number = np.full(order.size, self.number)
        return ManeuverLog(number, *(column[order] for column in columns))
