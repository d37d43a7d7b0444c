"""Growth of orbits by further tracklets: prediction, gate, and joint fits.

The attributable of a tracklet is predicted by an orbit and its covariance; the innovation nu of
direction and rate has the covariance S = H Phi P Phi' H' + C. A tracklet within the gate is added
if the fit to all angles agrees with them. The time from the orbit's detections within which
tracklets are sought increases in steps, since the covariance of a short arc predicts distant
tracklets badly.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.association import gate_threshold
from cislunar.compiled import njit, njit_noalloc
from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics.adaptive import DOP853, OK, integrate
from cislunar.orbit_determination.angles import Angles, frame_rate
from cislunar.orbit_determination.attributables import Attributables
from cislunar.orbit_determination.least_squares import OrbitFits, fit_orbits
from cislunar.orbit_determination.verdicts import agrees

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_TOLERANCE = 1e-9
"""Of the propagation of predictions, which are uncertain by far more."""


_FARTHEST = 0.1
"""Distance in the tangent plane from which on a tracklet is not of an orbit, however uncertain."""


class Grown(NamedTuple):
    """Orbits with the tracklets that they have been fitted to; indices in order of time."""

    fits: OrbitFits
    tracklets: tuple[tuple[int, ...], ...]


@njit_noalloc
def _is_near(here, place, u, basis):
    """Whether a predicted position is near the direction of a tracklet."""
    along = east = north = 0.0
    for c in range(3):
        way = here[c] - place[c]
        along += u[c] * way
        east += basis[0, c] * way
        north += basis[1, c] * way
    return along > 0.0 and max(abs(east), abs(north)) <= _FARTHEST * along


@njit_noalloc
def _predict(rate, here, place, velocity, u, motion, basis, noise, covariance, work):
    """Squared innovation of a tracklet and ln det S; infinite if the object is behind."""
    design, mapped, s, nu, way, speed, q = work
    along = upward = 0.0
    for c in range(3):
        way[c] = here[c] - place[c]
        along += u[c] * way[c]
    if not along > 0.0:
        return np.inf, np.inf
    speed[0] = here[3] - rate * here[1] - velocity[0]
    speed[1] = here[4] + rate * here[0] - velocity[1]
    speed[2] = here[5] - velocity[2]
    for c in range(3):
        upward += u[c] * speed[c]
    d = 1.0 / along
    for a in range(2):
        x = f = wanted = 0.0
        for c in range(3):
            x += basis[a, c] * way[c] * d
            f += basis[a, c] * speed[c] * d
            wanted += basis[a, c] * motion[c]
        nu[a] = -x
        nu[2 + a] = wanted - (f - x * upward * d)
        for c in range(3):
            q[c] = d * (basis[a, c] - x * u[c])
        for c in range(3):
            design[a, c] = q[c]
            design[a, 3 + c] = 0.0
            design[2 + a, c] = (x * upward * d - f) * d * u[c] - upward * d * q[c]
            design[2 + a, 3 + c] = q[c]
        design[2 + a, 0] += rate * q[1]
        design[2 + a, 1] -= rate * q[0]
    for i in range(4):
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += design[i, k] * here[6 + 6 * k + j]
            mapped[i, j] = total
    for i in range(4):
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += mapped[i, k] * covariance[k, j]
            design[i, j] = total
    for i in range(4):
        for j in range(i + 1):
            total = noise[i, j]
            for k in range(6):
                total += design[i, k] * mapped[j, k]
            s[i, j] = total
    squared, log_det = 0.0, 0.0
    for i in range(4):  # Cholesky factor and forward substitution in place
        for j in range(i + 1):
            total = s[i, j]
            for k in range(j):
                total -= s[i, k] * s[j, k]
            if i == j:
                if not total > 0.0:
                    return np.inf, np.inf
                s[i, i] = np.sqrt(total)
            else:
                s[i, j] = total / s[j, j]
        for k in range(i):
            nu[i] -= s[i, k] * nu[k]
        nu[i] /= s[i, i]
        squared += nu[i] ** 2
        log_det += 2.0 * np.log(s[i, i])
    return squared, log_det


@njit(cache=True, error_model="numpy")
def _matches(forces, rate, orbits, begin, end, tracklets, gate, out):
    """Tracklets within the gates of orbits; returns their number, -1 if there is no room."""
    epoch, state, covariance = orbits
    time, place, velocity, direction, motion, basis, noise = tracklets
    which, found, squared, log_density = out
    count, longest = 0, 0
    for k in range(epoch.size):
        longest = max(longest, end[k] - begin[k])
    elapsed, nothing = np.empty(longest), np.empty(0)
    paths, near = (np.empty((longest, 6)), np.empty((longest, 42))), np.empty(longest, np.int64)
    work = (
        np.empty((4, 6)), np.empty((4, 6)), np.empty((4, 4)), np.empty(4), np.empty(3), np.empty(3),
        np.empty(3),
    )  # fmt: skip
    starts = np.empty(6), np.zeros(42)
    for i in range(6):
        starts[1][6 + 7 * i] = 1.0
    for k in range(epoch.size):
        starts[0][:] = state[k]
        starts[1][:6] = state[k]
        n = end[k] - begin[k]
        for m in range(n):
            near[m] = begin[k] + m
        # the transition matrix is needed near the predicted directions alone
        for stage in range(2):
            path, first, kept = paths[stage], 0, 0
            while first < n and time[near[first]] < epoch[k]:
                first += 1
            near[:first] = near[:first][::-1].copy()
            for m in range(n):
                elapsed[m] = time[near[m]] - epoch[k]
            for low, high in ((0, first), (first, n)):
                if high == low:
                    continue
                status, _ = integrate(
                    DOP853, forces, epoch[k], starts[stage], elapsed[low:high], _TOLERANCE,
                    _TOLERANCE, path[low:high], nothing, nothing,
                )  # fmt: skip
                if status != OK:
                    continue
                for m in range(low, high):
                    q = near[m]
                    if stage == 0:
                        if _is_near(path[m], place[q], direction[q], basis[q]):
                            near[kept] = q
                            kept += 1
                        continue
                    distance, log_det = _predict(
                        rate, path[m], place[q], velocity[q], direction[q], motion[q], basis[q],
                        noise[q], covariance[k], work,
                    )  # fmt: skip
                    if not distance <= gate:
                        continue
                    if count == which.size:
                        return -1
                    which[count], found[count], squared[count] = k, q, distance
                    log_density[count] = -0.5 * (distance + log_det) - 2.0 * np.log(2.0 * np.pi)
                    count += 1
            if stage == 0:
                n = kept
                near[:n] = np.sort(near[:n])
    return count


def tracklet_matches(
    fits: OrbitFits,
    tracklets: Attributables,
    first: Array,
    last: Array,
    gate_probability: float,
    *,
    forces: tuple,
) -> tuple[Indices, Indices, Array, Array]:
    """Tracklets that orbits predict.

    Parameters
    ----------
    fits : OrbitFits
        Converged fits.
    tracklets : Attributables
    first, last : ndarray, shape (fit,)
        Times between which tracklets are sought, nondimensional.
    gate_probability : float
        Probability that the gate keeps a tracklet of the object.
    forces : NamedTuple
        Force model.

    Returns
    -------
    fit, tracklet : ndarray of int, shape (match,)
    squared, log_density : ndarray, shape (match,)
        Squared innovation, and the logarithm of the density of direction and rate, rad^-2 and
        nondimensional time squared.
    """
    data = (
        tracklets.time, tracklets.place, tracklets.velocity, tracklets.direction, tracklets.rate,
        tracklets.basis, tracklets.covariance,
    )  # fmt: skip
    begin = np.searchsorted(tracklets.time, first, side="left")
    end = np.searchsorted(tracklets.time, last, side="right")
    gate, room = gate_threshold(gate_probability, 4), 64 + 16 * fits.epoch.size
    while True:
        out = (
            np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64),
            np.empty(room), np.empty(room),
        )  # fmt: skip
        orbits = fits.epoch, fits.state, fits.covariance
        count = _matches(forces, frame_rate(forces), orbits, begin, end, data, gate, out)
        if count >= 0:
            return out[0][:count], out[1][:count], out[2][:count], out[3][:count]
        room *= 4


def grow(
    angles: Angles,
    tracklets: Attributables,
    orbits: Grown,
    usable: NDArray[np.bool_],
    *,
    forces: tuple,
    spans_h: tuple[float, ...],
    gate_probability: float,
    significance: float,
) -> Grown:
    """Add tracklets to orbits as long as the fits agree with the angles.

    Parameters
    ----------
    angles : Angles
    tracklets : Attributables
    orbits : Grown
        Converged fits and their tracklets.
    usable : ndarray of bool, shape (tracklet,)
    forces : NamedTuple
        Force model.
    spans_h : tuple of float
        Times before the first and after the last tracklet of an orbit, h, one after the other.
    gate_probability, significance : float
        Of the gate of a tracklet, and of chi squared of the fit.

    Returns
    -------
    Grown
        In the order of the orbits.
    """
    fits, members = orbits.fits, [list(each) for each in orbits.tracklets]
    n = len(members)
    stage, banned = np.zeros(n, dtype=int), [set() for _ in range(n)]
    parts = [fits.take([k]) for k in range(n)]
    active = list(range(n))
    while active:
        now = concatenate_fits([parts[k] for k in active], fits)
        ends = np.array([[members[k][0], members[k][-1]] for k in active])
        span = np.array([spans_h[stage[k]] for k in active]) * 3600.0 / TIME_UNIT_S
        which, found, _, density = tracklet_matches(
            now, tracklets, tracklets.time[ends[:, 0]] - span, tracklets.time[ends[:, 1]] + span,
            gate_probability, forces=forces,
        )  # fmt: skip
        order = np.lexsort((found, -density, which))
        which, found = which[order], found[order]
        begins = np.searchsorted(which, np.arange(len(active) + 1))
        trials, rows, later = [], [], []
        for position, k in enumerate(active):
            used = set(np.concatenate([tracklets.detections[t] for t in members[k]]).tolist())
            added: list[int] = []
            # a short arc takes the most probable tracklet alone
            most = 1 if len(members[k]) < 3 else 4
            for t in found[begins[position] : begins[position + 1]].tolist():
                own = tracklets.detections[t].tolist()
                if t in banned[k] or t in members[k] or not usable[t] or used & set(own):
                    continue
                added.append(t)
                used.update(own)
                if len(added) == most:
                    break
            if added:
                trials.append((k, added))
                rows.append(np.sort(np.array(sorted(used))))
            elif stage[k] + 1 < len(spans_h):
                stage[k] += 1
                later.append(k)
        if trials:
            starts = np.array([parts[k].state[0] for k, _ in trials])
            epochs = np.array([parts[k].epoch[0] for k, _ in trials])
            joint = fit_orbits(angles, rows, starts, epochs, forces=forces)
            good = agrees(joint, significance)
            for number, (k, added) in enumerate(trials):
                if good[number]:
                    parts[k] = joint.take([number])
                    members[k] = sorted(members[k] + added, key=lambda t: tracklets.time[t])
                else:
                    banned[k].add(added[0])
                later.append(k)
        active = sorted(later)
    return Grown(concatenate_fits(parts, fits), tuple(tuple(each) for each in members))


def concatenate_fits(parts: list[OrbitFits], empty: OrbitFits) -> OrbitFits:
    """Fits of several sets, one after the other.

    Parameters
    ----------
    parts : list of OrbitFits
    empty : OrbitFits
        Of which no fit is returned if there are no parts.
    """
    if not parts:
        return empty.take([])
    columns = [np.concatenate(each) for each in zip(*parts, strict=True)]
    sizes = np.concatenate([np.diff(part.begin) for part in parts])
    columns[6] = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    return OrbitFits(*columns)
