"""Observations of static targets that are lost in the shadows of the Earth and Moon.

Few targets are ever in a shadow. The tables are therefore computed for lit targets, and the lost
observations are subtracted. The dimming is that of `cislunar.observation.sightline`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import njit
from cislunar.dynamics.cr3bp import primary_positions
from cislunar.observation.sightline import outside_exclusion, sphere_brighter, sunlit_share
from cislunar.runtime import Array

_TARGETS_AT_ONCE = 256


class _Shade(NamedTuple):
    """Result of `shade_of`."""

    time: NDArray[np.int64]
    target: NDArray[np.int64]
    share: Array


def shade_of(target: Array, sun: Array, mu: float, length: ArrayLike = 1.0) -> _Shade:
    """Find the targets in shadow.

    Parameters
    ----------
    target : ndarray, shape (target, 3)
        Nondimensional, rotating frame.
    sun : ndarray, shape (time, 3)
        Nondimensional, rotating frame.
    mu : float
        Mass ratio.
    length : array_like, shape (time,) or ()
        Unit of length of the frame in units of l*; the radii of Earth and Moon are constant in km.

    Returns
    -------
    NamedTuple
        ``time`` and ``target``, shape (pair,), the indices of the pairs in shadow, and ``share``,
        shape (pair,), the visible share of the Sun's disc, below 1.
    """
    unit = np.broadcast_to(np.asarray(length, dtype=float), len(sun))[:, None]
    primaries = unit[..., None] * np.array(primary_positions(mu))
    found = []
    for first in range(0, len(target), _TARGETS_AT_ONCE):
        some = target[first : first + _TARGETS_AT_ONCE]
        share = sunlit_share(unit * some[:, None], unit * sun, primaries)
        which, when = np.nonzero(share < 1.0)
        found.append((when, first + which, share[which, when]))
    return _Shade(*(np.concatenate(column) for column in zip(*found, strict=True)))


@njit(cache=True, error_model="numpy")
def _lost(track, target, sun, cosines, faintness, primaries, shade, out):
    """Which observations of shaded pairs each track (n, time, 3) loses to the shadow, (n, pair)."""
    for i in range(shade.time.size):
        k, place, light = shade.time[i], target[shade.target[i]], sun[shade.time[i]]
        x, y, z, needed = place[0], place[1], place[2], faintness[k]
        fx, fy, fz = x - light[0], y - light[1], z - light[2]
        for n in range(track.shape[0]):
            ox, oy, oz = track[n, k, 0], track[n, k, 1], track[n, k, 2]
            dx, dy, dz = x - ox, y - oy, z - oz
            out[n, i] = sphere_brighter(dx, dy, dz, fx, fy, fz, needed)
            if not out[n, i]:
                continue
            share = shade.share[i]
            bright = share > 0.0 and sphere_brighter(dx, dy, dz, fx, fy, fz, needed / share)
            clear = outside_exclusion(ox, oy, oz, dx, dy, dz, light, cosines, primaries)
            out[n, i] = clear and not bright


def lost_observations(
    track: Array, target: Array, sun: Array, cosines: Array, faintness: Array, mu: float,
    shade: _Shade,
) -> NDArray[np.bool_]:  # fmt: skip
    """Which observations of lit targets are lost in the shadow.

    Parameters
    ----------
    track : ndarray, shape (..., time, 3)
        Positions of observers, nondimensional, rotating frame.
    target, sun, cosines, faintness, mu
        See `cislunar.visibility.kernel.count_observations`.
    shade : Shade
        From `shade_of`.

    Returns
    -------
    ndarray of bool, shape (..., pair)
    """
    flat = np.ascontiguousarray(track).reshape(-1, *track.shape[-2:])
    out = np.zeros((len(flat), shade.time.size), dtype=np.bool_)
    primaries = np.array(primary_positions(mu))
    _lost(flat, target, sun, cosines, faintness, primaries, shade, out)
    return out.reshape(*track.shape[:-2], -1)
