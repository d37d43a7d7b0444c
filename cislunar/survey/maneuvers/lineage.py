"""Orbits of one object before and after a maneuver.

The linking of detections finds an orbit of its own for the detections after a maneuver. Two orbits,
a before and b after a gap without detections of either, are of one object that changed its velocity
by v at a time t of the gap, or of two objects. States at t have independent normal errors with the
covariances P_a and P_b, and v is normal with the variance s^2 of each component, one of several
scales. With the difference z(t) = x_b(t) - x_a(t), the rate r of maneuvers, and the density n of
states of unknown objects, the ratio of the likelihoods is

    L = r / n int mean over s of N(z(t); 0, P_a + P_b + diag(0, s^2)) dt,                       (1)

because an unknown object of the density n is at x_b with the likelihood that the detections give
it, and phase-space volume does not change with time. Within a short interval z moves along a
straight line, so that its part of the integral is an integral of the normal distribution. If the
radiation pressure on the object is uncertain, one standard deviation of its factor displaces z by
d(t), and d d' is added to the covariance. The change of velocity and the state after it follow by
linear estimation in each interval and scale, and from the moments of their mixture.

An orbit has one successor and one predecessor at most; the set of pairs of the largest sum of ln L
is chosen (Crouse 2016, IEEE Transactions on Aerospace and Electronic Systems 52, 1679). Only what
the catalog knows is used.

Assumptions and limitations
---------------------------
- A maneuver is an impulse, and there is one in a gap.
- The distributions of both orbits are normal in the gap.
- That b was not detected between t and its first detection does not count.
- Encounters are sought by paths without the uncertainty of the radiation pressure.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from cislunar.association import best_pairs
from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import VELOCITY_UNIT_M_S
from cislunar.orbit_determination import (
    AdmissibleRegion,
    Angles,
    OrbitFits,
    propagated,
    propagated_each,
)
from cislunar.runtime import Array, Indices
from cislunar.survey.maneuvers.line_integrals import line_moments, log_line_integrals, moments
from cislunar.survey.settings import LineageSettings

_COARSE_S, _FINE_S = 600.0, 60.0
"""Longest intervals of a search for encounters, and of the integral of equation (1)."""

_GATE, _CURVED = 8.0, 0.02
"""Gate of an encounter in standard deviations, and the share of the relative displacement within an
interval by which a straight line may be wrong."""

_AT_ONCE = 64
"""Orbits whose transition matrices are held at once."""


class OrbitPaths(NamedTuple):
    """Orbits at common times.

    Attributes
    ----------
    time : ndarray, shape (time,)
        Nondimensional, at equal steps.
    state : ndarray, shape (orbit, time, 6)
        Nondimensional, propagation frame; those of an orbit that meets a body are NaN.
    covariance : ndarray, shape (orbit, time, 3, 3)
        Of the positions.
    """

    time: Array
    state: Array
    covariance: Array


class Lineage(NamedTuple):
    """Pairs of orbits before and after a maneuver, in the order of successors.

    Attributes
    ----------
    before, after : ndarray of int, shape (pair,)
        Indices of orbits.
    log_ratio : ndarray, shape (pair,)
        Logarithm of the ratio of likelihoods, equation (1).
    probability : ndarray, shape (pair,)
        That the pair is of one object, among all pairs of either orbit.
    time, time_sigma : ndarray, shape (pair,)
        Time of the maneuver and its standard deviation, nondimensional.
    velocity_m_s : ndarray, shape (pair, 3)
        Change of velocity, propagation frame.
    velocity_covariance : ndarray, shape (pair, 3, 3)
        m^2/s^2.
    state, covariance : ndarray, shapes (pair, 6) and (pair, 6, 6)
        State after the maneuver at the epoch of the later orbit, from both orbits; nondimensional.
    """

    before: Indices
    after: Indices
    log_ratio: Array
    probability: Array
    time: Array
    time_sigma: Array
    velocity_m_s: Array
    velocity_covariance: Array
    state: Array
    covariance: Array

    def take(self, which: Indices) -> "Lineage":
        """Some of the pairs."""
        return Lineage(*(each[which] for each in self))


class _Solution(NamedTuple):
    """Means and covariances of the mixture of equation (1) for a pair: of time, change of velocity,
    and the state at the epoch of the later orbit; nondimensional."""

    time: tuple[float, float]
    velocity: tuple[Array, Array]
    state: tuple[Array, Array]


def orbit_paths(fits: OrbitFits, first: float, last: float, *, forces: tuple) -> OrbitPaths:
    """Orbits and covariances of their positions at common times.

    Parameters
    ----------
    fits : OrbitFits
        Converged fits.
    first, last : float
        Times between which the paths are sought, nondimensional.
    forces : NamedTuple
        CR3BP or ephemeris forces.

    Returns
    -------
    OrbitPaths
    """
    count = max(1, int(np.ceil((last - first) * TIME_UNIT_S / _COARSE_S - 1e-9)))
    time, n = np.linspace(first, last, count + 1), fits.epoch.size
    state, covariance = np.empty((n, time.size, 6)), np.empty((n, time.size, 3, 3))
    for begin in range(0, n, _AT_ONCE):
        own = slice(begin, begin + _AT_ONCE)
        moved, stm = propagated(fits.state[own], fits.epoch[own], time, forces)
        state[own], upper = moved, stm[:, :, :3]
        covariance[own] = upper @ fits.covariance[own, None] @ upper.swapaxes(2, 3)
    return OrbitPaths(time, state, covariance)


def find_lineage(
    fits: OrbitFits,
    angles: Angles,
    before: NDArray[np.bool_],
    after: NDArray[np.bool_],
    *,
    forces: tuple,
    region: AdmissibleRegion,
    expected_objects: float,
    settings: LineageSettings,
    paths: OrbitPaths,
    radiation_sigma: float = 0.0,
    log_integrals: dict[tuple[int, int], float] | None = None,
) -> Lineage:
    """Find orbits of one object before and after a maneuver.

    Parameters
    ----------
    fits : OrbitFits
        Converged fits of all orbits.
    angles : Angles
        Detections, to whose rows the fits refer.
    before, after : ndarray of bool, shape (orbit,)
        Which orbits may be those before, and those after a maneuver.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    region : AdmissibleRegion
        With `expected_objects`, the density of states of unknown objects, nondimensional.
    expected_objects : float
        Expected number of unknown objects in the region.
    settings : LineageSettings
    paths : OrbitPaths
        Of all orbits, over all gaps.
    radiation_sigma : float
        Standard deviation of the factor of the radiation pressure on an object; 0: it is known.
    log_integrals : dict, optional
        Logarithms of the integral of equation (1) for pairs of these orbits, from an earlier call;
        those of other pairs are added.

    Returns
    -------
    Lineage
    """
    first, last = (angles.time[fits.row[each]] for each in (fits.begin[:-1], fits.begin[1:] - 1))
    longest = settings.longest_gap_h * 3600.0 / TIME_UNIT_S
    rate = settings.maneuvers_per_day * TIME_UNIT_S / SECONDS_PER_DAY
    constant = np.log(rate) - region.log_density - np.log(expected_objects)
    scales = np.array(settings.scales_m_s) / VELOCITY_UNIT_M_S
    later, given = np.flatnonzero(after), (paths, last, first, forces, radiation_sigma)
    log_integrals = {} if log_integrals is None else log_integrals
    possible: list[tuple[int, int]] = []
    for a in np.flatnonzero(before).tolist():
        gap = first[later] - last[a]
        possible += [(a, b) for b in later[(gap > 0.0) & (gap <= longest)].tolist()]
    new = [pair for pair in possible if pair not in log_integrals]
    for pair, approach in _approaches(fits, new, *given):
        log_integrals[pair] = _log_integral(approach, scales)
    found = ((pair, log_integrals[pair]) for pair in possible)
    ratio = {pair: constant + each for pair, each in found if np.isfinite(each)}
    chosen = _assigned(ratio)
    parts = []
    for a, b in chosen:
        # one of: two objects, this pair, another pair with one of these orbits
        others = [each for pair, each in ratio.items() if pair[0] == a or pair[1] == b]
        probability = float(np.exp(ratio[a, b] - logsumexp([0.0, *others])))
        if probability >= settings.least_probability:
            parts.append((a, b, probability))
    kept = [
        _solved(approach, fits.state[b], fits.covariance[b], scales)
        for (_, b), approach in _approaches(fits, [(a, b) for a, b, _ in parts], *given)
    ]
    unit = VELOCITY_UNIT_M_S
    return Lineage(
        np.array([a for a, *_ in parts], dtype=np.int64),
        np.array([b for _, b, _ in parts], dtype=np.int64),
        np.array([ratio[a, b] for a, b, _ in parts]),
        np.array([probability for *_, probability in parts]),
        np.array([each.time[0] for each in kept]),
        np.sqrt(np.array([each.time[1] for each in kept])),
        unit * np.array([each.velocity[0] for each in kept]).reshape(-1, 3),
        unit**2 * np.array([each.velocity[1] for each in kept]).reshape(-1, 3, 3),
        np.array([each.state[0] for each in kept]).reshape(-1, 6),
        np.array([each.state[1] for each in kept]).reshape(-1, 6, 6),
    )


def _assigned(ratio: dict[tuple[int, int], float]) -> list[tuple[int, int]]:
    """Pairs with the largest sum of positive logarithms, in the order of the later orbits."""
    if not ratio:
        return []
    pairs = list(ratio)
    taken = best_pairs(*np.array(pairs).T, np.maximum(list(ratio.values()), 0.0))
    return sorted((pairs[k] for k in taken.tolist()), key=lambda pair: pair[1])


def _encounters(paths: OrbitPaths, a: int, b: int, begin: float, end: float) -> Indices:
    """Times of the paths next to which two orbits may meet within a gap."""
    half = 0.5 * (paths.time[1] - paths.time[0])
    near = np.flatnonzero((paths.time >= begin - half) & (paths.time <= end + half))
    apart = paths.state[b, near] - paths.state[a, near]
    d, w = apart[:, :3], apart[:, 3:]
    speed2 = np.sum(w * w, axis=1)
    closest = np.clip(-np.sum(d * w, axis=1) / np.where(speed2 > 0.0, speed2, 1.0), -half, half)
    miss = np.linalg.norm(d + closest[:, None] * w, axis=1)
    spread = np.trace(paths.covariance[a, near] + paths.covariance[b, near], axis1=1, axis2=2)
    return near[miss <= _GATE * np.sqrt(spread) + _CURVED * half * np.sqrt(speed2)]


class _Approach(NamedTuple):
    """Two orbits next to some times of a gap.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Middles of intervals, nondimensional.
    width : float
        Of the intervals.
    z, rate : ndarray, shape (n, 6)
        z of equation (1) and its derivative.
    covariance : ndarray, shape (n, 6, 6)
        P_a + P_b, and that of the displacement of z by an uncertain radiation pressure.
    mapped : ndarray, shape (n, 6, 6)
        Covariances of the states of the later orbit with its state at its epoch.
    """

    time: Array
    width: float
    z: Array
    rate: Array
    covariance: Array
    mapped: Array


def _approaches(
    fits: OrbitFits,
    pairs: Sequence[tuple[int, int]],
    paths: OrbitPaths,
    last: Array,
    first: Array,
    forces: tuple,
    radiation_sigma: float,
) -> Iterator[tuple[tuple[int, int], _Approach | None]]:
    """Pairs of orbits where they may meet in the gap between the last detection of one and the
    first of the other. The approach is None if they do not meet, or if one meets a body."""
    near = [_near(paths, (a, b), float(last[a]), float(first[b])) for a, b in pairs]
    some = [k for k, (time, _) in enumerate(near) if time.size]
    orbit = np.array([pairs[k] for k in some], dtype=np.int64).ravel()
    times = [near[k][0] for k in some for _ in range(2)]
    start = fits.state[orbit], fits.epoch[orbit]
    moved = propagated_each(*start, times, forces, radiation_sigma)
    for pair, (time, width) in zip(pairs, near, strict=True):
        if time.size == 0:
            yield pair, None
            continue
        both = next(moved), next(moved)
        yield pair, _approach(time, width, both, fits.covariance[list(pair)])


def _near(
    paths: OrbitPaths, pair: tuple[int, int], begin: float, end: float
) -> tuple[Array, float]:
    """Middles of the intervals of a gap in which two orbits may meet, and the intervals' width."""
    count = max(1, int(np.ceil((end - begin) * TIME_UNIT_S / _FINE_S)))
    width = (end - begin) / count
    time = begin + width * (np.arange(count) + 0.5)
    step = paths.time[1] - paths.time[0]
    near = _encounters(paths, *pair, begin, end)
    return time[np.isin(np.rint((time - paths.time[0]) / step).astype(np.int64), near)], width


