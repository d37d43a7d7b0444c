"""Likelihood of a light curve given the initial attitude and rate of a torque-free body.

docs/attitude.md derives the cost: with ``u`` the deviations of initial attitude (GRP) and angular
velocity in prior standard deviations,

    cost(u) = |u|^2 / 2 + sum_k w_k (m_k - h_k(u))^2 / (2 R),

with R / w_k the variance of measurement k and h_k the expected magnitude. If R is known as from nu
measurements only (``nu R / R_true`` is chi squared with nu degrees of freedom), it is integrated
out: with n detections and S the sum over w_k (m_k - h_k)^2 the misfit becomes ``(nu + n) / 2 ln(1 +
S / (nu R))``, and ``(nu R + S) / (nu + n)`` replaces R in the derivatives.

Body-parameter deviations may follow the six constants: first those of the rotation
(`cislunar.attitude.parameter_deviations`), then those of the surface
(`cislunar.photometry.parameter_deviations`). An `Anchor` may replace the prior.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.grp import quaternion_from_grp_components
from cislunar.attitude.parameter_deviations import (
    TRACK_COLUMNS,
    TURN_IF_KNOWN,
    TURN_PER_STEP,
    begin_track,
    perturbed_rotation,
)
from cislunar.attitude.quaternion import multiply_components
from cislunar.compiled import njit, njit_alloc, njit_inline, njit_noalloc
from cislunar.elementary import normal_cdf
from cislunar.estimation.light_curves.row_blocks import (
    CURVATURE,
    MAGNITUDE,
    MISFIT_SLOPE,
    ROTATION,
    SEEN,
    WEIGHT,
    add_products,
    fill_block,
    fold,
    make_cost_work,
    parameter_rows,
    pull_back,
    pull_back_matrix,
    read_attitude,
    turn_evenly,
)
from cislunar.photometry.bodies import Body
from cislunar.photometry.body_blocks import (
    body_magnitude_deviations,
    body_magnitude_gradients,
    body_magnitudes,
)
from cislunar.photometry.facet_blocks import LANES
from cislunar.photometry.facet_blocks import MAGNITUDE as EXPECTED
from cislunar.photometry.materials import AXIS_SCALE, FACET
from cislunar.photometry.parameter_deviations import deviation_rows, perturbed_body
from cislunar.runtime import Array

OTHER_CAUSES = 1e-3
"""Probability that a target in clear view is not detected for a reason other than its faintness; it
bounds the effect of one misjudged row."""

_LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)


class LightCurveModel(NamedTuple):
    """Model of one target's light curve.
    `quaternion` (4,) inertial to body frame, `omega` (3,) rad/s, body frame: nominal motion at the
    epoch. `sigma` (n,): prior standard deviations of attitude error (GRP), angular velocity (rad/s)
    and body parameters. `rotation_kinds`, `surface_kinds`: estimated deviations, n - 6 together.
    `inertia`, `inverse_inertia` (3, 3): assumed, any unit; `even`: whether the angular velocity is
    constant, whatever the parameters. `surface`: assumed `Body`. `irradiance_4pi`, `fresnel_sqrt`:
    see `cislunar.photometry.materials.PhotometryModel`. `noise_variance`: R, mag^2, of a row of
    weight 1; `noise_freedom`: degrees of freedom of the prior knowledge of R, 0 if R is known."""

    quaternion: Array
    omega: Array
    sigma: Array
    rotation_kinds: NDArray[np.int64]
    surface_kinds: NDArray[np.int64]
    inertia: Array
    inverse_inertia: Array
    even: bool
    surface: Body
    irradiance_4pi: bool
    fresnel_sqrt: bool
    noise_variance: float
    noise_freedom: float


class Anchor(NamedTuple):
    """The quadratic ``offset + (u - mean)^T information (u - mean) / 2`` with which the cost
    begins; shapes (n,), (n, n) and (1,)."""

    mean: Array
    information: Array
    offset: Array


def prior_anchor(size: int) -> Anchor:
    """The prior N(0, I) of `size` parameters."""
    return Anchor(np.zeros(size), np.eye(size), np.zeros(1))


@njit_noalloc
def initial_state(u, model, quaternion, omega):
    """Attitude ``dq(p0) (x) q`` (4,) and angular velocity (3,) at the epoch, given the
    parameters."""
    sigma, q = model.sigma, model.quaternion
    d1, d2, d3, d4 = quaternion_from_grp_components(
        sigma[0] * u[0], sigma[1] * u[1], sigma[2] * u[2]
    )
    quaternion[0], quaternion[1], quaternion[2], quaternion[3] = multiply_components(
        d1, d2, d3, d4, q[0], q[1], q[2], q[3]
    )
    for c in range(3):
        omega[c] = model.omega[c] + sigma[3 + c] * u[3 + c]


@njit_noalloc
def anchor_cost(u, anchor):
    """Value of an anchor's quadratic."""
    total = 0.0
    for i in range(u.shape[0]):
        for j in range(u.shape[0]):
            total += (u[i] - anchor.mean[i]) * anchor.information[i, j] * (u[j] - anchor.mean[j])
    return anchor.offset[0] + 0.5 * total


