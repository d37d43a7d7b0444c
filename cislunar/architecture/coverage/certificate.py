"""The largest coverage of N satellites: greedy, local search, bound on what is left to gain."""

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.certified import (
    THOROUGH,
    Certificate,
    Effort,
    certified_search,
    check_size,
)
from cislunar.architecture.coverage.kernels import lazy_greedy
from cislunar.architecture.coverage.lagrangian import coverage_bound
from cislunar.architecture.coverage.objective import CoverageObjective

_LARGE = 10_000_000
"""Words of tables beyond which a search takes seconds, a bound tens of them: those of 2000 targets
hourly over 30 days from 1000 places have 22 million."""

_LITTLE = Effort(starts=6, worth=1 / 3)


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
    check_size(objective, n_satellites, n_slots)
    single = np.arange(objective.n_orbits) * objective.max_satellites
    orbit, _ = lazy_greedy(
        objective.candidates, single, n_slots, objective.tables.fold, objective.reachable
    )
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
) -> Certificate:
    """Search the architecture of largest coverage for a number of satellites, and bound the rest.

    Greedy is improved by `coordinate_search`, which replaces one satellite or moves satellites
    between two orbits; the Lagrangian relaxation bounds the result, its choices are searched from
    as well, and if they lead higher the bound is computed again from there. Over large tables only
    the six of largest value are, and the bound only if they close a third of the gap. No result
    depends on time.

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
    Certificate

    Raises
    ------
    ConfigurationError
        If the places cannot hold the satellites, or `steps` is below 1.
    """
    n_slots = n_satellites if n_slots is None else n_slots
    check_size(objective, n_satellites, n_slots, steps)
    return certified_search(
        objective,
        lambda: greedy_coverage(objective, n_satellites, n_slots=n_slots),
        lambda known: coverage_bound(objective, *known, steps=steps),
        restarts=restarts,
        rng=rng,
        effort=_LITTLE if objective.candidates.size > _LARGE else THOROUGH,
    )
