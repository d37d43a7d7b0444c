"""Physical constants and the units of the Earth-Moon system.

The circular restricted three-body problem (CR3BP) is nondimensional: lengths are in units of
`LENGTH_UNIT_KM` and times in units of `TIME_UNIT_S`, so that the distance of the primaries is one
and the frame rotates by one radian per unit of time.
"""

from math import sqrt

MU: float = 0.01215
"""Mass ratio of the Moon to Earth plus Moon (Paul & Fan, section 2.1)."""

LENGTH_UNIT_KM: float = 384_400.0
"""Earth-Moon distance l*, km."""

_GM_EARTH_KM3_S2: float = 398_600.4418
"""Gravitational parameter of the Earth, km^3/s^2."""

GM_MOON_KM3_S2: float = 4_902.8001
"""Gravitational parameter of the Moon, km^3/s^2."""

TIME_UNIT_S: float = sqrt(LENGTH_UNIT_KM**3 / (_GM_EARTH_KM3_S2 + GM_MOON_KM3_S2))
"""Characteristic time t* = 1/n of the two-body problem with l* and both masses, s (375,190.3)."""

GM_UNIT_KM3_S2: float = LENGTH_UNIT_KM**3 / TIME_UNIT_S**2
"""Unit of gravitational parameters in these units, km^3/s^2."""

EARTH_RADIUS_KM: float = 6_378.137
"""Equatorial radius of the Earth (WGS 84), km."""

MOON_RADIUS_KM: float = 1_737.4
"""Mean radius of the Moon (IAU), km."""

SUN_APPARENT_MAGNITUDE: float = -26.74
"""Apparent magnitude of the Sun at 1 au in Johnson V (Paul & Fan, section 2.2)."""

EPOCH_JD: float = 2_460_584.5
"""Initial epoch, Julian date UTC: 2024-10-01 00:00:00 (Paul & Fan, table 1)."""

SECONDS_PER_DAY: float = 86_400.0

DATE_SYSTEM = "UTC"
"""Time scale of the dates in files that are written, unless another is requested."""
