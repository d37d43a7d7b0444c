"""The largest coverage of N satellites: greedy, local search, bound on what is left to gain."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.coordinate_search import coordinate_search
from cislunar.architecture.coverage.kernels import lazy_greedy
from cislunar.architecture.coverage.lagrangian import coverage_bound
from cislunar.architecture.coverage.objective import CoverageObjective
from cislunar.errors import ConfigurationError

_ROUNDS = 2  # searches from the choices of a bound, each with a bound of its own


@dataclass(frozen=True)
class CoverageCertificate:
    """Best architecture found of one number of satellites, and how much better any could be.

    Attributes
    ----------
    orbit, satellites : ndarray of int64, shape (slot,)
        Places of the tables and satellites at each, ordered by place.
    value : float
        Its coverage.
    greedy : float
        Coverage that greedy alone reached.
    bound : float
        No architecture of as many places and satellites covers more.
    gap : float
        bound / value - 1; infinite if nothing was found where something may be.
    steps : int
        Subgradient steps.
    seconds : float
        Wall time of search and bound.
    """

    orbit: NDArray[np.int64]
    satellites: NDArray[np.int64]
    value: float
    greedy: float
    bound: float
    gap: float
    steps: int
    seconds: float

    @property
    def n_satellites(self) -> int:
        """Total number of satellites."""
        return int(self.satellites.sum())

    @property
    def proven(self) -> bool:
        """Whether no architecture covers more."""
        return self.bound <= self.value


def _check(objective: CoverageObjective, n_satellites: int, n_slots: int) -> None:
    places, most = objective.n_orbits, objective.max_satellites
    if not 1 <= n_slots <= places:
        raise ConfigurationError(f"n_slots = {n_slots} must lie in 1 .. {places}, the places")
    if not n_slots <= n_satellites <= n_slots * most:
        raise ConfigurationError(
            f"n_satellites = {n_satellites} must lie in {n_slots} .. {n_slots * most}: {n_slots} "
            f"places of 1 .. {most} satellites"
        )


def greedy_coverage(
    objective: CoverageObjective, n_satellites: int, *, n_slots: int | None = None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Architecture of a number of satellites, one greedy choice after the other.

    Places are added one by one, each where it covers most; then, in the paper's slots, satellites
    to the places where they raise coverage most. The first of equal choices is taken.

    Parameters
    ----------
    objective : CoverageObjective
        Coverage over its tables.
    n_satellites : int
        Number of satellites.
    n_slots : int, optional
        Number of places; as many as satellites by default.

    Returns
    -------
    orbit, satellites : ndarray of int64, shape (slot,)

    Raises
    ------
    ConfigurationError
        If the places cannot hold the satellites.
    """
    n_slots = n_satellites if n_slots is None else n_slots
    _check(objective, n_satellites, n_slots)
    single = np.arange(objective.n_orbits) * objective.max_satellites
    orbit, _ = lazy_greedy(objective.candidates, single, n_slots, objective.tables.fold)
    satellites = np.ones(n_slots, dtype=np.int64)
    for _ in range(n_satellites - n_slots):
        more = satellites + np.eye(n_slots, dtype=np.int64)
        values = [
            objective.value(orbit, row) if row.max() <= objective.max_satellites else -1.0
            for row in more
        ]
        satellites = more[int(np.argmax(values))]
    return orbit, satellites


def certify_coverage(
    objective: CoverageObjective,
    n_satellites: int,
    *,
    n_slots: int | None = None,
    steps: int = 150,
    restarts: int = 0,
    rng: np.random.Generator | None = None,
) -> CoverageCertificate:
    """Search the architecture of largest coverage for a number of satellites, and bound the rest.

    Greedy is improved by `coordinate_search`, which replaces one satellite or moves satellites
    between two orbits; the Lagrangian relaxation bounds the result, its choices are searched from
    as well, and if they lead higher the bound is computed again from there. No result depends on
    time.

    Parameters
    ----------
    objective : CoverageObjective
        Coverage over its tables.
    n_satellites : int
        Number of satellites, N.
    n_slots : int, optional
        Number of distinct places: the paper's 10 in its slots. As many as satellites by default,
        which is what free phases have.
    steps : int
        Most subgradient steps of each bound.
    restarts : int
        Further random starts of the search.
    rng : numpy.random.Generator, optional
        Source of the random starts.

    Returns
    -------
    CoverageCertificate

    Raises
    ------
    ConfigurationError
        If the places cannot hold the satellites, or `steps` is below 1.
    """
    if steps < 1:
        raise ConfigurationError(f"steps = {steps} must be at least 1")
    began = perf_counter()
    n_slots = n_satellites if n_slots is None else n_slots
    start = greedy_coverage(objective, n_satellites, n_slots=n_slots)
    greedy = objective.value(*start)
    rng = np.random.default_rng(0) if rng is None else rng
    search = {"n_slots": n_slots, "total": n_satellites}
    best = coordinate_search(objective, rng, restarts=restarts, starts=[start], **search)
    bound, taken = np.inf, 0
    for _ in range(_ROUNDS):
        found = coverage_bound(objective, best.orbit, best.satellites, steps=steps)
        bound, taken = min(bound, found.bound), taken + found.steps
        if bound <= best.value or not found.choices:
            break
        again = coordinate_search(objective, rng, restarts=0, starts=found.choices, **search)
        if again.value <= best.value:
            break
        best = again
    return CoverageCertificate(
        orbit=best.orbit,
        satellites=best.satellites,
        value=best.value,
        greedy=greedy,
        bound=bound,
        gap=bound / best.value - 1.0 if best.value > 0.0 else (np.inf if bound > 0.0 else 0.0),
        steps=taken,
        seconds=perf_counter() - began,
    )
