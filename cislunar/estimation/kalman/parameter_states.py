"""Body parameters as further states of the unscented filter, and the variance of its magnitudes.

The states of a target are the deviations of its body (rotation, then surface), attitude error,
angular velocity, position and velocity. The deviations are constant. The root of the covariance is
lower triangular with the deviations first; therefore only the sigma points of their own columns
have other bodies than the central point.

The variance of a magnitude is a factor times the assumed variance. It is known, or estimated by the
variational Bayesian filter of Sarkka & Nummenmaa (2009, eqs. 20-27): the factor has an
inverse-gamma distribution, which is independent of the state in the approximation, and spreads with
a forgetting factor rho between measurements. With the shape parameter at its stationary value
N / 2, where N = 1 / (1 - rho), the mean factor is an exponential average over N magnitudes,

    lambda = (1 - 1 / N) lambda_before + E[e^2] / (N r),

where r is the assumed variance and e the error of the measured magnitude. Its second moment depends
on lambda, so that the equations are iterated. With c, the innovation of the magnitude given those
of the angles, and s, its variance without the error of the magnitude,

    E[e^2] = (lambda r c / (lambda r + s))^2 + lambda r s / (lambda r + s).

The even part of the unscented transform belongs to s.
"""

import numpy as np

from cislunar.attitude.quaternion import multiply_components
from cislunar.compiled import njit_alloc, njit_noalloc
from cislunar.estimation.expected import attitude_error, expected_directions, set_geometry
from cislunar.observation.target_surfaces import body_of
from cislunar.photometry.body_blocks import body_magnitudes
from cislunar.photometry.facet_blocks import MAGNITUDE, QUATERNION
from cislunar.photometry.facets import FLOOR_MAGNITUDE
from cislunar.photometry.parameter_deviations import perturbed_body

_MOTION = 12
"""States of the motion."""

_ITERATIONS = 10
"""Iterations for the variance. They are monotonic, because the second moment grows with lambda."""


@njit_noalloc
def _set_attitude(block, lane, quaternion, motion, column, scale):
    """Attitude of a sigma point, given the rows of the motion (12, n) of the root."""
    q1, q2, q3, q4 = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    d1, d2, d3, d4 = attitude_error(motion, column, scale)
    q1, q2, q3, q4 = multiply_components(d1, d2, d3, d4, q1, q2, q3, q4)
    block[QUATERNION, lane], block[QUATERNION + 1, lane] = q1, q2
    block[QUATERNION + 2, lane], block[QUATERNION + 3, lane] = q3, q4


@njit_alloc
def expected_of_bodies(
    bundle, quaternion, parameters, root, spread, observer, axes, sun, to_inertial, surfaces, j,
    rotation_kinds, kinds, block, expected,
):  # fmt: skip
    """`cislunar.estimation.expected.expected_measurements` with deviations of the body as states.

    `parameters` (p,) are the mean deviations of target j; those of the surface have the `kinds` and
    follow those of the `rotation_kinds`.
    """
    p, n = parameters.shape[0], root.shape[0]
    first, motion = rotation_kinds.shape[0], root[root.shape[0] - _MOTION :]
    readings = surfaces.irradiance_4pi, surfaces.fresnel_sqrt
    undetectable = 0
    # the central point and those of the motion share the mean body
    body = perturbed_body(kinds, parameters[first:], body_of(surfaces, j))
    count = 2 * _MOTION + 1
    for lane in range(count):
        point = lane if lane == 0 else lane + (p if lane <= _MOTION else 2 * p)
        set_geometry(block, lane, point, bundle, observer, sun, to_inertial)
        scale = 0.0 if lane == 0 else (spread if lane <= _MOTION else -spread)
        _set_attitude(block, lane, quaternion, motion, (point - 1) % n, scale)
    body_magnitudes(block, np.int64(count), body, *readings)
    magnitude0 = block[MAGNITUDE, 0]
    undetectable += magnitude0 == FLOOR_MAGNITUDE
    for lane in range(1, count):
        point = lane + (p if lane <= _MOTION else 2 * p)
        undetectable += block[MAGNITUDE, lane] == FLOOR_MAGNITUDE
        expected[point - 1, 0] = block[MAGNITUDE, lane] - magnitude0
    for i in range(p):
        for sign in range(2):
            point, scale = (1 + i, spread) if sign == 0 else (1 + n + i, -spread)
            amounts = parameters[first:] + scale * root[first:p, i]
            body = perturbed_body(kinds, amounts, body_of(surfaces, j))
            set_geometry(block, 0, point, bundle, observer, sun, to_inertial)
            _set_attitude(block, 0, quaternion, motion, i, scale)
            body_magnitudes(block, np.int64(1), body, *readings)
            undetectable += block[MAGNITUDE, 0] == FLOOR_MAGNITUDE
            expected[point - 1, 0] = block[MAGNITUDE, 0] - magnitude0
    ra0, dec0 = expected_directions(bundle, observer, axes, expected[:, 1:])
    return magnitude0, ra0, dec0, undetectable


@njit_noalloc
def variance_factor(cross, even, innovation, variance, factor, memory):
    """Factor on the assumed `variance` of a magnitude after its measurement (see above).

    `cross` (n, 3) and `even` (3, 3) are those of
    `cislunar.estimation.unscented.innovation_moments` with any noise of the angles, but without
    that of the magnitude; `innovation` (3,) has the magnitude first. `factor` is that before the
    measurement, `memory` N.
    """
    p00, p01, p02 = even[0, 0], even[0, 1], even[0, 2]
    p11, p12, p22 = even[1, 1], even[1, 2], even[2, 2]
    for i in range(cross.shape[0]):
        u0, u1, u2 = cross[i, 0], cross[i, 1], cross[i, 2]
        p00, p01, p02 = p00 + u0 * u0, p01 + u0 * u1, p02 + u0 * u2
        p11, p12, p22 = p11 + u1 * u1, p12 + u1 * u2, p22 + u2 * u2
    # Cholesky factor of the angles' covariance, and regression of the magnitude on them
    l11 = np.sqrt(p11)
    l21 = p12 / l11
    l22 = np.sqrt(p22 - l21 * l21)
    g1 = p01 / l11
    g2 = (p02 - l21 * g1) / l22
    z1 = innovation[1] / l11
    z2 = (innovation[2] - l21 * z1) / l22
    squared = (innovation[0] - g1 * z1 - g2 * z2) ** 2
    state = max(p00 - g1 * g1 - g2 * g2, 0.0)
    share = 1.0 / memory
    kept = (1.0 - share) * factor
    found = kept
    for _ in range(_ITERATIONS):
        noise = found * variance
        part = noise / (noise + state)
        found = kept + share * (part * part * squared + part * state) / variance
    return found
