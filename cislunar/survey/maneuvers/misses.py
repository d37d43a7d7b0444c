"""Exposures that would have detected a known orbit's object, had it been where it is predicted.

For each exposure after the last detection of an orbit, or after another time, in whose field the
predicted direction lies with three standard deviations of margin, the probability p of a detection
follows from the size and the scatter that the orbit's own magnitudes imply. It is zero in the umbra
of Earth and Moon, and if there is a detection next to the predicted direction, whether it has been
linked or not, unless this detection is known to be of another orbit. Brightness
varies slowly: the visits of an observer within a block of time count as one, with the largest p,
and the magnitude of a body may differ from that of its sphere by the same d in all of them. Toward
an observer o a body may moreover be dark for hours, with the probability e. The probability of no
detection is

    m = int N(d; 0, s^2) product over o of (e + (1 - e) product of (1 - c p(d))) dd,           (1)

with c < 1 because the assumed brightness of a sphere is not that of the body.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from cislunar.compiled import njit, njit_noalloc
from cislunar.elementary import normal_cdf
from cislunar.observation import Scene, SensorLimits, limits_of, sunlit_share_at
from cislunar.orbit_determination import Angles, OrbitFits, implied_size
from cislunar.runtime import Array, Indices
from cislunar.survey.fields import faintness_of, sphere_margin_at
from cislunar.survey.maneuvers.lineage import OrbitPaths

_TRUST = 0.9
"""c of equation (1)."""

_DARK = 0.05
"""e of equation (1): the misses of one observer alone do not show that an object is elsewhere."""

_OFFSET, _SHARE = np.polynomial.hermite_e.hermegauss(9)
"""d / s of equation (1), and weights of the integral."""

_MARGIN = 3.0
"""Standard deviations of the direction between it and the edge of a field."""

_NEXT = float(np.deg2rad(0.02))
"""Distance within which a detection, besides these standard deviations, may be of the orbit."""


class FieldHistory(NamedTuple):
    """Exposures of a survey so far, sorted by time.

    Attributes
    ----------
    index : ndarray of int, shape (exposure,)
        Times of the scene.
    observer : ndarray of int, shape (exposure,)
    boresight : ndarray, shape (exposure, 3)
        Unit vectors, propagation frame.
    half_field : ndarray, shape (exposure,)
        rad.
    """

    index: Indices
    observer: Indices
    boresight: Array
    half_field: Array


_BLOCK_S = 1200.0
"""Time within which the exposures of an observer count as one, s."""


class Watch(NamedTuple):
    """What tells whether an orbit's object would have been detected.

    Attributes
    ----------
    fields : FieldHistory
    scene : Scene
    limits : SensorLimits
        Of all observers.
    magnitude_sigma : float
        Standard deviation of magnitudes about those of a sphere, mag.
    loss : float
        Share of detectable objects that an exposure loses.
    """

    fields: FieldHistory
    scene: Scene
    limits: SensorLimits
    magnitude_sigma: float
    loss: float


def log_missed(
    fits: OrbitFits,
    angles: Angles,
    which: Indices,
    paths: OrbitPaths,
    watch: Watch,
    *,
    since: Array | None = None,
    of_others: Indices | None = None,
) -> Array:
    """Logarithm of the probability that no exposure after a time detected the object of an orbit,
    if it is where it is predicted.

    Parameters
    ----------
    fits : OrbitFits
        Converged fits of all orbits.
    angles : Angles
        Detections, to whose rows the fits refer.
    which : ndarray of int, shape (n,)
        Orbits.
    paths : OrbitPaths
        Of all orbits, to the last exposure.
    watch : Watch
    since : ndarray, shape (n,), optional
        Times after which exposures count; those of the last detections of the orbits if omitted.
    of_others : ndarray of int, optional
        Rows of detections that are not of these orbits even if they are next to them.

    Returns
    -------
    ndarray, shape (n,)
        Equation (1); 0 for an orbit of unknown brightness.
    """
    fields, scene, limits, magnitude_sigma, loss = watch
    last = angles.time[fits.row[fits.begin[which + 1] - 1]] if since is None else since
    begin = np.searchsorted(fields.index, last.min(initial=np.inf) / scene.step - 1.0)
    fields = FieldHistory(*(each[begin:] for each in fields))
    possible = np.ones(angles.time.size, dtype=bool)
    if of_others is not None:
        possible[of_others] = False
    size, scatter = np.array([_size(fits, angles, k) for k in which.tolist()]).reshape(-1, 2).T
    offset = np.maximum(magnitude_sigma, scatter)[:, None] * _OFFSET
    block = np.floor(fields.index * scene.step_s / _BLOCK_S + 1e-9).astype(np.int64)
    out = np.zeros((*offset.shape, limits.half_field.size))
    spread = np.sqrt(np.trace(paths.covariance[which], axis1=2, axis2=3))
    orbits = which, np.where(np.isfinite(size), last, np.inf), 2.5 * np.log10(size), offset, spread
    seen = angles.time, angles.observer, angles.direction, possible
    own = limits, faintness_of(limits), np.sqrt(limits.noise_variance[:, 0]), 1.0 - loss
    _log_no_detection(fields, block, seen, paths[:2], orbits, scene, own, out)
    each = np.logaddexp(np.log(_DARK), np.log1p(-_DARK) + out).sum(axis=2)
    return logsumexp(each, axis=1, b=_SHARE / _SHARE.sum())


@njit(cache=True, error_model="numpy")
def _log_no_detection(fields, block, seen, paths, orbits, scene, own, out):
    """Add the logarithms of the products over blocks in equation (1) to `out` (orbit, offset,
    observer)."""
    which, last, brighter, offset, spread = orbits
    limits, faintness, sigma, share = own
    n, step = which.size, paths[0][1] - paths[0][0]
    best, place, sigmas = np.zeros(out.shape), np.empty((n, 3)), np.empty(n)
    k = current = -1
    for e in range(fields.index.size):
        if block[e] != current:
            _take_block(best, out)
            current = block[e]
        if fields.index[e] != k:
            k = fields.index[e]
            time = k * scene.step
            m = int(min(max((time - paths[0][0]) // step, 0), paths[0].size - 2))
            u = (time - paths[0][m]) / step
            begin = np.searchsorted(seen[0], time - 0.5 * scene.step)
            end = np.searchsorted(seen[0], time + 0.5 * scene.step)
            for j in range(n):
                if last[j] < time - 0.5 * scene.step:
                    _between(paths[1][which[j], m], paths[1][which[j], m + 1], u, step, place[j])
                    sigmas[j] = spread[j, m + (u > 0.5)]
        o = fields.observer[e]
        limit = limits_of(limits, o)
        for j in range(n):
            if not last[j] < time - 0.5 * scene.step:
                continue
            x, y, z = place[j, 0], place[j, 1], place[j, 2]
            at = scene.observer_position[o, k]
            way = x - at[0], y - at[1], z - at[2]
            inside, distance, gate = _within(
                way, fields.boresight[e], fields.half_field[e], sigmas[j]
            )
            if not inside or _is_near(seen, begin, end, o, way, distance, gate + _NEXT):
                continue
            margin = sphere_margin_at(scene, limit, faintness, o, k, x, y, z)
            lit = sunlit_share_at(x, y, z, scene.sun_position[k], scene.primaries[k])
            margin += 2.5 * np.log10(lit) + brighter[j]
            for q in range(offset.shape[1]):
                chance = share * normal_cdf(margin - offset[j, q], sigma[o])
                best[j, q, o] = max(best[j, q, o], chance)
    _take_block(best, out)


@njit_noalloc
def _take_block(best, out):
    """Add the logarithms of no detection in a block to `out`, and begin the next one."""
    for j in range(best.shape[0]):
        for q in range(best.shape[1]):
            for o in range(best.shape[2]):
                if best[j, q, o] > 0.0:
                    out[j, q, o] += np.log1p(-_TRUST * best[j, q, o])
                    best[j, q, o] = 0.0


@njit_noalloc
def _between(one, two, u, step, out):
    """Position by cubic interpolation between two states, into `out`; u is from 0 to 1."""
    for c in range(3):
        out[c] = (
            (1.0 + 2.0 * u) * (1.0 - u) ** 2 * one[c]
            + u**2 * (3.0 - 2.0 * u) * two[c]
            + step * u * (1.0 - u) * ((1.0 - u) * one[3 + c] - u * two[3 + c])
        )


@njit_noalloc
def _within(way, boresight, half_field, sigma):
    """Whether a field contains the end of a way (3,) with the margin of its direction; the
    distance, and this margin, rad. False for NaN."""
    x, y, z = way
    distance = np.sqrt(x * x + y * y + z * z)
    cosine = (x * boresight[0] + y * boresight[1] + z * boresight[2]) / distance
    gate = _MARGIN * sigma / distance
    return np.arccos(min(1.0, max(-1.0, cosine))) + gate <= half_field, distance, gate


@njit_noalloc
def _is_near(seen, begin, end, o, way, distance, limit):
    """Whether a possible detection by observer o at this time is near a direction."""
    for row in range(begin, end):
        if seen[1][row] == o and seen[3][row]:
            x = way[0] / distance - seen[2][row, 0]
            y = way[1] / distance - seen[2][row, 1]
            z = way[2] / distance - seen[2][row, 2]
            if not np.sqrt(x * x + y * y + z * z) > limit:
                return True
    return False


def _size(fits: OrbitFits, angles: Angles, k: int) -> tuple[float, float]:
    own = slice(fits.begin[k], fits.begin[k + 1])
    return implied_size(fits.position[own], angles.rows(fits.row[own]))
