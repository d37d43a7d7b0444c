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

from cislunar.observation import Scene, SensorLimits
from cislunar.orbit_determination import Angles, OrbitFits, implied_size
from cislunar.runtime import Array, Flags, Indices
from cislunar.survey.fields import detection_probability, views
from cislunar.survey.maneuvers.lineage import OrbitPaths

_TRUST = 0.9
"""c of equation (1)."""

_DARK = 0.05
"""e of equation (1): the misses of one observer alone do not show that an object is elsewhere."""

_OFFSET, _SHARE = np.polynomial.hermite_e.hermegauss(9)
"""d / s of equation (1), and weights of the integral."""

_MARGIN = 3.0
"""Standard deviations of the direction between it and the edge of a field."""

_NEXT = np.deg2rad(0.02)
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
    possible = np.ones(angles.time.size, dtype=bool)
    if of_others is not None:
        possible[of_others] = False
    size, scatter = np.array([_size(fits, angles, k) for k in which.tolist()]).reshape(-1, 2).T
    known = np.isfinite(size)
    offset = np.maximum(magnitude_sigma, scatter)[:, None] * _OFFSET
    sigma = np.sqrt(limits.noise_variance[:, :1])
    block = np.floor(fields.index * scene.step_s / _BLOCK_S + 1e-9).astype(np.int64)
    after = np.unique(fields.index[fields.index * scene.step > last.min(initial=np.inf)])
    best = np.zeros((*offset.shape, limits.half_field.size))
    out = np.zeros_like(best)
    current = -1
    for k in after.tolist():
        now = slice(*np.searchsorted(fields.index, [k, k + 1]).tolist())
        time = k * scene.step
        unseen = np.flatnonzero(known & (last < time - 0.5 * scene.step))
        if unseen.size == 0:
            continue
        if block[now.start] != current:
            out += np.log1p(-_TRUST * best)
            best[:], current = 0.0, block[now.start]
        position, spread = _predicted(paths, which[unseen], time)
        good = np.isfinite(position).all(axis=1)
        unseen, position, spread = unseen[good], position[good], spread[good]
        view = _view(fields, now, scene.observer_position[:, k], position, spread)
        if not view.inside.any():
            continue
        exposed = view.inside.any(axis=0)
        margin = np.full((limits.half_field.size, unseen.size), np.nan)
        margin[:, exposed] = views(scene, limits, k, position[exposed], eclipse=True).margin
        seen = slice(*np.searchsorted(angles.time, time + scene.step * np.array([-0.5, 0.5])))
        for e in np.flatnonzero(view.inside.any(axis=1)).tolist():
            way, distance, gate, inside = (each[e] for each in view)
            o = int(fields.observer[now.start + e])
            found = angles.direction[seen][(angles.observer[seen] == o) & possible[seen]]
            if found.size:
                unit = way / distance[:, None]
                apart = np.linalg.norm(unit[:, None] - found, axis=2).min(axis=1)
                inside = inside & (apart > gate + _NEXT)
            rows = unseen[inside]
            if rows.size == 0:
                continue
            bright = margin[o, inside, None] - offset[rows]
            chance = detection_probability(bright, size[rows, None], sigma[o], loss)
            best[rows, :, o] = np.maximum(best[rows, :, o], chance)
    out += np.log1p(-_TRUST * best)
    each = np.logaddexp(np.log(_DARK), np.log1p(-_DARK) + out).sum(axis=2)
    return logsumexp(each, axis=1, b=_SHARE / _SHARE.sum())


class _View(NamedTuple):
    """Positions as the observers of simultaneous exposures see them: ways (exposure, position, 3),
    and distances, margins of the directions (rad) and whether the field contains the position with
    this margin (exposure, position)."""

    way: Array
    distance: Array
    gate: Array
    inside: Flags


def _view(
    fields: FieldHistory, now: slice, observer_position: Array, position: Array, spread: Array
) -> _View:
    """The view of positions with standard deviations in a slice of exposures."""
    way = position - observer_position[fields.observer[now], None]
    distance = np.linalg.norm(way, axis=2)
    cosine = np.einsum("eni,ei->en", way, fields.boresight[now]) / distance
    gate = _MARGIN * spread / distance
    off = np.arccos(np.clip(cosine, -1.0, 1.0))
    return _View(way, distance, gate, off + gate <= fields.half_field[now, None])


def _size(fits: OrbitFits, angles: Angles, k: int) -> tuple[float, float]:
    own = slice(fits.begin[k], fits.begin[k + 1])
    return implied_size(fits.position[own], angles.rows(fits.row[own]))


def _predicted(paths: OrbitPaths, which: Indices, time: float) -> tuple[Array, Array]:
    """Positions (n, 3) by cubic interpolation between times, and standard deviations (n,)."""
    step = paths.time[1] - paths.time[0]
    k = int(np.clip((time - paths.time[0]) // step, 0, paths.time.size - 2))
    u = (time - paths.time[k]) / step
    one, two = paths.state[which, k], paths.state[which, k + 1]
    position = (
        (1.0 + 2.0 * u) * (1.0 - u) ** 2 * one[:, :3] + u**2 * (3.0 - 2.0 * u) * two[:, :3]
        + step * u * (1.0 - u) * ((1.0 - u) * one[:, 3:] - u * two[:, 3:])
    )  # fmt: skip
    variance = np.trace(paths.covariance[which, k + (u > 0.5)], axis1=1, axis2=2)
    return position, np.sqrt(variance)
