"""Multi-start coordinate local search for the architecture of largest cost J.

One slot after another is given the (orbit, satellite count) that serves the others best, until no
slot improves. With the total number of satellites prescribed, a slot's count changes only against
that of another slot, so that every move keeps the total.

A candidate is evaluated exactly only when a bound from five scalars says that it could win: the
sum of log10 over the targets is at most the number of targets times the concave envelope of log10
at the mean (Jensen's inequality). Most of the library is discarded that way.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.architecture.compiled_cost import (
    architecture_cost,
    log_envelope,
    log_sum,
    scalar_sums,
    seen_per_satellite,
    table_arrays,
)
from cislunar.architecture.cost import CostFactors, CostFunction
from cislunar.architecture.tables import ArchitectureTables
from cislunar.errors import ConfigurationError

_IMPROVES = 1.0 + 1e-12  # a gain below rounding is no gain, or the search could cycle


@njit(cache=True)
def _best_for_slot(
    observations,
    observed,
    distance,
    stability,
    n_steps,
    orbit,
    satellites,
    slot,
    lowest,
    highest,
    j,
):
    """Best (orbit, count) of one slot, the others fixed.

    Parameters
    ----------
    observed : ndarray, shape (orbit, satellites)
        Observations summed over the targets.
    lowest, highest : int
        Range of the slot's count.
    j : float
        Cost to beat.

    Returns
    -------
    orbit, satellites : int
        The best choice, or -1, 0 when nothing beats ``j``.
    cost : float
        Its cost, or ``j``.
    evaluations : int
        Candidates evaluated exactly.
    """
    n_targets = observations.shape[2]
    base = seen_per_satellite(observations, orbit, satellites, slot)
    other = scalar_sums(observed, distance, stability, orbit, satellites, slot)
    base_sum = base.sum()
    largest = highest
    for k in range(orbit.size):
        if k != slot:
            largest = max(largest, satellites[k])
    # with n satellites an argument between 0 and 1 is at least 1/n: the log-sum may be negative
    negative = n_targets * np.log10(largest)
    width = highest - lowest + 1
    bound = np.zeros(observations.shape[0] * width)
    for i in range(observations.shape[0]):
        used = False
        for k in range(orbit.size):
            if k != slot and orbit[k] == i:
                used = True
        if used:
            continue  # a duplicate orbit makes J zero
        for n in range(lowest, highest + 1):
            mean = (base_sum + observed[i, n - 1] / n) / n_targets
            logs = max(n_targets * log_envelope(mean), negative)
            bound[i * width + n - lowest] = (
                (other[2] + observed[i, n - 1])
                * logs
                / ((other[0] + n) * (other[1] + n * stability[i]) * (other[3] + distance[i, n - 1]))
            )
    scale = 1.0 / (n_targets * n_steps)
    best_orbit, best_count, evaluations = -1, 0, 0
    for position in np.argsort(-bound):
        if bound[position] * scale <= j * _IMPROVES:
            break
        i = position // width
        n = lowest + position % width
        logs = abs(log_sum(base, observations[i, n - 1], 1.0 / n))
        cost = (
            scale
            * (other[2] + observed[i, n - 1])
            * logs
            / ((other[0] + n) * (other[1] + n * stability[i]) * (other[3] + distance[i, n - 1]))
        )
        evaluations += 1
        if cost > j * _IMPROVES:
            best_orbit, best_count, j = i, n, cost
    return best_orbit, best_count, j, evaluations


@dataclass(frozen=True)
class MultiStartResult:
    """Outcome of a multi-start search.

    Attributes
    ----------
    orbit, satellites : ndarray of int, shape (slot,)
        Best architecture, ordered by orbit index.
    cost : CostFactors
        Its J and factors.
    restart_cost : ndarray, shape (restart,)
        J reached by each restart.
    history : tuple of ndarray, shape (improvement, 3)
        For each restart, exact evaluations so far, J and the total number of satellites after
        every improvement; the first row is the start.
    """

    orbit: NDArray[np.int64]
    satellites: NDArray[np.int64]
    cost: CostFactors
    restart_cost: NDArray[np.float64]
    history: tuple[NDArray[np.float64], ...] = field(repr=False)

    @property
    def n_satellites(self) -> int:
        """Total number of satellites."""
        return int(self.satellites.sum())

    @property
    def evaluations(self) -> int:
        """Exact evaluations of J over all restarts."""
        return int(sum(h[-1, 0] for h in self.history))


class _Climb:
    """One restart: the current architecture and its history."""

    def __init__(self, arguments: tuple, orbit: NDArray, satellites: NDArray):
        self.arguments = arguments
        self.max_satellites = arguments[0].shape[1]
        self.orbit = np.array(orbit, dtype=np.int64)
        self.satellites = np.array(satellites, dtype=np.int64)
        self.cost = architecture_cost(arguments, self.orbit, self.satellites)
        self.evaluations = 1
        self.history = [(1, self.cost, self.satellites.sum())]

    def _try(self, slot: int, satellites: NDArray, lowest: int, highest: int) -> bool:
        i, n, cost, evaluations = _best_for_slot(
            *self.arguments, self.orbit, satellites, slot, lowest, highest, self.cost
        )
        self.evaluations += evaluations
        if i < 0:
            return False
        self.orbit[slot] = i
        self.satellites = satellites.copy()
        self.satellites[slot] = n
        self.cost = cost
        self.history.append((self.evaluations, cost, self.satellites.sum()))
        return True

    def free(self) -> None:
        """Replace slots until none improves."""
        unimproved, slot = 0, 0
        while unimproved < self.orbit.size:
            improved = self._try(slot, self.satellites, 1, self.max_satellites)
            # the slot just replaced is at its best already
            unimproved = 1 if improved else unimproved + 1
            slot = (slot + 1) % self.orbit.size

    def prescribed(self) -> None:
        """Replace slots, moving satellites between pairs of slots, until no pair improves."""
        slots = self.orbit.size
        pairs = [(a, b) for a in range(slots) for b in range(slots)]
        unimproved, at = 0, 0
        while unimproved < len(pairs):
            improved = self._pair(*pairs[at])
            unimproved = 0 if improved else unimproved + 1
            at = (at + 1) % len(pairs)

    def _pair(self, slot: int, partner: int) -> bool:
        if slot == partner:
            n = int(self.satellites[slot])
            return self._try(slot, self.satellites, n, n)
        improved = False
        together = int(self.satellites[slot] + self.satellites[partner])
        first = max(1, together - self.max_satellites)
        for n in range(first, min(self.max_satellites, together - 1) + 1):
            satellites = self.satellites.copy()
            satellites[partner] = together - n
            if n != self.satellites[slot]:
                improved |= self._try(slot, satellites, n, n)
        return improved


def _check(tables: ArchitectureTables, n_slots: int, total: int | None) -> None:
    if not 1 <= n_slots <= tables.n_orbits:
        raise ConfigurationError(
            f"n_slots = {n_slots}: must lie in 1..{tables.n_orbits}, the orbits of the tables"
        )
    highest = n_slots * tables.max_satellites
    if total is not None and not n_slots <= total <= highest:
        raise ConfigurationError(
            f"total = {total}: {n_slots} slots of 1..{tables.max_satellites} satellites hold "
            f"between {n_slots} and {highest}"
        )


def _check_start(tables, n_slots: int, total: int | None, orbit: NDArray, satellites: NDArray):
    counts = np.asarray(satellites)
    if (
        np.unique(orbit).size != n_slots
        or np.shape(orbit) != counts.shape
        or not 1 <= counts.min() <= counts.max() <= tables.max_satellites
        or total not in (None, counts.sum())
    ):
        raise ConfigurationError(
            f"start {np.asarray(orbit).tolist()}, {counts.tolist()}: give {n_slots} distinct "
            f"orbits with 1..{tables.max_satellites} satellites each, in all the prescribed total"
        )


def random_start(
    tables: ArchitectureTables, n_slots: int, rng: np.random.Generator, total: int | None = None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Distinct random orbits with random counts, or counts that add up to ``total``.

    Returns
    -------
    orbit, satellites : ndarray of int, shape (slot,)
    """
    orbit = rng.choice(tables.n_orbits, n_slots, replace=False)
    if total is None:
        return orbit, rng.integers(1, tables.max_satellites + 1, n_slots)
    satellites = np.ones(n_slots, dtype=np.int64)
    for _ in range(total - n_slots):
        satellites[rng.choice(np.flatnonzero(satellites < tables.max_satellites))] += 1
    return orbit, satellites