@njit_noalloc
def fainter_than_limit(z):
    """Cost of a non-detection, and its first two derivatives with respect to z = (h - limit) /
    noise. It is -log(e + (1 - e) Phi(z)) with e = `OTHER_CAUSES`; the curvature is not below zero.
    """
    density = (1.0 - OTHER_CAUSES) * math.exp(-0.5 * z * z - _LOG_SQRT_2PI)
    chance = OTHER_CAUSES + (1.0 - OTHER_CAUSES) * normal_cdf(z, 1.0)
    slope = -density / chance
    return -math.log(chance), slope, max(slope * slope + z * density / chance, 0.0)


@njit(cache=True, inline="always")
def propagated_parameters(model):
    """Number of parameters, the first ones, on which the attitude at other times depends."""
    return ROTATION + model.rotation_kinds.shape[0]


@njit_noalloc
def set_motion(u, model, with_columns, work):
    """Motion and body at the epoch, given the parameters, into the work."""
    initial_state(u, model, work.start, work.omega)
    carried = propagated_parameters(model)
    for c in range(ROTATION, carried):
        work.amounts[c] = model.sigma[c] * u[c]
    amounts, assumed = work.amounts[ROTATION:carried], (model.inertia, model.inverse_inertia)
    perturbed_rotation(model.rotation_kinds, amounts, *assumed, work.body)
    if not model.even:
        begin_track(work.track, work.times, work.start, work.omega, work.body, with_columns)


@njit_alloc
def _surface(u, model):
    """Shape and material of a body with surface deviations, given the parameters."""
    carried = propagated_parameters(model)
    return perturbed_body(model.surface_kinds, model.sigma[carried:] * u[carried:], model.surface)


@njit_alloc
def surface_and_shares(u, model):
    """A body with surface deviations, and room for the contribution of each of its facets."""
    surface, with_shares = _surface(u, model), np.any(model.surface_kinds >= FACET)
    return surface, np.empty((surface.areas.shape[0] if with_shares else 0, LANES))


@njit_noalloc
def _magnitudes_and_deviations(block, shares, work, rows, surface, model):
    """Magnitudes of a block, and their derivatives with respect to attitude and surface
    deviations."""
    readings = model.irradiance_4pi, model.fresnel_sqrt
    kinds, scaled = model.surface_kinds, False
    for kind in kinds:
        scaled |= AXIS_SCALE <= kind < FACET
    body_magnitude_deviations(block, shares, scaled, rows, surface, *readings)
    first = propagated_parameters(model)
    out = parameter_rows(work, first)
    deviation_rows(block, shares, rows, kinds, model.sigma[first:], surface, readings[1], out)


