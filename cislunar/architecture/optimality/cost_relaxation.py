"""Concave relaxation of J for a prescribed number of satellites, and upper bounds from it.

For architectures x of N satellites, J = v s / (N S d c), and v, S, d and the observations per
satellite y of every target are linear in x. The question "is there an x with J > T?" becomes
"is sqrt(v s) > sqrt(N c T) sqrt(S d)?", which is relaxed to a concave function H(x) > 0:

* s <= sum over targets of the concave envelope of log10, and by Jensen's inequality the targets
  may be combined into groups at their mean;
* sqrt(v s) is concave, and sqrt(v s) <= (theta v + s / theta) / 2 for every theta > 0;
* for r0 <= S/d <= r1 the chord (S + sqrt(r0 r1) d) / (sqrt r0 + sqrt r1) <= sqrt(S d).

For fixed theta and tangent point y the bound is linear in x, so that its maximum over all choices
of orbits and counts is exact: if it is <= 0, no architecture in the cone exceeds T.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.cost_kernels import CostArrays, architecture_cost, log_envelope
from cislunar.architecture.optimality import node
from cislunar.architecture.optimality.knapsack import NO_CHOICE, best_choice
from cislunar.architecture.optimality.node import MAX_VERTICES, active_orbits
from cislunar.compiled import implements, njit

_LOG10_E = np.log10(np.e)
_MAX_CUTS = 40  # largest number of tangents
_MAX_STEPS = 12  # largest number of exchanges between vertices per tangent
_WIDE_CONE = 0.4  # ln(r1/r0) above which the cone is halved before anything else
_NARROW_CONE = 0.01  # ln(r1/r0) below which the cone is not split


class CostRelaxation(NamedTuple):
    """Linear pieces of J for one total number of satellites and one sign of the log-sum.

    `n_slots` to `interval` are described in `cislunar.architecture.optimality.node`; the parameter
    is S/d, its interval a cone. `observed`, `stability` and `distance` (orbit, count) are v, S and
    d by excess satellites; `cover` (orbit, count, group) are mean observations per satellite over
    the targets of a group, and `mass` (group,) their number. `constant` is added to the log-sum;
    with no groups it is the whole bound on |s|."""

    n_slots: int
    excess: int
    n_orbits: int
    counts: int
    interval: tuple[float, float]
    observed: NDArray[np.float64]
    stability: NDArray[np.float64]
    distance: NDArray[np.float64]
    cover: NDArray[np.float64]
    mass: NDArray[np.float64]
    constant: float
    arrays: CostArrays

    compiled = True


@njit(cache=True, nogil=True)
def _tangent(point, mass, constant, slope):
    """Log-sum bound, theta and log-sum of the tangent plane at y = 0, at a point (v, S, d, y of the
    groups); ``slope`` is filled. theta = sqrt(s / v) makes the bound on sqrt(v s) tight there."""
    logs = constant
    offset = constant
    for g in range(mass.size):
        y = point[3 + g]
        value = log_envelope(y)
        gradient = _LOG10_E / max(y, np.e)
        slope[g] = mass[g] * gradient
        logs += mass[g] * value
        offset += mass[g] * (value - gradient * y)
    theta = np.sqrt(max(logs, 1e-12) / max(point[0], 1e-12))
    return logs, theta, offset


@njit(cache=True, nogil=True)
def _scores(level, active, lowest, highest, theta, slope, price, ratio, score):
    """Fill the score of every allowed (orbit, count): the coefficient of the linear bound."""
    half = 0.5 / theta
    for a in range(active.size):
        i = active[a]
        for e in range(lowest[a], highest[a] + 1):
            logs = 0.0
            cover = level.cover[i, e]
            for g in range(slope.size):
                logs += slope[g] * cover[g]
            score[a, e] = (
                0.5 * theta * level.observed[i, e]
                + half * logs
                - price * (level.stability[i, e] + ratio * level.distance[i, e])
            )


@njit(cache=True, nogil=True)
def _vertex_point(level, orbit, extra, point):
    """Fill (v, S, d, y of the groups) of one architecture."""
    point[:] = 0.0
    for k in range(orbit.size):
        i, e = orbit[k], extra[k]
        point[0] += level.observed[i, e]
        point[1] += level.stability[i, e]
        point[2] += level.distance[i, e]
        for g in range(level.mass.size):
            point[3 + g] += level.cover[i, e, g]


@njit(cache=True, nogil=True)
def _value(point, logs, price, ratio):
    """H at a point."""
    return np.sqrt(max(point[0] * logs, 0.0)) - price * (point[1] + ratio * point[2])


@njit(cache=True, nogil=True)
def _exchange(level, points, weight, n, price, ratio, slope, tolerance):
    """Move weight from the worst vertex to the best until the vertices agree within tolerance.
    Returns H and the weighted mean point."""
    mean = np.zeros(points.shape[1])
    for k in range(n):
        mean += weight[k] * points[k]
    logs, theta, _ = _tangent(mean, level.mass, level.constant, slope)
    value = _value(mean, logs, price, ratio)
    trial = np.empty_like(mean)
    move = np.empty_like(mean)
    for _ in range(_MAX_STEPS):
        best, worst = -1, -1
        high, low = -np.inf, np.inf
        for k in range(n):
            p = points[k]
            logs = 0.0
            for g in range(slope.size):
                logs += slope[g] * p[3 + g]
            s = 0.5 * theta * p[0] + 0.5 / theta * logs - price * (p[1] + ratio * p[2])
            if s > high:
                best, high = k, s
            if weight[k] > 0.0 and s < low:
                worst, low = k, s
        if best == worst or high - low <= tolerance:
            break
        move[:] = points[best] - points[worst]
        step = min(weight[worst], _newton_step(mean, move, theta, slope, high - low))
        for _ in range(30):
            trial[:] = mean + step * move
            logs, trial_theta, _ = _tangent(trial, level.mass, level.constant, slope)
            trial_value = _value(trial, logs, price, ratio)
            if trial_value >= value:
                break
            step *= 0.5
        else:
            _tangent(mean, level.mass, level.constant, slope)
            break
        weight[best] += step
        weight[worst] -= step
        if weight[worst] < 1e-12:
            weight[worst] = 0.0
        mean[:] = trial
        value, theta = trial_value, trial_theta
    return value, mean


@njit(cache=True, nogil=True)
def _newton_step(mean, move, theta, slope, rise):
    """Maximizer of the quadratic model of H along a direction."""
    first, second = 0.0, 0.0
    for g in range(slope.size):
        first += slope[g] * move[3 + g]
        y = mean[3 + g]
        if y > np.e:
            second -= slope[g] * move[3 + g] ** 2 / y
    v, s = mean[0], theta * theta * mean[0]
    if v <= 0.0 or s <= 0.0:
        return 1.0
    product = v * s
    d1 = move[0] * s + v * first
    d2 = 2.0 * move[0] * first + v * second
    curvature = d2 / (2.0 * np.sqrt(product)) - d1 * d1 / (4.0 * product * np.sqrt(product))
    return rise / -curvature if curvature < 0.0 else 1.0


@njit(cache=True, nogil=True)
def _root(level, threshold):
    """sqrt(N c T)."""
    return np.sqrt((level.n_slots + level.excess) * level.arrays.scale * threshold)


@njit(cache=True, nogil=True)
def _decompose(level, threshold, r0, r1, active, lowest, highest, forced, stack, top):
    """Upper bound on H over the choices of a node, by simplicial decomposition. ``active`` holds
    the remaining orbits; ``lowest``, ``highest`` and ``forced`` are aligned with it. The vertices
    in the stack's row are the initial ones and are updated. Returns the bound, the scores (active,
    count) and the offset of its tangent, and the maximizer (v, S, d, y of the groups)."""
    orbits, extras, weight = stack.orbits[top], stack.extras[top], stack.weight[top]
    n = stack.vertices[top]
    # sqrt(N c T) sqrt(S d) >= price (S + ratio d) in the cone
    price, ratio = _root(level, threshold) / (np.sqrt(r0) + np.sqrt(r1)), np.sqrt(r0 * r1)
    n_groups = level.mass.size
    slope = np.empty(n_groups)
    points = np.empty((MAX_VERTICES, 3 + n_groups))
    score = np.empty((active.size, level.observed.shape[1]))
    best_score = np.empty_like(score)
    position = np.empty(level.n_slots, np.int64)
    extra = np.empty(level.n_slots, np.int64)
    for k in range(n):
        _vertex_point(level, orbits[k], extras[k], points[k])
    mean = _typical_point(level, active, lowest)
    value, bound, best_offset, tolerance = -np.inf, np.inf, 0.0, 0.0
    for _ in range(_MAX_CUTS):
        if n > 0:
            value, mean = _exchange(level, points, weight, n, price, ratio, slope, tolerance)
        _, theta, offset = _tangent(mean, level.mass, level.constant, slope)
        offset *= 0.5 / theta
        _scores(level, active, lowest, highest, theta, slope, price, ratio, score)
        choice = best_choice(
            score, lowest, highest, forced, level.n_slots, level.excess, position, extra
        )
        if choice <= 0.5 * NO_CHOICE:
            bound = -np.inf
            break
        if offset + choice < bound:
            bound, best_offset = offset + choice, offset
            best_score[:] = score
        gap = offset + choice - value
        if bound <= 0.0 or (value > 0.0 and gap <= 0.05 * value) or gap <= 1e-9 * abs(bound):
            break
        tolerance = 0.1 * gap if n > 0 else 0.0
        n = _add_vertex(orbits, extras, weight, points, n, active, position, extra)
        _vertex_point(level, orbits[n - 1], extras[n - 1], points[n - 1])
    stack.vertices[top] = n
    return bound, best_score, best_offset, mean


@njit(cache=True, nogil=True)
def _typical_point(level, active, lowest):
    """Point of S average orbits, the initial tangent point."""
    mean = np.zeros(3 + level.mass.size)
    factor = level.n_slots / max(active.size, 1)
    for a in range(active.size):
        i, e = active[a], lowest[a]
        mean[0] += factor * level.observed[i, e]
        for g in range(level.mass.size):
            mean[3 + g] += factor * level.cover[i, e, g]
    return mean


@njit(cache=True, nogil=True)
def _add_vertex(orbits, extras, weight, points, n, active, position, extra):
    """Append a vertex, replacing unused ones if the store is full; returns their number."""
    kept = 0
    lightest = 0
    for k in range(n):
        if weight[k] < weight[lightest]:
            lightest = k
    for k in range(n):
        if weight[k] == 0.0 or (n == MAX_VERTICES and k == lightest):
            continue
        orbits[kept] = orbits[k]
        extras[kept] = extras[k]
        points[kept] = points[k]
        weight[kept] = weight[k]
        kept += 1
    total = weight[:kept].sum()
    weight[:kept] /= max(total, 1e-300)
    for k in range(position.size):
        orbits[kept, k] = active[position[k]]
        extras[kept, k] = extra[k]
    weight[kept] = 1.0 if kept == 0 else 0.0
    return kept + 1


@njit(cache=True, nogil=True)
def _cone_split(level, threshold, r0, r1, mean, bound):
    """Where to split the cone, or 0 if branching on the orbits is more effective."""
    width = np.log(r1 / r0)
    if width > _WIDE_CONE:
        return np.sqrt(r0 * r1)
    if width < _NARROW_CONE:
        return 0.0
    loss = _root(level, threshold) * (
        np.sqrt(mean[1] * mean[2])
        - (mean[1] + np.sqrt(r0 * r1) * mean[2]) / (np.sqrt(r0) + np.sqrt(r1))
    )
    if loss < 0.5 * bound:
        return 0.0
    margin = 0.2 * width
    at = np.log(mean[1] / mean[2])
    return np.exp(min(max(at, np.log(r0) + margin), np.log(r1) - margin))


@implements(node.relax, CostRelaxation)
def _relax(level, threshold, stack, top):
    """Bound on H over a node; see `cislunar.architecture.optimality.node`."""
    r0, r1 = stack.interval[top]
    lowest, highest = stack.lowest[top], stack.highest[top]
    active = active_orbits(lowest, highest)
    bound, score, offset, mean = _decompose(
        level,
        threshold,
        r0,
        r1,
        active,
        lowest[active].astype(np.int64),
        highest[active].astype(np.int64),
        stack.forced[top][active],
        stack,
        top,
    )
    split = _cone_split(level, threshold, r0, r1, mean, bound) if bound > 0.0 else 0.0
    return bound, offset, score, split


@implements(node.value, CostRelaxation)
def _value_of(level, orbit, satellites):
    return architecture_cost(level.arrays, orbit, satellites)
