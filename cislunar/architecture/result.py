"""What an optimiser of the architecture returns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.cost import CostFactors, CostFunction


@dataclass(frozen=True)
class SearchResult:
    """The best architecture found and how the search went.

    Attributes
    ----------
    orbit : ndarray of int64, shape (slot,)
        Indices into the orbit library.
    satellites : ndarray of int64, shape (slot,)
        Satellites on each of those orbits.
    cost : CostFactors
        J and its factors.
    history : ndarray, shape (evaluation,)
        J of each evaluation, in order.
    satellites_history : ndarray of int64, shape (evaluation,)
        Total number of satellites of each evaluation.
    orbit_trials, satellites_trials : ndarray of int64, shape (evaluation, slot), or None
        The architecture of each evaluation, where the optimiser keeps it.
    """

    orbit: NDArray[np.int64]
    satellites: NDArray[np.int64]
    cost: CostFactors
    history: NDArray[np.float64]
    satellites_history: NDArray[np.int64]
    orbit_trials: NDArray[np.int64] | None = None
    satellites_trials: NDArray[np.int64] | None = None

    @property
    def n_satellites(self) -> int:
        """Total number of satellites."""
        return int(self.satellites.sum())

    @classmethod
    def from_trials(
        cls,
        cost: CostFunction,
        tried: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]],
        history: Sequence[float],
        *,
        keep_slots: bool = False,
    ) -> "SearchResult":
        """Pick the best of the architectures tried.

        Parameters
        ----------
        cost : CostFunction
            The cost they were judged by.
        tried : sequence of (orbit, satellites)
            Architectures in the order of evaluation.
        history : sequence of float
            Their J.
        keep_slots : bool
            Leave the slots in their order instead of sorting them by orbit.

        Returns
        -------
        SearchResult
        """
        orbit, satellites = tried[int(np.argmax(history))]
        order = np.arange(len(orbit)) if keep_slots else np.argsort(orbit, kind="stable")
        return cls(
            orbit=orbit[order],
            satellites=satellites[order],
            cost=cost(orbit[order], satellites[order]),
            history=np.asarray(history, dtype=float),
            satellites_history=np.array([n.sum() for _, n in tried], dtype=np.int64),
            orbit_trials=np.array([o for o, _ in tried], dtype=np.int64),
            satellites_trials=np.array([n for _, n in tried], dtype=np.int64),
        )
