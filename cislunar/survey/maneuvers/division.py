"""Division of the detections of an object between its orbits before and after a maneuver.

After a small maneuver the orbit before it still takes some detections, and the orbit after it may
take some from before. Both fits agree with their angles, but their states are biased, and their
times overlap or do not contain the maneuver. The detections of two such orbits are therefore
divided anew: all before a time belong to the one, all after it to the other. Of all such times
between two detections next to the end of the one orbit and the begin of the other, that with the
least sum of chi squared is chosen. The division counts if both fits agree with their angles, the
sum does not exceed that of the given orbits, and the divided orbits meet with a change of velocity
(`cislunar.survey.maneuvers.find_lineage`).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics import VELOCITY_UNIT_M_S
from cislunar.orbit_determination import (
    Angles,
    OrbitFits,
    agrees,
    concatenate_fits,
    fit_orbits,
    propagated,
)
from cislunar.runtime import Array
from cislunar.survey.maneuvers.lineage import OrbitPaths

_AROUND_H = 2.0
"""Time before and after the ends of two orbits within which they are divided."""

_DIVISIONS = 12
"""Largest number of divisions that are fitted."""

_LEAST_ROWS = 4
"""Least number of detections of each part."""

_NEAR_H, _NEAR = 1.0, 5e-4
"""Orbits are tried whose distance is at most their relative displacement in this time, plus a
distance, nondimensional."""

_FASTEST = 3.0
"""Largest relative velocity, over the largest scale of a component of a change of velocity."""


def overlapping_pairs(
    fits: OrbitFits, angles: Angles, paths: OrbitPaths, largest_m_s: float
) -> list[tuple[int, int]]:
    """Orbits, the earlier one first, that may be of one object before and after a maneuver although
    their times overlap or are next to each other.

    Parameters
    ----------
    fits : OrbitFits
        Converged fits.
    angles : Angles
    paths : OrbitPaths
        Of all orbits, from the first detection on.
    largest_m_s : float
        Largest scale of a component of a change of velocity.

    Returns
    -------
    list of (int, int)
        Indices of the earlier and the later orbit.
    """
    first, last = (angles.time[fits.row[each]] for each in (fits.begin[:-1], fits.begin[1:] - 1))
    around = _AROUND_H * 3600.0 / TIME_UNIT_S
    hour = _NEAR_H * 3600.0 / TIME_UNIT_S
    step, found = paths.time[1] - paths.time[0], []
    for a in range(fits.epoch.size):
        later = np.flatnonzero((first > first[a]) & (last >= last[a]) & (first - last[a] <= around))
        middle = np.clip(0.5 * (first[later] + last[a]), paths.time[0], paths.time[-1])
        at = np.rint((middle - paths.time[0]) / step).astype(np.int64)
        apart = paths.state[later, at] - paths.state[a, at]
        speed = np.linalg.norm(apart[:, 3:], axis=1)
        near = np.linalg.norm(apart[:, :3], axis=1) <= _NEAR + hour * speed
        near &= speed <= _FASTEST * largest_m_s / VELOCITY_UNIT_M_S
        found += [(a, b) for b in later[near].tolist()]
    return found


def divided(
    fits: OrbitFits,
    angles: Angles,
    pair: tuple[int, int],
    significance: float,
    fit: Callable[[list[NDArray[np.int64]], Array, Array], OrbitFits],
    forces: tuple,
) -> OrbitFits | None:
    """The best division of the detections of two orbits.

    Parameters
    ----------
    fits : OrbitFits
    angles : Angles
    pair : tuple of int
        The orbit before and the one after.
    significance : float
        Of the agreement of a fit with its angles.
    fit : callable
        Fits the chosen parts, as `cislunar.orbit_determination.fit_orbits`, from rows, states and
        epochs.
    forces : NamedTuple
        CR3BP or ephemeris forces.

    Returns
    -------
    OrbitFits or None
        Two fits, each at the time of its last detection; None if there is no division that counts.
    """
    a, b = (fits.take([k]) for k in pair)
    rows = np.union1d(a.row, b.row)
    time, around = angles.time[rows], _AROUND_H * 3600.0 / TIME_UNIT_S
    ends = angles.time[a.row[-1]], angles.time[b.row[0]]
    first = np.flatnonzero(np.diff(time, prepend=-np.inf) > 0.0)
    first = first[(first >= _LEAST_ROWS) & (first <= rows.size - _LEAST_ROWS)]
    # divisions between detections of which one is next to the ends
    first = first[(time[first] >= min(ends) - around) & (time[first - 1] <= max(ends) + around)]
    if first.size == 0:
        return None
    chosen = np.unique(np.linspace(0, first.size - 1, min(first.size, _DIVISIONS)).astype(np.int64))
    best, least = None, float(a.chi_squared[0] + b.chi_squared[0])
    for stage in (first[chosen], first):
        if stage is first and best is not None:
            # between the neighbors of the best one
            spacing = max(1, first.size // _DIVISIONS)
            at = int(np.searchsorted(first, best[0]))
            stage = first[max(0, at - spacing) : at + spacing + 1]
        elif stage is first:
            break
        parts = [rows[:k] for k in stage.tolist()] + [rows[k:] for k in stage.tolist()]
        n = stage.size
        trial = fit_orbits(
            angles, parts, np.repeat([a.state[0], b.state[0]], n, axis=0),
            np.repeat([a.epoch[0], b.epoch[0]], n), forces=forces,
        )  # fmt: skip
        good = agrees(trial, significance).reshape(2, n).all(axis=0)
        total = np.where(good, trial.chi_squared.reshape(2, n).sum(axis=0), np.inf)
        k = int(np.argmin(total))
        if total[k] <= least:
            best, least = (int(stage[k]), trial.take([k, n + k])), float(total[k])
    if best is None:
        return None
    chosen = best[1]
    rows = [chosen.detections(0), chosen.detections(1)]
    return fit_at_last_detection(chosen, angles, rows, fit, forces)


def fit_at_last_detection(
    fits: OrbitFits,
    angles: Angles,
    rows: list[NDArray[np.int64]],
    fit: Callable[[list[NDArray[np.int64]], Array, Array], OrbitFits],
    forces: tuple,
) -> OrbitFits:
    """Fits to detections (`rows`, of each fit), started from given ones; each is at the time of its
    last detection. `fit` is as for `divided`."""
    last = np.array([float(angles.time[each[-1]]) for each in rows])
    starts = [
        propagated(fits.state[[k]], fits.epoch[[k]], last[[k]], forces)[0][0, 0]
        for k in range(last.size)
    ]
    return fit(rows, np.array(starts).reshape(-1, 6), last)


def replaced(fits: OrbitFits, which: ArrayLike, parts: OrbitFits) -> OrbitFits:
    """Fits of which some are others, in the order of `which`."""
    order = np.arange(fits.epoch.size)
    order[np.asarray(which, dtype=np.int64)] = order.size + np.arange(parts.epoch.size)
    return concatenate_fits([fits, parts], fits).take(order)
