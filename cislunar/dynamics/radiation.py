"""Solar radiation pressure on a sphere, with the shadows of Earth and Moon (`docs/dynamics.md`).

The acceleration of a "cannonball" of cross-section per mass A/m and coefficient C_R points away
from the Sun, ``nu P C_R (A/m) (au / d)^2`` at the distance d. The visible fraction nu of the Sun's
disc is that of the conical shadow (Montenbruck & Gill 2000, "Satellite Orbits", section 3.4, eqs.
3.75 and 3.85 to 3.94). If both bodies cover the Sun, their fractions are multiplied.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.compiled import for_all_others, implements, njit_inline, njit_noalloc
from cislunar.constants import EARTH_RADIUS_KM, GM_UNIT_KM3_S2, LENGTH_UNIT_KM, MOON_RADIUS_KM
from cislunar.dynamics.forces import Nothing
from cislunar.errors import ConfigurationError
from cislunar.runtime import Array

SUN_RADIUS_KM = 695_700.0
"""Nominal radius of the Sun (IAU 2015 resolution B3), km."""

SOLAR_PRESSURE_N_M2 = 1361.0 / 299_792_458.0
"""Radiation pressure at one astronomical unit: irradiance (Kopp & Lean 2011) over speed of
light."""

ASTRONOMICAL_UNIT_KM = 149_597_870.7


class Radiation(NamedTuple):
    """Radiation pressure, nondimensional: acceleration times squared distance from the Sun, and the
    radii of Earth, Moon and Sun."""

    strength: float
    earth_radius: float
    moon_radius: float
    sun_radius: float


class RadiationOnEach(NamedTuple):
    """As `Radiation`, with a strength, shape (N,), for each state of a bundle."""

    strength: Array
    earth_radius: float
    moon_radius: float
    sun_radius: float


class _Sunlight(NamedTuple):
    """Radiation pressure without shadows."""

    strength: float


def radiation(area_to_mass: ArrayLike, reflectivity: ArrayLike) -> Radiation | RadiationOnEach:
    """Radiation pressure on spheres of cross-section per mass `area_to_mass`, m^2/kg, and
    coefficient C_R (1 for absorption, 2 for specular reflection), of all states () or of each state
    of a bundle (N,)."""
    for name, value in (("area_to_mass", area_to_mass), ("reflectivity", reflectivity)):
        each = np.asarray(value, dtype=float)
        if each.ndim > 1 or not np.all(np.isfinite(each) & (each >= 0.0)):
            raise ConfigurationError(
                f"{name} = {value} must be finite and >= 0, one value or one per state"
            )
    km_s2 = 1e-3 * SOLAR_PRESSURE_N_M2 * np.multiply(area_to_mass, reflectivity, dtype=float)
    strength = km_s2 * ASTRONOMICAL_UNIT_KM**2 / GM_UNIT_KM3_S2
    discs = [r / LENGTH_UNIT_KM for r in (EARTH_RADIUS_KM, MOON_RADIUS_KM, SUN_RADIUS_KM)]
    if np.ndim(strength) == 0:
        return Radiation(float(strength), *discs)
    return RadiationOnEach(np.ascontiguousarray(strength), *discs)


@for_all_others
def on_state(radiation, i):
    """Radiation on state i of a bundle."""
    return radiation


@implements(on_state, RadiationOnEach)
def _one_of_each(radiation, i):
    return Radiation(
        radiation.strength[i], radiation.earth_radius, radiation.moon_radius, radiation.sun_radius
    )


@for_all_others
def unshaded(radiation):
    """Radiation without shadows, for positions outside of them."""
    return radiation


@implements(unshaded, Radiation)
def _sunlight_alone(radiation):
    return _Sunlight(radiation.strength)


@for_all_others
def maybe_shaded(radiation, earth, moon, sun):
    """Whether a position, relative to Earth, Moon and Sun, may be in a shadow."""
    return False


@implements(maybe_shaded, Radiation)
def _in_either_cone(radiation, earth, moon, sun):
    return _in_cone(earth, sun, radiation.earth_radius, radiation.sun_radius) | _in_cone(
        moon, sun, radiation.moon_radius, radiation.sun_radius
    )


def light(radiation, earth, moon, sun):
    """Strength of the radiation at a position relative to Earth, Moon and Sun, and its gradient."""
    raise NotImplementedError


@implements(light, Nothing)
def _no_light(radiation, earth, moon, sun):
    return 0.0, 0.0, 0.0, 0.0


@implements(light, _Sunlight)
def _whole_sunlight(radiation, earth, moon, sun):
    return radiation.strength, 0.0, 0.0, 0.0


@implements(light, Radiation)
def _shaded_light(radiation, earth, moon, sun):
    return _shaded(radiation, earth, moon, sun)


@njit_noalloc
def _shaded(radiation, earth, moon, sun):
    strength, gx, gy, gz = radiation.strength, 0.0, 0.0, 0.0
    if _in_cone(earth, sun, radiation.earth_radius, radiation.sun_radius):
        seen, ux, uy, uz = visible_sun(earth, sun, radiation.earth_radius, radiation.sun_radius)
        gx, gy, gz = strength * ux, strength * uy, strength * uz
        strength *= seen
    if _in_cone(moon, sun, radiation.moon_radius, radiation.sun_radius):
        seen, ux, uy, uz = visible_sun(moon, sun, radiation.moon_radius, radiation.sun_radius)
        gx, gy, gz = gx * seen + strength * ux, gy * seen + strength * uy, gz * seen + strength * uz
        strength *= seen
    return strength, gx, gy, gz


@njit_inline
def _in_cone(body, sun, radius, sun_radius):
    """Whether a position, relative to a body and to the Sun, may be in the penumbra (conservative).
    The penumbra widens by (R_sun + R) / d per unit of length l behind the body, and starts less
    than R / 100 before its center."""
    x, y, z = body
    sx, sy, sz = x - sun[0], y - sun[1], z - sun[2]
    d2 = sx * sx + sy * sy + sz * sz
    r2 = x * x + y * y + z * z
    along = -(x * sx + y * sy + z * sz)
    behind2 = along * along / d2
    # (R + l k)^2 <= 2 R^2 + 2 (l k)^2, and one percent for the neglected cosines.
    spread = (sun_radius + radius) ** 2 / d2
    near = r2 - behind2 < 2.02 * (radius * radius + behind2 * spread)
    return near & ((along > 0.0) | (behind2 < 1e-4 * radius * radius))


@njit_noalloc
def visible_sun(body, sun, radius, sun_radius):
    """Visible fraction of the Sun and its gradient at a position relative to a body and to the Sun.
    All lengths are in one unit."""
    x, y, z = body
    tx, ty, tz = -sun[0], -sun[1], -sun[2]
    to_sun = np.sqrt(tx * tx + ty * ty + tz * tz)
    to_body = np.sqrt(x * x + y * y + z * z)
    # Cosines of the discs' distance and of the sum or difference of their radii decide on full
    # visibility or umbra; only the penumbra needs angles.
    sun_sine, disc_sine = sun_radius / to_sun, min(1.0, radius / to_body)
    both = np.sqrt((1.0 - sun_sine * sun_sine) * (1.0 - disc_sine * disc_sine))
    cosine = -(tx * x + ty * y + tz * z) / (to_sun * to_body)
    if cosine <= both - sun_sine * disc_sine:
        return 1.0, 0.0, 0.0, 0.0
    if disc_sine > sun_sine and cosine >= both + sun_sine * disc_sine:
        return 0.0, 0.0, 0.0, 0.0
    px, py, pz = tx / to_sun, ty / to_sun, tz / to_sun
    qx, qy, qz = -x / to_body, -y / to_body, -z / to_body
    sun, disc = np.arcsin(sun_sine), np.arcsin(disc_sine)
    # |p x q| and p . q: the arc cosine alone loses half of its digits near alignment.
    cx, cy, cz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    sine = np.sqrt(cx * cx + cy * cy + cz * cz)
    apart = np.arctan2(sine, cosine)
    area = np.pi * sun * sun
    if apart <= sun - disc:  # annular: the body's disc is within the Sun's
        covered = np.pi * disc * disc
        by_sun, by_disc, by_apart = 0.0, 2.0 * np.pi * disc, 0.0
    else:
        u = (apart * apart + sun * sun - disc * disc) / (2.0 * apart)
        half_chord = np.sqrt(max(0.0, sun * sun - u * u))
        sun_angle = np.arctan2(half_chord, u)
        disc_angle = np.arctan2(half_chord, apart - u)
        covered = sun * sun * sun_angle + disc * disc * disc_angle - apart * half_chord
        by_sun, by_disc = 2.0 * sun * sun_angle, 2.0 * disc * disc_angle
        by_apart = -2.0 * half_chord
    by_sun -= 2.0 * covered / sun
    # Angular radii change along the lines of sight, the angular distance perpendicular to them.
    along_p = by_sun * np.tan(sun) / to_sun
    # inside a body its disc is half of the sky, independent of position
    along_q = by_disc * np.tan(disc) / to_body if disc_sine < 1.0 else 0.0
    across = by_apart / sine if sine > 0.0 else 0.0
    p_part = along_p - across * cosine / to_sun + across / to_body
    q_part = along_q - across * cosine / to_body + across / to_sun
    scale = -1.0 / area
    return (
        1.0 - covered / area,
        scale * (p_part * px + q_part * qx),
        scale * (p_part * py + q_part * qy),
        scale * (p_part * pz + q_part * qz),
    )
