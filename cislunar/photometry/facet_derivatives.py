"""Derivatives of the facet model's magnitude by attitude, directions and range (compiled).

`cislunar.photometry.facet_blocks` has the derivative by a small rotation of the body. Here the
directions to the Sun and to the observer vary as well, as they do when the body moves. They change
|L + V| and therefore the slope distribution, the attenuation and the Fresnel factor.
"""

import numpy as np

from cislunar.attitude.quaternion import rotate_components
from cislunar.compiled import njit_noalloc
from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.photometry.facets import (
    FLOOR_MAGNITUDE,
    IRRADIANCE_FLOOR,
    LN10,
    facet_sums,
    fresnel_reflectance,
)

ZERO = (0.0, 0.0, 0.0)


@njit_noalloc
def fresnel_slope(cosine, normal_reflectance, fresnel_sqrt):
    """Derivative of `cislunar.photometry.facets.fresnel_reflectance` by the cosine."""
    q = cosine
    root = np.sqrt(normal_reflectance)
    b = (1.0 + root) / (1.0 - root)
    p = q * q - 1.0 + b * b
    slope = 2.0 * q
    if fresnel_sqrt:
        p = np.sqrt(p)
        slope = q / p
    ratio = (p - q) / (p + q)
    ratio_slope = 2.0 * (q * slope - p) / (p + q) ** 2
    above, below = q * (p + q) - 1.0, q * (p - q) + 1.0
    second = above / below
    above_slope = p + q + q * (slope + 1.0)
    below_slope = p - q + q * (slope - 1.0)
    second_slope = (above_slope - second * below_slope) / below
    return ratio * ratio_slope * (1.0 + second * second) + ratio * ratio * second * second_slope


@njit_noalloc
def fresnel_by_reflectance(cosine, normal_reflectance, fresnel_sqrt):
    """Derivative of `cislunar.photometry.facets.fresnel_reflectance` by F0, for F0 > 0."""
    q = cosine
    root = np.sqrt(normal_reflectance)
    b = (1.0 + root) / (1.0 - root)
    by_root = 1.0 / (root * (1.0 - root) * (1.0 - root))  # db/dF0
    p = q * q - 1.0 + b * b
    if fresnel_sqrt:
        p = np.sqrt(p)
        p_slope = b / p * by_root
    else:
        p_slope = 2.0 * b * by_root
    ratio = (p - q) / (p + q)
    above, below = q * (p + q) - 1.0, q * (p - q) + 1.0
    second = above / below
    ratio_slope = 2.0 * q / ((p + q) * (p + q))
    second_slope = q * (1.0 - second) / below
    by_p = ratio * ratio_slope * (1.0 + second * second) + ratio * ratio * second * second_slope
    return by_p * p_slope


@njit_noalloc
def facet_magnitude_derivatives(
    quaternion, sun_direction, view_direction, range_m, areas, normals, material,
    irradiance_4pi, fresnel_sqrt,
):  # fmt: skip
    """Apparent magnitude with its derivatives by attitude, directions and range (compiled).

    See `cislunar.photometry.facets.facet_irradiance` for the arguments. The derivatives are those
    by a small rotation (mag/rad, body frame, as in `facet_blocks.block_magnitude_gradients`), by
    the unit vectors to the Sun and to the observer (mag/rad, inertial frame; only the components
    perpendicular to the vector are meaningful), and by log r (mag). All are zero for a dark object.
    """
    q1, q2, q3, q4 = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    sx, sy, sz = sun_direction[0], sun_direction[1], sun_direction[2]
    wx, wy, wz = view_direction[0], view_direction[1], view_direction[2]
    hx, hy, hz = sx + wx, sy + wy, sz + wz
    half2 = hx * hx + hy * hy + hz * hz
    half = np.sqrt(half2)
    lx, ly, lz = rotate_components(q1, q2, q3, q4, sx, sy, sz)
    vx, vy, vz = rotate_components(q1, q2, q3, q4, wx, wy, wz)
    fresnel = fresnel_reflectance(0.5 * half, material[4], fresnel_sqrt)
    total, (ax, ay, az), (bx, by, bz), by_half2, shine = facet_sums(
        (lx, ly, lz), (vx, vy, vz), half2, fresnel, areas, normals, material
    )
    spread = np.pi * range_m * range_m
    if irradiance_4pi:
        spread *= 4.0 * np.pi
    flux = total / spread
    if flux <= IRRADIANCE_FLOOR:
        return FLOOR_MAGNITUDE, ZERO, ZERO, ZERO, 0.0
    if fresnel > 0.0:
        # cosine |L + V| / 2, whose derivative by |L + V|^2 is 1 / (4 |L + V|)
        slope = fresnel_slope(0.5 * half, material[4], fresnel_sqrt)
        by_half2 += shine * slope / fresnel * 0.25 / half
    scale = -2.5 / (LN10 * total)
    turn = (
        scale * (ay * lz - az * ly + by * vz - bz * vy),
        scale * (az * lx - ax * lz + bz * vx - bx * vz),
        scale * (ax * ly - ay * lx + bx * vy - by * vx),
    )
    ax, ay, az = rotate_components(-q1, -q2, -q3, q4, ax, ay, az)
    bx, by, bz = rotate_components(-q1, -q2, -q3, q4, bx, by, bz)
    common = 2.0 * by_half2
    by_sun = scale * (ax + common * hx), scale * (ay + common * hy), scale * (az + common * hz)
    by_view = scale * (bx + common * hx), scale * (by + common * hy), scale * (bz + common * hz)
    magnitude = SUN_APPARENT_MAGNITUDE - 2.5 * np.log10(flux)
    return magnitude, turn, by_sun, by_view, 5.0 / LN10
