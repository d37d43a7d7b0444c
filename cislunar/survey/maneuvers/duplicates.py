"""Orbits of one object next to each other.

After a maneuver an object may have several orbits that each take some of its detections, and none
of which agrees with all of them. An exposure has one detection of an object at most. Two orbits
that never have a detection in the same exposure, although one of them would have been detected in
the exposures of the other, are therefore of one object. Let m be the probability that none of the
exposures with detections of an orbit detected the other one, the smaller of the two
(`cislunar.survey.maneuvers.log_missed`). Without a preference for one or two objects, the
probability of one object is 1 / (1 + m).

Objects that were deployed together are next to each other as well, but have detections in the same
exposures.
"""

import numpy as np

from cislunar.constants import TIME_UNIT_S
from cislunar.orbit_determination import Angles, OrbitFits
from cislunar.runtime import Array, Flags, Indices
from cislunar.survey.maneuvers.lineage import OrbitPaths
from cislunar.survey.maneuvers.misses import Watch, log_missed

_NEAR, _SIGMAS = 5e-4, 3.0
"""Orbits are compared whose distance is at most this, nondimensional, plus this number of standard
deviations."""

_SOONER_H = 1.0
"""The orbit whose last detection is later by more than this is kept, or the one with more
detections."""


def duplicate_orbits(
    fits: OrbitFits,
    angles: Angles,
    which: Indices,
    paths: OrbitPaths,
    watch: Watch,
    least_probability: float,
) -> Indices:
    """Orbits that are of the same object as another one, which is kept.

    Parameters
    ----------
    fits : OrbitFits
        Converged fits of all orbits.
    angles : Angles
        Detections, to whose rows the fits refer.
    which : ndarray of int, shape (n,)
        Orbits that are compared.
    paths : OrbitPaths
        Of all orbits, from the first detection to the last exposure.
    watch : Watch
    least_probability : float
        Of one object.

    Returns
    -------
    ndarray of int
        In increasing order.
    """
    index = np.rint(angles.time / watch.scene.step).astype(np.int64)
    key = index * watch.limits.half_field.size + angles.observer
    position, step = paths.state[which, :, :3], paths.time[1] - paths.time[0]
    sigma = np.sqrt(np.trace(paths.covariance[which], axis1=2, axis2=3))
    last = angles.time[fits.row[fits.begin[which + 1] - 1]]
    at = np.rint((last - paths.time[0]) / step).astype(np.int64)
    longer = _SOONER_H * 3600.0 / TIME_UNIT_S / watch.scene.step
    dropped: set[int] = set()
    for i in range(which.size - 1):
        others = np.arange(i + 1, which.size)
        near = np.ones(others.size, dtype=bool)
        # at the last time, and at the last detection of either orbit
        for k in (-1, at[i], at[others]):
            apart = np.linalg.norm(position[others, k] - position[i, k], axis=1)
            near &= is_near(apart, sigma[others, k] + sigma[i, k])
        for j in others[near].tolist():
            pair = int(which[i]), int(which[j])
            rows = [fits.detections(k) for k in pair]
            if dropped & set(pair) or np.intersect1d(*(key[each] for each in rows)).size:
                continue
            missed = 0.0
            for own, other in zip(pair, rows[::-1], strict=True):
                begin = angles.time[fits.row[fits.begin[[own]]]]
                where = _exposures_of(key[other], watch)
                value = log_missed(
                    fits, angles, np.array([own]), paths, where, since=begin, of_others=other
                )[0]
                missed = min(missed, value)
            if 1.0 / (1.0 + np.exp(missed)) < least_probability:
                continue
            later = int(index[rows[0][-1]] - index[rows[1][-1]])
            if abs(later) <= longer:
                later = rows[0].size - rows[1].size
            dropped.add(pair[1] if later >= 0 else pair[0])
    return np.array(sorted(dropped), dtype=np.int64)


def is_near(distance: Array, sigma: Array) -> Flags:
    """Whether orbits at these distances, with these standard deviations, nondimensional, are
    compared as possible orbits of one object."""
    return distance <= _NEAR + _SIGMAS * sigma


def _exposures_of(key: Indices, watch: Watch) -> Watch:
    """The exposures of detections with these numbers of times and observers."""
    fields = watch.fields
    of = fields.index * watch.limits.half_field.size + fields.observer
    chosen = np.flatnonzero(np.isin(of, key))
    return watch._replace(fields=type(fields)(*(each[chosen] for each in fields)))
