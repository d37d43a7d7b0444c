"""The largest information of N satellites: greedy, local search, bound on what is left to gain."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.certified import (
    Bound,
    Certificate,
    Choice,
    certified_search,
    check_size,
)
from cislunar.architecture.information.kernels import greedy_places
from cislunar.architecture.information.objective import InformationObjective
from cislunar.architecture.information.relaxation import information_bound


def greedy_information(
    objective: InformationObjective, n_satellites: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Architecture of a number of satellites, one greedy choice after the other.

    Of choices equal to rounding the first is taken.

    Parameters
    ----------
    objective : InformationObjective
        Information over its tables.
    n_satellites : int
        Number of satellites.

    Returns
    -------
    orbit, satellites : ndarray of int64, shape (slot,)
        In the order of the choices; the first of them are the choice of fewer satellites.

    Raises
    ------
    ConfigurationError
        If there are fewer places.
    """
    check_size(objective, n_satellites, n_satellites)
    orbit, _ = greedy_places(objective.tables.matrix, n_satellites, objective.tables.nuisance)
    return orbit, np.ones_like(orbit)


def certify_information(
    objective: InformationObjective,
    n_satellites: int,
    *,
    steps: int = 200,
    halvings: int = 0,
    restarts: int = 0,
    rng: np.random.Generator | None = None,
) -> Certificate:
    """Search the architecture of largest information for a number of satellites, and bound the
    rest.

    Greedy is improved by `coordinate_search`, which places one satellite anew; the concave
    relaxation bounds the result, its own choice is searched from as well, and if it leads higher
    the bound is computed again from there. No result depends on time.

    Parameters
    ----------
    objective : InformationObjective
        Information over its tables.
    n_satellites : int
        Number of satellites, N, each at a place of its own.
    steps : int
        Most steps of each bound.
    halvings : int
        The bound is linear also over the first N/2, N/4 ... of greedy's choices, so many sets of
        them, see `cislunar.architecture.information.relaxation`.
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
        If there are fewer places, or `steps` is below 1.
    """
    check_size(objective, n_satellites, n_satellites, steps)

    @cache
    def greedy() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return greedy_information(objective, n_satellites)

    def bound(known: Choice) -> Bound:
        over = [greedy()[0][: n_satellites // 2**number] for number in range(1, halvings + 1)]
        return information_bound(objective, known[0], steps=steps, over=over)

    return certified_search(
        objective,
        greedy,
        bound,
        restarts=restarts,
        rng=rng,
    )
