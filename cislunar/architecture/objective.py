"""Interface of objectives of an architecture, which every search and proof uses."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError
from cislunar.runtime.arguments import array_of

IMPROVES = 1.0 + 1e-9
"""Least ratio of values that is an improvement; below it, rounding could make a search cycle or
depend on the machine."""


def first_best(values: NDArray[np.float64]) -> int:
    """Index of the first of nonnegative values that no other exceeds by `IMPROVES`."""
    return int(np.argmax(values * IMPROVES >= values.max()))


class Replacement(NamedTuple):
    """Best choice for one slot: orbit (-1 if none), its satellites, value, evaluations."""

    orbit: int
    satellites: int
    value: float
    evaluations: int


@dataclass(frozen=True)
class Level:
    """A set of architectures with one total number of satellites that are bounded together: `part`
    names the subset of those architectures ("" for all), `bound` is an upper bound on their value,
    and `relaxation` returns the relaxation of `cislunar.architecture.optimality.node.search` for a
    sharper one."""

    n_satellites: int
    part: str
    bound: float
    relaxation: Callable[[], Any]


class Objective(ABC):
    """Value of an architecture (a choice of orbits and satellite counts); larger is better.

    Parameters
    ----------
    family : ndarray of str, shape (orbit,)
        Family of each candidate orbit; members are consecutive and ordered along it.
    stability_index : ndarray, shape (orbit,)
        Stability index of each candidate orbit.
    max_satellites : int
        Largest number of satellites on one orbit.
    """

    def __init__(self, family: NDArray, stability_index: NDArray, max_satellites: int) -> None:
        self.family = family
        self.stability_index = stability_index
        self.max_satellites = max_satellites

    @property
    def n_orbits(self) -> int:
        """Number of candidate orbits."""
        return len(self.family)

    @abstractmethod
    def value(self, orbit: ArrayLike, satellites: ArrayLike) -> float:
        """Value of one architecture, not negative; `orbit` and `satellites`, shape (slot,), are the
        indices of the orbits and the satellites on each."""

    def best_replacement(
        self, orbit: NDArray, satellites: NDArray, slot: int, lowest: int, highest: int, best: float
    ) -> Replacement:
        """The orbit and count, from `lowest` to `highest`, of one slot with the largest value above
        `best`, with the other slots fixed and no orbit twice. This method evaluates every
        candidate; an objective that can discard most of them overrides it."""
        found, evaluations = (-1, 0), 0
        orbit, satellites = orbit.copy(), satellites.copy()
        for i in np.setdiff1d(np.arange(self.n_orbits), np.delete(orbit, slot)):
            for n in range(lowest, highest + 1):
                orbit[slot], satellites[slot] = i, n
                value = self.value(orbit, satellites)
                evaluations += 1
                if value > best * IMPROVES:
                    found, best = (int(i), n), value
        return Replacement(*found, best, evaluations)

    def levels(self, n_slots: int) -> list[Level]:
        """Levels, by total number of satellites ascending, that cover all architectures of
        `n_slots` distinct orbits."""
        raise NotImplementedError(f"{type(self).__name__} has no bounds to prove an optimum with")

    def checked(self, orbit: ArrayLike, satellites: ArrayLike) -> tuple[NDArray, NDArray]:
        """Both as int64 arrays; a `ConfigurationError` if they do not match or are out of range."""
        orbit, satellites = _whole(orbit), _whole(satellites)
        if orbit.shape != satellites.shape or orbit.ndim != 1 or orbit.size == 0:
            raise ConfigurationError("orbit and satellites must be equally long, non-empty lists")
        if orbit.min() < 0 or orbit.max() >= self.n_orbits:
            raise ConfigurationError(f"orbit indices must lie in 0 .. {self.n_orbits - 1}")
        if satellites.min() < 1 or satellites.max() > self.max_satellites:
            raise ConfigurationError(f"satellites must lie in 1 .. {self.max_satellites}")
        return orbit, satellites


def _whole(given: ArrayLike) -> NDArray[np.int64]:
    """Whole numbers as int64; a `ConfigurationError` otherwise."""
    found = np.asarray(given)
    if found.dtype.kind not in "iu":
        found = array_of("orbit and satellites", given)
        if np.any(found != np.floor(found)):
            raise ConfigurationError("orbit and satellites must be whole numbers")
    return found.astype(np.int64)
