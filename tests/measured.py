"""Simulated records of simple schedules, and metrics of a whole run."""

import numpy as np

from cislunar.evaluation.metrics import Evaluation
from cislunar.observation.measurement import measure
from cislunar.observation.records import Measurements, rows_of, schedule


def looked_at(observer_of, scene, surfaces, sensor, truth, first=1, n_steps=None):
    """Records and their fates of one observer for each target, or none (-1), at every step."""
    observer_of = np.asarray(observer_of)
    n_steps = scene.sun_position.shape[0] - first if n_steps is None else n_steps
    target = np.repeat(np.flatnonzero(observer_of >= 0), n_steps)
    step = np.tile(np.arange(n_steps), np.count_nonzero(observer_of >= 0))
    looks = schedule(target, step, observer_of[target], observer_of.size, n_steps)
    return measure(
        first, looks, scene, surfaces, sensor, truth.translation, truth.quaternion, truth.noise
    )


def nothing_measured(n_targets, n_steps):
    """Records of an interval in which nobody looks."""
    none = np.empty(0, dtype=int)
    looks = schedule(none, none, none, n_targets, n_steps)
    return Measurements(*looks, np.empty((0, 3)), np.empty((0, 3)))


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
