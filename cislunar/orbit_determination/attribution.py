"""Attribution of tracklets to orbits: prediction, gate, and joint fits (Milani et al. 2001, Icarus
151, 150).

The attributable of a tracklet is predicted by an orbit and its covariance P; the innovation nu of
direction and rate has the covariance S = H Phi P Phi' H' + C. The prediction applies the estimators
of the tracklet to the curved path, since its polynomials may be wrong by an arcminute within an
hour. A tracklet within the gate is added if the fit to all angles agrees with them and with the new
ones, since many angles hide a contradiction of few, as after a maneuver. The time from the orbit's
detections within which tracklets are sought increases in steps, since the covariance of a short arc
predicts distant tracklets badly.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from cislunar.association import gate_threshold
from cislunar.compiled import njit, njit_noalloc
from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics.adaptive import DOP853, OK, integrate
from cislunar.orbit_determination.angles import Angles, frame_rate
from cislunar.orbit_determination.least_squares import NOT_CONVERGED, OrbitFits, fit_orbits
from cislunar.orbit_determination.pairs import gravity_at
from cislunar.orbit_determination.tracklets import Attributables
from cislunar.orbit_determination.verdicts import agrees
from cislunar.runtime import Array, Indices

_TOLERANCE = 1e-9
"""Of the propagation of predictions, which are uncertain by far more."""

_FARTHEST = 0.1
"""Distance in the tangent plane from which on a tracklet is not of an orbit, however uncertain."""

_MOST_REJECTED = 100
"""Tracklets that an orbit rejects before its extension ends. Some fifty are usual at most; of an
object in a group, the tracklets that mix detections of its members are thousands."""

_SHORT_ARC, _AT_ONCE, _MOST_AT_ONCE = 3, 4, 32
"""Tracklets below which an orbit takes the most probable tracklet alone, and the smallest and
largest number of tracklets that other orbits take before they are fitted again. The number grows
to twice that of the last fit that agreed. If a fit with more than the smallest number does not
agree, the orbit takes the smallest number again; otherwise it rejects the most probable one."""

_MANY = 300
"""Detections of an orbit from which on its fit is a prior of fits to further detections."""


class OrbitHypotheses(NamedTuple):
    """Orbits with the tracklets that they have been fitted to; indices in order of time."""

    fits: OrbitFits
    tracklets: tuple[tuple[int, ...], ...]


@njit_noalloc
def _is_near(here, observer, direction, basis):
    """Whether a predicted position is near the direction of a tracklet."""
    along = east = north = 0.0
    for c in range(3):
        line = here[c] - observer[c]
        along += direction[c] * line
        east += basis[0, c] * line
        north += basis[1, c] * line
    return along > 0.0 and max(abs(east), abs(north)) <= _FARTHEST * along


@njit_noalloc
def _bend(here, line, rate, pull, observer, velocity, direction, curvature):
    """Change a predicted state to what the estimators of a tracklet make of the path: the offset of
    the direction has a second derivative due to gravity and to the change of the range. They are
    applied to the path of the observer, too, so that its acceleration has no effect."""
    along, outward, turning = 0.0, 0.0, (-rate * here[1], rate * here[0], 0.0)
    for c in range(3):
        line[c] = here[3 + c] + turning[c] - velocity[c]
        along += direction[c] * (here[c] - observer[c])
        outward += direction[c] * line[c]
    for c in range(3):
        bent = pull[c] - 2.0 * outward / along * (line[c] - outward * direction[c])
        here[c] += curvature[0] * bent
        here[3 + c] += curvature[1] * bent + turning[c]
    here[3] += rate * here[1]
    here[4] -= rate * here[0]


@njit_noalloc
def _may_match(here, observer, direction, basis, noise, covariance, gate, row):
    """Whether the offset of a direction is within the gate of the sum of its two variances, as that
    of every tracklet within the gate of all four components is."""
    along = offset2 = variance = 0.0
    for c in range(3):
        along += direction[c] * (here[c] - observer[c])
    if not along > 0.0:
        return False
    for a in range(2):
        x = 0.0
        for c in range(3):
            x += basis[a, c] * (here[c] - observer[c]) / along
        for i in range(6):
            row[i] = 0.0
            for c in range(3):
                row[i] += (basis[a, c] - x * direction[c]) * here[6 + 6 * c + i] / along
        for i in range(6):
            for j in range(6):
                variance += row[i] * covariance[i, j] * row[j]
        variance += noise[a, a]
        offset2 += x * x
    return offset2 <= gate * variance


@njit(cache=True, error_model="numpy")
def _predictions(forces, rate, orbits, limits, tracklets, gate, out):
    """States and transition matrices at the tracklets that orbits may match: those between the
    first two `limits` (4, orbit) but not between the last two; returns their number, -1 if there
    are too many."""
    epoch, state, covariance = orbits
    time, observer, velocity, direction, basis, noise, curvature = tracklets
    (begin, end, inner_begin, inner_end), (which, found, predicted) = limits, out
    count, longest = 0, 0
    for k in range(epoch.size):
        longest = max(longest, end[k] - begin[k])
    elapsed, nothing = np.empty(longest), np.empty(0)
    paths, near = (np.empty((longest, 6)), np.empty((longest, 42))), np.empty(longest, np.int64)
    starts, row = (np.empty(6), np.zeros(42)), np.empty(6)
    for i in range(6):
        starts[1][6 + 7 * i] = 1.0
    for k in range(epoch.size):
        starts[0][:] = state[k]
        starts[1][:6] = state[k]
        n = 0
        for q in range(begin[k], end[k]):
            if not inner_begin[k] <= q < inner_end[k]:
                near[n] = q
                n += 1
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
                        if _is_near(path[m], observer[q], direction[q], basis[q]):
                            near[kept] = q
                            kept += 1
                        continue
                    here = path[m]
                    pull = gravity_at(forces, rate, time[q], here[0], here[1], here[2])
                    _bend(
                        here, row, rate, pull, observer[q], velocity[q], direction[q], curvature[q]
                    )
                    if not _may_match(
                        here, observer[q], direction[q], basis[q], noise[q], covariance[k], gate,
                        row,
                    ):  # fmt: skip
                        continue
                    if count == which.size:
                        return -1
                    which[count], found[count] = k, q
                    predicted[count] = here
                    count += 1
            if stage == 0:
                n = kept
                near[:n] = np.sort(near[:n])
    return count


def _innovations(
    predicted: Array, tracklets: Attributables, which: Indices, rate: float
) -> tuple[Array, Array]:
    """Innovations (match, 4) of directions and rates, and their derivatives (match, 4, 6) by the
    states at the epochs."""
    state, transition = predicted[:, :6], predicted[:, 6:].reshape(-1, 6, 6)
    unit, basis = tracklets.direction[which], tracklets.basis[which]
    turning = np.cross([0.0, 0.0, rate], np.eye(3)).T
    line = state[:, :3] - tracklets.observer_position[which]
    speed = state[:, 3:] + state[:, :3] @ turning.T - tracklets.observer_velocity[which]
    along, outward = np.einsum("pnc,nc->pn", np.stack([line, speed], axis=0), unit)
    inverse = (1.0 / along)[:, None]
    x = np.einsum("nac,nc->na", basis, line) * inverse
    f = np.einsum("nac,nc->na", basis, speed) * inverse
    growth = outward[:, None] * inverse
    measured = np.einsum("nac,nc->na", basis, tracklets.rate[which])
    innovation = np.concatenate([-x, measured - (f - x * growth)], axis=1)
    # derivatives of x and of f - x growth
    by_line = (basis - x[:, :, None] * unit[:, None]) * inverse[:, None]
    design = np.zeros((len(state), 4, 6))
    design[:, :2, :3] = by_line
    design[:, 2:, 3:] = by_line
    shift = (x * growth - f) * inverse
    design[:, 2:, :3] = shift[:, :, None] * unit[:, None] - growth[:, None] * by_line
    design[:, 2:, :3] += by_line @ turning
    return innovation, design @ transition


def tracklet_matches(
    fits: OrbitFits,
    tracklets: Attributables,
    first: Array,
    last: Array,
    gate_probability: float,
    *,
    forces: tuple,
    without: tuple[Array, Array] | None = None,
) -> tuple[Indices, Indices, Array]:
    """Tracklets within the gates of converged fits, whose times lie between `first` and `last`
    (fit,), and not between those of `without`: indices of fits and of tracklets (match,), and the
    logarithm of the density of direction and rate, in rad^-4 times the squared nondimensional unit
    of time.

    Raises
    ------
    ConfigurationError
        If `gate_probability` does not lie between 0 and 1.
    """
    data = (
        tracklets.time, tracklets.observer_position, tracklets.observer_velocity,
        tracklets.direction, tracklets.basis, tracklets.covariance, tracklets.curvature,
    )  # fmt: skip
    orbits, gate, rate = fits[:3], gate_threshold(gate_probability, 4), frame_rate(forces)
    spans = (first, last) if without is None else (first, last, *without)
    limits = np.zeros((4, fits.epoch.size), dtype=np.int64)
    for k, each in enumerate(spans):
        limits[k] = np.searchsorted(tracklets.time, each, side="right" if k % 2 else "left")
    count, capacity = -1, 64 + 16 * fits.epoch.size
    while count < 0:
        out = *np.empty((2, capacity), dtype=np.int64), np.empty((capacity, 42))
        count = _predictions(forces, rate, orbits, limits, data, gate, out)
        capacity *= 4
    which, found, predicted = (each[:count] for each in out)
    innovation, design = _innovations(predicted, tracklets, found, rate)
    s = design @ fits.covariance[which] @ design.swapaxes(1, 2) + tracklets.covariance[found]
    # nothing matches a prediction whose covariance is singular in double precision
    sign, log_det = np.linalg.slogdet(s)
    regular, squared = (sign != 0.0) & np.isfinite(log_det), np.full(len(s), np.inf)
    solved = np.linalg.solve(s[regular], innovation[regular, :, None])[..., 0]
    squared[regular] = np.einsum("ni,ni->n", innovation[regular], solved)
    kept = (squared >= 0.0) & (squared <= gate)
    log_density = -0.5 * (squared[kept] + log_det[kept]) - 2.0 * np.log(2.0 * np.pi)
    return which[kept], found[kept], log_density


def extend_orbits(
    angles: Angles,
    tracklets: Attributables,
    orbits: OrbitHypotheses,
    usable: NDArray[np.bool_],
    exposure: Indices,
    *,
    forces: tuple,
    spans_h: tuple[float, ...],
    gate_probability: float,
    significance: float,
) -> OrbitHypotheses:
    """Attribute usable tracklets (tracklet,) to orbits as long as the fits agree with the angles.
    Tracklets are sought within `spans_h` before the first and after the last tracklet of an orbit,
    one span after the other, until it has rejected `_MOST_REJECTED`. Of each `exposure` (row,) an
    orbit takes one detection at most. A fit to `_MANY` detections is the prior of fits to further
    ones, and the orbit is fitted to all of them at the end. If this fit does not agree, the orbit
    is extended by fits to all detections."""
    given = {"forces": forces, "significance": significance, "exposure": exposure,
             "spans_h": spans_h, "gate_probability": gate_probability}  # fmt: skip
    many = np.diff(orbits.fits.begin) >= _MANY
    fits, members = _extended(angles, tracklets, orbits, usable, many, **given)
    more = [k for k in np.flatnonzero(many).tolist() if members[k] != orbits.tracklets[k]]
    whole = fit_orbits(
        angles, [_rows_of(tracklets, members[k]) for k in more], fits.state[more],
        fits.epoch[more], forces=forces,
    )  # fmt: skip
    good = agrees(whole, significance)
    parts = {k: whole.take([i]) for i, k in enumerate(more) if good[i]}
    if again := [k for k in more if k not in parts]:
        own = OrbitHypotheses(orbits.fits.take(again), tuple(orbits.tracklets[k] for k in again))
        none = np.zeros(len(again), dtype=bool)
        fully, those = _extended(angles, tracklets, own, usable, none, **given)
        for i, k in enumerate(again):
            parts[k], members[k] = fully.take([i]), those[i]
    each = [parts.get(k, fits.take([k])) for k in range(len(members))]
    return OrbitHypotheses(concatenate_fits(each, fits), tuple(members))


def _rows_of(tracklets: Attributables, members: Iterable[int]) -> Indices:
    """Detections of tracklets, in order."""
    return np.unique(np.concatenate([tracklets.detections[t] for t in members]))


def _extended(
    angles: Angles,
    tracklets: Attributables,
    orbits: OrbitHypotheses,
    usable: NDArray[np.bool_],
    many: NDArray[np.bool_],
    *,
    exposure: Indices,
    forces: tuple,
    spans_h: tuple[float, ...],
    gate_probability: float,
    significance: float,
) -> tuple[OrbitFits, list[tuple[int, ...]]]:
    """Orbits with further tracklets, and all tracklets of each. The fits of `many` (orbit,) are to
    the further detections, with the given fits as priors."""
    fits, members = orbits.fits, [list(each) for each in orbits.tracklets]
    n = len(members)
    priors = fits._replace(
        status=np.where(many, fits.status, NOT_CONVERGED), begin=np.zeros(n + 1, dtype=np.int64),
        row=fits.row[:0], position=fits.position[:0],
    )  # fmt: skip
    stage, rejected = np.zeros(n, dtype=int), [set() for _ in range(n)]
    # no tracklet within these hours is left that the orbit, as it is, might take
    searched, hour = np.full(n, -np.inf), 3600.0 / TIME_UNIT_S
    at_once, own = [_AT_ONCE] * n, np.flatnonzero(usable)
    candidates = tracklets.take(own)
    parts = [fits.take([k]) for k in range(n)]
    # tracklets that the priors have not been fitted to, and exposures of all
    new = [[] if many[k] else list(members[k]) for k in range(n)]
    taken = [set(exposure[_rows_of(tracklets, each)].tolist()) for each in members]
    # of each orbit, as it is, with the most probable ones first; None: to be sought
    matches: list[list[int] | None] = [None] * n
    active = list(range(n))
    while active:
        if sought := [k for k in active if matches[k] is None]:
            now = concatenate_fits([parts[k] for k in sought], fits)
            ends = np.array([[members[k][0], members[k][-1]] for k in sought])
            first, last = tracklets.time[ends].T
            span, inner = np.array(spans_h)[stage[sought]] * hour, searched[sought] * hour
            which, found, density = tracklet_matches(
                now, candidates, first - span, last + span, gate_probability, forces=forces,
                without=(first - inner, last + inner),
            )  # fmt: skip
            order = np.lexsort((found, -density, which))
            split = np.searchsorted(which[order], np.arange(1, len(sought)))
            for k, each in zip(sought, np.split(own[found[order]], split), strict=True):
                matches[k] = each.tolist()
        trials, rows, later = [], [], []
        for k in active:
            used, added = set(), []
            most = at_once[k] if len(members[k]) >= _SHORT_ARC else 1
            for t in matches[k]:
                exposed = exposure[tracklets.detections[t]].tolist()
                if t in rejected[k] or not (
                    taken[k].isdisjoint(exposed) and used.isdisjoint(exposed)
                ):
                    continue
                added.append(t)
                used.update(exposed)
                if len(added) == most:
                    break
            if added:
                trials.append((k, added, used))
                rows.append(_rows_of(tracklets, [*new[k], *added]))
            elif stage[k] + 1 < len(spans_h):
                searched[k] = spans_h[stage[k]]
                stage[k], at_once[k], matches[k] = stage[k] + 1, _AT_ONCE, None
                later.append(k)
        if trials:
            now = concatenate_fits([parts[k] for k, *_ in trials], fits)
            prior = priors.take([k for k, *_ in trials])
            joint = fit_orbits(angles, rows, now.state, now.epoch, forces=forces, prior=prior)
            limit = chi2.isf(significance, [2 * len(used) for *_, used in trials])
            good = agrees(joint, significance) & (joint.chi_squared - now.chi_squared <= limit)
            for number, (k, added, used) in enumerate(trials):
                if good[number]:
                    parts[k], searched[k], matches[k] = joint.take([number]), -np.inf, None
                    members[k] = sorted(members[k] + added)  # tracklets are in order of time
                    new[k] += added
                    taken[k] |= used
                    at_once[k] = min(max(at_once[k], 2 * len(added)), _MOST_AT_ONCE)
                elif len(added) > _AT_ONCE:
                    at_once[k] = _AT_ONCE
                else:
                    rejected[k].add(added[0])
                if len(rejected[k]) < _MOST_REJECTED:
                    later.append(k)
        active = sorted(later)
    return concatenate_fits(parts, fits), [tuple(each) for each in members]


def concatenate_fits(parts: list[OrbitFits], empty: OrbitFits) -> OrbitFits:
    """Fits of several sets, one after the other; none, like `empty`, if there are no sets."""
    if not parts:
        return empty.take([])
    columns = [np.concatenate(each) for each in zip(*parts, strict=True)]
    sizes = np.concatenate([np.diff(part.begin) for part in parts])
    columns[7] = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    return OrbitFits(*columns)
