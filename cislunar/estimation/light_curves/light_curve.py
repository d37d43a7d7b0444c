"""Likelihood of a whole light curve given the initial attitude and rate of a torque-free body.

The attitude of a torque-free body is a function of six constants: a small turn p0 (GRP) of the
nominal attitude at the epoch and a change of the angular velocity there. In units of the prior's
standard deviations they form the vector ``u``, with N(0, I) before any measurement, and

    cost(u) = |u|^2 / 2 + sum_k w_k (m_k - h_k(u))^2 / (2 R),

R / w_k the variance of measurement k and h_k the magnitude of the facet model at ``q(t_k; u)``.
Lines of sight and ranges are those of the translational estimate at the time of each measurement;
what their error does to the magnitude is far below the noise.

The prior may be replaced by an `Anchor`, the Gaussian that stands for data no longer kept.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.attitude.grp import GRP_A, GRP_F, quaternion_from_grp_components
from cislunar.attitude.quaternion import multiply_components
from cislunar.estimation.light_curves.row_blocks import (
    CURVATURE,
    MAGNITUDE,
    MISFIT_SLOPE,
    MOTION_ROWS,
    OFFSET_WEIGHT,
    SEEN,
    SUM_ROWS,
    UNKNOWNS,
    WEIGHT,
    add_products,
    carry_attitude,
    fill_block,
    fold,
    pull_back,
    pull_back_matrix,
)
from cislunar.photometry.facet_blocks import (
    BLOCK_ROWS,
    LANES,
    block_magnitude_gradients,
    block_magnitudes,
)
from cislunar.photometry.facet_blocks import MAGNITUDE as EXPECTED

Array = NDArray[np.float64]

OTHER_CAUSES = 1e-3
"""Chance that a target in clear view is not seen for another reason than its faintness; bounds what
one row misjudged can do."""

_LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)
_SQRT_HALF = math.sqrt(0.5)


class LightCurveModel(NamedTuple):
    """What the cost of one target needs besides its data.

    Attributes
    ----------
    quaternion, omega : ndarray, shapes (4,) and (3,)
        Nominal attitude (inertial to body) and angular velocity (rad/s, body frame) at the epoch.
    sigma : ndarray, shape (6,)
        Prior standard deviations: attitude error (GRP) and angular velocity (rad/s).
    inertia, inverse_inertia : ndarray, shape (3, 3)
        Any unit.
    spherical : bool
        Whether the angular velocity is constant.
    areas, normals, material, irradiance_4pi, fresnel_sqrt
        As in `cislunar.photometry.facets.facet_magnitude`.
    noise_variance : float
        R, mag^2, of a row of weight 1.
    offset_variance : float
        Variance of an unknown offset common to all magnitudes, mag^2; 0 for none.
    limiting_magnitude : float
        What a non-detection is known to be fainter than.
    """

    quaternion: Array
    omega: Array
    sigma: Array
    inertia: Array
    inverse_inertia: Array
    spherical: bool
    areas: Array
    normals: Array
    material: Array
    irradiance_4pi: bool
    fresnel_sqrt: bool
    noise_variance: float
    offset_variance: float
    limiting_magnitude: float


class Anchor(NamedTuple):
    """The quadratic ``offset + (u - mean)^T information (u - mean) / 2`` the cost begins with.

    Attributes
    ----------
    mean : ndarray, shape (6,)
    information : ndarray, shape (6, 6)
    offset : ndarray, shape (1,)
    """

    mean: Array
    information: Array
    offset: Array


@njit(cache=True, error_model="numpy")
def initial_state(u, model, quaternion, omega):
    """Attitude ``dq(p0) (x) q`` (4,) and angular velocity (3,) at the epoch, given the unknowns."""
    sigma, q = model.sigma, model.quaternion
    d1, d2, d3, d4 = quaternion_from_grp_components(
        sigma[0] * u[0], sigma[1] * u[1], sigma[2] * u[2], GRP_A, GRP_F
    )
    quaternion[0], quaternion[1], quaternion[2], quaternion[3] = multiply_components(
        d1, d2, d3, d4, q[0], q[1], q[2], q[3]
    )
    for c in range(3):
        omega[c] = model.omega[c] + sigma[3 + c] * u[3 + c]


@njit(cache=True, error_model="numpy")
def anchor_cost(u, anchor):
    """Value of an anchor's quadratic."""
    total = 0.0
    for i in range(UNKNOWNS):
        for j in range(UNKNOWNS):
            total += (u[i] - anchor.mean[i]) * anchor.information[i, j] * (u[j] - anchor.mean[j])
    return anchor.offset[0] + 0.5 * total


@njit(cache=True, error_model="numpy")
def fainter_than_limit(z):
    """Cost of a non-detection, and its first two derivatives by z = (h - limit) / noise.

    It is -log(e + (1 - e) Phi(z)) with e = `OTHER_CAUSES`; the curvature is not below zero.
    """
    density = (1.0 - OTHER_CAUSES) * math.exp(-0.5 * z * z - _LOG_SQRT_2PI)
    chance = OTHER_CAUSES + (1.0 - OTHER_CAUSES) * 0.5 * math.erfc(-z * _SQRT_HALF)
    slope = -density / chance
    return -math.log(chance), slope, max(slope * slope + z * density / chance, 0.0)


@njit(cache=True, error_model="numpy", inline="always")
def _surface(model):
    """Shape, material and readings, in the order the magnitudes take them."""
    return model.areas, model.normals, model.material, model.irradiance_4pi, model.fresnel_sqrt


