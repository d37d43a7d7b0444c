"""Largest information of N satellites: greedy choice, local search and upper bound."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.certified import Bound, Choice, ObjectiveCertificate, certified_search
from cislunar.architecture.information.kernels import greedy_orbit_slots
from cislunar.architecture.information.objective import InformationObjective
from cislunar.architecture.information.relaxation import information_bound
from cislunar.runtime.arguments import count_of


def greedy_information(
    objective: InformationObjective, n_satellites: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Greedy architecture of a number of satellites, `orbit` and `satellites` (slot,) in the order
    of the choices, so that the first n are the greedy choice of n satellites; ties to rounding go
    to the first."""
    count_of("n_satellites", n_satellites, most=objective.n_orbits)
    orbit = greedy_orbit_slots(objective.tables.matrix, n_satellites, objective.tables.nuisance)
    return orbit, np.ones_like(orbit)


def certify_information(
    objective: InformationObjective,
    n_satellites: int,
    *,
    steps: int = 200,
    halvings: int = 0,
) -> ObjectiveCertificate:
    """Search for the architecture of largest information of a number of satellites, with an upper
    bound.

    `coordinate_search` improves the greedy choice by moving one satellite at a time. The concave
    relaxation bounds the result; the search restarts from its choice, and if that increases the
    value, the bound is computed again from there. No result depends on time.

    Parameters
    ----------
    objective : InformationObjective
        Information over its tables.
    n_satellites : int
        Number of satellites, N, each in its own orbit slot.
    steps : int
        Largest number of steps of each bound.
    halvings : int
        Number of further sets, the first N/2, N/4 ... of the greedy choices, over which the bound
        is also linear, see `cislunar.architecture.information.relaxation`.

    Returns
    -------
    ObjectiveCertificate

    Raises
    ------
    ConfigurationError
        If the number of satellites or of steps is impossible.
    """
    count_of("steps", steps)

    @cache
    def greedy() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return greedy_information(objective, n_satellites)

    def bound(known: Choice) -> Bound:
        over = [greedy()[0][: n_satellites // 2**number] for number in range(1, halvings + 1)]
        return information_bound(objective, known[0], steps=steps, over=over)

    return certified_search(objective, greedy, bound)
