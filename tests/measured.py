"""Simulated records of simple schedules, and metrics of a whole run."""

import numpy as np

from cislunar.evaluation.metrics import Evaluation
from cislunar.observation.measurement import measure
from cislunar.observation.records import pointed_schedule, rows_of, schedule
from cislunar.observation.sensor import Sensor
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.truth import TrueMotion

SENSOR = Sensor(limiting_magnitude=24.0)


def draw_truth(initial, scene, noise, seed, target_ids, **model):
    """True states, drawn from the initial distribution, at all times of the scene."""
    motion = TrueMotion(initial, scene, noise, seed, target_ids, **model)
    return motion.advance(scene.sun_position.shape[0] - 1)


def constant_schedule(target, n_targets, n_steps):
    """Schedule in which every observer, shape (observer,), observes its target at every step."""
    return pointed_schedule(np.tile(target, (n_steps, 1)), n_targets)


def observed_by(observer_of, scene, surfaces, sensor, truth, first=1, n_steps=None):
    """Records and detection outcomes of one observer, or none (-1), for each target and step."""
    observer_of = np.asarray(observer_of)
    n_steps = scene.sun_position.shape[0] - first if n_steps is None else n_steps
    target = np.repeat(np.flatnonzero(observer_of >= 0), n_steps)
    step = np.tile(np.arange(n_steps), np.count_nonzero(observer_of >= 0))
    observations = schedule(target, step, observer_of[target], observer_of.size, n_steps)
    motion = truth.translation, truth.quaternion, truth.noise
    return measure(first, observations, scene, surfaces, sensor, *motion)


def measured_problem(hours, sensor=SENSOR, inertia=1.0, seed=3):
    """Five targets, each measured by one observer at every step.

    Scene, surfaces, initial estimate, truth, records, and outcomes of shape (target, step).
    """
    scene, _, epoch, ids, loop = tracking_problem(5, 5, duration_hours=hours)
    surfaces = target_surfaces(icosahedron(), Material(), 5, inertia=inertia)
    initial = initial_estimate(epoch, loop.initial.components())
    truth = draw_truth(initial, scene, sensor.noise, seed, ids, inertia=surfaces.inertia)
    records, outcome = observed_by(np.arange(5), scene, surfaces, sensor, truth)
    return scene, surfaces, initial, truth, records, outcome.reshape(5, -1)


def during(records, first, last):
    """Records of the steps first .. last - 1."""
    _, step = rows_of(records)
    some = records.where((step >= first) & (step < last))
    return some._replace(offset=np.ascontiguousarray(some.offset[:, first : last + 1]))


def evaluate(error, sigma, used, step_s, bound=None):
    """Metrics of a whole run at once; `used` has shape (target, time)."""
    evaluation = Evaluation(*error.shape[:2], step_s)
    evaluation.update(error, sigma, used.any(axis=1), bound)
    return evaluation.result()
