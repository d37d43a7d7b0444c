"""Measures of coverage that J does not include: which share of the target set is observed, and
when.

J counts an observation by two satellites twice and tolerates targets that are never seen. These
measures count each target once.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import MU, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import require_nondimensional
from cislunar.runtime.arguments import array_of, require_kind
from cislunar.visibility import VisibilitySettings, count_observers, lost_observations, shade_of


def day_starts(times: ArrayLike) -> NDArray[np.intp]:
    """Index of the first time of each day, shape (day,), of nondimensional times since the epoch.
    The last sample lies at the end of the last day and belongs to it."""
    elapsed_days = np.asarray(times, dtype=float) * TIME_UNIT_S / SECONDS_PER_DAY
    n_days = max(1, int(np.ceil(elapsed_days[-1] - 1e-9)))
    day = np.minimum((elapsed_days + 1e-9).astype(int), n_days - 1)
    return np.flatnonzero(np.r_[True, day[1:] != day[:-1]])


@dataclass(frozen=True)
class Coverage:
    """Union coverage of a static target set.

    Attributes
    ----------
    union_coverage : float
        Share of (target, time) pairs seen by at least one satellite.
    target_days : float
        Share of (target, day) pairs in which the target is seen at least once.
    never_seen : int
        Number of targets that no satellite ever sees.
    observers_per_covered : float
        Mean number of satellites that see a target, over the covered (target, time) pairs.
    """

    union_coverage: float
    target_days: float
    never_seen: int
    observers_per_covered: float


def coverage(
    track: ArrayLike,
    target: ArrayLike,
    times: ArrayLike,
    sun_position: ArrayLike,
    settings: VisibilitySettings,
    *,
    length: ArrayLike = 1.0,
) -> Coverage:
    """Coverage of a static target set by a set of satellites.

    Parameters
    ----------
    track : array_like, shape (satellite, time, 3)
        Positions of the satellites, nondimensional, rotating frame.
    target : array_like, shape (target, 3)
        Static targets, nondimensional, rotating frame.
    times : array_like, shape (time,)
        Nondimensional times since the epoch.
    sun_position : array_like, shape (time, 3)
        Sun at those times, nondimensional, rotating frame.
    settings : VisibilitySettings
        Photometry and exclusion.
    length : array_like, shape (time,) or ()
        Unit of length of the frame in units of l*.

    Returns
    -------
    Coverage

    Raises
    ------
    ConfigurationError
        If shapes disagree, a value is not finite, or a position is evidently in km.
    """
    require_kind("settings", settings, VisibilitySettings, "give VisibilitySettings")
    times = array_of("times", times, ("time",))
    positions = [
        np.ascontiguousarray(array_of(name, each, axes))
        for name, each, axes in (
            ("track", track, ("satellite", times.size, 3)),
            ("target", target, ("target", 3)),
            ("sun_position", sun_position, (times.size, 3)),
        )
    ]
    require_nondimensional("track", positions[0])
    require_nondimensional("target", positions[1])
    faintness = settings.faintness_at(len(times), length)
    given = *positions, settings.exclusion_deg.cosines, faintness, MU
    observers = count_observers(*given)
    if settings.eclipse:
        shade = shade_of(given[1], given[2], MU, length)
        lost = lost_observations(*given, shade).sum(axis=0, dtype=observers.dtype)
        np.subtract.at(observers, (shade.time, shade.target), lost)
    seen = observers > 0
    daily = np.logical_or.reduceat(seen, day_starts(times), axis=0)
    covered = int(np.count_nonzero(seen))
    return Coverage(
        union_coverage=covered / seen.size,
        target_days=float(daily.mean()),
        never_seen=int(np.count_nonzero(~seen.any(axis=0))),
        observers_per_covered=float(observers.sum(dtype=np.int64) / covered) if covered else 0.0,
    )


@dataclass(frozen=True)
class Gaps:
    """Gaps between observations of the targets, from samples at equal steps.

    A gap is a run of samples in which a target is not seen, where each sample represents one step.
    Runs at the ends of the horizon count with their length within it; the gap of a target that is
    never seen is the horizon. All arrays have shape (target,) and unit h: the longest gap, the mean
    length of the gaps (both 0 for a target always seen), and the mean time from any time to the
    next observation or the end of the horizon."""

    longest_h: NDArray[np.float64]
    mean_h: NDArray[np.float64]
    wait_h: NDArray[np.float64]


def gaps(seen: ArrayLike, step_hours: float) -> Gaps:
    """Lengths of the gaps in which targets are not seen.

    Parameters
    ----------
    seen : array_like of bool, shape (time, target)
        Whether each target is seen, at times of equal step.
    step_hours : float
        The step, h.

    Returns
    -------
    Gaps
    """
    seen = np.asarray(seen, dtype=bool)
    n_times, n_targets = seen.shape
    longest, mean, wait = np.zeros((3, n_targets))
    for target in range(n_targets):
        edges = np.flatnonzero(np.diff(np.r_[True, seen[:, target], True]))
        if edges.size:
            length = np.diff(edges)[::2] * step_hours
            longest[target] = length.max()
            mean[target] = length.mean()
            wait[target] = np.sum(length**2) / (2.0 * n_times * step_hours)
    return Gaps(longest, mean, wait)
