"""Largest coverage of N satellites: greedy choice, local search and upper bound."""

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.certified import THOROUGH, Effort, ObjectiveCertificate, certified_search
from cislunar.architecture.coordinate_search import check_numbers
from cislunar.architecture.coverage.kernels import lazy_greedy
from cislunar.architecture.coverage.lagrangian import coverage_bound
from cislunar.architecture.coverage.objective import CoverageObjective
from cislunar.runtime.arguments import count_of

_LARGE = 10_000_000
"""Size of tables, in words, above which a search takes seconds and a bound tens of seconds. Tables
of 2000 targets, hourly over 30 days, from 1000 orbit slots have 22 million words."""

_LITTLE = Effort(starts=6, least_gain=1 / 3)


def greedy_coverage(
    objective: CoverageObjective, n_satellites: int, *, n_slots: int | None = None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Greedy architecture of a number of satellites.

    Orbit slots are added one by one, each where it covers most; then, in slots with several
    satellites, further satellites are added where they increase coverage most. Ties go to the first
    choice.

    Parameters
    ----------
    objective : CoverageObjective
        Coverage over its tables.
    n_satellites : int
        Number of satellites.
    n_slots : int, optional
        Number of orbit slots; by default one per satellite.

    Returns
    -------
    orbit, satellites : ndarray of int64, shape (slot,)

    Raises
    ------
    ConfigurationError
        If the number of satellites or of orbit slots is impossible.
    """
    size = objective.n_orbits, objective.max_satellites
    if n_slots is None:
        n_slots = count_of("n_satellites", n_satellites, most=objective.n_orbits)
    check_numbers(*size, n_slots, n_satellites, "n_satellites")
    single = np.arange(objective.n_orbits) * objective.max_satellites
    orbit = lazy_greedy(
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
) -> ObjectiveCertificate:
    """Search for the architecture of largest coverage of a number of satellites, with an upper
    bound.

    `coordinate_search` improves the greedy choice by replacing one satellite or moving satellites
    between two orbits. The Lagrangian relaxation bounds the result; the search restarts from its
    choices, and if that increases the value, the bound is computed again from there. For large
    tables only the six choices of largest value are used, and the bound is computed again only if
    they close a third of the gap. No result depends on time.

    Parameters
    ----------
    objective : CoverageObjective
        Coverage over its tables.
    n_satellites : int
        Number of satellites, N.
    n_slots : int, optional
        Number of distinct orbit slots: 10 in the paper. By default one per satellite, as for free
        phases.
    steps : int
        Largest number of subgradient steps of each bound.

    Returns
    -------
    ObjectiveCertificate

    Raises
    ------
    ConfigurationError
        If the number of satellites, of orbit slots or of steps is impossible.
    """
    count_of("steps", steps)
    return certified_search(
        objective,
        lambda: greedy_coverage(objective, n_satellites, n_slots=n_slots),
        lambda known: coverage_bound(objective, *known, steps=steps),
        effort=_LITTLE if objective.candidates.size > _LARGE else THOROUGH,
    )
