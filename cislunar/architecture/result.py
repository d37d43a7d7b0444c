"""What an optimiser of the architecture returns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.objective import Objective, first_best


@dataclass(frozen=True)
class SearchResult:
    """The best architecture found and how the search went.

    Attributes
    ----------
    orbit : ndarray of int64, shape (slot,)
        Indices into the orbit library.
    satellites : ndarray of int64, shape (slot,)
        Satellites on each of those orbits.
    value : float
        Its value.
    history : ndarray, shape (evaluation,)
        Value of each evaluation, in order.
    satellites_history : ndarray of int64, shape (evaluation,)
        Total number of satellites of each evaluation.
    orbit_trials, satellites_trials : ndarray of int64, shape (evaluation, slot)
        The architecture of each evaluation.
    """

    orbit: NDArray[np.int64]
    satellites: NDArray[np.int64]
    value: float
    history: NDArray[np.float64]
    satellites_history: NDArray[np.int64]
    orbit_trials: NDArray[np.int64]
    satellites_trials: NDArray[np.int64]

    @property
    def n_satellites(self) -> int:
        """Total number of satellites."""
        return int(self.satellites.sum())

    @classmethod
    def from_trials(
        cls,
        objective: Objective,
        tried: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]],
        history: Sequence[float],
        *,
        keep_slots: bool = False,
    ) -> "SearchResult":
        """Pick the best of the architectures tried, whose values are the history.

        The slots are sorted by orbit, or left in their order.
        """
        orbit, satellites = tried[first_best(np.asarray(history))]
        order = np.arange(len(orbit)) if keep_slots else np.argsort(orbit, kind="stable")
        return cls(
            orbit=orbit[order],
            satellites=satellites[order],
            value=objective.value(orbit[order], satellites[order]),
            history=np.asarray(history, dtype=float),
            satellites_history=np.array([n.sum() for _, n in tried], dtype=np.int64),
            orbit_trials=np.array([o for o, _ in tried], dtype=np.int64),
            satellites_trials=np.array([n for _, n in tried], dtype=np.int64),
        )
