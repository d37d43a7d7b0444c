"""Largest value of N satellites on a number of orbits, by search and branch and bound."""

import numpy as np

from cislunar.architecture import Objective, random_start
from cislunar.architecture.certified import Bound, Choice, ObjectiveCertificate, certified_search
from cislunar.architecture.coordinate_search import check_numbers
from cislunar.architecture.optimality.branch_and_bound import search_level
from cislunar.runtime.arguments import count_of

_BELOW = 1.0 - 1e-6  # threshold relative to the value, so that the bound can equal the value


def certify_total(
    objective: Objective,
    n_satellites: int,
    *,
    n_slots: int = 10,
    nodes: int = 10_000,
    restarts: int = 10,
    rng: np.random.Generator | None = None,
) -> ObjectiveCertificate:
    """Search for the architecture of largest value of a number of satellites, with an upper bound.

    The objective must have `Objective.levels`, like J. `coordinate_search` finds the architecture,
    and the branch and bound of `cislunar.architecture.optimality.node` bounds all others with as
    many satellites. If it finds a better one, the search continues from there. No result depends on
    time.

    Parameters
    ----------
    objective : Objective
        Not negative, and with `Objective.levels`.
    n_satellites : int
        Number of satellites, N.
    n_slots : int
        Number of distinct orbits (the paper: 10).
    nodes : int
        Largest number of nodes of each bound.
    restarts : int
        Random starts of the search, besides the first.
    rng : numpy.random.Generator, optional
        Source of the starts.

    Returns
    -------
    ObjectiveCertificate

    Raises
    ------
    ConfigurationError
        If the number of satellites, of orbits, of nodes or of restarts is impossible.
    """
    size = objective.n_orbits, objective.max_satellites
    check_numbers(*size, n_slots, n_satellites, "n_satellites")
    count_of("nodes", nodes)
    rng = np.random.default_rng(0) if rng is None else rng

    def bound(known: Choice) -> Bound:
        value = objective.value(*known)
        reached, taken, choices = value, 0, []
        for level in objective.levels(n_slots):
            threshold = max(value * _BELOW, 1e-300)
            if level.n_satellites != n_satellites or level.bound < threshold:
                continue
            found = search_level(level.relaxation(), threshold, threads=1, most_nodes=nodes - taken)
            taken += found.nodes
            reached = max(reached, min(level.bound, max([found.open_bound, *found.value])))
            choices += zip(found.orbit, found.satellites, strict=True)
        return Bound(reached, taken, choices)

    return certified_search(
        objective,
        lambda: random_start(*size, n_slots, rng, n_satellites),
        bound,
        restarts=restarts,
        rng=rng,
    )
