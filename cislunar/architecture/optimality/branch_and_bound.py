"""Branch and bound over one level: all architectures of N satellites with value >= a threshold.

The tree is divided, breadth first, into subtrees. They are searched depth first and independently
of one another against a fixed threshold, so that nodes and results do not depend on the threads.
"""

import heapq
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.optimality.node import Stack, empty_stack, search

_SUBTREES = 64
_CHUNK = 200  # nodes between two reports of progress
_FOUND = 256  # largest number of architectures from a chunk


@dataclass
class _LevelOutcome:
    """Number of bounded nodes, architectures found (found, slot) with their values (found,), and an
    upper bound on the value over nodes that were not searched, 0 if there are none."""

    nodes: int
    orbit: NDArray[np.int64]
    satellites: NDArray[np.int64]
    value: NDArray[np.float64]
    open_bound: float


@dataclass
class _Subtree:
    """Waiting nodes, and the architectures found so far."""

    stack: Stack
    top: int
    nodes: int = 0
    found: list = field(default_factory=list)

    def run(self, relaxation: Any, threshold: float, budget: int) -> None:
        """Search at most ``budget`` nodes."""
        found = (
            np.empty((_FOUND, relaxation.n_slots), np.int64),
            np.empty((_FOUND, relaxation.n_slots), np.int64),
            np.empty(_FOUND),
        )
        self.top, nodes, n_found = search(
            relaxation, threshold, self.stack, self.top, budget, found
        )
        self.nodes += nodes
        if n_found:
            self.found.append(tuple(part[:n_found].copy() for part in found))

    @property
    def share(self) -> float:
        """Share of the tree that remains to be searched."""
        return float(self.stack.share[: self.top].sum())

    def row(self, at: int, relaxation: Any, rows: int) -> "_Subtree":
        """A subtree of one waiting node, with memory for ``rows`` nodes."""
        stack = empty_stack(relaxation, rows)
        for target, source in zip(stack, self.stack, strict=True):
            target[0] = source[at]
        return _Subtree(stack, 1)


def _root(relaxation: Any) -> _Subtree:
    stack = empty_stack(relaxation, 2)
    stack.interval[0] = relaxation.interval
    stack.highest[0] = relaxation.counts - 1
    stack.share[0] = 1.0
    return _Subtree(stack, 1)


def _spread(relaxation: Any, threshold: float, most: float):
    """Branch the largest shares until there are enough subtrees, or `most` nodes are bounded."""
    closed = []
    waiting = [(-1.0, 0, _root(relaxation))]
    serial = 1
    while waiting and len(waiting) < _SUBTREES and len(closed) < most:
        _, _, tree = heapq.heappop(waiting)
        tree.run(relaxation, threshold, 1)
        closed.append(tree)
        for at in range(tree.top):
            child = tree.row(at, relaxation, 2)
            heapq.heappush(waiting, (-child.share, serial, child))
            serial += 1
        tree.top = 0
    return closed, [tree for _, _, tree in sorted(waiting, key=lambda entry: entry[:2])]


def _finish(tree: _Subtree, relaxation, threshold, most: float, stopped: Event) -> _Subtree:
    """Search a subtree to its end, or until `most` nodes are bounded or the search is stopped."""
    # one row per branching on a path
    rows = relaxation.n_orbits + relaxation.n_slots * relaxation.counts + 128
    deep = tree.row(0, relaxation, rows)
    while deep.top > 0 and deep.nodes < most and not stopped.is_set():
        deep.run(relaxation, threshold, int(min(_CHUNK, most - deep.nodes)))
        tree.top = deep.top
        tree.stack.share[0] = deep.share
        tree.nodes, tree.found = deep.nodes, deep.found
    return deep


def search_level(
    relaxation: Any,
    threshold: float,
    *,
    threads: int = 2,
    most_nodes: float = np.inf,
    progress: Callable[[float], None] | None = None,
) -> _LevelOutcome:
    """Find every architecture of a level with value >= threshold.

    `relaxation` has the interface of `cislunar.architecture.optimality.node`; `threads` subtrees
    are searched concurrently, and each may use an equal share of `most_nodes`. `progress` is called
    with the share of the tree searched, 0 .. 1."""

    stopped = Event()
    closed, waiting = _spread(relaxation, threshold, most_nodes)
    share = np.floor((most_nodes - len(closed)) / max(len(waiting), 1))
    with ThreadPoolExecutor(threads) as pool:
        jobs = [
            pool.submit(_finish, tree, relaxation, threshold, share, stopped) for tree in waiting
        ]
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
    slots = np.zeros((0, relaxation.n_slots), np.int64)
    return _LevelOutcome(
        nodes=sum(tree.nodes for tree in trees),
        orbit=np.concatenate([slots] + [part[0] for part in parts]),
        satellites=np.concatenate([slots] + [part[1] for part in parts]),
        value=np.concatenate([np.zeros(0)] + [part[2] for part in parts]),
        open_bound=_open_bound(relaxation, threshold, finished),
    )


def _open_bound(relaxation: Any, threshold: float, trees: list[_Subtree]) -> float:
    """Upper bound on the value over the waiting nodes; 0 without any."""
    highest = 0.0
    for tree in trees:
        for at in range(tree.top):
            highest = max(highest, threshold)
            if not _refuted(relaxation, highest, tree, at):
                highest = _node_bound(relaxation, highest, tree, at)
    return highest


def _refuted(relaxation: Any, threshold: float, tree: _Subtree, at: int) -> bool:
    # on a copy, because fixings for a higher threshold do not hold for a lower one
    copy = tree.row(at, relaxation, 2)
    copy.run(relaxation, threshold, 1)
    return copy.top == 0 and not copy.found


def _node_bound(relaxation: Any, low: float, tree: _Subtree, at: int) -> float:
    """A threshold above ``low`` that the relaxation refutes, to 0.1 %."""
    high = 1.1 * low
    while not _refuted(relaxation, high, tree, at):
        low, high = high, 2.0 * high
    while high > 1.001 * low:
        middle = np.sqrt(low * high)
        if _refuted(relaxation, middle, tree, at):
            high = middle
        else:
            low = middle
    return float(high)
