"""Proof that an architecture has the largest value over all orbits and satellite counts.

The value is bounded level by level, one total number of satellites at a time. A level is refuted by
its own bound, or searched by branch and bound with the objective's relaxation. All architectures
with value >= (1 - epsilon) x best are found in the process.

The proof is computer-assisted, in double precision: nodes are pruned against the threshold minus
one part in 1e9, not by interval arithmetic.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.coordinate_search import coordinate_search
from cislunar.architecture.objective import Objective
from cislunar.architecture.optimality.branch_and_bound import search_level
from cislunar.errors import ConfigurationError

_TOLERANCE = 1e-6  # least relative gap between the threshold and the best
_ROUNDING = 1e-9
_SAME_DIGITS = 9  # digits to which values count as equal
_PROGRESS_STEPS = 1000


@dataclass(frozen=True)
class _CostCertificate:
    """Result of `certify`."""

    proven: bool
    orbit: NDArray[np.int64]
    satellites: NDArray[np.int64]
    value: float
    bound: float
    gap: float
    near_orbit: NDArray[np.int64]
    near_satellites: NDArray[np.int64]
    near_value: NDArray[np.float64]
    nodes: int
    seconds: float


@dataclass
class _Best:
    """The architectures found so far."""

    orbit: NDArray[np.int64]
    satellites: NDArray[np.int64]
    value: NDArray[np.float64]

    def add(self, orbit: NDArray, satellites: NDArray, value: NDArray) -> None:
        """Merge, remove duplicates, sort best first (ties to rounding by orbit and count)."""
        orbit = np.concatenate([self.orbit, orbit])
        satellites = np.concatenate([self.satellites, satellites])
        value = np.concatenate([self.value, value])
        keys = np.hstack([orbit, satellites])
        first = np.unique(keys, axis=0, return_index=True)[1]
        scale = max(float(value.max()), 1e-300)
        order = first[np.argsort(-np.round(value[first] / scale, _SAME_DIGITS), kind="stable")]
        self.orbit, self.satellites, self.value = orbit[order], satellites[order], value[order]

    def threshold(self, margin: float) -> float:
        """Threshold for the search; positive, so that a best value of 0 can be proven as well."""
        return margin * (1.0 - _ROUNDING) * max(float(self.value[0]), 1e-300)


def certify(
    objective: Objective,
    rng: np.random.Generator,
    *,
    n_slots: int = 10,
    incumbent: tuple[NDArray, NDArray] | None = None,
    epsilon: float = 0.01,
    restarts: int = 10,
    threads: int = 2,
    most_nodes: float = np.inf,
    progress: Callable[[int, int], None] | None = None,
) -> _CostCertificate:
    """Prove the largest value over every choice of distinct orbits and satellite counts.

    Parameters
    ----------
    objective : Objective
        Not negative, and with `Objective.levels`.
    rng : numpy.random.Generator
        Source of the starts of the coordinate search that supplies the first incumbent.
    n_slots : int
        Number of distinct orbits (the paper: 10).
    incumbent : (orbit, satellites), optional
        A good initial architecture.
    epsilon : float
        Architectures with value >= (1 - epsilon) x best are listed. The list and the time grow
        quickly with it.
    restarts : int
        Restarts of the coordinate search.
    threads : int
        Number of subtrees that are searched concurrently; the outcome does not depend on it.
    most_nodes : float
        Largest number of nodes, after which the current bound is reported. The outcome does not
        depend on the speed of the machine.
    progress : callable, optional
        Called with (done, total) in thousandths of the tree of each level.

    Returns
    -------
    dataclass
        ``proven``, True if no architecture exceeds ``value`` by more than one part in 1e6 and the
        list is complete; ``orbit`` and ``satellites``, shape (slot,), the best architecture, with
        its ``value``; ``bound``, an upper bound over all architectures, and ``gap``, bound / value
        - 1; ``near_orbit`` and ``near_satellites``, shape (found, slot), and ``near_value``, shape
        (found,), the listed architectures, best first; ``nodes`` of all levels; ``seconds`` of the
        whole proof.

    Raises
    ------
    ConfigurationError
        If `epsilon` or `threads` is out of range, or another argument is impossible; see
        `cislunar.coordinate_search`.
    """
    if not 0.0 <= epsilon < 1.0:
        raise ConfigurationError(f"epsilon = {epsilon}: must lie in [0, 1)")
    if threads < 1:
        raise ConfigurationError(f"threads = {threads}: must be at least 1")
    began = time.monotonic()
    starts = [] if incumbent is None else [incumbent]
    found = coordinate_search(objective, rng, n_slots=n_slots, restarts=restarts, starts=starts)
    best = _Best(found.orbit[None], found.satellites[None], np.array([found.value]))
    levels = objective.levels(n_slots)
    margin = 1.0 - max(epsilon, _TOLERANCE)
    bounds, nodes = _search_levels(levels, best, margin, threads, most_nodes, progress)
    value = float(best.value[0])
    bound = max([value] + [each for each in bounds if each > margin * value])
    near = best.value >= (1.0 - epsilon) * value
    return _CostCertificate(
        proven=bound <= value,
        orbit=best.orbit[0],
        satellites=best.satellites[0],
        value=value,
        bound=bound,
        gap=bound / value - 1.0 if value > 0.0 else (0.0 if bound <= value else np.inf),
        near_orbit=best.orbit[near],
        near_satellites=best.satellites[near],
        near_value=best.value[near],
        nodes=nodes,
        seconds=time.monotonic() - began,
    )


def _search_levels(levels, best, margin, threads, most_nodes, progress) -> tuple[list[float], int]:
    """Search every level that its bound does not refute: a bound on each level, and the nodes used.
    Levels of many satellites are fast and come first; the other levels use the remaining nodes."""
    open_levels = [level for level in reversed(levels) if level.bound >= best.threshold(margin)]
    bounds, nodes = [], 0
    for done, level in enumerate(open_levels):
        threshold = best.threshold(margin)
        if level.bound < threshold:  # refuted by a better architecture
            bounds.append(level.bound)
            continue

        def report(share: float, done: int = done) -> None:
            if progress is not None:
                progress(int(_PROGRESS_STEPS * (done + share)), _PROGRESS_STEPS * len(open_levels))

        outcome = search_level(
            level.relaxation(),
            threshold,
            threads=threads,
            most_nodes=most_nodes - nodes,
            progress=report,
        )
        best.add(outcome.orbit, outcome.satellites, outcome.value)
        reached = max([threshold, outcome.open_bound, *outcome.value])
        bounds.append(float(min(level.bound, reached)))
        nodes += outcome.nodes
        report(1.0)
    return bounds, nodes