@njit_alloc
def cost(u, data, anchor, model, stop_above):
    """Negative logarithm of the posterior, up to a constant (compiled).

    Parameters
    ----------
    u : ndarray, shape (n,)
        Estimated parameters, in prior standard deviations.
    data : ndarray, shape (n, ROW_COLUMNS)
        The light curve, in the order of time: time since the epoch (s), magnitude (for a
        non-detection the limit), directions to Sun and observer (inertial frame), range (m), 1 for
        a detection or 0 for a non-detection, and the model's noise variance over that of the row.
    anchor : Anchor
        Prior.
    model : LightCurveModel
    stop_above : float
        The summation stops once it exceeds this value.

    Returns
    -------
    float
        Dimensionless; a lower bound if the summation has stopped.
    """
    return cost_with(make_cost_work(u.shape[0]), u, data, anchor, model, stop_above)


@njit_noalloc
def cost_with(work, u, data, anchor, model, stop_above):
    """`cost` with given scratch."""
    set_motion(u, model, False, work)
    total = anchor_cost(u, anchor)
    if model.surface_kinds.shape[0] > 0:
        return _sum_of_perturbed_rows(total, u, data, model, stop_above, work)
    return _sum_of_rows(total, data, model, model.surface, stop_above, work)


@njit_alloc
def _sum_of_perturbed_rows(total, u, data, model, stop_above, work):
    """`_sum_of_rows` for a body with surface deviations."""
    return _sum_of_rows(total, data, model, _surface(u, model), stop_above, work)


@njit_noalloc
def _sum_of_rows(total, data, model, surface, stop_above, work):
    """Cost of the rows added to that of the anchor, given the motion in the work; see `cost`."""
    block, track, times = work.block, work.track, work.times
    squares, seen, even = 0.0, 0, model.even
    turn = TURN_IF_KNOWN if model.rotation_kinds.shape[0] == 0 else TURN_PER_STEP
    inverse_noise = 1.0 / np.sqrt(model.noise_variance)
    for first in range(0, data.shape[0], LANES):
        rows = min(LANES, data.shape[0] - first)
        fill_block(block, work.rows, data, first, rows)
        if even:
            turn_evenly(block, work.rows, rows, work.start, work.omega)
        else:
            read_attitude(block, work.rows, rows, track, times, 0, work.body, turn)
        body_magnitudes(block, rows, surface, model.irradiance_4pi, model.fresnel_sqrt)
        for k in range(rows):
            h, weight = block[EXPECTED, k], data[first + k, WEIGHT]
            if data[first + k, SEEN] == 1.0:
                residual = data[first + k, MAGNITUDE] - h
                squares += weight * residual * residual
                seen += 1
            else:
                excess = (h - data[first + k, MAGNITUDE]) * inverse_noise
                total += fainter_than_limit(excess * np.sqrt(weight))[0]
        if total + _misfit(squares, seen, model) > stop_above:
            break
    return total + _misfit(squares, seen, model)


@njit_noalloc
def _misfit(squares, seen, model):
    """Misfit of the detections; it never falls as data are added."""
    freedom = model.noise_freedom
    if freedom > 0.0:
        return 0.5 * (freedom + seen) * np.log(1.0 + squares / (freedom * model.noise_variance))
    return 0.5 * squares / model.noise_variance


@njit_inline
def _trust(squares, seen, model):
    """Assumed noise variance over that expected from the residuals; 1 if the variance is known."""
    freedom, assumed = model.noise_freedom, model.noise_variance
    return (freedom + seen) * assumed / (freedom * assumed + squares) if freedom > 0.0 else 1.0


@njit_alloc
def cost_and_derivatives(u, data, anchor, model, gradient, information):
    """Cost, its gradient (n,), and the Gauss-Newton approximation of its Hessian (n, n), ``Lambda +
    sum_k w_k a_k a_k^T / R``, with a_k the gradient of h_k; see `cost`."""
    work = make_cost_work(u.shape[0])
    return derivatives_with(work, u, data, anchor, model, np.inf, gradient, information)


