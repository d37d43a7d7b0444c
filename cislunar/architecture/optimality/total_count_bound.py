"""Bounds on J for each total number of satellites, and the levels the tree has to search."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.architecture.compiled_cost import log_envelope, table_arrays
from cislunar.architecture.optimality.knapsack import NO_CHOICE, best_choice
from cislunar.architecture.optimality.relaxation import Level
from cislunar.architecture.optimality.target_groups import group_means, group_targets
from cislunar.architecture.tables import ArchitectureTables


@dataclass(frozen=True)
class CountBounds:
    """Upper bounds on J by total number of satellites, from four scalars each.

    Attributes
    ----------
    satellites : ndarray of int, shape (total,)
        Every possible total.
    seen : ndarray, shape (total,)
        Bound on J over architectures whose log-sum is >= 0.
    rarely_seen : ndarray, shape (total,)
        Bound on J over architectures whose log-sum is negative: with n satellites on an orbit a
        target may count as seen less than once, and J takes the absolute value.
    """

    satellites: NDArray[np.int64]
    seen: NDArray[np.float64]
    rarely_seen: NDArray[np.float64]


class LevelFactory:
    """Bounds and relaxation data of one set of tables.

    Parameters
    ----------
    tables : ArchitectureTables
    n_slots : int
        Number of distinct orbits.
    n_groups : int
        Most target groups of the relaxation.
    """

    def __init__(self, tables: ArchitectureTables, n_slots: int, n_groups: int):
        self.arrays = table_arrays(tables)
        observations, self.observed, self.distance, stability, n_steps = self.arrays
        self.n_slots = n_slots
        self.scale = tables.n_targets * n_steps
        self.n_targets = tables.n_targets
        counts = np.arange(1, tables.max_satellites + 1)
        self.stability = stability[:, None] * counts
        self.per_satellite = self.observed / counts
        # orbits that cost the denominator least make up the good architectures
        weight = (stability * self.distance[:, 0]) ** -2.0
        label = group_targets(observations[:, 0], n_slots * weight / weight.sum(), n_groups)
        self.cover, self.mass = group_means(observations, label, int(label.max()) + 1)
        self.negative = _negative_log_sums(observations)

    def counts(self, excess: int) -> int:
        """Different numbers of satellites an orbit may hold."""
        return min(self.observed.shape[1], excess + 1)

    def bounds(self) -> CountBounds:
        """Scalar bounds of every total number of satellites."""
        highest = self.n_slots * (self.observed.shape[1] - 1)
        seen, rarely = np.zeros(highest + 1), np.zeros(highest + 1)
        for excess in range(highest + 1):
            k = self.counts(excess)
            observed = self._most(self.observed[:, :k], excess)
            mean = self._most(self.per_satellite[:, :k], excess) / self.n_targets
            stability = -self._most(-self.stability[:, :k], excess)
            distance = -self._most(-self.distance[:, :k], excess)
            factor = observed / ((self.n_slots + excess) * stability * distance * self.scale)
            seen[excess] = factor * self.n_targets * log_envelope(mean)
            rarely[excess] = factor * self.negative[k - 1]
        return CountBounds(self.n_slots + np.arange(highest + 1), seen, rarely)

    def _most(self, score: NDArray, excess: int) -> float:
        """Largest sum of a score over the architectures with so many excess satellites."""
        n, counts = score.shape
        slots = np.empty((2, self.n_slots), dtype=np.int64)
        best = best_choice(
            np.ascontiguousarray(score),
            np.zeros(n, np.int64),
            np.full(n, counts - 1),
            np.zeros(n, np.bool_),
            self.n_slots,
            excess,
            slots[0],
            slots[1],
        )
        assert best > 0.5 * NO_CHOICE
        return best

    def level(self, satellites: int, negative: bool) -> Level:
        """Relaxation data of one total number of satellites and sign of the log-sum."""
        excess = satellites - self.n_slots
        k = self.counts(excess)
        groups = 0 if negative else self.mass.size
        return Level(
            n_slots=self.n_slots,
            excess=excess,
            satellites=float(satellites),
            observed=np.ascontiguousarray(self.observed[:, :k]),
            stability=np.ascontiguousarray(self.stability[:, :k]),
            distance=np.ascontiguousarray(self.distance[:, :k]),
            cover=np.ascontiguousarray(self.cover[:, :k, :groups]),
            mass=self.mass[:groups].copy(),
            constant=float(self.negative[k - 1]) if negative else 0.0,
            scale=float(self.scale),
        )


@njit(cache=True)
def _negative_log_sums(observations):
    """Bound on a negative log-sum by largest number of satellites on an orbit.

    A target that is seen at all has at least the least non-zero observations per satellite that
    any orbit gives it.
    """
    n_orbits, counts, n_targets = observations.shape
    least = np.ones(n_targets)
    bound = np.zeros(counts)
    for e in range(counts):
        for i in range(n_orbits):
            for t in range(n_targets):
                if observations[i, e, t] > 0:
                    least[t] = min(least[t], observations[i, e, t] / (e + 1))
        for t in range(n_targets):
            bound[e] -= np.log10(least[t])
    return bound