@njit(cache=True, error_model="numpy")
def cost(u, data, anchor, model, stop_above):
    """Negative logarithm of the posterior, up to a constant (compiled).

    Parameters
    ----------
    u : ndarray, shape (6,)
        Unknowns.
    data : ndarray, shape (n, COLUMNS)
        The light curve: time since the epoch (s), magnitude, directions to Sun and observer
        (inertial frame), range (m), 1 for a detection or 0 for a non-detection, and the model's
        noise variance over that of the row; by rising time.
    anchor : Anchor
        Prior.
    model : LightCurveModel
    stop_above : float
        The sum is given up once it exceeds this.

    Returns
    -------
    float
        The cost, or a lower bound of it above `stop_above`.
    """
    total = anchor_cost(u, anchor)
    start, omega, now = np.empty(4), np.empty(3), 0.0
    initial_state(u, model, start, omega)
    q, rate = start.copy(), omega.copy()
    block, work = np.empty((BLOCK_ROWS, LANES)), np.empty((MOTION_ROWS, LANES))
    no_errors = np.empty((6, 0))
    squares, sums, count = 0.0, 0.0, 0.0
    spherical, surface = model.spherical, _surface(model)
    inverse_noise = 1.0 / np.sqrt(model.noise_variance)
    for first in range(0, data.shape[0], LANES):
        rows = min(LANES, data.shape[0] - first)
        fill_block(block, work, data, first, rows, start, omega)
        if not spherical:
            now = carry_attitude(
                block, work, rows, now, q, rate, no_errors, model.inertia, model.inverse_inertia
            )
        block_magnitudes(block, rows, *surface)
        for k in range(rows):
            h, weight = block[EXPECTED, k], data[first + k, WEIGHT]
            if data[first + k, SEEN] == 1.0:
                residual = data[first + k, MAGNITUDE] - h
                squares += weight * residual * residual
                sums += weight * residual
                count += weight
            else:
                excess = (h - model.limiting_magnitude) * inverse_noise
                total += fainter_than_limit(excess * np.sqrt(weight))[0]
        if total + _misfit(squares, sums, count, model) > stop_above:
            break
    return total + _misfit(squares, sums, count, model)


@njit(cache=True, inline="always")
def _shrinkage(count, model):
    """Share of the squared sum of residuals that an unknown offset explains, over the weights."""
    return model.offset_variance / (model.noise_variance + count * model.offset_variance)


@njit(cache=True, error_model="numpy")
def _misfit(squares, sums, count, model):
    """Misfit of the detections, minimised over the offset; never falls as data come in."""
    return 0.5 * (squares - _shrinkage(count, model) * sums * sums) / model.noise_variance


@njit(cache=True, error_model="numpy")
def cost_and_derivatives(u, data, anchor, model, gradient, information):
    """Cost, its gradient (6,), and the Gauss-Newton approximation of its Hessian (6, 6).

    The latter is ``Lambda + sum_k w_k a_k a_k^T / R``, a_k the gradient of h_k; see `cost`.
    """
    total = anchor_cost(u, anchor)
    start, omega, now = np.empty(4), np.empty(3), 0.0
    initial_state(u, model, start, omega)
    q, rate = start.copy(), omega.copy()
    block, work = np.empty((BLOCK_ROWS, LANES)), np.empty((MOTION_ROWS, LANES))
    products, errors = np.zeros((SUM_ROWS, LANES)), np.zeros((6, 3))
    for i in range(3):
        errors[3 + i, i] = 1.0  # d omega(0) / d omega(0)
    inverse_variance = 1.0 / model.noise_variance
    inverse_noise = np.sqrt(inverse_variance)
    squares, sums, count = 0.0, 0.0, 0.0
    spherical, surface = model.spherical, _surface(model)
    for first in range(0, data.shape[0], LANES):
        rows = min(LANES, data.shape[0] - first)
        fill_block(block, work, data, first, rows, start, omega)
        if not spherical:
            now = carry_attitude(
                block, work, rows, now, q, rate, errors, model.inertia, model.inverse_inertia
            )
        block_magnitude_gradients(block, rows, *surface)
        for k in range(rows):
            h, weight = block[EXPECTED, k], data[first + k, WEIGHT]
            if data[first + k, SEEN] == 1.0:
                residual = data[first + k, MAGNITUDE] - h
                squares += weight * residual * residual
                sums += weight * residual
                count += weight
                curvature = weight * inverse_variance
                slope, of_offset = -residual * curvature, weight
            else:
                sharpness = inverse_noise * np.sqrt(weight)
                excess = (h - model.limiting_magnitude) * sharpness
                value, slope, curvature = fainter_than_limit(excess)
                total += value
                slope *= sharpness
                curvature *= weight * inverse_variance
                of_offset = 0.0
            work[MISFIT_SLOPE, k], work[CURVATURE, k] = slope, curvature
            work[OFFSET_WEIGHT, k] = of_offset
        pull_back(block, work, rows, omega, spherical)
        add_products(work, rows, products)
    to_unknowns = pull_back_matrix(u, start, model.sigma)
    curvatures, slopes, offsets = fold(products, to_unknowns)
    shrinkage = inverse_variance * _shrinkage(count, model)
    for i in range(UNKNOWNS):
        gradient[i] = slopes[i] + shrinkage * sums * offsets[i]
        for j in range(UNKNOWNS):
            gradient[i] += anchor.information[i, j] * (u[j] - anchor.mean[j])
            information[i, j] = anchor.information[i, j] + curvatures[i, j]
            information[i, j] -= shrinkage * offsets[i] * offsets[j]
    return total + _misfit(squares, sums, count, model)
