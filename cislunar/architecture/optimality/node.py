"""One node of the architecture branch and bound: bound, fix, branch.

A node is a set of architectures: a cone of S/d and, for every orbit, a range of excess satellites
(empty = left out) and whether it must be chosen. Nodes live in the rows of a stack of arrays.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.architecture.compiled_cost import exact_cost
from cislunar.architecture.optimality.knapsack import conditional_bests
from cislunar.architecture.optimality.relaxation import MAX_VERTICES, Level, relax

_WIDE_CONE = 0.4  # ln(r1/r0) above which the cone is halved before anything else
_NARROW_CONE = 0.01  # and below which it is left alone


class Stack(NamedTuple):
    """Nodes in rows.

    Attributes
    ----------
    cone : ndarray, shape (node, 2)
        Least and largest S/d.
    lowest, highest : ndarray of int16, shape (node, orbit)
        Range of excess satellites; lowest > highest leaves the orbit out.
    forced : ndarray of bool, shape (node, orbit)
        Orbits that must be chosen.
    share : ndarray, shape (node,)
        Share of the tree, halved at each branching.
    orbits, extras : ndarray of int16, shape (node, vertex, slot)
        Vertices the relaxation starts from.
    weight : ndarray, shape (node, vertex)
        Their weights.
    vertices : ndarray of int64, shape (node,)
        Number of them.
    """

    cone: NDArray[np.float64]
    lowest: NDArray[np.int16]
    highest: NDArray[np.int16]
    forced: NDArray[np.bool_]
    share: NDArray[np.float64]
    orbits: NDArray[np.int16]
    extras: NDArray[np.int16]
    weight: NDArray[np.float64]
    vertices: NDArray[np.int64]


def empty_stack(level: Level, rows: int) -> Stack:
    """Stack with room for ``rows`` nodes."""
    n_orbits = level.observed.shape[0]
    return Stack(
        cone=np.zeros((rows, 2)),
        lowest=np.zeros((rows, n_orbits), np.int16),
        highest=np.zeros((rows, n_orbits), np.int16),
        forced=np.zeros((rows, n_orbits), np.bool_),
        share=np.zeros(rows),
        orbits=np.zeros((rows, MAX_VERTICES, level.n_slots), np.int16),
        extras=np.zeros((rows, MAX_VERTICES, level.n_slots), np.int16),
        weight=np.zeros((rows, MAX_VERTICES)),
        vertices=np.zeros(rows, np.int64),
    )


@njit(cache=True, nogil=True)
def _active(lowest, highest):
    count = 0
    for i in range(lowest.size):
        if lowest[i] <= highest[i]:
            count += 1
    active = np.empty(count, np.int64)
    count = 0
    for i in range(lowest.size):
        if lowest[i] <= highest[i]:
            active[count] = i
            count += 1
    return active


@njit(cache=True, nogil=True)
def _fix(level, bound_offset, score, active, lowest, highest, forced):
    """Drop counts and force orbits that the bound decides; False when nothing is left.

    ``lowest``, ``highest`` and ``forced`` are the node's own rows and are updated.
    """
    low, high, must = lowest[active], highest[active], forced[active]
    taken, left_out = conditional_bests(score, low, high, must, level.n_slots, level.excess)
    n_forced = 0
    for a in range(active.size):
        i = active[a]
        while lowest[i] <= highest[i] and bound_offset + taken[a, lowest[i]] <= 0.0:
            lowest[i] += 1
        while lowest[i] <= highest[i] and bound_offset + taken[a, highest[i]] <= 0.0:
            highest[i] -= 1
        if lowest[i] > highest[i]:
            if forced[i]:
                return False
        elif bound_offset + left_out[a] <= 0.0:
            forced[i] = True
        if forced[i]:
            n_forced += 1
    return n_forced <= level.n_slots


@njit(cache=True, nogil=True)
def bound_node(level, threshold, stack, top):
    """Upper bound on H over a node, with the fixings it allows made in the node's row.

    Returns
    -------
    bound : float
        <= 0 when nothing in the node beats the threshold.
    mean : ndarray, shape (3 + group,)
        Maximiser of the relaxation.
    """
    lowest, highest, forced = stack.lowest[top], stack.highest[top], stack.forced[top]
    active = _active(lowest, highest)
    bound, score, offset, n, mean = relax(
        level,
        threshold,
        stack.cone[top, 0],
        stack.cone[top, 1],
        active,
        lowest[active].astype(np.int64),
        highest[active].astype(np.int64),
        forced[active],
        stack.orbits[top],
        stack.extras[top],
        stack.weight[top],
        stack.vertices[top],
    )
    stack.vertices[top] = n
    if bound > 0.0 and not _fix(level, offset, score, active, lowest, highest, forced):
        bound = -np.inf
    return bound, mean


@njit(cache=True, nogil=True)
def _copy(stack, source, target):
    stack.cone[target] = stack.cone[source]
    stack.lowest[target] = stack.lowest[source]
    stack.highest[target] = stack.highest[source]
    stack.forced[target] = stack.forced[source]
    stack.share[target] = stack.share[source]
    stack.orbits[target] = stack.orbits[source]
    stack.extras[target] = stack.extras[source]
    stack.weight[target] = stack.weight[source]
    stack.vertices[target] = stack.vertices[source]


@njit(cache=True, nogil=True)
def _keep_feasible(stack, top):
    """Drop the vertices a node no longer allows."""
    kept, total = 0, 0.0
    n_forced = stack.forced[top].sum()
    for k in range(stack.vertices[top]):
        allowed = stack.weight[top, k] > 0.0
        met = 0
        for slot in range(stack.orbits.shape[2]):
            i, e = stack.orbits[top, k, slot], stack.extras[top, k, slot]
            allowed &= stack.lowest[top, i] <= e <= stack.highest[top, i]
            met += stack.forced[top, i]
        if not allowed or met < n_forced:
            continue
        stack.orbits[top, kept] = stack.orbits[top, k]
        stack.extras[top, kept] = stack.extras[top, k]
        stack.weight[top, kept] = stack.weight[top, k]
        total += stack.weight[top, k]
        kept += 1
    stack.vertices[top] = kept
    for k in range(kept):
        stack.weight[top, k] /= total


@njit(cache=True, nogil=True)
def _usage(stack, top, n_orbits):
    """Weight of each orbit and its mean excess satellites in the maximiser."""
    usage, excess = np.zeros(n_orbits), np.zeros(n_orbits)
    for k in range(stack.vertices[top]):
        weight = stack.weight[top, k]
        for slot in range(stack.orbits.shape[2]):
            usage[stack.orbits[top, k, slot]] += weight
            excess[stack.orbits[top, k, slot]] += weight * stack.extras[top, k, slot]
    return usage, excess


@njit(cache=True, nogil=True)
def _orbit_to_branch(stack, top, usage):
    """The free orbit used most nearly by half, or -1."""
    best, chosen = -1.0, -1
    for i in range(usage.size):
        if stack.forced[top, i] or stack.lowest[top, i] > stack.highest[top, i]:
            continue
        # among orbits used wholly or not at all, one that is used
        fraction = min(usage[i], 1.0 - usage[i]) + 1e-9 * usage[i]
        if fraction > best:
            best, chosen = fraction, i
    return chosen


@njit(cache=True, nogil=True)
def _count_to_branch(stack, top, usage, excess):
    """The forced orbit with the widest range of counts, and where to split it, or -1."""
    best, chosen, split = 0, -1, 0
    for i in range(usage.size):
        width = stack.highest[top, i] - stack.lowest[top, i]
        if stack.forced[top, i] and width > best:
            mean = excess[i] / max(usage[i], 1e-9)
            best, chosen = width, i
            split = min(max(int(mean), stack.lowest[top, i]), stack.highest[top, i] - 1)
    return chosen, split


@njit(cache=True, nogil=True)
def _cone_split(level, threshold, stack, top, mean, bound):
    """Where to split the cone, or 0 when branching on the orbits does more."""
    r0, r1 = stack.cone[top]
    width = np.log(r1 / r0)
    if width > _WIDE_CONE:
        return np.sqrt(r0 * r1)
    if width < _NARROW_CONE:
        return 0.0
    root = np.sqrt(level.satellites * level.scale * threshold)
    loss = root * (
        np.sqrt(mean[1] * mean[2])
        - (mean[1] + np.sqrt(r0 * r1) * mean[2]) / (np.sqrt(r0) + np.sqrt(r1))
    )
    if loss < 0.5 * bound:
        return 0.0
    margin = 0.2 * width
    at = np.log(mean[1] / mean[2])
    return np.exp(min(max(at, np.log(r0) + margin), np.log(r1) - margin))


@njit(cache=True, nogil=True)
def _branch(level, threshold, stack, top, mean, bound):
    """Replace the node at ``top`` by its two children, at ``top`` and ``top + 1``."""
    stack.share[top] *= 0.5
    _copy(stack, top, top + 1)
    split = _cone_split(level, threshold, stack, top, mean, bound)
    if split > 0.0:
        stack.cone[top, 1] = split
        stack.cone[top + 1, 0] = split
        return
    usage, excess = _usage(stack, top, stack.lowest.shape[1])
    orbit = _orbit_to_branch(stack, top, usage)
    # a fraction of an orbit is settled first, then the counts, then the rest of the orbits
    if orbit < 0 or min(usage[orbit], 1.0 - usage[orbit]) < 1e-6:
        counted, at = _count_to_branch(stack, top, usage, excess)
        if counted >= 0:
            stack.highest[top, counted] = at
            stack.lowest[top + 1, counted] = at + 1
            return
    stack.highest[top, orbit] = -1
    stack.lowest[top, orbit] = 0
    stack.forced[top + 1, orbit] = True


@njit(cache=True, nogil=True)
def _settle(level, stack, top, chosen, satellites):
    """Whether the node is one architecture; then ``chosen`` and ``satellites`` hold it."""
    lowest, highest, forced = stack.lowest[top], stack.highest[top], stack.forced[top]
    if _active(lowest, highest).size == level.n_slots:
        for i in range(lowest.size):
            forced[i] = lowest[i] <= highest[i]
    slot, excess = 0, 0
    for i in range(lowest.size):
        if forced[i]:
            if slot == level.n_slots or lowest[i] != highest[i]:
                return False
            chosen[slot] = i
            satellites[slot] = lowest[i] + 1
            excess += lowest[i]
            slot += 1
    return slot == level.n_slots and excess == level.excess


@njit(cache=True, nogil=True)
def search(level, arrays, threshold, stack, top, budget, found):
    """Depth-first search until the stack is empty or the budget of nodes spent.

    Parameters
    ----------
    level : Level
    arrays : tuple
        Exact tables: observations, observed, distance, stability, n_steps.
    threshold : float
        The J to reach.
    stack : Stack
    top : int
        Number of nodes on the stack.
    budget : int
        Most nodes to bound.
    found : tuple of ndarray
        Orbits (found, slot), satellites (found, slot), J (found,); filled with the architectures
        of J >= threshold.

    Returns
    -------
    top, nodes, n_found : int
        Nodes left, nodes bounded, architectures found. The search also stops when ``found`` is
        full.
    """
    observations, observed, distance, stability, n_steps = arrays
    found_orbit, found_satellites, found_cost = found
    chosen = np.empty(level.n_slots, np.int64)
    satellites = np.empty(level.n_slots, np.int64)
    nodes, n_found = 0, 0
    while top > 0 and nodes < budget and n_found < found_cost.size:
        nodes += 1
        here = top - 1
        bound, mean = bound_node(level, threshold, stack, here)
        if bound <= 0.0:
            top -= 1
            continue
        if _settle(level, stack, here, chosen, satellites):
            cost = exact_cost(
                observations, observed, distance, stability, n_steps, chosen, satellites
            )
            if cost >= threshold:
                found_orbit[n_found] = chosen
                found_satellites[n_found] = satellites
                found_cost[n_found] = cost
                n_found += 1
            top -= 1
            continue
        _branch(level, threshold, stack, here, mean, bound)
        _keep_feasible(stack, here)
        _keep_feasible(stack, here + 1)
        top += 1
    return top, nodes, n_found
