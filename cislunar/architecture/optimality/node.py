"""One node of the branch and bound over architectures: bound, fix, branch.

A node is a set of architectures: for every orbit a range of excess satellites (empty = excluded)
and whether it must be chosen, and an interval of one parameter that the bound may need. Nodes are
rows of a stack of arrays.

The relaxation of the objective is any object with

* ``n_slots``, ``excess``, ``n_orbits``, ``counts``, ``interval``: orbits to choose, satellites
  beyond one per orbit, candidate orbits, different counts, root interval (two floats);
* ``relax(threshold, stack, top)``: bound, offset, score, split. An architecture of the node that
  exceeds the threshold has offset + sum of its scores > 0, with the scores by (orbit not excluded,
  count); bound is the maximum of this sum, so that a bound <= 0 refutes the node. A split inside
  the interval requests to divide it there; 0 leaves the branching to the orbits. The maximizer, as
  architectures with weights, is written into the row of the stack;
* ``value(orbit, satellites)``: the objective itself.

`search` is interpreted for such an object. A NamedTuple with ``compiled = True`` that implements
`relax` and `value` (`cislunar.compiled`) is compiled.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.optimality.knapsack import conditional_bests
from cislunar.compiled import njit

MAX_VERTICES = 32
_CLOSED, _LEAF, _BRANCHED = 0, 1, 2


class Stack(NamedTuple):
    """Nodes in rows: interval (node, 2) of the relaxation's parameter; range of excess satellites
    (node, orbit), lowest > highest for an excluded orbit; orbits that must be chosen (node, orbit);
    share of the tree, halved at each branching; and the initial architectures of the relaxation,
    orbits and excess satellites (node, vertex, slot), weights (node, vertex) and their number."""

    interval: NDArray[np.float64]
    lowest: NDArray[np.int16]
    highest: NDArray[np.int16]
    forced: NDArray[np.bool_]
    share: NDArray[np.float64]
    orbits: NDArray[np.int16]
    extras: NDArray[np.int16]
    weight: NDArray[np.float64]
    vertices: NDArray[np.int64]


def empty_stack(relaxation: Any, rows: int) -> Stack:
    """Stack with memory for ``rows`` nodes."""
    slots = (rows, MAX_VERTICES, relaxation.n_slots)
    return Stack(
        interval=np.zeros((rows, 2)),
        lowest=np.zeros((rows, relaxation.n_orbits), np.int16),
        highest=np.zeros((rows, relaxation.n_orbits), np.int16),
        forced=np.zeros((rows, relaxation.n_orbits), np.bool_),
        share=np.zeros(rows),
        orbits=np.zeros(slots, np.int16),
        extras=np.zeros(slots, np.int16),
        weight=np.zeros((rows, MAX_VERTICES)),
        vertices=np.zeros(rows, np.int64),
    )


def relax(relaxation, threshold, stack, top):
    """Bound, offset, score and split of a node; overloaded for compiled relaxations."""
    return relaxation.relax(threshold, stack, top)


def value(relaxation, orbit, satellites):
    """Value of an architecture; overloaded for compiled relaxations."""
    return relaxation.value(orbit, satellites)


@njit(cache=True, nogil=True)
def active_orbits(lowest, highest):
    """Indices of the orbits that are not excluded."""
    return np.flatnonzero(lowest <= highest)


@njit(cache=True, nogil=True)
def _fix(stack, top, n_slots, excess, offset, score):
    """Drop counts and force orbits according to the bound; False if no architecture remains."""
    lowest, highest, forced = stack.lowest[top], stack.highest[top], stack.forced[top]
    active = active_orbits(lowest, highest)
    low, high, must = lowest[active], highest[active], forced[active]
    taken, left_out = conditional_bests(score, low, high, must, n_slots, excess)
    n_forced = 0
    for a in range(active.size):
        i = active[a]
        while lowest[i] <= highest[i] and offset + taken[a, lowest[i]] <= 0.0:
            lowest[i] += 1
        while lowest[i] <= highest[i] and offset + taken[a, highest[i]] <= 0.0:
            highest[i] -= 1
        if lowest[i] > highest[i]:
            if forced[i]:
                return False
        elif offset + left_out[a] <= 0.0:
            forced[i] = True
        if forced[i]:
            n_forced += 1
    return n_forced <= n_slots


@njit(cache=True, nogil=True)
def _copy(stack, source, target):
    stack.interval[target] = stack.interval[source]
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
    """Drop the vertices that a node no longer permits."""
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
    """Weight of each orbit and its mean excess satellites in the maximizer."""
    usage, excess = np.zeros(n_orbits), np.zeros(n_orbits)
    for k in range(stack.vertices[top]):
        weight = stack.weight[top, k]
        for slot in range(stack.orbits.shape[2]):
            usage[stack.orbits[top, k, slot]] += weight
            excess[stack.orbits[top, k, slot]] += weight * stack.extras[top, k, slot]
    return usage, excess


@njit(cache=True, nogil=True)
def _orbit_to_branch(stack, top, usage):
    """The free orbit whose weight is nearest to one half, or -1."""
    best, chosen = -1.0, -1
    for i in range(usage.size):
        if stack.forced[top, i] or stack.lowest[top, i] > stack.highest[top, i]:
            continue
        # among orbits with weight 0 or 1, prefer weight 1
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
def _branch(stack, top, split):
    """Replace the node at ``top`` by its two children, at ``top`` and ``top + 1``."""
    stack.share[top] *= 0.5
    _copy(stack, top, top + 1)
    if split > 0.0:
        stack.interval[top, 1] = split
        stack.interval[top + 1, 0] = split
        return
    usage, excess = _usage(stack, top, stack.lowest.shape[1])
    orbit = _orbit_to_branch(stack, top, usage)
    # first orbits with fractional weight, then counts, then the remaining orbits
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
def _settle(stack, top, n_slots, excess, chosen, satellites):
    """Whether the node is one architecture, then written into ``chosen`` and ``satellites``."""
    lowest, highest, forced = stack.lowest[top], stack.highest[top], stack.forced[top]
    if active_orbits(lowest, highest).size == n_slots:
        for i in range(lowest.size):
            forced[i] = lowest[i] <= highest[i]
    slot, used = 0, 0
    for i in range(lowest.size):
        if forced[i]:
            if slot == n_slots or lowest[i] != highest[i]:
                return False
            chosen[slot] = i
            satellites[slot] = lowest[i] + 1
            used += lowest[i]
            slot += 1
    return slot == n_slots and used == excess


@njit(cache=True, nogil=True)
def _advance(stack, top, n_slots, excess, offset, score, split, chosen, satellites):
    """Fix according to the bound, then close the node, recognize a leaf, or branch."""
    if not _fix(stack, top, n_slots, excess, offset, score):
        return _CLOSED
    if _settle(stack, top, n_slots, excess, chosen, satellites):
        return _LEAF
    _branch(stack, top, split)
    _keep_feasible(stack, top)
    _keep_feasible(stack, top + 1)
    return _BRANCHED


@njit(cache=True, nogil=True)
def _search(relaxation, threshold, stack, top, budget, found):
    """See `search`."""
    found_orbit, found_satellites, found_value = found
    chosen = np.empty(relaxation.n_slots, np.int64)
    satellites = np.empty(relaxation.n_slots, np.int64)
    nodes, n_found = 0, 0
    while top > 0 and nodes < budget and n_found < found_value.size:
        nodes += 1
        bound, offset, score, split = relax(relaxation, threshold, stack, top - 1)
        state = _CLOSED
        if bound > 0.0:
            state = _advance(
                stack, top - 1, relaxation.n_slots, relaxation.excess, offset, score, split,
                chosen, satellites,
            )  # fmt: skip
        if state == _BRANCHED:
            top += 1
            continue
        top -= 1
        if state == _LEAF:
            reached = value(relaxation, chosen, satellites)
            if reached >= threshold:
                found_orbit[n_found] = chosen
                found_satellites[n_found] = satellites
                found_value[n_found] = reached
                n_found += 1
    return top, nodes, n_found


def search(
    relaxation: Any,
    threshold: float,
    stack: Stack,
    top: int,
    budget: int,
    found: tuple[NDArray, NDArray, NDArray],
) -> tuple[int, int, int]:
    """Depth-first search for value >= threshold through the ``top`` nodes on the stack. It stops
    when the stack is empty, the budget of nodes is used, or ``found`` is full. ``found`` receives
    orbits (found, slot), satellites (found, slot) and values (found,). Returns the number of
    remaining nodes, of bounded nodes and of architectures found."""
    run = _search if getattr(relaxation, "compiled", False) else _search.py_func
    return run(relaxation, threshold, stack, top, budget, found)