def _approach(
    time: Array, width: float, moved: Sequence[tuple[Array, Array, Array]], covariance: Array
) -> _Approach | None:
    """Two orbits with their covariances, as moved to some times by `propagated_each`."""
    state, stm, by_factor = (np.stack(each) for each in zip(*moved, strict=True))
    if not np.all(np.isfinite(state)):
        return None
    mapped = stm @ covariance[:, None]
    z, rate = state[1] - state[0], np.zeros((time.size, 6))
    rate[:, :3] = z[:, 3:]
    whole = (mapped @ stm.swapaxes(2, 3)).sum(axis=0)
    # both orbits are of one object, whose factor of the radiation pressure displaces z
    shift = by_factor[1] - by_factor[0]
    whole += shift @ shift.swapaxes(1, 2)
    return _Approach(time, width, z, rate, whole, mapped[1])


def _log_integral(approach: _Approach | None, scales: Array) -> float:
    """Logarithm of equation (1) without r / n; minus infinity without an approach, or if
    covariances are singular in double precision."""
    if approach is None:
        return -np.inf
    log_weight = log_line_integrals(
        approach.z, approach.rate, approach.covariance, scales, approach.width
    )
    return float(logsumexp(log_weight)) - np.log(scales.size)


def _solved(approach: _Approach, state: Array, covariance: Array, scales: Array) -> _Solution:
    """The moments of the mixture of equation (1); `state` and `covariance` are those of the later
    orbit."""
    given = approach.z, approach.rate, approach.covariance, approach.mapped
    parts = [line_moments(*given, scale, approach.width) for scale in scales]
    log_weight, shift, spread, change, change_spread, moved, reduced = (
        np.concatenate(each) for each in zip(*parts, strict=True)
    )
    share = np.exp(log_weight - logsumexp(log_weight))
    when = np.tile(approach.time, scales.size) + shift
    mean_time = float(share @ when)
    correction, lower = moments(share, moved, reduced)
    return _Solution(
        (mean_time, float(share @ (spread + (when - mean_time) ** 2))),
        moments(share, change, change_spread),
        (state + correction, lower + covariance),
    )
