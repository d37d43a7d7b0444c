"""Branch and bound over one level: every architecture of N satellites with J >= a threshold.

The tree is spread, breadth first, into subtrees that are searched depth first and independently
of one another against a fixed threshold, so that nodes and results do not depend on the threads.
"""

import heapq
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from threading import Event

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.optimality.node import Stack, bound_node, empty_stack, search
from cislunar.architecture.optimality.relaxation import Level

_SUBTREES = 64
_CHUNK = 200  # nodes between two looks at the clock
_FOUND = 256  # architectures a chunk can hand back


@dataclass
class LevelOutcome:
    """What the search of one level gave.

    Attributes
    ----------
    nodes : int
        Nodes bounded.
    orbit, satellites : ndarray of int, shape (found, slot)
        Architectures of J >= threshold.
    cost : ndarray, shape (found,)
        Their J.
    open_bound : float
        Upper bound on J over what was not searched; 0 when everything was.
    """

    nodes: int
    orbit: NDArray[np.int64]
    satellites: NDArray[np.int64]
    cost: NDArray[np.float64]
    open_bound: float


@dataclass
class _Subtree:
    """Nodes waiting, and what was found so far."""

    stack: Stack
    top: int
    nodes: int = 0
    found: list = field(default_factory=list)

    def run(self, level: Level, arrays: tuple, threshold: float, budget: int) -> None:
        """Search at most ``budget`` nodes."""
        found = (
            np.empty((_FOUND, level.n_slots), np.int64),
            np.empty((_FOUND, level.n_slots), np.int64),
            np.empty(_FOUND),
        )
        self.top, nodes, n_found = search(
            level, arrays, threshold, self.stack, self.top, budget, found
        )
        self.nodes += nodes
        if n_found:
            self.found.append(tuple(part[:n_found].copy() for part in found))

    @property
    def share(self) -> float:
        """Share of the tree still to search."""
        return float(self.stack.share[: self.top].sum())

    def row(self, at: int, level: Level, rows: int) -> "_Subtree":
        """A subtree of one waiting node, with room for ``rows``."""
        stack = empty_stack(level, rows)
        for target, source in zip(stack, self.stack, strict=True):
            target[0] = source[at]
        return _Subtree(stack, 1)


def _root(level: Level) -> _Subtree:
    stack = empty_stack(level, 2)
    ratio = level.stability / level.distance
    # a cone a little wider than the ratios, so that rounding cannot put a sum outside it
    stack.cone[0] = ratio.min() * (1.0 - 1e-9), ratio.max() * (1.0 + 1e-9)
    stack.highest[0] = level.observed.shape[1] - 1
    stack.share[0] = 1.0
    return _Subtree(stack, 1)


def _spread(level: Level, arrays: tuple, threshold: float, expired: Callable[[], bool]):
    """Branch the largest shares until there are enough subtrees."""
    closed = []
    waiting = [(-1.0, 0, _root(level))]
    serial = 1
    while waiting and len(waiting) < _SUBTREES and not expired():
        _, _, tree = heapq.heappop(waiting)
        tree.run(level, arrays, threshold, 1)
        closed.append(tree)
        for at in range(tree.top):
            child = tree.row(at, level, 2)
            heapq.heappush(waiting, (-child.share, serial, child))
            serial += 1
        tree.top = 0
    return closed, [tree for _, _, tree in sorted(waiting, key=lambda entry: entry[:2])]


def _depth(level: Level) -> int:
    """Most nodes a depth-first stack can hold: one per branching on a path."""
    n_orbits, counts = level.observed.shape
    return n_orbits + level.n_slots * counts + 128


def _finish(tree: _Subtree, level, arrays, threshold, expired) -> _Subtree:
    """Search a subtree to its end or until time has expired."""
    deep = tree.row(0, level, _depth(level))
    while deep.top > 0 and not expired():
        deep.run(level, arrays, threshold, _CHUNK)
        tree.top = deep.top
        tree.stack.share[0] = deep.share
        tree.nodes, tree.found = deep.nodes, deep.found
    return deep


def search_level(
    level: Level,
    arrays: tuple,
    threshold: float,
    *,
    threads: int = 2,
    deadline: float = np.inf,
    progress: Callable[[float], None] | None = None,
) -> LevelOutcome:
    """Find every architecture of a level with J >= threshold.

    Parameters
    ----------
    level : Level
        Relaxation data.
    arrays : tuple
        Exact tables, see `cislunar.architecture.compiled_cost.table_arrays`.
    threshold : float
        The J to reach.
    threads : int
        Subtrees searched at once.
    deadline : float
        Value of ``time.monotonic()`` at which to stop.
    progress : callable, optional
        Called with the share of the tree searched, 0 .. 1.

    Returns
    -------
    LevelOutcome
    """
    stopped = Event()

    def expired() -> bool:
        return stopped.is_set() or time.monotonic() >= deadline

    closed, waiting = _spread(level, arrays, threshold, expired)
    with ThreadPoolExecutor(threads) as pool:
        jobs = [pool.submit(_finish, tree, level, arrays, threshold, expired) for tree in waiting]
        try:
            pending = set(jobs)
            while pending:
                pending = wait(pending, timeout=0.5).not_done
                if progress is not None:
                    left = sum(tree.stack.share[0] for tree in waiting if tree.top > 0)
                    progress(1.0 - left)
        except BaseException:
            stopped.set()
            for job in jobs:
                job.cancel()
            raise
        finished = [job.result() for job in jobs]
    trees = closed + finished
    parts = [part for tree in trees for part in tree.found]
    slots = np.zeros((0, level.n_slots), np.int64)
    return LevelOutcome(
        nodes=sum(tree.nodes for tree in trees),
        orbit=np.concatenate([slots] + [part[0] for part in parts]),
        satellites=np.concatenate([slots] + [part[1] for part in parts]),
        cost=np.concatenate([np.zeros(0)] + [part[2] for part in parts]),
        open_bound=_open_bound(level, threshold, finished),
    )


def _open_bound(level: Level, threshold: float, trees: list[_Subtree]) -> float:
    """Upper bound on J over the nodes still waiting; 0 without any."""
    highest = 0.0
    for tree in trees:
        for at in range(tree.top):
            highest = max(highest, threshold)
            if not _refuted(level, highest, tree, at):
                highest = _node_bound(level, highest, tree, at)
    return highest


def _refuted(level: Level, threshold: float, tree: _Subtree, at: int) -> bool:
    # on a copy: fixings for a higher threshold do not hold for the lower one
    copy = tree.row(at, level, 1)
    return bound_node(level, threshold, copy.stack, 0)[0] <= 0.0


def _node_bound(level: Level, low: float, tree: _Subtree, at: int) -> float:
    """A threshold above ``low`` that the relaxation refutes, to 0.1 %."""
    high = 1.1 * low
    while not _refuted(level, high, tree, at):
        low, high = high, 2.0 * high
    while high > 1.001 * low:
        middle = np.sqrt(low * high)
        if _refuted(level, middle, tree, at):
            high = middle
        else:
            low = middle
    return float(high)
