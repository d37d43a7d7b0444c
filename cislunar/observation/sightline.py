"""Lines of sight: direction, obstacles, and the Sun's light at the target (compiled).

Positions are nondimensional and in the propagation frame. o is the position of the observer and d
the vector from it to the target. `primaries` are the centers of Earth and Moon: a row of
`Scene.primaries`, or `cislunar.dynamics.cr3bp.primary_positions` of a mass ratio.

The visible share of the Sun's disc follows from the conical shadows of
`cislunar.dynamics.radiation`. A target that reflects sunlight only is fainter by -2.5 log10 of the
share, without limit in the umbra.

Assumptions and limitations
---------------------------
- In an eclipse the target is a point. Light scattered by the Earth's atmosphere into its shadow,
  earthshine and moonshine are neglected.
"""

import numpy as np
from numpy.typing import ArrayLike

from cislunar.attitude.rigid_body import matrix_times
from cislunar.compiled import njit_inline, njit_noalloc
from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM
from cislunar.dynamics.radiation import SUN_RADIUS_KM, visible_sun
from cislunar.observation.sensor import sine_of_elevation
from cislunar.runtime import Array
from cislunar.runtime.arguments import array_of

EARTH_RADIUS = EARTH_RADIUS_KM / LENGTH_UNIT_KM
MOON_RADIUS = MOON_RADIUS_KM / LENGTH_UNIT_KM
_SUN_RADIUS = SUN_RADIUS_KM / LENGTH_UNIT_KM
METERS = 1000.0 * LENGTH_UNIT_KM
"""Meters per unit of length."""

SUN, MOON, EARTH = range(3)

CLEAR, BRIGHT, _HIDDEN = range(3)


def wrapped(angle):
    """Angles in [-pi, pi), of angles of any shape."""
    return angle - 2.0 * np.pi * np.floor(0.5 * angle / np.pi + 0.5)


wrap_angle = njit_inline(wrapped)
"""`wrapped` of a single angle, for kernels."""


@njit_noalloc
def direction_angles(dx, dy, dz, axes):
    """Right ascension and declination (rad) of a line of sight; `axes` is the rotation from the
    frame of d to the observer's body frame."""
    bx, by, bz = matrix_times(axes, dx, dy, dz)
    return np.arctan2(by, bx), np.arctan2(bz, np.sqrt(bx * bx + by * by))


@njit_inline
def lit_directions(place, observer, sun, to_inertial):
    """Unit vectors from a target at `place` to Sun and observer (inertial frame), and the distances
    to the observer and to the Sun."""
    dx, dy, dz = place[0] - observer[0], place[1] - observer[1], place[2] - observer[2]
    sx, sy, sz = sun[0] - place[0], sun[1] - place[1], sun[2] - place[2]
    distance = np.sqrt(dx * dx + dy * dy + dz * dz)
    to_sun = np.sqrt(sx * sx + sy * sy + sz * sz)
    view = matrix_times(to_inertial, -dx / distance, -dy / distance, -dz / distance)
    light = matrix_times(to_inertial, sx / to_sun, sy / to_sun, sz / to_sun)
    return light, view, distance, to_sun


@njit_inline
def toward_primary(body, x, y, z, primaries):
    """Vector from a position to the center of the MOON or the EARTH."""
    place = primaries[1] if body == MOON else primaries[0]
    return place[0] - x, place[1] - y, place[2] - z


@njit_noalloc
def outside_exclusion(ox, oy, oz, dx, dy, dz, sun, cosines, primaries):
    """Whether a line of sight is outside the exclusion angles of Sun, Moon and Earth, whose cosines
    are `cosines` (3,)."""
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


@njit_noalloc
def _disc_hides(bx, by, bz, dx, dy, dz, radius):
    """Whether a sphere at b from the observer cuts the segment to d."""
    fraction = (bx * dx + by * dy + bz * dz) / (dx * dx + dy * dy + dz * dz)
    fraction = min(1.0, max(0.0, fraction))
    gx, gy, gz = bx - fraction * dx, by - fraction * dy, bz - fraction * dz
    return gx * gx + gy * gy + gz * gz < radius * radius


@njit_noalloc
def occulted(ox, oy, oz, dx, dy, dz, primaries):
    """Whether the Earth or the Moon is between observer and target."""
    for body, radius in ((EARTH, EARTH_RADIUS), (MOON, MOON_RADIUS)):
        bx, by, bz = toward_primary(body, ox, oy, oz, primaries)
        if _disc_hides(bx, by, bz, dx, dy, dz, radius):
            return True
    return False


@njit_noalloc
def in_clear_view(ox, oy, oz, dx, dy, dz, sun, limits, primaries):
    """Whether there is no `obstacle` to an observation."""
    return obstacle(ox, oy, oz, dx, dy, dz, sun, limits, primaries) == CLEAR


