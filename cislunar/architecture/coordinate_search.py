"""Multi-start coordinate local search for the architecture of largest value.

One slot after another is given the orbit and satellite count that maximize the value with the other
slots fixed, until no slot improves. With a prescribed total number of satellites, the count of a
slot changes together with that of another slot, so that every move keeps the total.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.objective import IMPROVES, Objective, first_best
from cislunar.errors import ConfigurationError
from cislunar.runtime import counted
from cislunar.runtime.arguments import count_of, require_kind


@dataclass(frozen=True)
class MultiStartResult:
    """Best architecture of several searches.

    Attributes
    ----------
    orbit, satellites : ndarray of int, shape (slot,)
        The architecture, ordered by orbit.
    value : float
        Its value.
    restart_value : ndarray, shape (restart,)
        Value that each restart reached.
    history : tuple of ndarray, shape (improvement, 3)
        Of each restart from the start on: number of exact evaluations, value and total number of
        satellites.
    """

    orbit: NDArray[np.int64]
    satellites: NDArray[np.int64]
    value: float
    restart_value: NDArray[np.float64]
    history: tuple[NDArray[np.float64], ...] = field(repr=False)

    @property
    def n_satellites(self) -> int:
        """Total number of satellites."""
        return int(self.satellites.sum())

    @property
    def evaluations(self) -> int:
        """Exact evaluations over all restarts."""
        return int(sum(h[-1, 0] for h in self.history))

    def evaluation_history(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Value and size of the current architecture at each evaluation, over all restarts."""
        values, sizes = [], []
        for improvements in self.history:
            until = np.append(improvements[1:, 0], improvements[-1, 0] + 1)
            repeats = (until - improvements[:, 0]).astype(int)
            values.append(np.repeat(improvements[:, 1], repeats))
            sizes.append(np.repeat(improvements[:, 2], repeats))
        return np.concatenate(values), np.concatenate(sizes).astype(np.int64)


class _Climb:
    """One restart: the current architecture and its history."""

    def __init__(self, objective: Objective, orbit: NDArray, satellites: NDArray):
        self.objective = objective
        self.max_satellites = objective.max_satellites
        self.orbit = np.array(orbit, dtype=np.int64)
        self.satellites = np.array(satellites, dtype=np.int64)
        self.value = objective.value(self.orbit, self.satellites)
        self.evaluations = 1
        self.history = [(1, self.value, self.satellites.sum())]

    def _try(self, slot: int, satellites: NDArray, lowest: int, highest: int) -> bool:
        found = self.objective.best_replacement(
            self.orbit, satellites, slot, lowest, highest, self.value
        )
        self.evaluations += found.evaluations
        if found.orbit < 0:
            return False
        self.orbit[slot] = found.orbit
        self.satellites = satellites.copy()
        self.satellites[slot] = found.satellites
        self.value = found.value
        self.history.append((self.evaluations, self.value, self.satellites.sum()))
        return True

    def free(self) -> None:
        """Replace slots until none improves."""
        unimproved, slot = 0, 0
        while unimproved < self.orbit.size:
            improved = self._try(slot, self.satellites, 1, self.max_satellites)
            # the replaced slot is already optimal
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


def check_numbers(
    n_orbits: int, max_satellites: int, n_slots: int, total: int | None, name: str = "total"
) -> None:
    """Raise a `ConfigurationError` for an impossible number of slots, or of satellites in all,
    which the argument `name` of the caller states."""
    highest = count_of("n_slots", n_slots, most=n_orbits) * max_satellites
    if total is not None and not n_slots <= count_of(name, total) <= highest:
        raise ConfigurationError(
            f"{name} = {total}: {n_slots} slots of 1..{max_satellites} satellites hold between "
            f"{n_slots} and {highest}"
        )


def _check(objective: Objective, n_slots: int, total: int | None) -> None:
    require_kind("objective", objective, Objective, "give an Objective of cislunar.architecture")
    check_numbers(objective.n_orbits, objective.max_satellites, n_slots, total)


def _check_start(objective: Objective, n_slots: int, total: int | None, orbit, satellites):
    counts = np.asarray(satellites)
    if (
        np.unique(orbit).size != n_slots
        or np.shape(orbit) != counts.shape
        or not 1 <= counts.min() <= counts.max() <= objective.max_satellites
        or total not in (None, counts.sum())
    ):
        raise ConfigurationError(
            f"start {np.asarray(orbit).tolist()}, {counts.tolist()}: give {n_slots} distinct "
            f"orbits with 1..{objective.max_satellites} satellites each, in all the "
            "prescribed total"
        )


