"""Lines of sight: their direction, the bodies in view, and what stands in the way (compiled).

Positions are nondimensional; o is the observer and d the way from it to the target. `primaries` are
the places of Earth and Moon: a row of `Scene.primaries`, or `cislunar.dynamics.cr3bp.
primary_positions` of a mass ratio.
"""

import numpy as np
from numba import njit

from cislunar.compiled import borrowing
from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM
from cislunar.observation.sensor import sine_of_elevation

EARTH_RADIUS = EARTH_RADIUS_KM / LENGTH_UNIT_KM
MOON_RADIUS = MOON_RADIUS_KM / LENGTH_UNIT_KM
METRES = 1000.0 * LENGTH_UNIT_KM
"""Metres in the unit of length."""

SUN, MOON, EARTH = range(3)

CLEAR, BRIGHT, HIDDEN = range(3)


@njit(cache=True, inline="always")
def wrap_angle(angle):
    """An angle in [-pi, pi)."""
    return angle - 2.0 * np.pi * np.floor(0.5 * angle / np.pi + 0.5)


@njit(cache=True, inline="always")
def rotate(axes, x, y, z):
    """Product of a 3 x 3 matrix and a vector, as scalars."""
    return (
        axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z,
        axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z,
        axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z,
    )


@borrowing
def direction_angles(dx, dy, dz, axes):
    """Right ascension and declination (rad) of a line of sight.

    `axes` turns the frame in which d is given into the observer's body.
    """
    bx, by, bz = rotate(axes, dx, dy, dz)
    return np.arctan2(by, bx), np.arctan2(bz, np.sqrt(bx * bx + by * by))


@njit(cache=True, error_model="numpy", inline="always")
def lit_directions(dx, dy, dz, sx, sy, sz, to_inertial):
    """Unit vectors from the target to Sun and observer (inertial frame), and the two distances.

    s is the way from the target to the Sun.
    """
    distance = np.sqrt(dx * dx + dy * dy + dz * dz)
    to_sun = np.sqrt(sx * sx + sy * sy + sz * sz)
    view = rotate(to_inertial, -dx / distance, -dy / distance, -dz / distance)
    light = rotate(to_inertial, sx / to_sun, sy / to_sun, sz / to_sun)
    return light, view, distance, to_sun


@njit(cache=True, error_model="numpy", inline="always")
def toward_primary(body, x, y, z, primaries):
    """The way from a place to the centre of the MOON or the EARTH."""
    place = primaries[1] if body == MOON else primaries[0]
    return place[0] - x, place[1] - y, place[2] - z


@borrowing
def outside_exclusion(ox, oy, oz, dx, dy, dz, sun, cosines, primaries):
    """Whether a line of sight keeps clear of the Sun, Moon and Earth.

    `cosines` (3,) are those of the exclusion angles.
    """
    squared = dx * dx + dy * dy + dz * dz
    for body in range(3):
        if body == SUN:
            bx, by, bz = sun[0] - ox, sun[1] - oy, sun[2] - oz
        else:
            bx, by, bz = toward_primary(body, ox, oy, oz, primaries)
        along = bx * dx + by * dy + bz * dz
        if along >= cosines[body] * np.sqrt(squared * (bx * bx + by * by + bz * bz)):
            return False
    return True


@borrowing
def _disc_hides(bx, by, bz, dx, dy, dz, radius):
    """Whether a sphere at b from the observer cuts the segment to d."""
    fraction = (bx * dx + by * dy + bz * dz) / (dx * dx + dy * dy + dz * dz)
    fraction = min(1.0, max(0.0, fraction))
    gx, gy, gz = bx - fraction * dx, by - fraction * dy, bz - fraction * dz
    return gx * gx + gy * gy + gz * gz < radius * radius


@borrowing
def occulted(ox, oy, oz, dx, dy, dz, primaries):
    """Whether the Earth or the Moon stands between observer and target."""
    for body, radius in ((EARTH, EARTH_RADIUS), (MOON, MOON_RADIUS)):
        bx, by, bz = toward_primary(body, ox, oy, oz, primaries)
        if _disc_hides(bx, by, bz, dx, dy, dz, radius):
            return True
    return False


@borrowing
def in_clear_view(ox, oy, oz, dx, dy, dz, sun, limits, primaries):
    """Whether nothing is in the way of a look, see `obstacle`."""
    return obstacle(ox, oy, oz, dx, dy, dz, sun, limits, primaries) == CLEAR


@borrowing
def obstacle(ox, oy, oz, dx, dy, dz, sun, limits, primaries):
    """What is in the way of a look: CLEAR, BRIGHT (a body, or the day) or HIDDEN.

    A target is hidden by a disc, where `SensorLimits` heed it; on the ground by that of the Moon,
    and by the Earth where it stands too low.
    """
    if not outside_exclusion(ox, oy, oz, dx, dy, dz, sun, limits.cosines, primaries):
        return BRIGHT
    if limits.ground:
        earth = primaries[0]
        sx, sy, sz = sun[0] - ox, sun[1] - oy, sun[2] - oz
        if sine_of_elevation(ox, oy, oz, sx, sy, sz, earth) > limits.atmosphere[1]:
            return BRIGHT
        if sine_of_elevation(ox, oy, oz, dx, dy, dz, earth) < limits.atmosphere[0]:
            return HIDDEN
        bx, by, bz = toward_primary(MOON, ox, oy, oz, primaries)
        hidden = limits.occultation and _disc_hides(bx, by, bz, dx, dy, dz, MOON_RADIUS)
        return HIDDEN if hidden else CLEAR
    hidden = limits.occultation and occulted(ox, oy, oz, dx, dy, dz, primaries)
    return HIDDEN if hidden else CLEAR


@borrowing
def sphere_margin(dx, dy, dz, fx, fy, fz, faintness):
    """By how much a diffuse sphere is brighter than a limit, mag; as of `sphere_brighter`."""
    squared = dx * dx + dy * dy + dz * dz
    cosine = (dx * fx + dy * fy + dz * fz) / np.sqrt(squared * (fx * fx + fy * fy + fz * fz))
    cosine = min(1.0, max(-1.0, cosine))
    alpha = np.arccos(cosine)
    phase = np.sin(alpha) + (np.pi - alpha) * cosine
    return 2.5 * np.log10(max(0.0, phase) / (faintness * squared))


@borrowing
def sphere_brighter(dx, dy, dz, fx, fy, fz, faintness):
    """Whether a diffuse sphere outshines a limit; f is the way from the Sun to it.

    `faintness` is that of `cislunar.photometry.sphere.faintness_per_squared_range`, per squared
    unit of length.
    """
    squared = dx * dx + dy * dy + dz * dz
    cosine = (dx * fx + dy * fy + dz * fz) / np.sqrt(squared * (fx * fx + fy * fy + fz * fz))
    cosine = min(1.0, max(-1.0, cosine))
    alpha = np.arccos(cosine)
    return np.sin(alpha) + (np.pi - alpha) * cosine > faintness * squared


@borrowing
def inside_primary(x, y, z, primaries):
    """Whether a place lies within the Earth or the Moon."""
    for body, radius in ((EARTH, EARTH_RADIUS), (MOON, MOON_RADIUS)):
        bx, by, bz = toward_primary(body, x, y, z, primaries)
        if bx * bx + (by * by + bz * bz) < radius * radius:
            return True
    return False
