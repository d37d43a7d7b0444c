"""Assignment of detections to the orbits of objects next to each other.

Objects that were deployed together are seconds to minutes of arc apart for hours. Linking may mix
their tracklets, and a fit to detections of which some are of a neighbor still agrees with them. The
detections of such orbits are therefore reassigned. In each exposure, a detection belongs to one
orbit, and an orbit has one detection, at most. Of the assignments within the gates of the
predictions, that of the least sum

    sum of  nu' S^-1 nu + ln |S| - 2 ln n_k                                                     (1)

is taken (rectangular linear assignment: Jonker & Volgenant 1987, Computing 38, 325), with the
offset nu of a detection from the prediction of orbit k, the sum S of the covariances of both, and
the number n_k of detections of the orbit. A pair that is missing for a complete assignment counts
with 1 more than the largest term of the group. Orbits with changed detections are then fitted
again, five times at most. The term in n_k lets the orbit with more detections absorb a second orbit
of the same object.

Linking may also make further orbits of detections of several of the objects. The detections of such
an orbit are next to the predictions of orbits that have no detection in the same exposures. It is
therefore reassigned together with these.

Assumptions and limitations
---------------------------
- S neglects that an orbit has been fitted to its own detections, so that an orbit of few detections
  rather keeps them.
- The largest term of equation (1) is that of all exposures of the group. The choice between one
  pair of a small term and two of large ones therefore depends on other exposures.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.special import chdtri

from cislunar.orbit_determination import (
    CONVERGED,
    Angles,
    OrbitFits,
    agrees,
    concatenate_fits,
    exposure_numbers,
    propagated,
)
from cislunar.runtime import Array, Indices
from cislunar.survey.maneuvers.division import fit_at_last_detection
from cislunar.survey.maneuvers.duplicates import is_near

_NEXT, _LEAST_SHARED = np.deg2rad(0.03), 3
"""Largest separation of two detections in one exposure, and least number of such pairs, for which
the detections of their orbits are reassigned."""

_GATE = float(chdtri(2, 1e-6))
"""Largest squared normalized offset of a detection from an orbit."""

_ROUNDS, _LEAST_ROWS, _LEAST_KEPT = 5, 6, 0.5
"""Largest number of divisions; least number of detections of an orbit, and least share of its
former ones, without which all are those of others."""


class NeighborFits(NamedTuple):
    """Orbits next to each other with reassigned detections: indices `changed` (n,) of the orbits
    with new detections, their `fits`, and indices `empty` (m,) of the orbits whose detections
    belong to others."""

    changed: Indices
    fits: OrbitFits
    empty: Indices


def divided_neighbors(
    fits: OrbitFits,
    angles: Angles,
    significance: float,
    fit: Callable[[list[Indices], Array, Array], OrbitFits],
    forces: tuple,
) -> NeighborFits:
    """Reassign the detections of orbits next to each other.

    Parameters
    ----------
    fits : OrbitFits
        Converged fits.
    angles : Angles
        Detections, to whose rows the fits refer.
    significance : float
        Of the agreement of a fit with its angles.
    fit : callable
        Fits orbits, as `cislunar.orbit_determination.fit_orbits`, from rows, states and epochs.
    forces : NamedTuple
        CR3BP or ephemeris forces.

    Returns
    -------
    NeighborFits
        Each fit is at the time of its last detection. If an orbit would not agree with its new
        detections, an orbit without which all others agree, and take at least half of its
        detections, is empty. If there is none, the orbit that would not agree keeps the detections
        that it has, which no other orbit takes.
    """
    exposure, fit = exposure_numbers(angles), _Remembered(fit, fits)
    changed: list[int] = []
    empty: list[int] = []
    parts: list[OrbitFits] = []
    for group in _groups(fits, angles, exposure, forces):
        every = np.unique(fits.take(group).row)
        # an orbit that meets a body before or after its own detections keeps them
        path, _ = propagated(
            fits.state[group], fits.epoch[group], np.unique(angles.time[every]), forces
        )
        usable = np.isfinite(path).all(axis=(1, 2))
        members, kept = group[usable], group[~usable]
        while members.size:
            before = fits.take(members)
            pool = np.setdiff1d(every, fits.take(kept).row)
            divide = partial(
                _divided, angles=angles, exposure=exposure[pool],
                offsets=_Offsets(angles, pool, forces), fit=fit, forces=forces,
            )  # fmt: skip
            found = divide(before)
            good = agrees(found, significance) | (np.diff(found.begin) < _least_rows(before))
            # an orbit that does not agree would give back the detections that it takes
            weak = (
                _weak(before, found)
                if np.all(good)
                else _superfluous(before, found, divide, significance)
            )
            if np.any(weak):
                empty += members[weak].tolist()
                members = members[~weak]
                continue
            if not np.all(good):
                kept, members = np.append(kept, members[~good]), members[good]
                continue
            other = [
                k for k in range(members.size)
                if not np.array_equal(before.detections(k), found.detections(k))
            ]  # fmt: skip
            changed += members[other].tolist()
            parts.append(found.take(other))
            break
    return NeighborFits(
        np.array(changed, dtype=np.int64), concatenate_fits(parts, fits),
        np.array(empty, dtype=np.int64),
    )  # fmt: skip


def _least_rows(before: OrbitFits) -> Indices:
    """Least numbers of detections (orbit,) that orbits need."""
    return np.minimum(_LEAST_ROWS, np.diff(before.begin))


def _weak(before: OrbitFits, after: OrbitFits) -> NDArray[np.bool_]:
    """Orbits with too few detections, and the one that has kept the least share of its detections
    if that is less than half."""
    share = _shares(before, after)
    weak = np.diff(after.begin) < _least_rows(before)
    least = int(np.argmin(share))
    weak[least] |= share[least] < _LEAST_KEPT
    return weak


def _superfluous(
    before: OrbitFits,
    after: OrbitFits,
    divide: Callable[[OrbitFits], OrbitFits],
    significance: float,
) -> NDArray[np.bool_]:
    """The orbit, if any, without which the others agree, none of them is weak, and they have at
    least half of its detections. Those that have kept the least shares are tried first, and of
    these those of fewer detections."""
    out = np.zeros(before.epoch.size, dtype=bool)
    for k in np.lexsort((np.diff(before.begin), _shares(before, after))).tolist():
        rest = before.take(np.delete(np.arange(out.size), k))
        found = divide(rest)
        taken = np.isin(before.detections(k), found.row).mean()
        if taken >= _LEAST_KEPT and not np.any(_weak(rest, found) | ~agrees(found, significance)):
            out[k] = True
            break
    return out


def _shares(before: OrbitFits, after: OrbitFits) -> Array:
    """Share of its detections that each orbit has kept."""
    own = [(before.detections(k), after.detections(k)) for k in range(before.epoch.size)]
    return np.array([np.isin(old, new).mean() for old, new in own])


def _groups(fits: OrbitFits, angles: Angles, exposure: Indices, forces: tuple) -> list[Indices]:
    """Sets of orbits, each of which has detections next to those of another one of the set, or is
    next to such an orbit (`_near_predictions`)."""
    n = fits.epoch.size
    owner = np.repeat(np.arange(n), np.diff(fits.begin))
    order = np.argsort(exposure[fits.row], kind="stable")
    of, rows = owner[order], fits.row[order]
    pairs, shift = [], 1
    while shift < rows.size:
        # detections at this distance in the order, within one exposure
        same = np.flatnonzero(exposure[rows[shift:]] == exposure[rows[:-shift]])
        if same.size == 0:
            break
        a, b = same, same + shift
        apart = np.linalg.norm(angles.direction[rows[a]] - angles.direction[rows[b]], axis=1)
        near = (apart <= _NEXT) & (of[a] != of[b])
        pairs.append(np.sort(np.stack([of[a[near]], of[b[near]]], axis=1), axis=1))
        shift += 1
    found, count = np.unique(np.concatenate([np.empty((0, 2), dtype=np.int64), *pairs]), axis=0,
                             return_counts=True)  # fmt: skip
    edges = found[count >= _LEAST_SHARED]
    close = np.unique(edges)
    if close.size:
        edges = np.concatenate([edges, _near_predictions(fits, angles, exposure, close, forces)])
    graph = coo_array((np.ones(len(edges)), edges.T), shape=(n, n))
    label = connected_components(graph, directed=False)[1]
    sizes = np.bincount(label, minlength=n)
    return [np.flatnonzero(label == each) for each in np.flatnonzero(sizes > 1)]


def _near_predictions(
    fits: OrbitFits, angles: Angles, exposure: Indices, by: Indices, forces: tuple
) -> Indices:
    """Pairs (pair, 2) of an orbit of `by` and another one, of which at least three detections are
    within the gate of the first in exposures without a detection of the first. At the epoch of the
    second the first is near it (`is_near`), with the standard deviation of the second."""
    time, at = np.unique(fits.epoch, return_inverse=True)
    state, _ = propagated(fits.state[by], fits.epoch[by], time, forces)
    apart = np.linalg.norm(state[:, at, :3] - fits.state[:, :3], axis=2)
    sigma = np.sqrt(np.trace(fits.covariance[:, :3, :3], axis1=1, axis2=2))
    near = is_near(apart, sigma)
    near[np.arange(by.size), by] = False
    pairs = []
    for k in np.flatnonzero(near.any(axis=0)).tolist():
        rows, others = fits.detections(k), by[near[:, k]]
        squared, _ = _Offsets(angles, rows, forces)(fits.take(others))
        for i, other in enumerate(others.tolist()):
            alone = ~np.isin(exposure[rows], exposure[fits.detections(other)])
            if np.count_nonzero(squared[alone, i] <= _GATE) >= _LEAST_SHARED:
                pairs.append((other, k))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _divided(
    fits: OrbitFits,
    angles: Angles,
    exposure: Indices,
    offsets: "_Offsets",
    fit: Callable[[list[Indices], Array, Array], OrbitFits],
    forces: tuple,
) -> OrbitFits:
    """Fits to the division of the detections of `offsets`, whose exposures are given, with those of
    too few as they are assigned."""
    n, own = fits.epoch.size, [fits.detections(k) for k in range(fits.epoch.size)]
    least = _least_rows(fits)
    for _ in range(_ROUNDS):
        owner = _assigned(fits, exposure, offsets)
        before, own = own, [offsets.rows[owner == k] for k in range(n)]
        if all(np.array_equal(*each) for each in zip(before, own, strict=True)):
            break
        other = [k for k in range(n) if not np.array_equal(own[k], before[k])]
        enough = [k for k in other if own[k].size >= least[k]]
        parts = {k: fits.take([k]) for k in range(n)}
        again = fit_at_last_detection(
            fits.take(enough), angles, [own[k] for k in enough], fit, forces
        )
        parts |= {k: again.take([i]) for i, k in enumerate(enough)}
        for k in sorted(set(other) - set(enough)):
            unknown = np.full((own[k].size, 3), np.nan)
            parts[k] = parts[k]._replace(
                begin=np.array([0, own[k].size]), row=own[k], position=unknown
            )
        fits = concatenate_fits([parts[k] for k in range(n)], fits)
        if np.any(fits.status != CONVERGED):
            break
    return fits


def _assigned(fits: OrbitFits, exposure: Indices, offsets: "_Offsets") -> Indices:
    """Orbit (row,) of each detection of `offsets` by equation (1); -1: none."""
    squared, log_determinant = offsets(fits)
    cost = np.where(squared <= _GATE, squared + log_determinant, np.inf)
    number = np.diff(fits.begin)
    cost -= 2.0 * np.log(np.maximum(number, 1))
    owner = np.full(exposure.size, -1, dtype=np.int64)
    # a cost above all others, at which a detection stays without an orbit
    finite = cost[np.isfinite(cost)]
    none = 1.0 + finite.max(initial=0.0) - finite.min(initial=0.0)
    order = np.argsort(exposure, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(exposure[order])) + 1):
        here = np.minimum(cost[rows] - finite.min(initial=0.0), none)
        for i, k in zip(*linear_sum_assignment(here), strict=True):
            if here[i, k] < none:
                owner[rows[i]] = k
    return owner


class _Remembered:
    """A function that fits orbits, which fits each set of detections from one start once: divisions
    without one orbit or another one have most fits in common."""

    def __init__(
        self, fit: Callable[[list[Indices], Array, Array], OrbitFits], like: OrbitFits
    ) -> None:
        self._fit, self._empty = fit, like.take([])
        self._known: dict[tuple[bytes, bytes, float], OrbitFits] = {}

    def __call__(self, rows: list[Indices], state: Array, epoch: Array) -> OrbitFits:
        keys = [
            (own.tobytes(), start.tobytes(), float(when))
            for own, start, when in zip(rows, state, epoch, strict=True)
        ]
        new = [k for k, key in enumerate(keys) if key not in self._known]
        if new:
            found = self._fit([rows[k] for k in new], state[new], epoch[new])
            self._known |= {keys[k]: found.take([i]) for i, k in enumerate(new)}
        return concatenate_fits([self._known[key] for key in keys], self._empty)


class _Offsets:
    """Squared normalized offsets nu' S^-1 nu of equation (1) and ln |S| of detections, (row, orbit)
    each; infinite and 0 for an orbit without a prediction. Those of an orbit are computed once."""

    def __init__(self, angles: Angles, rows: Indices, forces: tuple) -> None:
        self.rows, self._seen, self._forces = rows, angles.rows(rows), forces
        self._time, self._at = np.unique(angles.time[rows], return_inverse=True)
        self._known: dict[bytes, tuple[Array, Array]] = {}

    def __call__(self, fits: OrbitFits) -> tuple[Array, Array]:
        columns = np.column_stack([fits.epoch, fits.state, fits.covariance.reshape(-1, 36)])
        keys = [each.tobytes() for each in columns]
        new = [k for k, key in enumerate(keys) if key not in self._known]
        if new:
            given = fits.state[new], fits.epoch[new]
            paths = zip(*propagated(*given, self._time, self._forces), strict=True)
            for k, path in zip(new, paths, strict=True):
                self._known[keys[k]] = self._column(*path, fits.covariance[k])
        found = np.empty((2, self._at.size, len(keys)))
        for k, key in enumerate(keys):
            found[..., k] = self._known[key]
        return found[0], found[1]

    def _column(self, state: Array, transition: Array, covariance: Array) -> tuple[Array, Array]:
        seen, at = self._seen, self._at
        squared, log_determinant = np.full(at.size, np.inf), np.zeros(at.size)
        way = state[at, :3] - seen.observer_position
        along = np.sum(way * seen.direction, axis=1)
        design = seen.basis / along[:, None, None] @ transition[at, :3]
        offset = np.einsum("nac,nc->na", seen.basis, way) / along[:, None]
        s = design @ covariance @ design.swapaxes(1, 2) + seen.covariance
        determinant = np.linalg.det(s)
        good = np.isfinite(determinant) & (determinant > 0.0) & (along > 0.0)
        solved = np.linalg.solve(s[good], offset[good, :, None])[..., 0]
        squared[good] = np.sum(offset[good] * solved, axis=1)
        log_determinant[good] = np.log(determinant[good])
        return squared, log_determinant