def coordinate_search(
    tables: ArchitectureTables,
    rng: np.random.Generator,
    *,
    n_slots: int = 10,
    restarts: int = 10,
    total: int | None = None,
    starts: Iterable[tuple[NDArray, NDArray]] = (),
    progress: Callable[[int, int], None] | None = None,
) -> MultiStartResult:
    """Best architecture over several coordinate local searches.

    Parameters
    ----------
    tables : ArchitectureTables
    rng : numpy.random.Generator
        Source of the random starts.
    n_slots : int
        Number of distinct orbits (the paper: 10).
    restarts : int
        Number of random starts.
    total : int, optional
        Prescribed total number of satellites.
    starts : iterable of (orbit, satellites)
        Further starts, tried before the random ones.
    progress : callable, optional
        Called with (restarts done, restarts).

    Returns
    -------
    MultiStartResult

    Raises
    ------
    ConfigurationError
        If ``n_slots`` or ``total`` is impossible, or there is no start.
    """
    _check(tables, n_slots, total)
    arguments = table_arrays(tables)
    starts = list(starts)
    for start in starts:
        _check_start(tables, n_slots, total, *start)
    n_runs = len(starts) + restarts
    if n_runs < 1:
        raise ConfigurationError("restarts = 0 and no start given: ask for at least one restart")
    best, costs, histories = None, [], []
    for run in range(n_runs):
        start = starts[run] if run < len(starts) else random_start(tables, n_slots, rng, total)
        climb = _Climb(arguments, *start)
        climb.free() if total is None else climb.prescribed()
        costs.append(climb.cost)
        histories.append(np.array(climb.history, dtype=np.float64))
        if best is None or climb.cost > best.cost:
            best = climb
        if progress is not None:
            progress(run + 1, n_runs)
    order = np.argsort(best.orbit)
    orbit, satellites = best.orbit[order], best.satellites[order]
    cost = CostFunction(tables)(orbit, satellites)
    return MultiStartResult(orbit, satellites, cost, np.array(costs), tuple(histories))


