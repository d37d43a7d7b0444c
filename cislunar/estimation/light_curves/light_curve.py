"""Likelihood of a whole light curve given the initial attitude and rate of a torque-free body.

The attitude of a torque-free body is a function of six constants: a small turn p0 (GRP) of the
nominal attitude at the epoch and a change of the angular velocity there. In units of the prior's
standard deviations they form the vector ``u``, with N(0, I) before any measurement, and

    cost(u) = |u|^2 / 2 + sum_k w_k (m_k - h_k(u))^2 / (2 R),

R / w_k the variance of measurement k and h_k the magnitude of the facet model at ``q(t_k; u)``.
Lines of sight and ranges are those of the translational estimate at the time of each measurement;
what their error does to the magnitude is far below the noise.

Where R itself is known as from nu measurements alone (``nu R / R_true`` is chi squared with nu
degrees of freedom), it is integrated out: with n detections and S the sum over w_k (m_k - h_k)^2
the misfit becomes ``(nu + n) / 2 ln(1 + S / (nu R))``, Student's t in place of the Gaussian, and
``(nu R + S) / (nu + n)`` takes the place of R in the derivatives.

Further unknowns may follow the six: how the body's rotation (`cislunar.attitude.departures`) and
then its surface (`cislunar.photometry.departures`) depart from what is believed, each in units of
its prior standard deviation too.

The prior may be replaced by an `Anchor`, the Gaussian that stands for data no longer kept.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.attitude.departures import (
    COLUMNS,
    TURN_IF_KNOWN,
    TURN_PER_STEP,
    begin_track,
    departed_rotation,
)
from cislunar.attitude.grp import GRP_A, GRP_F, quaternion_from_grp_components
from cislunar.attitude.quaternion import multiply_components
from cislunar.compiled import allocating, borrowing
from cislunar.estimation.light_curves.cost_work import make_cost_work
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
    pull_back,
    pull_back_matrix,
    read_attitude,
    rows_of_unknowns,
    turn_evenly,
)
from cislunar.photometry.bodies import Body
from cislunar.photometry.body_blocks import (
    body_magnitude_departures,
    body_magnitude_gradients,
    body_magnitudes,
)
from cislunar.photometry.departures import departed_body, departure_rows
from cislunar.photometry.facet_blocks import LANES
from cislunar.photometry.facet_blocks import MAGNITUDE as EXPECTED
from cislunar.photometry.materials import FACET, STRETCH

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
    sigma : ndarray, shape (n,)
        Prior standard deviations: attitude error (GRP), angular velocity (rad/s), departures.
    rotation_kinds, surface_kinds : ndarray of int
        Departures of rotation and surface that are estimated, n - 6 together.
    inertia, inverse_inertia : ndarray, shape (3, 3)
        Any unit.
    even : bool
        Whether the angular velocity is constant, whatever the unknowns.
    surface : Body
        Shape and material.
    irradiance_4pi, fresnel_sqrt : bool
        Readings of the reflection model, see `cislunar.photometry.materials.PhotometryModel`.
    noise_variance : float
        R, mag^2, of a row of weight 1.
    noise_freedom : float
        Degrees of freedom of what is known of R beforehand; 0 if R is known.
    """

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
    """The quadratic ``offset + (u - mean)^T information (u - mean) / 2`` the cost begins with.

    Attributes
    ----------
    mean : ndarray, shape (n,)
    information : ndarray, shape (n, n)
    offset : ndarray, shape (1,)
    """

    mean: Array
    information: Array
    offset: Array


@borrowing
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


@borrowing
def anchor_cost(u, anchor):
    """Value of an anchor's quadratic."""
    total = 0.0
    for i in range(u.shape[0]):
        for j in range(u.shape[0]):
            total += (u[i] - anchor.mean[i]) * anchor.information[i, j] * (u[j] - anchor.mean[j])
    return anchor.offset[0] + 0.5 * total


@borrowing
def fainter_than_limit(z):
    """Cost of a non-detection, and its first two derivatives by z = (h - limit) / noise.

    It is -log(e + (1 - e) Phi(z)) with e = `OTHER_CAUSES`; the curvature is not below zero.
    """
    density = (1.0 - OTHER_CAUSES) * math.exp(-0.5 * z * z - _LOG_SQRT_2PI)
    chance = OTHER_CAUSES + (1.0 - OTHER_CAUSES) * 0.5 * math.erfc(-z * _SQRT_HALF)
    slope = -density / chance
    return -math.log(chance), slope, max(slope * slope + z * density / chance, 0.0)


@njit(cache=True, inline="always")
def carried_unknowns(model):
    """Number of unknowns, the first ones, on which the attitude at other times depends."""
    return ROTATION + model.rotation_kinds.shape[0]


@borrowing
def _set_motion(u, model, with_columns, work):
    """Motion and body at the epoch, given the unknowns, into the work."""
    initial_state(u, model, work.start, work.omega)
    carried = carried_unknowns(model)
    for c in range(ROTATION, carried):
        work.amounts[c] = model.sigma[c] * u[c]
    amounts, believed = work.amounts[ROTATION:carried], (model.inertia, model.inverse_inertia)
    departed_rotation(model.rotation_kinds, amounts, *believed, work.body)
    if not model.even:
        begin_track(work.track, work.times, work.start, work.omega, work.body, with_columns)


@allocating
def _surface(u, model):
    """Shape and material of a body whose surface departs, given the unknowns."""
    carried = carried_unknowns(model)
    return departed_body(model.surface_kinds, model.sigma[carried:] * u[carried:], model.surface)


