"""Search of the best architecture of N satellites with a bound on what any other could reach."""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.coordinate_search import coordinate_search
from cislunar.architecture.objective import IMPROVES, Objective
from cislunar.errors import ConfigurationError

_ROUNDS = 2  # searches from the choices of a bound, each with a bound of its own

Choice = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Places and satellites at each, both of shape (slot,)."""


class Effort(NamedTuple):
    """What is done with the choices that a bound points at.

    Attributes
    ----------
    starts : int or None
        From how many of them is searched, those of largest value; None: from all.
    worth : float
        Share of the gap by which a search has to raise the value for another bound to be made.
    """

    starts: int | None
    worth: float


THOROUGH = Effort(starts=None, worth=0.0)
"""Every choice is searched from, and any rise is followed by another bound."""


class Bound(NamedTuple):
    """Upper bound on an objective and what was found on the way.

    Attributes
    ----------
    bound : float
        No architecture of the places and satellites asked for has a larger value.
    steps : int
        Steps taken towards it.
    choices : list of (orbit, satellites)
        Architectures that the relaxation points at, for starts of a search.
    """

    bound: float
    steps: int
    choices: list[Choice]


@dataclass(frozen=True)
class Certificate:
    """Best architecture found of one number of satellites, and how much better any could be.

    Attributes
    ----------
    orbit, satellites : ndarray of int64, shape (slot,)
        Places of the tables and satellites at each, ordered by place.
    value : float
        Its value, in the unit of the objective.
    greedy : float
        Value of the start of the search.
    bound : float
        No architecture of as many places and satellites has a larger one.
    gap : float
        bound / value - 1; infinite if nothing was found where something may be.
    steps : int
        Steps of the bound.
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
        """Whether no architecture has a larger value."""
        return self.bound <= self.value


def check_size(objective: Objective, n_satellites: int, n_slots: int, steps: int = 1) -> None:
    """Refuse more satellites than places hold, and a bound without steps."""
    places, most = objective.n_orbits, objective.max_satellites
    if not 1 <= n_slots <= places:
        raise ConfigurationError(f"n_slots = {n_slots} must lie in 1 .. {places}, the places")
    if not n_slots <= n_satellites <= n_slots * most:
        raise ConfigurationError(
            f"n_satellites = {n_satellites} must lie in {n_slots} .. {n_slots * most}: {n_slots} "
            f"places of 1 .. {most} satellites"
        )
    if steps < 1:
        raise ConfigurationError(f"steps = {steps} must be at least 1")


def _promising(objective: Objective, choices: list[Choice], most: int | None) -> list[Choice]:
    """The choices, each once, or those of largest value; of those equal to rounding the first."""
    each = {(orbit.tobytes(), count.tobytes()): (orbit, count) for orbit, count in choices}
    distinct = list(each.values())
    if most is None or len(distinct) <= most:
        return distinct
    values = np.array([objective.value(*choice) for choice in distinct])
    scale = max(values.max(), np.finfo(float).tiny)
    order = np.argsort(-np.round(values / scale, 9), kind="stable")
    return [distinct[k] for k in order[:most]]


def certified_search(
    objective: Objective,
    start: Callable[[], Choice],
    bound_of: Callable[[Choice], Bound],
    *,
    restarts: int = 0,
    rng: np.random.Generator | None = None,
    effort: Effort = THOROUGH,
) -> Certificate:
    """Search from a start, bound what was found, and search on from the choices of the bound.

    The search is `coordinate_search` with the number of satellites prescribed. If a choice of the
    bound leads higher, the bound is computed again from there. No result depends on time.

    Parameters
    ----------
    objective : Objective
        What makes an architecture better.
    start : callable
        Makes the architecture to start from, whose places and satellites set their numbers.
    bound_of : callable
        Bound on all architectures of these numbers, from the best one known.
    restarts : int
        Further random starts of the search.
    rng : numpy.random.Generator, optional
        Source of the random starts.
    effort : Effort
        What is done with the choices of the bound.

    Returns
    -------
    Certificate
    """
    began = perf_counter()
    first = start()
    rng = np.random.default_rng(0) if rng is None else rng
    search = {"n_slots": len(first[0]), "total": int(first[1].sum())}
    greedy = objective.value(*first)
    best = coordinate_search(objective, rng, restarts=restarts, starts=[first], **search)
    bound, taken = np.inf, 0
    for _ in range(_ROUNDS):
        found = bound_of((best.orbit, best.satellites))
        bound, taken = min(bound, found.bound), taken + found.steps
        if bound <= best.value or not found.choices:
            break
        starts = _promising(objective, found.choices, effort.starts)
        again = coordinate_search(objective, rng, restarts=0, starts=starts, **search)
        if again.value <= best.value * IMPROVES:
            break
        before, best = best, again
        if best.value - before.value < effort.worth * (bound - before.value):
            break
    return Certificate(
        orbit=best.orbit,
        satellites=best.satellites,
        value=best.value,
        greedy=greedy,
        bound=bound,
        gap=bound / best.value - 1.0 if best.value > 0.0 else (np.inf if bound > 0.0 else 0.0),
        steps=taken,
        seconds=perf_counter() - began,
    )