def satellite_front(
    tables: ArchitectureTables,
    totals: Iterable[int],
    rng: np.random.Generator,
    *,
    n_slots: int = 10,
    restarts: int = 4,
    progress: Callable[[int, int], None] | None = None,
) -> list[MultiStartResult]:
    """Best J against the prescribed number of satellites.

    Each total is searched from random starts and from the best architecture of the total before,
    with satellites added or removed where they cost least.

    Parameters
    ----------
    tables, rng, n_slots, restarts
        As in `coordinate_search`.
    totals : iterable of int
        Numbers of satellites.
    progress : callable, optional
        Called with (totals done, totals).

    Returns
    -------
    list of MultiStartResult
        One per total, in the order given.
    """
    totals = list(totals)
    results: list[MultiStartResult] = []
    for done, total in enumerate(totals):
        starts = [_resized(tables, results[-1], total)] if results else []
        results.append(
            coordinate_search(
                tables, rng, n_slots=n_slots, restarts=restarts, total=total, starts=starts
            )
        )
        if progress is not None:
            progress(done + 1, len(totals))
    return results


def _resized(tables, result: MultiStartResult, total: int) -> tuple[NDArray, NDArray]:
    """Architecture with satellites added or removed greedily until there are ``total``."""
    arguments = table_arrays(tables)
    satellites = result.satellites.copy()
    while satellites.sum() != total:
        step = 1 if satellites.sum() < total else -1
        counts = satellites + step
        slots = np.flatnonzero((counts >= 1) & (counts <= tables.max_satellites))
        trials = [np.where(np.arange(satellites.size) == k, counts, satellites) for k in slots]
        costs = [architecture_cost(arguments, result.orbit, trial) for trial in trials]
        satellites = trials[int(np.argmax(costs))]
    return result.orbit, satellites
