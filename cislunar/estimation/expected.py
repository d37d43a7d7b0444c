"""Measurements expected at the sigma points of an estimate, compiled (Paul & Fan, section 2.4).

The points of position and velocity lie in the columns of a bundle, shape (6, 2 n + 1), the central
one first. What is expected at the outer ones less the central one goes into the columns of
`expected`, shape (2 n, m).
"""

from numba import njit

from cislunar.attitude.grp import GRP_A, GRP_F, quaternion_from_grp_components
from cislunar.attitude.quaternion import multiply_components
from cislunar.observation.measurement import target_magnitude
from cislunar.observation.sightline import direction_angles, wrap_angle
from cislunar.photometry.facets import FLOOR_MAGNITUDE


@njit(cache=True, error_model="numpy", inline="always")
def expected_directions(bundle, observer, axes, expected):
    """Right ascension and declination, rad, into the two columns; returns the central ones.

    `observer` (3,) is its position, `axes` the rotation from the rotating frame to its body.
    """
    ra0, dec0 = 0.0, 0.0
    for point in range(bundle.shape[1]):
        ra, dec = direction_angles(
            bundle[0, point] - observer[0],
            bundle[1, point] - observer[1],
            bundle[2, point] - observer[2],
            axes,
        )
        if point == 0:
            ra0, dec0 = ra, dec
        else:
            expected[point - 1, 0] = wrap_angle(ra - ra0)
            expected[point - 1, 1] = dec - dec0
    return ra0, dec0


@njit(cache=True, error_model="numpy", inline="always")
def attitude_error(root, column, scale):
    """Attitude error of a sigma point, as a quaternion: GRP ``scale * root[:3, column]``."""
    return quaternion_from_grp_components(
        scale * root[0, column], scale * root[1, column], scale * root[2, column], GRP_A, GRP_F
    )


@njit(cache=True, error_model="numpy", inline="always")
def expected_measurements(
    bundle, quaternion, root, spread, observer, axes, sun, to_inertial, surfaces, j, expected
):
    """Magnitudes of target j and directions at the sigma points (Paul & Fan, eqs. 35, 36, 42).

    The magnitudes go into column 0, right ascension and declination, as in `expected_directions`,
    into the next two; returns the central ones, and how many points are dark. One pass lets the
    processor overlap the two.
    The root (12, 12) being triangular with the attitude first, only the points of its first six
    columns differ from the mean attitude.
    """
    q = (quaternion[0], quaternion[1], quaternion[2], quaternion[3])
    size = root.shape[0]
    magnitude0, ra0, dec0, dark = 0.0, 0.0, 0.0, 0
    for point in range(bundle.shape[1]):
        x, y, z = bundle[0, point], bundle[1, point], bundle[2, point]
        attitude = q
        column = (point - 1) % size
        if point > 0 and column < 6:
            d1, d2, d3, d4 = attitude_error(root, column, spread if point <= size else -spread)
            attitude = multiply_components(d1, d2, d3, d4, q[0], q[1], q[2], q[3])
        dx, dy, dz = x - observer[0], y - observer[1], z - observer[2]
        ra, dec = direction_angles(dx, dy, dz, axes)
        magnitude = target_magnitude(
            dx, dy, dz, sun[0] - x, sun[1] - y, sun[2] - z, to_inertial, attitude, surfaces, j
        )
        dark += magnitude == FLOOR_MAGNITUDE
        if point == 0:
            magnitude0, ra0, dec0 = magnitude, ra, dec
        else:
            expected[point - 1, 0] = magnitude - magnitude0
            expected[point - 1, 1] = wrap_angle(ra - ra0)
            expected[point - 1, 2] = dec - dec0
    return magnitude0, ra0, dec0, dark