def random_start(
    n_orbits: int,
    max_satellites: int,
    n_slots: int,
    rng: np.random.Generator,
    total: int | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Distinct random orbits with random counts, or counts that add up to ``total``.

    Parameters
    ----------
    n_orbits, max_satellites : int
        Number of candidate orbits, and largest number of satellites on one.
    n_slots : int
        Number of orbits to choose.
    rng : numpy.random.Generator
        Source of randomness.
    total : int, optional
        Total number of satellites.

    Returns
    -------
    orbit, satellites : ndarray of int, shape (slot,)

    Raises
    ------
    ConfigurationError
        If a number is impossible, or the slots cannot hold the total.
    """
    size = count_of("n_orbits", n_orbits), count_of("max_satellites", max_satellites)
    check_numbers(*size, n_slots, total)
    orbit = rng.choice(n_orbits, n_slots, replace=False)
    if total is None:
        return orbit, rng.integers(1, max_satellites + 1, n_slots)
    satellites = np.ones(n_slots, dtype=np.int64)
    for _ in range(total - n_slots):
        satellites[rng.choice(np.flatnonzero(satellites < max_satellites))] += 1
    return orbit, satellites


def coordinate_search(
    objective: Objective,
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
    objective : Objective
        The objective to maximize.
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
        If an argument is of another kind or impossible, or there is no start at all.
    """
    require_kind("rng", rng, np.random.Generator, "give numpy.random.default_rng(seed)")
    n_slots, restarts = count_of("n_slots", n_slots), count_of("restarts", restarts, least=0)
    _check(objective, n_slots, total)
    starts = list(starts)
    for start in starts:
        _check_start(objective, n_slots, total, *start)
    n_runs = len(starts) + restarts
    if n_runs < 1:
        raise ConfigurationError("restarts = 0 and no start given: set restarts to at least 1")
    best, values, histories = None, [], []
    size = objective.n_orbits, objective.max_satellites
    for run in counted(range(n_runs), progress):
        start = starts[run] if run < len(starts) else random_start(*size, n_slots, rng, total)
        climb = _Climb(objective, *start)
        climb.free() if total is None else climb.prescribed()
        values.append(climb.value)
        histories.append(np.array(climb.history, dtype=np.float64))
        if best is None or climb.value > best.value * IMPROVES:
            best = climb
    order = np.argsort(best.orbit, kind="stable")
    orbit, satellites = best.orbit[order], best.satellites[order]
    value = objective.value(orbit, satellites)
    return MultiStartResult(orbit, satellites, value, np.array(values), tuple(histories))


def satellite_front(
    objective: Objective,
    totals: Iterable[int],
    rng: np.random.Generator,
    *,
    n_slots: int = 10,
    restarts: int = 4,
    progress: Callable[[int, int], None] | None = None,
) -> list[MultiStartResult]:
    """Best value for each prescribed number of satellites.

    Each total is searched from random starts and from the best architecture of the previous total,
    with satellites added or removed where that is best.

    Parameters
    ----------
    objective, rng, n_slots, restarts
        See `coordinate_search`.
    totals : iterable of int
        Numbers of satellites.
    progress : callable, optional
        Called with (totals done, totals).

    Returns
    -------
    list of MultiStartResult
        One per total, in order.

    Raises
    ------
    ConfigurationError
        If a total does not fit into the slots, or as for `coordinate_search`.
    """
    totals = list(totals)
    for total in totals:
        _check(objective, n_slots, total)
    results: list[MultiStartResult] = []
    for total in counted(totals, progress):
        starts = [_resized(objective, results[-1], total)] if results else []
        results.append(
            coordinate_search(
                objective, rng, n_slots=n_slots, restarts=restarts, total=total, starts=starts
            )
        )
    return results


def _resized(objective, result: MultiStartResult, total: int) -> tuple[NDArray, NDArray]:
    """Add or remove satellites greedily until there are ``total``."""
    satellites = result.satellites.copy()
    while satellites.sum() != total:
        step = 1 if satellites.sum() < total else -1
        counts = satellites + step
        slots = np.flatnonzero((counts >= 1) & (counts <= objective.max_satellites))
        trials = [np.where(np.arange(satellites.size) == k, counts, satellites) for k in slots]
        values = np.array([objective.value(result.orbit, trial) for trial in trials])
        # the first of values equal to rounding
        satellites = trials[first_best(values)]
    return result.orbit, satellites
