"""Formation of tracklets from detections without identity.

A tracklet consists of detections of one observer that may belong to one pass of an object. Two
detections form a pair if their separation in time, their angular rate and their difference of
magnitude are within the settings. Later detections near the straight path of the pair on the sky
extend it. A detection may be in several tracklets; linking chooses among them.
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.constants import TIME_UNIT_S
from cislunar.observation import ARCSECOND
from cislunar.orbit_determination.angles import Angles
from cislunar.orbit_determination.attributables import TrackletSettings, turned_about_z

Indices = NDArray[np.int64]


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
        Rows of the angles, at least two each, in order of time; no tracklet contains another.
    """
    settings = TrackletSettings() if settings is None else settings
    gap = settings.largest_gap_min * 60.0 / TIME_UNIT_S
    fastest = settings.largest_rate_arcsec_s * ARCSECOND * TIME_UNIT_S
    bend = settings.largest_acceleration_arcsec_s2 * ARCSECOND * TIME_UNIT_S**2
    fixed = turned_about_z(angles.direction, rate * angles.time)
    sigma = np.sqrt(np.trace(angles.covariance, axis1=1, axis2=2))
    found: list[Indices] = []
    for observer in np.unique(angles.observer).tolist():
        rows = np.flatnonzero(angles.observer == observer)
        times = angles.time[rows]
        after = np.searchsorted(times, times, side="right")
        until = np.searchsorted(times, times + gap, side="right")
        count = until - after
        first = np.repeat(np.arange(rows.size), count)
        within = np.arange(first.size) - np.repeat(np.cumsum(count) - count, count)
        second = after[first] + within
        a, b = rows[first], rows[second]
        apart = np.linalg.norm(fixed[b] - fixed[a], axis=1)
        difference = np.abs(angles.magnitude[b] - angles.magnitude[a])
        kept = apart <= fastest * (times[second] - times[first])
        kept &= ~(difference > settings.largest_magnitude_difference)
        later: dict[int, list[int]] = {}
        for p, q in zip(a[kept].tolist(), b[kept].tolist(), strict=True):
            later.setdefault(p, []).append(q)
        used: set[tuple[int, int]] = set()
        for p in sorted(later):
            for q in later[p]:
                if (p, q) in used:
                    continue
                chain = [p, q]
                while True:
                    near = [
                        (miss, each)
                        for each in later.get(chain[-1], ())
                        if (miss := _miss(angles.time, fixed, sigma, bend, chain, each)) <= 1.0
                    ]
                    if not near:
                        break
                    soonest = min(angles.time[each] for _, each in near)
                    chain.append(min(n for n in near if angles.time[n[1]] == soonest)[1])
                used.update((chain[i], each) for i in range(len(chain)) for each in chain[i + 1 :])
                found.append(np.array(chain))
    return found


def _miss(time, fixed, sigma, bend, chain, row) -> float:
    """Distance of a detection from the straight path of the first and last of a chain, over the
    allowance for its curvature and five standard deviations."""
    p, q = chain[0], chain[-1]
    ratio = (time[row] - time[p]) / (time[q] - time[p])
    expected = fixed[p] + (fixed[q] - fixed[p]) * ratio
    allowed = 0.5 * bend * (time[row] - time[p]) * (time[row] - time[q])
    noise = np.hypot(sigma[row], sigma[p] * abs(1.0 - ratio) + sigma[q] * abs(ratio))
    return float(np.linalg.norm(fixed[row] - expected) / (allowed + 5.0 * noise))
