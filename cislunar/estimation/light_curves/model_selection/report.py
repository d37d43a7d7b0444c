"""Attitude and its uncertainty from a mixture over models of the body."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.quaternion import attitude_matrix, compose, from_rotation_vector
from cislunar.estimation.light_curves.hypotheses import mixture_points, prior_hypotheses
from cislunar.estimation.light_curves.light_curve import LightCurveModel
from cislunar.estimation.light_curves.mixture import mixture_moments, step_points
from cislunar.estimation.light_curves.model_selection.rungs import (
    UNKNOWN_SHAPE,
    SelectedModel,
    model_of_rung,
)
from cislunar.estimation.light_curves.row_blocks import ROTATION

Array = NDArray[np.float64]

_FRAME_SIGMA = np.deg2rad(5.0)
"""Standard deviation of the body frame of an unknown shape about each axis, rad (empirical)."""

_FRAME_ANGLE = np.sqrt(3.0) * _FRAME_SIGMA
"""Angle, rad, of six equally weighted rotations, two about each axis, with that variance."""


class RotationPoints(NamedTuple):
    """Weighted points of a rotation at a time, which have the mean and covariance of a mixture:
    attitudes (n, 4), inertial to body frame; angular velocities (n, 3), body frame, rad/s; weights;
    `deviations` (n, m) of inertia and torque; and the number of the mode of each point."""

    quaternion: Array
    omega: Array
    weight: Array
    deviations: Array
    mode: NDArray[np.int64]


class RotationEstimate(NamedTuple):
    """Mean and covariance of a rotation.

    Attributes
    ----------
    quaternion : ndarray, shape (4,)
        Mean attitude, inertial to body frame, scalar last.
    omega : ndarray, shape (3,)
        Mean angular velocity, body frame, rad/s.
    covariance : ndarray, shape (6, 6)
        Of the attitude error (GRP, rad) and of the angular velocity, within and between modes.
    """

    quaternion: Array
    omega: Array
    covariance: Array


def points_of(selected: SelectedModel, model: LightCurveModel) -> RotationPoints:
    """Points of the posterior at the epoch; `model` is the one given to `select_model`."""
    parts = []
    for number, candidate in enumerate(selected.candidates):
        own = model_of_rung(model, candidate.rung)
        modes = prior_hypotheses(1, own.sigma.size)
        modes.u[0] = candidate.minimum.u
        modes.root[0] = np.linalg.cholesky(candidate.minimum.information)
        size = 2 * (ROTATION + own.rotation_kinds.size)
        shapes = (size, 4), (size, 3), (size,), (size, own.rotation_kinds.size)
        quaternion, omega, weight, deviations = (np.empty(shape) for shape in shapes)
        mixture_points(modes, own, quaternion, omega, weight, deviations)
        weight *= selected.weight[number]
        parts.append((quaternion, omega, weight, deviations, np.full(size, number)))
    points = RotationPoints(*(np.concatenate(each) for each in zip(*parts, strict=True)))
    return _of_uncertain_frames(points) if selected.rung in UNKNOWN_SHAPE else points


def _of_uncertain_frames(points: RotationPoints) -> RotationPoints:
    """The points in body frames that are rotated about each axis, with the variance of an uncertain
    frame. Angular velocities are rotated as well, so that the rotations remain constant in time."""
    parts = []
    for axis in range(3):
        for angle in (_FRAME_ANGLE, -_FRAME_ANGLE):
            turn = from_rotation_vector(angle * np.eye(3)[axis])
            quaternion = compose(turn, points.quaternion)
            omega = points.omega @ attitude_matrix(turn).T
            parts.append((quaternion, omega, points.weight / 6.0, points.deviations, points.mode))
    return RotationPoints(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def rotation_at(
    selected: SelectedModel, model: LightCurveModel, elapsed_s: float
) -> RotationEstimate:
    """Rotation at a time after the epoch.

    Parameters
    ----------
    selected : SelectedModel
    model : LightCurveModel
        Model given to `select_model`.
    elapsed_s : float
        Time since the epoch of the light curve, s.

    Returns
    -------
    RotationEstimate
    """
    points = points_of(selected, model)
    quaternion, omega = points.quaternion.copy(), points.omega.copy()
    step_points(quaternion, omega, points.deviations, float(elapsed_s), model)
    mean, rate, differences = np.empty(4), np.empty(3), np.empty((points.weight.size, 6))
    mixture_moments(quaternion, omega, points.weight, mean, rate, differences)
    covariance = (differences.T * points.weight) @ differences
    return RotationEstimate(mean, rate, covariance)
