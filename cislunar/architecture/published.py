"""The architectures of Paul & Fan, table 2: families and counts, with members chosen by this
library.

The paper does not give the member of the family. It is chosen here to maximize J, so that the value
is an upper estimate of the value of the paper's own members with these tables.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.objective import IMPROVES, Objective
from cislunar.architecture.result import SearchResult
from cislunar.errors import ConfigurationError
from cislunar.runtime import count_of, counted

PUBLISHED: dict[str, tuple[tuple[str, int], ...]] = {
    "A": (
        ("Halo_L3_N", 2),
        ("Halo_L3_S", 1),
        ("Halo_L2_S", 7),
        ("Halo_L3_N", 1),
        ("Halo_L3_S", 1),
        ("Halo_L2_S", 1),
        ("Halo_L3_S", 2),
        ("Halo_L2_N", 1),
        ("Halo_L2_S", 3),
        ("Halo_L2_S", 1),
    ),
    "B": (
        ("Butterfly_N", 5),
        ("Halo_L3_S", 2),
        ("Halo_L1_S", 7),
        ("Halo_L3_N", 5),
        ("Halo_L2_S", 3),
        ("Halo_L2_S", 3),
        ("Halo_L2_N", 3),
        ("Butterfly_S", 2),
        ("Butterfly_S", 2),
        ("Lyap_L3", 1),
    ),
    "C": (
        ("Halo_L1_N", 5),
        ("Halo_L2_S", 2),
        ("Halo_L3_N", 7),
        ("Halo_L2_N", 1),
        ("Halo_L2_N", 10),
        ("Halo_L2_S", 8),
        ("Lyap_L3", 2),
        ("Halo_L2_S", 4),
        ("Halo_L2_S", 1),
        ("Lyap_L3", 3),
    ),
}
"""Orbit family and number of satellites of each slot, by scenario (Paul & Fan, table 2)."""

PUBLISHED_COST: dict[str, dict[str, tuple[float, int]]] = {
    "A": {"tpe": (1.5081e-4, 20), "random": (1.2236e-5, 51)},
    "B": {"tpe": (3.9069e-4, 33), "random": (1.1624e-4, 45)},
    "C": {"tpe": (3.4424e-3, 43), "random": (6.0012e-4, 46)},
}
"""J and total number of satellites in the paper, by scenario and optimizer (section 5.1)."""

_DRAWS = 1000
"""Number of random choices of members."""


def choose_members(
    objective: Objective,
    slots: tuple[tuple[str, int], ...],
    *,
    rng: np.random.Generator,
    restarts: int = 20,
    progress: Callable[[int, int], None] | None = None,
) -> SearchResult:
    """Choose the member of each family so that the value is largest, for given counts.

    Coordinate search from random members: one slot after another takes its best free member until
    none improves.

    Parameters
    ----------
    objective : Objective
        The objective to maximize.
    slots : tuple of (str, int)
        Family and number of satellites of each slot.
    rng : numpy.random.Generator
        Source of the initial members.
    restarts : int
        Number of random starts.
    progress : callable, optional
        Called with (restarts done, restarts).

    Returns
    -------
    SearchResult
        Slots in the given order.

    Raises
    ------
    ConfigurationError
        If there is no slot or no restart, a family has fewer members in the tables than it has
        slots, or a count is impossible.
    """
    count_of("restarts", restarts)
    if not slots:
        raise ConfigurationError("slots is empty; give a family and a number of satellites of each")
    for family, count in slots:
        count_of(f"slots: satellites of {family}", count)
    satellites = np.array([count for _, count in slots], dtype=np.int64)
    if satellites.max() > objective.max_satellites:
        raise ConfigurationError(
            f"a published slot has {satellites.max()} satellites, the tables stop at "
            f"max_satellites = {objective.max_satellites}"
        )
    members = _members(objective, slots)
    tried: list[tuple[np.ndarray, np.ndarray]] = []
    history: list[float] = []

    def judge(orbit: np.ndarray) -> float:
        value = objective.value(orbit, satellites)
        tried.append((orbit.copy(), satellites))
        history.append(value)
        return value

    for _ in counted(range(restarts), progress):
        orbit = _random_members(slots, members, rng)
        best = judge(orbit)
        improved = True
        while improved:
            improved = False
            for slot, (family, _) in enumerate(slots):
                for candidate in members[family]:
                    if candidate in orbit:
                        continue
                    trial = orbit.copy()
                    trial[slot] = candidate
                    value = judge(trial)
                    if value > best * IMPROVES:
                        orbit, best, improved = trial, value, True
    return SearchResult.from_trials(objective, tried, history, keep_slots=True)


def random_member_values(
    objective: Objective, slots: tuple[tuple[str, int], ...], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Values of random choices of the members of each family, for given counts, shape (draw,). For
    `objective`, `slots` and the errors see `choose_members`."""
    satellites = np.array([count for _, count in slots], dtype=np.int64)
    members = _members(objective, slots)
    chosen = (_random_members(slots, members, rng) for _ in range(_DRAWS))
    return np.array([objective.value(orbit, satellites) for orbit in chosen])


def _members(objective: Objective, slots) -> dict[str, NDArray[np.int64]]:
    """Orbits of each family; raises a `ConfigurationError` if there are too few."""
    members = {}
    for family in dict.fromkeys(name for name, _ in slots):  # a set has no fixed order
        members[family] = np.flatnonzero(objective.family == family)
        needed = sum(name == family for name, _ in slots)
        if len(members[family]) < needed:
            raise ConfigurationError(
                f"orbit family {family} has {len(members[family])} members in the library, "
                f"the published architecture needs {needed}: raise orbits.members"
            )
    return members


def _random_members(slots, members, rng) -> np.ndarray:
    """Distinct random members for all slots."""
    orbit = np.empty(len(slots), dtype=np.int64)
    for family, candidates in members.items():
        where = [i for i, (name, _) in enumerate(slots) if name == family]
        orbit[where] = rng.choice(candidates, size=len(where), replace=False)
    return orbit