@njit_noalloc
def obstacle(ox, oy, oz, dx, dy, dz, sun, limits, primaries):
    """Obstacle to an observation: CLEAR, BRIGHT (a bright body or daylight) or HIDDEN. A disc hides
    targets if `SensorLimits.occultation` is set. For an observer on the ground the Moon's disc
    does, and the Earth hides targets below the least elevation."""
    if not outside_exclusion(ox, oy, oz, dx, dy, dz, sun, limits.cosines, primaries):
        return BRIGHT
    if limits.ground:
        earth = primaries[0]
        sx, sy, sz = sun[0] - ox, sun[1] - oy, sun[2] - oz
        if sine_of_elevation(ox, oy, oz, sx, sy, sz, earth) > limits.atmosphere[1]:
            return BRIGHT
        if sine_of_elevation(ox, oy, oz, dx, dy, dz, earth) < limits.atmosphere[0]:
            return _HIDDEN
        bx, by, bz = toward_primary(MOON, ox, oy, oz, primaries)
        hidden = limits.occultation and _disc_hides(bx, by, bz, dx, dy, dz, MOON_RADIUS)
        return _HIDDEN if hidden else CLEAR
    hidden = limits.occultation and occulted(ox, oy, oz, dx, dy, dz, primaries)
    return _HIDDEN if hidden else CLEAR


@njit_noalloc
def sphere_margin(dx, dy, dz, fx, fy, fz, faintness):
    """Amount by which a diffuse sphere is brighter than a limit, mag; see `sphere_brighter`."""
    squared = dx * dx + dy * dy + dz * dz
    cosine = (dx * fx + dy * fy + dz * fz) / np.sqrt(squared * (fx * fx + fy * fy + fz * fz))
    cosine = min(1.0, max(-1.0, cosine))
    alpha = np.arccos(cosine)
    phase = np.sin(alpha) + (np.pi - alpha) * cosine
    return 2.5 * np.log10(max(0.0, phase) / (faintness * squared))


@njit_noalloc
def sphere_brighter(dx, dy, dz, fx, fy, fz, faintness):
    """Whether a diffuse sphere is brighter than a limit; f is the vector from the Sun to the
    sphere, and `faintness` is `cislunar.photometry.sphere.faintness_per_squared_range` per squared
    unit of length."""
    squared = dx * dx + dy * dy + dz * dz
    cosine = (dx * fx + dy * fy + dz * fz) / np.sqrt(squared * (fx * fx + fy * fy + fz * fz))
    cosine = min(1.0, max(-1.0, cosine))
    alpha = np.arccos(cosine)
    return np.sin(alpha) + (np.pi - alpha) * cosine > faintness * squared


@njit_noalloc
def inside_primary(x, y, z, primaries):
    """Whether a position lies within the Earth or the Moon."""
    for body, radius in ((EARTH, EARTH_RADIUS), (MOON, MOON_RADIUS)):
        bx, by, bz = toward_primary(body, x, y, z, primaries)
        if bx * bx + (by * by + bz * bz) < radius * radius:
            return True
    return False


@njit_noalloc
def sunlit_share_at(x, y, z, sun, primaries):
    """Visible share of the Sun's disc at a position."""
    from_sun, share = (x - sun[0], y - sun[1], z - sun[2]), 1.0
    for body, radius in ((0, EARTH_RADIUS), (1, MOON_RADIUS)):
        center = primaries[body]
        from_body = (x - center[0], y - center[1], z - center[2])
        share *= visible_sun(from_body, from_sun, radius, _SUN_RADIUS)[0]
    return share


@njit_noalloc
def _shares(place, sun, primaries, out):
    """Visible shares of the Sun's disc (target, time), into `out`."""
    for k in range(place.shape[1]):
        for j in range(place.shape[0]):
            x, y, z = place[j, k, 0], place[j, k, 1], place[j, k, 2]
            out[j, k] = sunlit_share_at(x, y, z, sun[k], primaries[k])


def sunlit_share(place: ArrayLike, sun: ArrayLike, primaries: ArrayLike) -> Array:
    """Share of the Sun's disc that is visible from given positions.

    Parameters
    ----------
    place : array_like, shape (target, time, 3)
        Positions, nondimensional.
    sun, primaries : array_like, shapes (time, 3) and (time, 2, 3)
        Sun, and centers of Earth and Moon, in the frame of the positions.

    Returns
    -------
    ndarray, shape (target, time)
        From 0 in the umbra to 1; NaN where a position is NaN.

    Raises
    ------
    ConfigurationError
        If a shape is wrong, or the numbers of times disagree.
    """
    where = np.ascontiguousarray(array_of("place", place, (None, None, 3), finite=False))
    times = where.shape[1]
    light = np.ascontiguousarray(array_of("sun", sun, (times, 3), finite=False))
    bodies = np.ascontiguousarray(array_of("primaries", primaries, (times, 2, 3), finite=False))
    out = np.empty(where.shape[:2])
    _shares(where, light, bodies, out)
    return out


def dimming(place: ArrayLike, sun: ArrayLike, primaries: ArrayLike) -> Array:
    """Dimming of targets by the shadows of Earth and Moon, mag; infinite in the umbra. See
    `sunlit_share` for the arguments and the shape."""
    with np.errstate(divide="ignore"):
        return -2.5 * np.log10(sunlit_share(place, sun, primaries))


def unit_vectors(ra: ArrayLike, dec: ArrayLike) -> Array:
    """Unit vectors (..., 3) of directions, rad."""
    a, d = np.asarray(ra, dtype=float), np.asarray(dec, dtype=float)
    return np.stack([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.sin(d)], axis=-1)


def angles_of_vectors(vectors: ArrayLike) -> Array:
    """Right ascension and declination (..., 2), rad, of vectors (..., 3) of any length."""
    x, y, z = np.moveaxis(np.asarray(vectors, dtype=float), -1, 0)
    return np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], axis=-1)
