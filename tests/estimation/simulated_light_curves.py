"""Simulated light curves of a rotating body, seen by two observers."""

from types import SimpleNamespace

import numpy as np
from oracles.light_curves import geometry, model_of

from cislunar.attitude.quaternion import compose, from_rotation_vector
from cislunar.estimation.light_curves.light_curve import initial_state
from cislunar.estimation.light_curves.mixture import mixture_moments
from cislunar.estimation.light_curves.model_selection.in_loop import Selection, reported_points
from cislunar.estimation.light_curves.model_selection.rows import expected_rows
from cislunar.estimation.light_curves.row_blocks import MAGNITUDE, TIME, VIEW

HOURS = 20.0
"""Duration of the light curves."""


def observed_rows(n=600):
    """Geometry of two observers that take turns every hour."""
    data = geometry(n, (0.0, HOURS))
    second = (data[:, TIME] // 3600.0) % 2 == 1
    data[second, VIEW] = data[second, VIEW] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0, 0], [0, 0, 1.0]])
    return data


def rotation(model, u, times):
    """Attitudes of a spherical body and its angular velocity."""
    quaternion, omega = np.empty(4), np.empty(3)
    initial_state(u, model, quaternion, omega)
    return [compose(from_rotation_vector(omega * t), quaternion) for t in times], omega


def simulated(magnitude, seed=0):
    """Light curve of a body, its model and the final true attitude."""
    model, rng = model_of(), np.random.default_rng(seed)
    model = model._replace(irradiance_4pi=False)
    u, data = rng.standard_normal(6), observed_rows()
    attitudes, _ = rotation(model, u, data[:, TIME])
    data[:, MAGNITUDE] = magnitude(attitudes, data) + 0.1 * rng.standard_normal(len(data))
    data = np.ascontiguousarray(data[np.isfinite(data[:, MAGNITUDE])])
    return data, model, rotation(model, u, [3600.0 * HOURS])[0][0], u


def as_believed(attitudes, data, **surface):
    """Magnitudes of the body that the model assumes, with changes of its surface, inf for a dark
    object."""
    model, found = model_of()._replace(irradiance_4pi=False), []
    model = model._replace(surface=model.surface._replace(**surface))
    for q, row in zip(attitudes, data, strict=True):
        still = model._replace(quaternion=np.asarray(q), omega=np.zeros(3))
        found.append(expected_rows(np.zeros(6), row[None], still)[0][0])
    return np.where(np.array(found) < 28.0, found, np.inf)


def rotation_at(selected, model, elapsed_s):
    """Mean attitude at a time after the epoch, and covariance (6, 6) of attitude error and rate."""
    selection = Selection(selected, 0, 0)
    (quaternion, omega, weight, _), count = reported_points(selection, model, elapsed_s, 0)
    mean, differences = np.empty(4), np.empty((count, 6))
    mixture_moments(quaternion, omega, weight, mean, np.empty(3), differences)
    covariance = (differences.T * weight) @ differences
    return SimpleNamespace(quaternion=mean, covariance=covariance)