@njit_alloc
def derivatives_with(work, u, data, anchor, model, stop_above, gradient, information):
    """`cost_and_derivatives` with given scratch. As in `cost`, the summation stops above a value;
    there are no derivatives then."""
    set_motion(u, model, True, work)
    size, total = u.shape[0], anchor_cost(u, anchor)
    if model.surface_kinds.shape[0] > 0:
        total, squares, seen = _products_of_perturbed(total, u, data, model, stop_above, work)
    else:
        no_shares = work.block[:0]
        total, squares, seen = _sum_of_products(
            total, data, model, model.surface, no_shares, stop_above, work
        )
    value = total + _misfit(squares, seen, model)
    if value > stop_above:
        return value
    curvatures, slopes = fold(work.products, pull_back_matrix(u, work.start, model.sigma), size)
    trust = _trust(squares, seen, model)
    for i in range(size):
        gradient[i] = trust * slopes[i]
        for j in range(size):
            gradient[i] += anchor.information[i, j] * (u[j] - anchor.mean[j])
            information[i, j] = anchor.information[i, j] + trust * curvatures[i, j]
    return value


@njit_alloc
def _products_of_perturbed(total, u, data, model, stop_above, work):
    """`_sum_of_products` for a body with surface deviations."""
    surface, shares = surface_and_shares(u, model)
    return _sum_of_products(total, data, model, surface, shares, stop_above, work)


@njit_noalloc
def differentiate_block(first, rows, data, model, surface, shares, work):
    """Magnitudes of a block's rows from `first` on, and their derivatives, into the work. Those by
    the rotation are with respect to a small rotation of the initial attitude in the inertial frame
    and to the initial angular velocity."""
    block, w, track, times = work.block, work.rows, work.track, work.times
    even, kinds, carried = model.even, model.rotation_kinds, propagated_parameters(model)
    turn = TURN_IF_KNOWN if kinds.shape[0] == 0 else TURN_PER_STEP
    fill_block(block, w, data, first, rows)
    if even:
        turn_evenly(block, w, rows, work.start, work.omega)
    else:
        read_attitude(block, w, rows, track, times, TRACK_COLUMNS, work.body, turn)
    if model.surface_kinds.shape[0] > 0:
        _magnitudes_and_deviations(block, shares, w, rows, surface, model)
    else:
        readings = model.irradiance_4pi, model.fresnel_sqrt
        body_magnitude_gradients(block, rows, surface, *readings)
    pull_back(block, w, rows, work.omega, even, kinds, model.sigma[ROTATION:carried])


@njit_noalloc
def _sum_of_products(total, data, model, surface, shares, stop_above, work):
    """Add the rows as `_sum_of_rows` does, and the products of the derivatives, until the cost is
    above `stop_above`. Returns the cost without the detections, the sum of their squares, and their
    number."""
    block, w = work.block, work.rows
    work.products[:, :] = 0.0
    squares, seen = 0.0, 0
    inverse_variance = 1.0 / model.noise_variance
    inverse_noise = np.sqrt(inverse_variance)
    for first in range(0, data.shape[0], LANES):
        rows = min(LANES, data.shape[0] - first)
        differentiate_block(first, rows, data, model, surface, shares, work)
        for k in range(rows):
            h, weight = block[EXPECTED, k], data[first + k, WEIGHT]
            if data[first + k, SEEN] == 1.0:
                residual = data[first + k, MAGNITUDE] - h
                squares += weight * residual * residual
                seen += 1
                curvature = weight * inverse_variance
                slope = -residual * curvature
            else:
                sharpness = inverse_noise * np.sqrt(weight)
                excess = (h - data[first + k, MAGNITUDE]) * sharpness
                value, slope, curvature = fainter_than_limit(excess)
                total += value
                slope *= sharpness
                curvature *= weight * inverse_variance
            w[MISFIT_SLOPE, k], w[CURVATURE, k] = slope, curvature
        if total + _misfit(squares, seen, model) > stop_above:
            break
        add_products(w, rows, work.products)
    return total, squares, seen
