"""Search for the best architecture of N satellites, with an upper bound on all others."""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.coordinate_search import coordinate_search
from cislunar.architecture.objective import IMPROVES, Objective

_ROUNDS = 2  # bounds, each followed by a search from its choices

Choice = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Orbit slots and satellites at each, both of shape (slot,)."""


class Effort(NamedTuple):
    """Effort of the search from the choices of a bound: the number `starts` of choices, those of
    largest value, from which it starts (None: all), and the share `least_gain` of the gap that it
    must close for the bound to be computed again."""

    starts: int | None
    least_gain: float


THOROUGH = Effort(starts=None, least_gain=0.0)
"""Search from every choice, and compute the bound again after any improvement."""


class Bound(NamedTuple):
    """Upper `bound` on an objective over all architectures of the prescribed numbers of orbit slots
    and satellites, the number of `steps` of the relaxation, and the `choices` (orbit, satellites)
    that it suggests as starts of a search."""

    bound: float
    steps: int
    choices: list[Choice]


@dataclass(frozen=True)
class ObjectiveCertificate:
    """Best known architecture of a number of satellites, and an upper bound on all others.

    Attributes
    ----------
    orbit, satellites : ndarray of int64, shape (slot,)
        Indices of the orbit slots in the tables, ascending, and satellites at each.
    value : float
        Value, in the unit of the objective.
    greedy : float
        Value of the start of the search.
    bound : float
        No architecture with as many orbit slots and satellites has a larger value.
    gap : float
        bound / value - 1; infinite if the value is zero and the bound is not.
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


def _promising(objective: Objective, choices: list[Choice], most: int | None) -> list[Choice]:
    """Distinct choices, or those of largest value; the first of values equal to rounding."""
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
) -> ObjectiveCertificate:
    """Search from a start, bound the result, and search again from the choices of the bound.

    The search is `coordinate_search` with the numbers of orbit slots and satellites of the
    architecture that `start` returns; `bound_of` bounds all architectures of these numbers, given
    the best known one. If a choice of the bound leads to a larger value, the bound is computed
    again from there. No result depends on time."""
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
        if best.value - before.value < effort.least_gain * (bound - before.value):
            break
    return ObjectiveCertificate(
        orbit=best.orbit,
        satellites=best.satellites,
        value=best.value,
        greedy=greedy,
        bound=bound,
        gap=bound / best.value - 1.0 if best.value > 0.0 else (np.inf if bound > 0.0 else 0.0),
        steps=taken,
        seconds=perf_counter() - began,
    )
