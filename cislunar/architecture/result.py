"""Result of an optimizer of the architecture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.objective import Objective, first_best


@dataclass(frozen=True)
class SearchResult:
    """The best architecture found, `orbit` and `satellites` (slot,) with its `value`, and the
    history: value and total number of satellites of each evaluation (evaluation,), and its
    architecture, `orbit_trials` and `satellites_trials` (evaluation, slot)."""

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
        """Select the best of the evaluated architectures, given the value of each, with its slots
        sorted by orbit or in their order."""
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
