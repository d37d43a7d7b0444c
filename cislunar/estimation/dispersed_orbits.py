"""Sigma points of the positions and velocities of targets, and their propagation."""

import numpy as np

from cislunar.compiled import njit
from cislunar.dynamics.bundle import step_bundle
from cislunar.dynamics.forces import of_state
from cislunar.dynamics.tableau import STAGES8
from cislunar.estimation.triangular import cholesky
from cislunar.estimation.unscented import sigma_points

TRANSLATION_SIZE = 6
"""Components of a position and a velocity."""


@njit(cache=True, error_model="numpy")
def dispersed_points(mean, covariance, spread, points):
    """Sigma points (target, 6, 13) of all targets; NaN for those without an estimate."""
    root = np.empty((TRANSLATION_SIZE, TRANSLATION_SIZE))
    for j in range(mean.shape[0]):
        root[:, :] = covariance[j]
        if np.isfinite(np.sum(mean[j])) and cholesky(root):
            sigma_points(mean[j], root, spread, points[j])
        else:
            points[j, :, :] = np.nan


@njit(cache=True, error_model="numpy")
def carry_points(points, index, count, step, forces):
    """Propagate sigma points (target, 6, 13) over some steps from time `index` on."""
    slopes = np.empty((STAGES8, TRANSLATION_SIZE, points.shape[2]))
    stage = np.empty(points.shape[1:])
    for j in range(points.shape[0]):
        own = of_state(forces, j)
        for k in range(index, index + count):
            step_bundle(own, k * step, points[j], step, slopes, stage)
