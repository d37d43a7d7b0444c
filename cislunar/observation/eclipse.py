"""Targets in the shadow of the Earth or Moon: how much of the Sun they see, and how they dim.

The visible share of the Sun's disc is that of the conical shadows of `cislunar.dynamics.radiation`.
A target that throws back sunlight alone is fainter by -2.5 log10 of it, without end in the umbra.

Assumptions and limitations
---------------------------
- The target is a point beside the shadow's edge; light scattered by the Earth's atmosphere into
  its shadow, earthshine and moonshine are left out.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import borrowing
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics.radiation import SUN_RADIUS_KM, visible_sun
from cislunar.observation.sightline import EARTH_RADIUS, MOON_RADIUS

Array = NDArray[np.float64]

_SUN_RADIUS = SUN_RADIUS_KM / LENGTH_UNIT_KM


@borrowing
def _shares(place, sun, primaries, out):
    """Visible shares of the Sun (target, time), into `out`."""
    for k in range(place.shape[1]):
        for j in range(place.shape[0]):
            x, y, z = place[j, k, 0], place[j, k, 1], place[j, k, 2]
            from_sun = (x - sun[k, 0], y - sun[k, 1], z - sun[k, 2])
            out[j, k] = 1.0
            for body, radius in ((0, EARTH_RADIUS), (1, MOON_RADIUS)):
                center = primaries[k, body]
                from_body = (x - center[0], y - center[1], z - center[2])
                out[j, k] *= visible_sun(from_body, from_sun, radius, _SUN_RADIUS)[0]


def sunlit_share(place: ArrayLike, sun: ArrayLike, primaries: ArrayLike) -> Array:
    """Share of the Sun's disc that is seen from places.

    Parameters
    ----------
    place : array_like, shape (target, time, 3)
        Nondimensional.
    sun : array_like, shape (time, 3)
        Nondimensional, in the frame of the places.
    primaries : array_like, shape (time, 2, 3)
        Centres of Earth and Moon.

    Returns
    -------
    ndarray, shape (target, time)
        From 0 in the umbra to 1; NaN where a place is.
    """
    where, light, bodies = (
        np.ascontiguousarray(each, dtype=float) for each in (place, sun, primaries)
    )
    out = np.empty(where.shape[:2])
    _shares(where, light, bodies, out)
    return out


def dimming(place: ArrayLike, sun: ArrayLike, primaries: ArrayLike) -> Array:
    """By how much the shadows of Earth and Moon dim targets.

    Parameters
    ----------
    place, sun, primaries : array_like
        As of `sunlit_share`.

    Returns
    -------
    ndarray, shape (target, time)
        mag; infinite in the umbra.
    """
    with np.errstate(divide="ignore"):
        return -2.5 * np.log10(sunlit_share(place, sun, primaries))