@borrowing
def _magnitudes_and_departures(block, shares, work, rows, surface, model):
    """Magnitudes of a block, their derivatives by a turn, and those by departures of surface."""
    readings = model.irradiance_4pi, model.fresnel_sqrt
    kinds, stretched = model.surface_kinds, False
    for kind in kinds:
        stretched |= STRETCH <= kind < FACET
    body_magnitude_departures(block, shares, stretched, rows, surface, *readings)
    first = carried_unknowns(model)
    out = rows_of_unknowns(work, first)
    departure_rows(block, shares, rows, kinds, model.sigma[first:], surface, readings[1], out)


@allocating
def cost(u, data, anchor, model, stop_above):
    """Negative logarithm of the posterior, up to a constant (compiled).

    Parameters
    ----------
    u : ndarray, shape (n,)
        Unknowns.
    data : ndarray, shape (n, COLUMNS)
        The light curve: time since the epoch (s), magnitude (of a non-detection that which the
        target is known to be fainter than), directions to Sun and observer
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
    return cost_with(make_cost_work(u.shape[0]), u, data, anchor, model, stop_above)


@borrowing
def cost_with(work, u, data, anchor, model, stop_above):
    """As `cost`, which makes the scratch that is given here."""
    _set_motion(u, model, False, work)
    total = anchor_cost(u, anchor)
    if model.surface_kinds.shape[0] > 0:
        return _sum_of_departed_rows(total, u, data, model, stop_above, work)
    return _sum_of_rows(total, data, model, model.surface, stop_above, work)


@allocating
def _sum_of_departed_rows(total, u, data, model, stop_above, work):
    """`_sum_of_rows` of a body whose surface departs."""
    return _sum_of_rows(total, data, model, _surface(u, model), stop_above, work)


@borrowing
def _sum_of_rows(total, data, model, surface, stop_above, work):
    """Cost of the rows added to that of the anchor, the motion given in the work; see `cost`."""
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


@borrowing
def _misfit(squares, seen, model):
    """Misfit of the detections; never falls as data come in."""
    freedom = model.noise_freedom
    if freedom > 0.0:
        return 0.5 * (freedom + seen) * np.log(1.0 + squares / (freedom * model.noise_variance))
    return 0.5 * squares / model.noise_variance


@njit(cache=True, inline="always")
def _trust(squares, seen, model):
    """Assumed noise variance over the one expected in view of the residuals; 1 if it is known."""
    freedom, assumed = model.noise_freedom, model.noise_variance
    return (freedom + seen) * assumed / (freedom * assumed + squares) if freedom > 0.0 else 1.0


@allocating
def cost_and_derivatives(u, data, anchor, model, gradient, information):
    """Cost, its gradient (n,), and the Gauss-Newton approximation of its Hessian (n, n).

    The latter is ``Lambda + sum_k w_k a_k a_k^T / R``, a_k the gradient of h_k; see `cost`.
    """
    work = make_cost_work(u.shape[0])
    return derivatives_with(work, u, data, anchor, model, gradient, information)


@allocating
def derivatives_with(work, u, data, anchor, model, gradient, information):
    """As `cost_and_derivatives`, which makes the scratch that is given here."""
    _set_motion(u, model, True, work)
    unknowns, total = u.shape[0], anchor_cost(u, anchor)
    if model.surface_kinds.shape[0] > 0:
        total, squares, seen = _products_of_departed(total, u, data, model, work)
    else:
        no_shares = work.block[:0]
        total, squares, seen = _sum_of_products(total, data, model, model.surface, no_shares, work)
    curvatures, slopes = fold(work.products, pull_back_matrix(u, work.start, model.sigma), unknowns)
    trust = _trust(squares, seen, model)
    for i in range(unknowns):
        gradient[i] = trust * slopes[i]
        for j in range(unknowns):
            gradient[i] += anchor.information[i, j] * (u[j] - anchor.mean[j])
            information[i, j] = anchor.information[i, j] + trust * curvatures[i, j]
    return total + _misfit(squares, seen, model)


@allocating
def _products_of_departed(total, u, data, model, work):
    """`_sum_of_products` of a body whose surface departs."""
    surface = _surface(u, model)
    with_shares = np.any(model.surface_kinds >= FACET)
    shares = np.empty((surface.areas.shape[0] if with_shares else 0, LANES))
    return _sum_of_products(total, data, model, surface, shares, work)


@borrowing
def _sum_of_products(total, data, model, surface, shares, work):
    """As `_sum_of_rows`, and the products of the derivatives; the misfit is returned in its parts.

    They are the cost without the detections, the sum of their squares, and their number.
    """
    block, w, track, times = work.block, work.rows, work.track, work.times
    work.products[:, :] = 0.0
    squares, seen, even = 0.0, 0, model.even
    kinds, carried = model.rotation_kinds, carried_unknowns(model)
    turn = TURN_IF_KNOWN if kinds.shape[0] == 0 else TURN_PER_STEP
    inverse_variance = 1.0 / model.noise_variance
    inverse_noise = np.sqrt(inverse_variance)
    for first in range(0, data.shape[0], LANES):
        rows = min(LANES, data.shape[0] - first)
        fill_block(block, w, data, first, rows)
        if even:
            turn_evenly(block, w, rows, work.start, work.omega)
        else:
            read_attitude(block, w, rows, track, times, COLUMNS, work.body, turn)
        if model.surface_kinds.shape[0] > 0:
            _magnitudes_and_departures(block, shares, w, rows, surface, model)
        else:
            readings = model.irradiance_4pi, model.fresnel_sqrt
            body_magnitude_gradients(block, rows, surface, *readings)
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
        pull_back(block, w, rows, work.omega, even, kinds, model.sigma[ROTATION:carried])
        add_products(w, rows, work.products)
    return total, squares, seen
