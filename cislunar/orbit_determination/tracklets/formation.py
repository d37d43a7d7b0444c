"""Formation of tracklets: detections of one pass of an object by one observer.

Two detections of one observer form a pair if their separation in time, their angular rate and their
difference of magnitude are within the settings. A third detection has to be near the straight path
of the pair on the sky, and each further one on the smooth path of the detections before it; each
also forms a pair with the one before it. A detection may be in several tracklets; linking chooses
among them. A tracklet is left out if each of its detections is in a tracklet with at least two more
detections, since short chance alignments are more frequent.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from cislunar.compiled import njit, njit_noalloc
from cislunar.constants import TIME_UNIT_S
from cislunar.observation import ARCSECOND
from cislunar.orbit_determination.angles import Angles, require_order, rotate_about_z
from cislunar.orbit_determination.tracklets.settings import TrackletSettings
from cislunar.runtime import Array, Indices

_PATH_LENGTH = 7
"""Number of detections in the path to which a further one is fitted, itself included."""

_PATH_LIMITS = (*[np.inf] * 4, *(float(chi2.isf(1e-6, n)) for n in (2, 2, 4, 6)))
"""Largest chi squared by the number of detections: a parabola for four, a cubic for more."""

_CLEARLY_LONGER = 2
"""Least excess of detections of a tracklet that may replace another one."""


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
        Rows of the angles, at least `least_detections` each, in order of time. Tracklets that are
        longer than `largest_span_min` are divided into parts; before, none contains another.

    Notes
    -----
    The third detection may deviate from the straight path by half of
    `largest_acceleration_arcsec_s2` times the product of the times since the two others, plus five
    standard deviations. A further one is accepted if it and up to six detections before it fit a
    cubic of time (a parabola for the fourth one) at a significance of 1e-6. Of several detections
    at the time of the third one, the one that leads to the longest tracklet is taken; of several
    further ones at one time, the one that fits best.
    """
    require_order(angles.time)
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
            parts = _divided(chain, angles.time[chain], longest, least)
            found += [part for part in parts if part.size >= least]
    return found


def _divided(chain: Indices, time: Array, longest: float, least: int) -> list[Indices]:
    """Parts of a tracklet that are at most as long as a limit: of equal size if that is possible
    with `least` detections in each part, and otherwise as large as possible from the begin on."""
    count = max(1, int(np.ceil((time[-1] - time[0]) / longest)))
    parts = np.array_split(np.arange(time.size), count)
    if any(part.size < least or time[part[-1]] - time[part[0]] > longest for part in parts):
        begin = [0]
        for k in range(time.size):
            if time[k] - time[begin[-1]] > longest:
                begin.append(k)
        parts = np.split(np.arange(time.size), begin[1:])
    return [chain[part] for part in parts]


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
    """Which chains have a detection that is in no chain with `_CLEARLY_LONGER` more detections."""
    longest = np.zeros(members.max() + 1, dtype=np.int64)
    np.maximum.at(longest, members, np.repeat(size, size))
    least = np.minimum.reduceat(longest[members], np.cumsum(size) - size)
    return least < size + _CLEARLY_LONGER
