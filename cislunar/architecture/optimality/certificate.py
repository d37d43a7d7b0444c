"""Proof that an architecture has the largest J of all orbits and satellite counts.

J = |v s| / (N S d c) is bounded level by level, one total number of satellites N at a time. A level
is refuted by four scalars, or searched by a branch and bound whose nodes are bounded by a concave
relaxation (`cislunar.architecture.optimality.relaxation`). Everything with J >= (1 - epsilon) J* is
found on the way. The log-sum s may be negative when orbits hold several satellites; those
architectures are bounded apart.

The proof is computer-assisted, in double precision: nodes are pruned against the threshold less
one part in 1e9, not by interval arithmetic.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.compiled_cost import architecture_cost, table_arrays
from cislunar.architecture.coordinate_search import coordinate_search
from cislunar.architecture.optimality.branch_and_bound import search_level
from cislunar.architecture.optimality.total_count_bound import LevelFactory
from cislunar.architecture.tables import ArchitectureTables
from cislunar.errors import ConfigurationError

_TOLERANCE = 1e-6  # least relative gap between the threshold and J*
_ROUNDING = 1e-9
_PROGRESS_STEPS = 1000


@dataclass(frozen=True)
class CountSummary:
    """How the architectures of one total number of satellites were dealt with.

    Attributes
    ----------
    n_satellites : int
        Total number of satellites.
    negative : bool
        Whether these are the architectures with a negative log-sum.
    scalar_bound : float
        Upper bound on J from four scalars.
    bound : float
        Upper bound on J after the search.
    nodes : int
        Nodes of the tree; 0 when not searched.
    n_found : int
        Architectures within epsilon of the best.
    seconds : float
        Time spent.
    """

    n_satellites: int
    negative: bool
    scalar_bound: float
    bound: float
    nodes: int
    n_found: int
    seconds: float


@dataclass(frozen=True)
class Certificate:
    """What is proven about the largest J.

    Attributes
    ----------
    proven : bool
        True when no architecture beats `cost` (to one part in 1e6) and the list is complete.
    orbit, satellites : ndarray of int, shape (slot,)
        Best architecture.
    cost : float
        Its J.
    bound : float
        Upper bound on J over all architectures.
    gap : float
        bound / cost - 1.
    epsilon : float
        Relative distance from the best within which architectures are listed.
    near_orbit, near_satellites : ndarray of int, shape (found, slot)
        Architectures with J >= (1 - epsilon) cost, best first.
    near_cost : ndarray, shape (found,)
        Their J.
    counts : tuple of CountSummary
        The levels that four scalars did not refute.
    seconds : float
        Time of the whole proof.
    """

    proven: bool
    orbit: NDArray[np.int64]
    satellites: NDArray[np.int64]
    cost: float
    bound: float
    gap: float
    epsilon: float
    near_orbit: NDArray[np.int64]
    near_satellites: NDArray[np.int64]
    near_cost: NDArray[np.float64]
    counts: tuple[CountSummary, ...]
    seconds: float

    @property
    def nodes(self) -> int:
        """Nodes bounded over all levels."""
        return sum(count.nodes for count in self.counts)


@dataclass
class _Best:
    """The architectures found so far."""

    orbit: NDArray[np.int64]
    satellites: NDArray[np.int64]
    cost: NDArray[np.float64]

    def add(self, orbit: NDArray, satellites: NDArray, cost: NDArray) -> None:
        """Merge, drop repeats, best first (ties by orbit and count)."""
        orbit = np.concatenate([self.orbit, orbit])
        satellites = np.concatenate([self.satellites, satellites])
        cost = np.concatenate([self.cost, cost])
        keys = np.hstack([orbit, satellites])
        first = np.unique(keys, axis=0, return_index=True)[1]
        order = first[np.argsort(-cost[first], kind="stable")]
        self.orbit, self.satellites, self.cost = orbit[order], satellites[order], cost[order]


def certify(
    tables: ArchitectureTables,
    rng: np.random.Generator,
    *,
    n_slots: int = 10,
    incumbent: tuple[NDArray, NDArray] | None = None,
    epsilon: float = 0.01,
    n_groups: int = 100,
    restarts: int = 10,
    threads: int = 2,
    time_limit: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Certificate:
    """Prove the largest J over every choice of distinct orbits and satellite counts.

    Parameters
    ----------
    tables : ArchitectureTables
    rng : numpy.random.Generator
        Source of the starts of the coordinate search that supplies the first incumbent.
    n_slots : int
        Number of distinct orbits (the paper: 10).
    incumbent : (orbit, satellites), optional
        A good architecture to begin with.
    epsilon : float
        Architectures with J >= (1 - epsilon) J* are listed. The list and the time grow quickly
        with it.
    n_groups : int
        Most target groups of the relaxation: more give fewer, slower nodes.
    restarts : int
        Restarts of the coordinate search.
    threads : int
        Subtrees searched at once; the outcome does not depend on it.
    time_limit : float, optional
        Seconds after which the bound reached is reported; compilation does not count.
    progress : callable, optional
        Called with (done, total) in thousandths of the tree of each level.

    Returns
    -------
    Certificate

    Raises
    ------
    ConfigurationError
        If a setting is out of range.
    """
    if not 0.0 <= epsilon < 1.0:
        raise ConfigurationError(f"epsilon = {epsilon}: must lie in [0, 1)")
    if n_groups < 1 or threads < 1:
        raise ConfigurationError("n_groups and threads must be at least 1")
    if time_limit is not None:
        _compile(tables, n_slots)
    began = time.monotonic()
    deadline = np.inf if time_limit is None else began + time_limit
    best = _incumbent(tables, rng, n_slots, incumbent, restarts)
    factory = LevelFactory(tables, n_slots, n_groups)
    margin = 1.0 - max(epsilon, _TOLERANCE)
    counts = _search_counts(factory, best, margin, threads, deadline, progress)
    cost = float(best.cost[0])
    bound = max([cost] + [count.bound for count in counts if count.bound > margin * cost])
    near = best.cost >= (1.0 - epsilon) * cost
    return Certificate(
        proven=bound <= cost,
        orbit=best.orbit[0],
        satellites=best.satellites[0],
        cost=cost,
        bound=bound,
        gap=bound / cost - 1.0 if cost > 0.0 else (0.0 if bound <= cost else np.inf),
        epsilon=epsilon,
        near_orbit=best.orbit[near],
        near_satellites=best.satellites[near],
        near_cost=best.cost[near],
        counts=tuple(counts),
        seconds=time.monotonic() - began,
    )


def _compile(tables: ArchitectureTables, n_slots: int) -> None:
    """Prove a corner of the problem, so that a time limit is not spent on compiling kernels."""
    orbits = slice(n_slots + 2)
    corner = ArchitectureTables(
        observations=np.ascontiguousarray(tables.observations[orbits, :2, :20]),
        distance=np.ascontiguousarray(tables.distance[orbits, :2]),
        stability_index=tables.stability_index[orbits],
        family=tables.family[orbits],
        n_steps=tables.n_steps,
    )
    certify(corner, np.random.default_rng(0), n_slots=n_slots, restarts=1)


def _incumbent(tables, rng, n_slots, incumbent, restarts) -> _Best:
    starts = [] if incumbent is None else [incumbent]
    found = coordinate_search(tables, rng, n_slots=n_slots, restarts=restarts, starts=starts)
    # the cost by the same sums as the tree's, so that equals compare equal
    cost = architecture_cost(table_arrays(tables), found.orbit, found.satellites)
    return _Best(found.orbit[None], found.satellites[None], np.array([cost]))


def _threshold(best: _Best, margin: float) -> float:
    """The J to reach; positive, so that a best J of 0 is proven like any other."""
    return margin * (1.0 - _ROUNDING) * max(float(best.cost[0]), 1e-300)


def _search_counts(factory, best, margin, threads, deadline, progress) -> list[CountSummary]:
    """Deal with every level the scalar bounds leave open, most satellites first.

    The levels with many satellites are the quick ones; a time limit is then spent on the rest.
    """
    bounds = factory.bounds()
    levels = [
        (int(n), negative, float(scalar))
        for n, *pair in zip(bounds.satellites, bounds.seen, bounds.rarely_seen, strict=True)
        for negative, scalar in zip((False, True), pair, strict=True)
    ]
    wanted = [level for level in reversed(levels) if level[2] >= _threshold(best, margin)]
    counts = []
    for done, (n, negative, scalar) in enumerate(wanted):
        began = time.monotonic()
        threshold = _threshold(best, margin)
        if scalar < threshold:  # a better architecture was found since
            counts.append(CountSummary(n, negative, scalar, scalar, 0, 0, 0.0))
            continue

        def report(share: float, done: int = done) -> None:
            if progress is not None:
                progress(int(_PROGRESS_STEPS * (done + share)), _PROGRESS_STEPS * len(wanted))

        outcome = search_level(
            factory.level(n, negative),
            factory.arrays,
            threshold,
            threads=threads,
            deadline=deadline,
            progress=report,
        )
        best.add(outcome.orbit, outcome.satellites, outcome.cost)
        bound = min(scalar, max([outcome.open_bound, *outcome.cost]))
        bound = float(max(bound, min(scalar, threshold)))
        seconds = time.monotonic() - began
        counts.append(
            CountSummary(n, negative, scalar, bound, outcome.nodes, outcome.cost.size, seconds)
        )
        report(1.0)
    return counts
