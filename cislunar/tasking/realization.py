"""One realization of a cell: truth, estimator, bound and metrics, from epoch to epoch.

What it carries from interval to interval does not grow with the length of the run, except for the
light curves a batch estimator keeps; histories leave it in pieces.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.estimation.estimator import (
    Estimates,
    Estimator,
    EstimatorFactory,
    InitialEstimate,
    Prediction,
)
from cislunar.evaluation.cramer_rao import CramerRaoBound
from cislunar.evaluation.metrics import Evaluation, TrackingMetrics
from cislunar.observation.drawn_bodies import true_departures
from cislunar.observation.eclipse import dimming
from cislunar.observation.measurement import (
    DETECTED,
    FAINT,
    NOT_TASKED,
    OCCULTED,
    measure,
    within_reach,
)
from cislunar.observation.records import Measurements, highest, pointed_schedule, rows_of
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.observation.sensor import sensor_limits
from cislunar.tasking.communication.contact import arrivals
from cislunar.tasking.communication.reception import Reception
from cislunar.tasking.decision import Decision, decide
from cislunar.tasking.planning.assignment import IDLE
from cislunar.tasking.planning.detection import LearnedDetection
from cislunar.tasking.planning.under_way import credited
from cislunar.tasking.recording import Piece, interval_records
from cislunar.tasking.settings import LoopSettings
from cislunar.tasking.simulation import (
    ESTIMATOR,
    TASKING,
    TrueMotion,
    Truth,
    TruthModel,
    estimation_errors,
    stream,
)

Array = NDArray[np.float64]

USED = DETECTED + 1
"""Fate of a look whose measurement was used, beyond those of `cislunar.observation.measurement`.

