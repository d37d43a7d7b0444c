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

from cislunar.attitude.grp import GRP_A, GRP_F, pull_back_to_grp, quaternion_from_grp_components
from cislunar.attitude.quaternion import multiply_components, rotate_components
from cislunar.attitude.rigid_body import propagate_spherical, pull_back_gradient
from cislunar.attitude.short_steps import propagate_with_errors
from cislunar.photometry.facets import facet_magnitude, facet_magnitude_gradient

Array = NDArray[np.float64]

UNKNOWNS = 6
"""Attitude error (GRP) and angular velocity at the epoch, in prior standard deviations."""

# Columns of a light curve.
TIME, MAGNITUDE, SUN, VIEW, RANGE, SEEN, WEIGHT = 0, 1, slice(2, 5), slice(5, 8), 8, 9, 10
COLUMNS = 11

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
    start, omega = np.empty(4), np.empty(3)
    initial_state(u, model, start, omega)
    q, rate, no_errors = start.copy(), omega.copy(), np.empty((6, 0))
    now = 0.0
    squares, sums, count = 0.0, 0.0, 0.0
    inverse_noise = 1.0 / np.sqrt(model.noise_variance)
    for k in range(data.shape[0]):
        row = data[k]
        if model.spherical:
            q = propagate_spherical(start, omega, row[TIME])
        else:
            propagate_with_errors(
                q, rate, no_errors, row[TIME] - now, model.inertia, model.inverse_inertia
            )
            now = row[TIME]
        h = facet_magnitude(
            q,
            row[SUN],
            row[VIEW],
            row[RANGE],
            model.areas,
            model.normals,
            model.material,
            model.irradiance_4pi,
            model.fresnel_sqrt,
        )
        weight = row[WEIGHT]
        if row[SEEN] == 1.0:
            residual = row[MAGNITUDE] - h
            squares += weight * residual * residual
            sums += weight * residual
            count += weight
        else:
            excess = (h - model.limiting_magnitude) * inverse_noise
            total += fainter_than_limit(excess * np.sqrt(weight))[0]
        if k % 8 == 7 and total + _misfit(squares, sums, count, model) > stop_above:
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
    gradient[:] = 0.0
    for i in range(UNKNOWNS):
        for j in range(UNKNOWNS):
            gradient[i] += anchor.information[i, j] * (u[j] - anchor.mean[j])
    information[:, :] = anchor.information
    start, omega = np.empty(4), np.empty(3)
    initial_state(u, model, start, omega)
    q, rate, sensitivity = start.copy(), omega.copy(), np.zeros((6, 3))
    for i in range(3):
        sensitivity[3 + i, i] = 1.0  # d omega(0) / d omega(0)
    p = model.sigma[:3] * u[:3]
    inverse_variance = 1.0 / model.noise_variance
    inverse_noise = np.sqrt(inverse_variance)
    squares, sums, count, now = 0.0, 0.0, 0.0, 0.0
    by_grp, a, mean_a = np.empty(3), np.empty(UNKNOWNS), np.zeros(UNKNOWNS)
    for k in range(data.shape[0]):
        row = data[k]
        t = row[TIME]
        if model.spherical:
            q = propagate_spherical(start, omega, t)
        else:
            propagate_with_errors(
                q, rate, sensitivity, t - now, model.inertia, model.inverse_inertia
            )
            now = t
        h, gx, gy, gz = facet_magnitude_gradient(
            q,
            row[SUN],
            row[VIEW],
            row[RANGE],
            model.areas,
            model.normals,
            model.material,
            model.irradiance_4pi,
            model.fresnel_sqrt,
        )
        if model.spherical:
            e1, e2, e3, w1, w2, w3 = pull_back_gradient(omega, t, gx, gy, gz)
        else:
            t1, t2, t3, t4 = multiply_components(
                q[0], q[1], q[2], q[3], -start[0], -start[1], -start[2], start[3]
            )
            e1, e2, e3 = rotate_components(-t1, -t2, -t3, t4, gx, gy, gz)
            w1 = sensitivity[0, 0] * gx + sensitivity[1, 0] * gy + sensitivity[2, 0] * gz
            w2 = sensitivity[0, 1] * gx + sensitivity[1, 1] * gy + sensitivity[2, 1] * gz
            w3 = sensitivity[0, 2] * gx + sensitivity[1, 2] * gy + sensitivity[2, 2] * gz
        by_grp[0], by_grp[1], by_grp[2] = e1, e2, e3
        by_grp = pull_back_to_grp(p, by_grp, GRP_A, GRP_F)
        for c in range(3):
            a[c] = model.sigma[c] * by_grp[c]
        a[3], a[4], a[5] = model.sigma[3] * w1, model.sigma[4] * w2, model.sigma[5] * w3
        weight = row[WEIGHT]
        if row[SEEN] == 1.0:
            residual = row[MAGNITUDE] - h
            squares += weight * residual * residual
            sums += weight * residual
            count += weight
            curvature = weight * inverse_variance
            slope = -residual * curvature
            for i in range(UNKNOWNS):
                mean_a[i] += weight * a[i]
        else:
            sharpness = inverse_noise * np.sqrt(weight)
            value, slope, curvature = fainter_than_limit((h - model.limiting_magnitude) * sharpness)
            total += value
            slope *= sharpness
            curvature *= weight * inverse_variance
        for i in range(UNKNOWNS):
            gradient[i] += slope * a[i]
            for j in range(i + 1):
                information[i, j] += curvature * a[i] * a[j]
    shrinkage = inverse_variance * _shrinkage(count, model)
    for i in range(UNKNOWNS):
        gradient[i] += shrinkage * sums * mean_a[i]
        for j in range(i + 1):
            information[i, j] -= shrinkage * mean_a[i] * mean_a[j]
            information[j, i] = information[i, j]
    return total + _misfit(squares, sums, count, model)
