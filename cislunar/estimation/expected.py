"""Measurements expected at the sigma points of an estimate, compiled (Paul & Fan, section 2.4).
Points of position and velocity are the columns of a bundle (6, 2 n + 1), the central point first.
The expected measurements of the outer points less the central one are the rows of `expected` (2 n,
m)."""

from cislunar.attitude.grp import quaternion_from_grp_components
from cislunar.attitude.quaternion import multiply_components
from cislunar.compiled import njit_inline
from cislunar.observation.sightline import METERS, direction_angles, lit_directions, wrap_angle
from cislunar.observation.target_surfaces import body_of
from cislunar.photometry.body_blocks import body_magnitudes
from cislunar.photometry.facet_blocks import MAGNITUDE, QUATERNION, RANGE, SUN, VIEW
from cislunar.photometry.facets import FLOOR_MAGNITUDE


@njit_inline
def expected_directions(bundle, observer, axes, expected):
    """Right ascension and declination, rad, into the two columns; returns the central ones.

    `observer` (3,) is its position, `axes` the rotation from the propagation frame to its body
    frame.
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


@njit_inline
def attitude_error(root, column, scale):
    """Attitude error of a sigma point as a quaternion: GRP ``scale * root[:3, column]``."""
    return quaternion_from_grp_components(
        scale * root[0, column], scale * root[1, column], scale * root[2, column]
    )


@njit_inline
def set_geometry(block, lane, point, bundle, observer, sun, to_inertial):
    """Directions to Sun and observer (inertial frame) and range of a point, into a column of the
    block."""
    place = bundle[0, point], bundle[1, point], bundle[2, point]
    light, view, distance, _ = lit_directions(place, observer, sun, to_inertial)
    block[SUN, lane], block[SUN + 1, lane], block[SUN + 2, lane] = light
    block[VIEW, lane], block[VIEW + 1, lane], block[VIEW + 2, lane] = view
    block[RANGE, lane] = distance * METERS


@njit_inline
def _set_attitudes(block, count, quaternion, root, spread):
    """Attitudes of the sigma points, into the block. The root (12, 12) is triangular with the
    attitude first, so that only the points of its first six columns differ from the mean attitude.
    """
    q1, q2, q3, q4 = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    size = root.shape[0]
    for point in range(count):
        a1, a2, a3, a4 = q1, q2, q3, q4
        column = (point - 1) % size
        if point > 0 and column < 6:
            d1, d2, d3, d4 = attitude_error(root, column, spread if point <= size else -spread)
            a1, a2, a3, a4 = multiply_components(d1, d2, d3, d4, q1, q2, q3, q4)
        block[QUATERNION, point], block[QUATERNION + 1, point] = a1, a2
        block[QUATERNION + 2, point], block[QUATERNION + 3, point] = a3, a4


@njit_inline
def expected_measurements(
    bundle, quaternion, root, spread, observer, axes, sun, to_inertial, surfaces, j, block, expected
):
    """Magnitudes of target j and directions at the sigma points (Paul & Fan, eqs. 35, 36, 42).

    The magnitudes go into column 0, right ascension and declination into the next two (see
    `expected_directions`). Returns the central values and the number of undetectable points.
    `block` is scratch of the shape that `cislunar.photometry.facet_blocks` takes.
    """
    count = bundle.shape[1]
    for point in range(count):
        set_geometry(block, point, point, bundle, observer, sun, to_inertial)
    _set_attitudes(block, count, quaternion, root, spread)
    body_magnitudes(
        block, count, body_of(surfaces, j), surfaces.irradiance_4pi, surfaces.fresnel_sqrt
    )
    magnitude0, undetectable = block[MAGNITUDE, 0], 0
    for point in range(count):
        undetectable += block[MAGNITUDE, point] == FLOOR_MAGNITUDE
        if point > 0:
            expected[point - 1, 0] = block[MAGNITUDE, point] - magnitude0
    ra0, dec0 = expected_directions(bundle, observer, axes, expected[:, 1:])
    return magnitude0, ra0, dec0, undetectable
