"""One realization of a cell: truth, estimator, bound and metrics, from epoch to epoch.

What it carries from interval to interval does not grow with the length of the run, except for the
light curves a batch estimator keeps; histories leave it in pieces.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.estimation.estimator import Estimates, Estimator, EstimatorFactory, InitialEstimate
from cislunar.evaluation.cramer_rao import CramerRaoBound
from cislunar.evaluation.metrics import Evaluation, TrackingMetrics
from cislunar.observation.measurement import DETECTED, NOT_TASKED, measure
from cislunar.observation.records import Measurements, constant_schedule, highest, rows_of
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.tasking.planning.assignment import Assignment, assign, total_information
from cislunar.tasking.planning.detection import LearnedDetection, sphere_magnitudes
from cislunar.tasking.planning.information import pair_information
from cislunar.tasking.planning.preselection import assign_preselected, preselects
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
"""Fate of a look whose measurement was used, beyond those of `cislunar.observation.measurement`."""

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
    """What is carried on of one; its parts change."""

    number: int
    seed: int
    truth: TruthModel
    motion: TrueMotion
    estimator: Estimator
    bound: CramerRaoBound
    evaluation: Evaluation
    detection: LearnedDetection | None

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
        truth.noise,
        seed,
        world.ids,
        forces=truth.forces,
        inertia=truth.surfaces.inertia,
        angular_acceleration=truth.angular_acceleration,
    )
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
    return Realization(number, seed, truth, motion, estimator, bound, evaluation, detection)


def interval(world: World, own: Realization, number: int) -> Piece:
    """Assign the observers at an epoch and work through the interval that follows."""
    settings, start = world.settings, int(world.settings.epochs[number])
    n_steps = min(settings.steps_per_interval, settings.n_steps - start)
    tasking, pairs, margin = _tasked(world, own, number)
    motion, measurements, fate, estimates = _observed(world, own, start, n_steps, tasking.target)
    error, least = _judged(world, own, start, motion, measurements, estimates)
    some = settings.recorded_within(start, n_steps)
    asked, looks = interval_records(
        start, own.number, tasking.target, motion, estimates, measurements, fate, settings,
        world.scene,
    )  # fmt: skip
    kept: dict[str, tuple[str, NDArray]] = {
        "assignment": ("epoch", tasking.target[None].astype(np.int16)),
        "information": ("epoch", np.array([tasking.information])),
        "evaluations": ("epoch", np.array([tasking.history.size])),
        "fate": ("step", highest(measurements, fate, NOT_TASKED).T),
    }
    for history, name, values in (
        ("errors", "error", error),
        ("errors", "sigma", estimates.sigma),
        ("bound", "bound", least),
    ):
        if history in settings.histories:
            kept[name] = "time", values[:, some].swapaxes(0, 1).astype(np.float32)
    if own.detection is not None and margin is not None:
        own.detection.learn(rows_of(measurements)[0], measurements.observer, fate, margin)
        names = "brightness_offset", "brightness_offset_sigma"
        for name, values in zip(names, own.detection.offset(), strict=True):
            kept[name] = "epoch", values[None].astype(np.float32)
    if pairs is not None and settings.keep_information:
        kept["pair_information"] = "epoch", pairs[None]
    stop = start + n_steps
    times = slice(*np.searchsorted(settings.recorded, [start, stop]).tolist())
    places = {"epoch": slice(number, number + 1), "step": slice(start, stop), "time": times}
    return Piece(own.number, places, kept | asked, looks)


def _tasked(
    world: World, own: Realization, number: int
) -> tuple[Assignment, Array | None, Array | None]:
    """The assignment at an epoch, the information of all pairs where it took that, and by how much
    spheres are brighter than the limit where detection is learned."""
    settings, prediction = world.settings, own.estimator.predict()
    known = world.scene, world.surfaces, settings.sensor, settings.tasking
    n_pairs = world.scene.observer_position.shape[0] * world.ids.size
    if not settings.keep_information and preselects(settings.tasking, settings.method, n_pairs):
        return assign_preselected(prediction, *known), None, None
    pairs = pair_information(prediction, *known)
    worth, margin = pairs, None
    if own.detection is not None:
        margin = settings.sensor.limiting_magnitude - sphere_magnitudes(
            prediction,
            world.scene,
            radius_m=settings.tasking.radius_m,
            diffuse_reflection_coefficient=settings.tasking.diffuse_reflection_coefficient,
        )
        worth = own.detection.worth(pairs, margin)
    tasking = assign(
        worth,
        settings.method,
        rng=stream(TASKING, own.seed, number),
        max_evaluations=settings.max_evaluations,
        early_stop=settings.early_stop,
    )
    if margin is not None:
        tasking = replace(tasking, information=total_information(pairs, tasking.target))
    return tasking, pairs, margin


def _observed(
    world: World, own: Realization, start: int, n_steps: int, target: NDArray[np.int64]
) -> tuple[Truth, Measurements, NDArray[np.uint8], Estimates]:
    """Truth, measurements with their fates, and estimates of the steps from `start` on."""
    motion = own.motion.advance(n_steps)
    measurements, fate = measure(
        start + 1,  # index 0 of the scene is the start of the run, without a measurement
        constant_schedule(target, world.ids.size, n_steps),
        world.scene,
        own.truth.surfaces,
        world.settings.sensor,
        motion.translation,
        motion.quaternion,
        motion.noise,
        begins=start,
    )
    estimates = own.estimator.advance(
        measurements, covariance="covariance" in world.settings.record
    )
    fate[estimates.used] = USED
    return motion, measurements, fate, estimates


def _judged(
    world: World,
    own: Realization,
    start: int,
    motion: Truth,
    measurements: Measurements,
    estimates: Estimates,
) -> tuple[Array, Array]:
    """Errors of an interval and its bound, both added to the metrics."""
    error = estimation_errors(1, motion, estimates)
    used = measurements.where(estimates.used)
    variance = np.broadcast_to(own.truth.noise**2, used.variance.shape).copy()
    wanted = own.evaluation.final(error.shape[1])
    wanted[world.settings.recorded_within(start, error.shape[1])] = True
    least = own.bound.advance(
        motion.translation,
        motion.quaternion,
        motion.angular_velocity,
        used._replace(variance=variance),
        wanted,
    )
    observed = np.isin(np.arange(world.ids.size), rows_of(used)[0])
    own.evaluation.update(error, estimates.sigma, observed, least)
    return error, least