So is that of a measurement still under way at the end of its interval.
"""

FATE_NAMES = ("not_tasked", "faint", "excluded", "occulted", "rejected", "used")
"""Names of the fates; "rejected" was out of the field of view, or the estimate had failed."""


class World(NamedTuple):
    """What all realizations of a cell have in common; see `cislunar.tasking.closed_loop`."""

    scene: Scene
    surfaces: TargetSurfaces
    settings: LoopSettings
    factory: EstimatorFactory
    initial: InitialEstimate
    truth: TruthModel
    ids: NDArray[np.int64]
    forces: tuple


class Realization(NamedTuple):
    """What is carried on of one; its parts change.

    `variance` is that of the true noise (3,), or where the truth has sensors of its own, by how
    much that of each observer's (observer, 3) exceeds what measurements say.
    """

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

    @property
    def end(self) -> tuple[TrackingMetrics, NDArray[np.uint8], NDArray[np.int64]]:
        """Metrics, why estimates failed, and counters."""
        return self.evaluation.result(), self.estimator.failed, self.estimator.counters


def begun(world: World, number: int, seed: int) -> Realization:
    """A realization at the epoch."""
    scene, settings = world.scene, world.settings
    truth = world.truth.drawn(seed, world.ids)
    motion = TrueMotion(
        world.initial,
        scene,
        truth.noise if truth.sensor is None else np.ones(3),
        seed,
        world.ids,
        forces=truth.forces,
        inertia=truth.surfaces.inertia,
        angular_acceleration=truth.angular_acceleration,
        looks=settings.schedule.observers_per_target,
    )
    variance = truth.noise**2
    if truth.sensor is not None:
        # of photons as recorded; what is constant may truly be otherwise
        believed, true = (
            sensor_limits(each, scene.observer_position.shape[0]).noise_variance
            for each in (settings.sensor, truth.sensor)
        )
        variance = true - believed
    own = stream(ESTIMATOR, seed)
    given = settings.sensor, world.initial, own, world.forces
    estimator = world.factory(scene, world.surfaces, *given)
    bound = CramerRaoBound(
        scene,
        truth.surfaces,
        world.initial.sigma,
        unknowns=estimator.unknowns,
        forces=truth.forces,
    )
    evaluation = Evaluation(world.ids.size, settings.n_steps, settings.step_s, settings.custody)
    learned = settings.tasking.detection
    detection = None if learned is None else LearnedDetection(learned, world.ids.size)
    pointing = np.full(scene.observer_position.shape[0], IDLE, dtype=np.int64)
    reception = None
    if settings.communication.late:
        reception = Reception(
            arrivals(settings.communication, scene),
            settings.steps_between_updates,
            (estimator, bound),
            (scene, world.surfaces, truth.surfaces, world.forces, truth.forces),
            world.ids.size,
        )
    return Realization(
        number, seed, truth, variance, motion, estimator, bound, evaluation, detection, pointing,
        reception,
    )  # fmt: skip


def interval(world: World, own: Realization, number: int) -> Piece:
    """Assign the observers at an epoch and work through the interval that follows."""
    settings, start = world.settings, int(world.settings.epochs[number])
    n_steps = min(settings.steps_per_interval, settings.n_steps - start)
    tasking = decide(
        _predicted(world, own, start), n_steps, world.scene, world.surfaces, settings,
        world.forces, own.detection, own.pointing, stream(TASKING, own.seed, number),
    )  # fmt: skip
    for target in tasking.target:
        own.pointing[:] = np.where(target == IDLE, own.pointing, target)
    motion, measurements, fate, visible = _observed(world, own, start, tasking)
    estimates, error, least = _judged(world, own, start, motion, measurements, fate)
    some = settings.recorded_within(start, n_steps)
    asked, looks = interval_records(
        start, own.number, tasking.looking, motion, estimates, measurements, fate, settings,
        world.scene,
    )  # fmt: skip
    kept: dict[str, tuple[str, NDArray]] = {
        "assignment": ("epoch", _in_slots(tasking.target, settings)[None].astype(np.int16)),
        "information": ("epoch", np.array([tasking.information])),
        "evaluations": ("epoch", np.array([tasking.evaluations])),
        "fate": ("step", highest(measurements, fate, NOT_TASKED).T),
    }
    for history, name, values in (
        ("errors", "error", error),
        ("errors", "sigma", estimates.sigma),
        ("bound", "bound", least),
    ):
        if history in settings.histories:
            kept[name] = "time", values[:, some].swapaxes(0, 1).astype(np.float32)
    if settings.schedule.bounded:
        kept["planning_gap"] = "epoch", np.array([tasking.gap])
    if own.detection is not None:
        names = "brightness_offset", "brightness_offset_sigma"
        for name, values in zip(names, own.detection.offset(), strict=True):
            kept[name] = "epoch", values[None].astype(np.float32)
    if own.estimator.unknowns:
        mean, sigma = own.estimator.learned()
        surfaces, forced = own.truth.surfaces, own.truth.angular_acceleration
        true = true_departures(own.estimator.unknowns, world.surfaces, surfaces, forced)
        kept["departure_error"] = "epoch", (true - mean)[None].astype(np.float32)
        kept["departure_sigma"] = "epoch", sigma[None].astype(np.float32)
        kept["searches"] = "epoch", own.estimator.searches[None].astype(np.int32)
    if visible is not None:
        kept["visible"] = "epoch", visible[None]
    if settings.keep_information:
        kept["pair_information"] = "epoch", tasking.pairs[None]
    stop = start + n_steps
    times = slice(*np.searchsorted(settings.recorded, [start, stop]).tolist())
    places = {"epoch": slice(number, number + 1), "step": slice(start, stop), "time": times}
    return Piece(own.number, places, kept | asked, looks)


def _in_slots(target: NDArray[np.int64], settings: LoopSettings) -> NDArray[np.int64]:
    """Targets (slot, observer) as they are kept: without slots (observer,), filled up with them."""
    if settings.slots is None:
        return target[0]
    missing = settings.slots - target.shape[0]
    return np.pad(target, ((0, missing), (0, 0)), constant_values=IDLE)


def _observed(
    world: World, own: Realization, start: int, tasking: Decision
) -> tuple[Truth, Measurements, NDArray[np.uint8], NDArray[np.bool_] | None]:
    """Truth and measurements with their fates of the steps from `start` on.

    And which targets any observer could have found, if that is recorded.
    """
    looking, scene = tasking.looking, world.scene
    motion = own.motion.advance(looking.shape[0])
    dimmed = np.zeros(motion.noise.shape[:2])
    if world.settings.eclipse:
        here = slice(start, start + looking.shape[0] + 1)
        given = scene.sun_position[here], scene.primaries[here]
        dimmed = dimming(motion.translation[..., :3], *given)
    # index 0 of the scene is the start of the run, without a measurement
    first, lit = start + 1, {"begins": start, "dimmed": dimmed}
    true = scene, own.truth.surfaces, world.settings.sensor, motion.translation, motion.quaternion
    measurements, fate = measure(
        first,
        pointed_schedule(looking, world.ids.size),
        *true,
        motion.noise,
        true=own.truth.sensor,
        **lit,
    )
    visible = within_reach(first, *true, **lit) if "visibility" in world.settings.record else None
    target, step = rows_of(measurements)
    shaded = dimmed[target, step + 1] > 0.0
    if own.detection is not None or own.reception is not None:
        # a shadow says nothing of how bright its target is
        told = np.where(shaded & (fate == FAINT), OCCULTED, fate)
        if own.reception is not None:
            own.reception.note(start, tasking, measurements, told)
        else:
            tasking.learn(own.detection, target, step, measurements.observer, told)
    return motion, measurements, fate, visible


def _predicted(world: World, own: Realization, start: int) -> Prediction:
    """What tasking knows at the epoch before the step `start`."""
    if own.reception is None:
        return own.estimator.predict()
    settings = world.settings
    own.reception.receive(start, partial(_worked, world, own))
    own.reception.learn(start, own.detection)
    prediction = own.estimator.predict()
    if not settings.communication.credit_under_way:
        return prediction
    looks = own.reception.under_way(start, own.detection)
    return credited(prediction, looks, world.scene, settings.sensor, settings.tasking, world.forces)


def _worked(
    world: World,
    own: Realization,
    motion: Truth,
    measurements: Measurements,
    wanted: NDArray[np.bool_],
) -> tuple[Estimates, Array]:
    """Estimates of the steps of measurements, and the bound of what was used of them."""
    estimates = own.estimator.advance(
        measurements, covariance="covariance" in world.settings.record
    )
    used = measurements.where(estimates.used)
    if own.truth.sensor is None:
        variance = np.broadcast_to(own.variance, used.variance.shape).copy()
    else:
        variance = used.variance + own.variance[used.observer]
    least = own.bound.advance(
        motion.translation,
        motion.quaternion,
        motion.angular_velocity,
        used._replace(variance=variance),
        wanted,
    )
    return estimates, least


def _judged(
    world: World,
    own: Realization,
    start: int,
    motion: Truth,
    measurements: Measurements,
    fate: NDArray[np.uint8],
) -> tuple[Estimates, Array, Array]:
    """Estimates of an interval, their errors and the bound, which are added to the metrics.

    The fates of what is used are set.
    """
    n_steps = measurements.offset.shape[1] - 1
    wanted = own.evaluation.final(n_steps)
    wanted[world.settings.recorded_within(start, n_steps)] = True
    work = partial(_worked, world, own)
    if own.reception is None:
        estimates, least = work(motion, measurements, wanted)
        observed = np.isin(np.arange(world.ids.size), rows_of(measurements)[0][estimates.used])
    else:
        estimates, least = own.reception.advance(start, motion, measurements, wanted, work)
        observed = own.reception.observed
    fate[estimates.used & (fate == DETECTED)] = USED
    error = estimation_errors(1, motion, estimates)
    own.evaluation.update(error, estimates.sigma, observed, least)
    return estimates, error, least
