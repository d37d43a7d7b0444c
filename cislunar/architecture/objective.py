"""What makes one architecture better than another: the interface every search and proof takes."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError

IMPROVES = 1.0 + 1e-9
"""Least ratio of values that is a gain: below rounding a search could cycle, or end elsewhere on
another machine."""


def first_best(values: NDArray[np.float64]) -> int:
    """Index of the first of the values, not negative, that none surpasses by `IMPROVES`."""
    return int(np.argmax(values * IMPROVES >= values.max()))


class Replacement(NamedTuple):
    """The best choice for one slot: orbit (-1 without a gain), its satellites, value, effort."""

    orbit: int
    satellites: int
    value: float
    evaluations: int


@dataclass(frozen=True)
class Level:
    """Architectures of one total number of satellites, or a part of them, bounded together.

    Attributes
    ----------
    n_satellites : int
        Total number of satellites.
    part : str
        Which of those architectures; "" for all.
    bound : float
        Upper bound on their value.
    relaxation : callable
        Makes what `cislunar.architecture.optimality.node.search` needs for a sharper bound.
    """

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
        """Value of one architecture, not negative.

        Parameters
        ----------
        orbit, satellites : array_like of int, shape (slot,)
            Indices of the orbits and satellites on each.
        """

    def best_replacement(
        self, orbit: NDArray, satellites: NDArray, slot: int, lowest: int, highest: int, best: float
    ) -> Replacement:
        """The orbit and count of one slot that gain most, the other slots held.

        Here every candidate is evaluated; an objective that can discard most of them overrides it.

        Parameters
        ----------
        orbit, satellites : ndarray of int64, shape (slot,)
            The architecture.
        slot : int
            The slot to replace, by an orbit that no other slot holds.
        lowest, highest : int
            Range of its count.
        best : float
            Value to beat.

        Returns
        -------
        Replacement
        """
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
        """Bounds for a proof: levels that hold every architecture of distinct orbits together.

        Parameters
        ----------
        n_slots : int
            Number of distinct orbits.

        Returns
        -------
        list of Level
            By total number of satellites, ascending.
        """
        raise NotImplementedError(f"{type(self).__name__} has no bounds to prove an optimum with")

    def check(self, orbit: NDArray, satellites: NDArray) -> None:
        """Refuse an architecture that is not among the candidates.

        Raises
        ------
        ConfigurationError
            If the lists do not match, or an index or a count is out of range.
        """
        if orbit.shape != satellites.shape or orbit.ndim != 1 or orbit.size == 0:
            raise ConfigurationError("orbit and satellites must be equally long, non-empty lists")
        if orbit.min() < 0 or orbit.max() >= self.n_orbits:
            raise ConfigurationError(f"orbit indices must lie in 0 .. {self.n_orbits - 1}")
        if satellites.min() < 1 or satellites.max() > self.max_satellites:
            raise ConfigurationError(f"satellites must lie in 1 .. {self.max_satellites}")
