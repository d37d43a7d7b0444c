"""Tracklets: detections of one pass of an object by one observer, and their attributables.

Two detections of one observer form a pair if their separation in time, their angular rate and their
difference of magnitude are within the settings. A third detection has to be near the straight path
of the pair on the sky, and each further one on the smooth path of the detections before it. A
detection may be in several tracklets; linking chooses among them. A tracklet is left out if each of
its detections is in a tracklet that has two more, since shorter paths agree by chance more often.

An attributable is the direction and its rate, with covariance, at a reference time. The offsets of
the detections in the plane tangent at their mean direction are fitted by a polynomial of time, in
axes that do not rotate. The same linear estimator is applied to the positions of the observer and
gives its position o and its velocity w, which correspond to the direction u and its rate d. An
object at the range rho with the range rate rho' has the inertial velocity

    v = w + rho' u + rho d                                                                      (1)

(Milani et al. 2004, Icarus 168, 1). Since both are estimated in the same way, the curvature of the
observer's path causes no error in equation (1).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from cislunar.compiled import njit, njit_noalloc
from cislunar.constants import TIME_UNIT_S
from cislunar.errors import ConfigurationError
from cislunar.observation import ARCSECOND
from cislunar.orbit_determination.angles import Angles, tangent_basis
from cislunar.orbit_determination.tracklet_settings import TrackletSettings

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_CURVATURE_CHI_SQUARED = float(chi2.ppf(0.999, 2))
"""Decrease of chi squared from which a path is fitted with a curvature."""

_PATH_LENGTH = 7
"""Detections to whose path another one of a tracklet has to fit, itself included."""

_PATH_LIMITS = (*[np.inf] * 4, *(float(chi2.isf(1e-6, n)) for n in (2, 2, 4, 6)))
"""Largest chi squared of a path of so many detections: a parabola through four, else a cubic."""

_CLEARLY_LONGER = 2
"""How many more detections those tracklets have that may replace another one."""


class Attributables(NamedTuple):
    """Directions and rates of tracklets, in order of time.

    Attributes
    ----------
    time : ndarray, shape (tracklet,)
        Weighted mean time of the detections, nondimensional, since the epoch of the force model.
    observer : ndarray of int, shape (tracklet,)
        Number of the observer.
    observer_position, observer_velocity : ndarray, shape (tracklet, 3)
        Position and inertial velocity of the observer, nondimensional, axes of the propagation
        frame at that time.
    direction, rate : ndarray, shape (tracklet, 3)
        Unit vector, and its derivative in axes that do not rotate; axes of the propagation frame.
    basis : ndarray, shape (tracklet, 2, 3)
        Unit vectors along right ascension and declination.
    covariance : ndarray, shape (tracklet, 4, 4)
        Covariance of direction and rate along the basis, rad and nondimensional time.
    magnitude, magnitude_sigma : ndarray, shape (tracklet,)
        Weighted mean and its standard deviation, mag; NaN if unknown.
    chi_squared : ndarray, shape (tracklet,)
        Squared residuals of the polynomials in variances.
    detections : tuple of ndarray of int
        Rows of the angles of each tracklet.
    """

    time: Array
    observer: Indices
    observer_position: Array
    observer_velocity: Array
    direction: Array
    rate: Array
    basis: Array
    covariance: Array
    magnitude: Array
    magnitude_sigma: Array
    chi_squared: Array
    detections: tuple[Indices, ...]

    def take(self, which: ArrayLike) -> "Attributables":
        """Some of the tracklets, in the order of their indices."""
        chosen = np.atleast_1d(np.asarray(which, dtype=np.int64))
        parts = tuple(self.detections[k] for k in chosen.tolist())
        return Attributables(*(each[chosen] for each in self[:-1]), parts)


def rotate_about_z(vector: ArrayLike, angle: ArrayLike) -> Array:
    """Vectors (..., 3) rotated about z by angles (...), rad, positive from x to y."""
    given = np.asarray(vector, dtype=float)
    x, y, c, s = given[..., 0], given[..., 1], np.cos(angle), np.sin(angle)
    out = np.empty((*np.broadcast_shapes(x.shape, c.shape), 3))
    out[..., 0], out[..., 1], out[..., 2] = c * x - s * y, s * x + c * y, given[..., 2]
    return out


def index_pairs(begin: Indices, end: Indices) -> Indices:
    """Pairs (2, pair) of each index k with those from ``begin[k]`` to before ``end[k]``."""
    count = np.maximum(end - begin, 0)
    first = np.repeat(np.arange(begin.size), count)
    within = np.arange(first.size) - np.repeat(np.cumsum(count) - count, count)
    return np.stack([first, begin[first] + within])


def form_tracklets(
    angles: Angles, settings: TrackletSettings | None = None, *, rate: float = 1.0
) -> list[Indices]:
    """Group detections of each observer into tracklets.

    Parameters
    ----------
    angles : Angles
        Detections, in order of time. Those of one observer at one time are of different objects.
    settings : TrackletSettings, optional
    rate : float
        Angular rate of the propagation frame (`frame_rate`).

    Returns
    -------
    list of ndarray of int
        Rows of the angles, at least `least_detections` each, in order of time; no tracklet contains
        another.

    Notes
    -----
    The third detection may deviate from the straight path by half of
    `largest_acceleration_arcsec_s2` times the product of the times since the two others, and by
    five standard deviations. A further one is accepted if the last six detections and it fit a
    cubic of time, or the first four a parabola, at a significance of 1e-6. Of several detections at
    the time of the third one, the one that leads to the longest tracklet is taken; of several
    further ones, the one that fits best.
    """
    settings = TrackletSettings() if settings is None else settings
    gap = settings.largest_gap_min * 60.0 / TIME_UNIT_S
    # the share above 1 keeps a span that equals the limit but for rounding in one part
    longest = settings.largest_span_min * 60.0 / TIME_UNIT_S * (1.0 + 1e-9)
    fastest = settings.largest_rate_arcsec_s * ARCSECOND * TIME_UNIT_S
    acceleration = settings.largest_acceleration_arcsec_s2 * ARCSECOND * TIME_UNIT_S**2
    fixed = rotate_about_z(angles.direction, rate * angles.time)
    sigma = np.sqrt(np.trace(angles.covariance, axis1=1, axis2=2))
    least = settings.least_detections
    limits = gap, fastest, settings.largest_magnitude_difference
    found: list[Indices] = []
    for observer in np.unique(angles.observer).tolist():
        rows = np.flatnonzero(angles.observer == observer)
        own = angles.time[rows], fixed[rows], angles.magnitude[rows], sigma[rows]
        begin, later = _successors(*own[:3], limits)
        members, size = _chains(*own[:2], own[3], begin, later, acceleration, least)
        if size.size == 0:
            continue
        chains = np.split(rows[members], np.cumsum(size)[:-1])
        for k in np.flatnonzero(_without_longer(members, size)).tolist():
            chain = chains[k]
            span = angles.time[chain[-1]] - angles.time[chain[0]]
            parts = np.array_split(chain, max(1, int(np.ceil(span / longest))))
            found += [part for part in parts if part.size >= least]
    return found


@njit(cache=True, error_model="numpy")
def _successors(time, fixed, magnitude, limits):
    """For each detection of an observer the later ones that form a pair with it: detections
    ``later[begin[k]:begin[k + 1]]`` of detection k."""
    gap, fastest, largest_difference = limits
    n = time.size
    begin, later, count = np.zeros(n + 1, np.int64), np.empty(max(4 * n, 64), np.int64), 0
    for p in range(n):
        for q in range(p + 1, n):
            if time[q] > time[p] + gap:
                break
            span, apart2 = time[q] - time[p], 0.0
            for c in range(3):
                apart2 += (fixed[q, c] - fixed[p, c]) ** 2
            # a magnitude that is unknown differs from none
            if (
                span > 0.0
                and np.sqrt(apart2) <= fastest * span
                and not abs(magnitude[q] - magnitude[p]) > largest_difference
            ):
                if count == later.size:
                    longer = np.empty(2 * count, np.int64)
                    longer[:count] = later
                    later = longer
                later[count] = q
                count += 1
        begin[p + 1] = count
    return begin, later[:count]


@njit_noalloc
def _path_offset(time, fixed, sigma, acceleration, p, q, row):
    """Distance of a detection from the straight path of two others, over the allowance for its
    curvature and five standard deviations."""
    ratio = (time[row] - time[p]) / (time[q] - time[p])
    distance2 = 0.0
    for c in range(3):
        expected = fixed[p, c] + (fixed[q, c] - fixed[p, c]) * ratio
        distance2 += (fixed[row, c] - expected) ** 2
    allowed = 0.5 * acceleration * (time[row] - time[p]) * (time[row] - time[q])
    noise = np.hypot(sigma[row], sigma[p] * abs(1.0 - ratio) + sigma[q] * abs(ratio))
    return np.sqrt(distance2) / (allowed + 5.0 * noise)


@njit_noalloc
def _path_misfit(time, fixed, sigma, chain, n, row, work):
    """Chi squared of a polynomial of time through the last detections of a chain of `n` and another
    detection, over its limit. The polynomials are orthogonal for the weights of the detections."""
    first = max(0, n - _PATH_LENGTH + 1)
    m = n - first + 1
    span = time[row] - time[chain[first]]
    weight, x, below, here, left = 0, 1, 2, 3, 4
    for i in range(m):
        k = row if i == m - 1 else chain[first + i]
        work[weight, i], work[x, i] = 2.0 / sigma[k] ** 2, (time[row] - time[k]) / span
        work[below, i], work[here, i] = 0.0, 1.0
        for c in range(3):
            work[left + c, i] = fixed[k, c] - fixed[row, c]
    before, chi_squared = 1.0, 0.0
    for _ in range(min(m - 1, 4)):
        norm = shift = 0.0
        for i in range(m):
            share = work[weight, i] * work[here, i] ** 2
            norm, shift = norm + share, shift + share * work[x, i]
        for c in range(3):
            along = 0.0
            for i in range(m):
                along += work[weight, i] * work[here, i] * work[left + c, i]
            for i in range(m):
                work[left + c, i] -= along / norm * work[here, i]
        for i in range(m):
            following = (work[x, i] - shift / norm) * work[here, i]
            following -= norm / before * work[below, i]
            work[below, i], work[here, i] = work[here, i], following
        before = norm
    for c in range(3):
        for i in range(m):
            chi_squared += work[weight, i] * work[left + c, i] ** 2
    return chi_squared / _PATH_LIMITS[m]


@njit_noalloc
def _grown(time, fixed, sigma, begin, later, chain, n, work):
    """Size of a chain of `n` detections after it has been extended by the next ones that fit its
    path, into `chain`."""
    while True:
        last, best, least = chain[n - 1], -1, 1.0
        for k in range(begin[last], begin[last + 1]):
            q = later[k]
            if best >= 0 and time[q] > time[best]:
                break
            value = _path_misfit(time, fixed, sigma, chain, n, q, work)
            if value <= least:
                best, least = q, value
        if best < 0:
            return n
        chain[n] = best
        n += 1


@njit(cache=True, error_model="numpy")
def _chains(time, fixed, sigma, begin, later, acceleration, least):
    """Chains of at least `least` detections along smooth paths, each from a pair that no chain
    before contains: their detections, one chain after the other, and their sizes. Of the third
    detections of the same time, the one of the longest chain is taken."""
    used = np.zeros(later.size, np.bool_)
    members, size = np.empty(max(time.size, 64), np.int64), np.empty(max(time.size, 64), np.int64)
    chain, trial = np.empty(time.size, np.int64), np.empty(time.size, np.int64)
    work = np.empty((7, _PATH_LENGTH))
    total = count = 0
    for p in range(time.size):
        for start in range(begin[p], begin[p + 1]):
            if used[start]:
                continue
            last, n, third, offset = later[start], 2, -1, 0.0
            chain[0], chain[1], trial[0], trial[1] = p, last, p, last
            for k in range(begin[last], begin[last + 1]):
                q = later[k]
                if third >= 0 and time[q] > time[third]:
                    break
                value = _path_offset(time, fixed, sigma, acceleration, p, last, q)
                if value > 1.0:
                    continue
                trial[2] = q
                longer = _grown(time, fixed, sigma, begin, later, trial, 3, work)
                if longer > n or (longer == n and value < offset):
                    n, third, offset = longer, q, value
                    chain[:n] = trial[:n]
            for i in range(n):
                k = begin[chain[i]]
                for m in range(i + 1, n):
                    while k < begin[chain[i] + 1] and later[k] < chain[m]:
                        k += 1
                    if k < begin[chain[i] + 1] and later[k] == chain[m]:
                        used[k] = True
            if n < least:
                continue
            if total + n > members.size or count == size.size:
                longest = np.empty(2 * (total + n), np.int64)
                sizes = np.empty(2 * count + 64, np.int64)
                longest[:total], sizes[:count] = members[:total], size[:count]
                members, size = longest, sizes
            members[total : total + n] = chain[:n]
            size[count] = n
            total, count = total + n, count + 1
    return members[:total], size[:count]


def _without_longer(members: Indices, size: Indices) -> NDArray[np.bool_]:
    """Which chains have a detection that is in no chain of at least `_CLEARLY_LONGER` more."""
    longest = np.zeros(members.max() + 1, dtype=np.int64)
    np.maximum.at(longest, members, np.repeat(size, size))
    least = np.minimum.reduceat(longest[members], np.cumsum(size) - size)
    return least < size + _CLEARLY_LONGER


def attributables(
    angles: Angles,
    tracklets: Sequence[ArrayLike],
    *,
    rate: float = 1.0,
    degree: int | None = None,
    known: Attributables | None = None,
) -> Attributables:
    """Fit the direction and rate of each tracklet.

    Parameters
    ----------
    angles : Angles
    tracklets : sequence of array_like of int
        Rows of the angles of each tracklet, of one observer, at two different times at least.
    rate : float
        Angular rate of the propagation frame (`frame_rate`).
    degree : int, optional
        Degree of the polynomials. By default it is 1, or 2 where detections at four or more times
        require it at a significance of 0.001.
    known : Attributables, optional
        Result for the first rows of the same angles, from which equal tracklets are taken.

    Returns
    -------
    Attributables

    Raises
    ------
    ConfigurationError
        If a tracklet has detections of several observers or at fewer than two different times.
    """
    sets = [np.sort(np.asarray(rows, dtype=np.int64)) for rows in tracklets]
    before = {} if known is None else {d.tobytes(): k for k, d in enumerate(known.detections)}
    at = np.array([before.get(rows.tobytes(), -1) for rows in sets], dtype=np.int64)
    size = np.array([rows.size for rows in sets], dtype=np.int64)
    shapes = ((), (), (3,), (3,), (3,), (3,), (2, 3), (4, 4), (), (), ())
    columns = [
        np.empty((len(sets), *shape), dtype=np.int64 if c == 1 else float)
        for c, shape in enumerate(shapes)
    ]
    parts = [(np.flatnonzero(at >= 0), None if known is None else known[:-1])]
    for each in np.unique(size[at < 0]).tolist():
        own = np.flatnonzero((at < 0) & (size == each))
        parts.append((own, _of_equal_size(angles, np.array([sets[k] for k in own]), rate, degree)))
    for own, values in parts:
        if own.size:
            for column, value in zip(columns, values, strict=True):
                column[own] = value[at[own]] if at[own[0]] >= 0 else value
    order = np.lexsort((columns[1], columns[0]))
    return Attributables(*(each[order] for each in columns), tuple(sets[k] for k in order.tolist()))


def _of_equal_size(angles: Angles, rows: Indices, rate: float, degree: int | None) -> tuple:
    """Columns of the attributables of tracklets of the same number of detections, `rows` (tracklet,
    detection)."""
    times, owners = angles.time[rows], angles.observer[rows]
    distinct = 1 + np.count_nonzero(np.diff(times, axis=1) > 0.0, axis=1)
    mixed = np.any(owners != owners[:, :1], axis=1)
    for k in np.flatnonzero(mixed | (distinct < 2)).tolist():
        raise ConfigurationError(
            f"a tracklet of rows {rows[k].tolist()} has {np.unique(owners[k]).size} observers and "
            f"{distinct[k]} times; it needs one observer and two different times"
        )
    weight = 1.0 / np.trace(angles.covariance[rows], axis1=2, axis2=3)
    middle = np.sum(weight * times, axis=1) / np.sum(weight, axis=1)
    since = times - middle[:, None]
    directions, positions = (
        rotate_about_z(each[rows], rate * since)
        for each in (angles.direction, angles.observer_position)
    )
    mean = np.einsum("tn,tnc->tc", weight, directions)
    mean /= np.linalg.norm(mean, axis=1)[:, None]
    tangents = tangent_basis(mean)
    # an offset by the unit error vectors, projected to the plane at the mean direction
    errors = rotate_about_z(angles.basis[rows], rate * since[:, :, None])
    along = np.einsum("tnc,tc->tn", directions, mean)
    offset = np.einsum("tnc,tac->tna", directions, tangents) / along[:, :, None]
    outward = np.einsum("tnbc,tc->tnb", errors, mean)
    turned = np.einsum("tac,tnbc->tnab", tangents, errors) - offset[..., None] * outward[:, :, None]
    turned /= along[:, :, None, None]
    noise = turned @ angles.covariance[rows] @ turned.swapaxes(2, 3)
    largest = np.abs(since).max(axis=1)
    scaled = since / largest[:, None]

    def fitted(order: int, which: Indices) -> tuple[Array, Array]:
        """Estimators of the first two coefficients, and chi squared."""
        design = scaled[which, :, None] ** np.arange(order + 1)
        weighted = (weight[which, :, None] * design).swapaxes(1, 2)
        estimator = np.linalg.solve(weighted @ design, weighted)
        left = offset[which] - design @ (estimator @ offset[which])
        inverse = np.linalg.inv(noise[which])
        return estimator[:, :2], np.einsum("tna,tnab,tnb->t", left, inverse, left)

    estimator, chi_squared = fitted(1 if degree is None else degree, np.arange(len(rows)))
    many = np.flatnonzero(distinct >= 4)
    if degree is None and many.size:
        curved = fitted(2, many)
        better = np.flatnonzero(chi_squared[many] - curved[1] > _CURVATURE_CHI_SQUARED)
        estimator[many[better]], chi_squared[many[better]] = (each[better] for each in curved)
    estimator[:, 1] /= largest[:, None]
    shift, drift = np.moveaxis(estimator @ offset @ tangents, 1, 0)
    position, velocity = np.moveaxis(estimator @ positions, 1, 0)
    unit = mean + shift
    length = np.linalg.norm(unit, axis=1)[:, None]
    unit /= length
    motion = drift / length
    motion -= np.sum(motion * unit, axis=1)[:, None] * unit
    basis = tangent_basis(unit)
    covariance = np.einsum("tin,tnab,tjn->tiajb", estimator, noise, estimator).reshape(-1, 4, 4)
    turn = basis @ tangents.swapaxes(1, 2) / length[:, None]
    change = np.zeros_like(covariance)
    change[:, :2, :2] = change[:, 2:, 2:] = turn
    bright, magnitude = angles.magnitude_variance[rows], angles.magnitude[rows]
    known = np.isfinite(bright) & np.isfinite(magnitude)
    share = np.where(known, 1.0 / np.where(known, bright, 1.0), 0.0)
    total = share.sum(axis=1)
    total[total == 0.0] = np.nan
    return (
        middle, owners[:, 0], position, velocity, unit, motion, basis,
        change @ covariance @ change.swapaxes(1, 2),
        np.sum(share * np.where(known, magnitude, 0.0), axis=1) / total, total**-0.5, chi_squared,
    )  # fmt: skip
