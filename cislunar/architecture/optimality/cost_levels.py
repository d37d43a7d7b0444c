"""Bounds on J for each total number of satellites, and the relaxations for branch and bound."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.cost_kernels import CostArrays, cost, log_envelope
from cislunar.architecture.objective import Level
from cislunar.architecture.optimality.cost_relaxation import CostRelaxation
from cislunar.architecture.optimality.knapsack import NO_CHOICE, best_choice
from cislunar.architecture.optimality.target_groups import group_means, group_targets
from cislunar.compiled import njit


def cost_levels(arrays: CostArrays, n_slots: int, n_groups: int) -> list[Level]:
    """Levels of J, two for each total number of satellites, bounded by four scalars each. With n
    satellites on an orbit a target may count as seen less than once, so that the log-sum is
    negative; J takes its magnitude. Those architectures are the second level of a total."""
    pieces = _Pieces(arrays, n_slots, n_groups)
    levels = []
    for excess in range(n_slots * (arrays.observed.shape[1] - 1) + 1):
        for part, bound in zip(("", "negative log-sum"), pieces.bounds(excess), strict=True):
            relaxation = partial(pieces.relaxation, excess, bool(part))
            levels.append(Level(n_slots + excess, part, bound, relaxation))
    return levels


class _Pieces:
    """Precomputed arrays from which the levels of one set of tables are built."""

    def __init__(self, arrays: CostArrays, n_slots: int, n_groups: int):
        self.arrays = arrays
        self.n_slots = n_slots
        counts = np.arange(1, arrays.observed.shape[1] + 1)
        self.stability = arrays.stability[:, None] * counts
        self.per_satellite = arrays.observed / counts
        # good architectures consist of orbits with a small contribution to the denominator
        weight = (arrays.stability * arrays.distance[:, 0]) ** -2.0
        shares = n_slots * weight / weight.sum()
        label = group_targets(arrays.observations[:, 0], shares, n_groups)
        self.cover, self.mass = group_means(arrays.observations, label, int(label.max()) + 1)
        self.negative = _negative_log_sums(arrays.observations)

    def counts(self, excess: int) -> int:
        """Number of different satellite counts of an orbit."""
        return min(self.stability.shape[1], excess + 1)

    def bounds(self, excess: int) -> tuple[float, float]:
        """Upper bounds on J with a log-sum >= 0 and with a negative one."""
        k = self.counts(excess)
        n_targets = self.arrays.observations.shape[2]
        mean = self._most(self.per_satellite[:, :k], excess) / n_targets
        sums = (
            float(self.n_slots + excess),
            -self._most(-self.stability[:, :k], excess),
            self._most(self.arrays.observed[:, :k], excess),
            -self._most(-self.arrays.distance[:, :k], excess),
        )
        seen, rarely = (
            cost(*sums, logs, self.arrays.scale, 1.0)
            for logs in (n_targets * log_envelope(mean), self.negative[k - 1])
        )
        return seen, rarely

    def _most(self, score: NDArray, excess: int) -> float:
        """Largest sum of a score over the architectures with a number of excess satellites."""
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

    def relaxation(self, excess: int, negative: bool) -> CostRelaxation:
        """Relaxation of one total number of satellites and sign of the log-sum."""
        k = self.counts(excess)
        groups = 0 if negative else self.mass.size
        stability, distance = self.stability[:, :k], self.arrays.distance[:, :k]
        ratio = stability / distance
        return CostRelaxation(
            n_slots=self.n_slots,
            excess=excess,
            n_orbits=len(ratio),
            counts=k,
            # slightly wider than the ratios, so that rounding cannot move a sum out of the cone
            interval=(float(ratio.min() * (1.0 - 1e-9)), float(ratio.max() * (1.0 + 1e-9))),
            observed=np.ascontiguousarray(self.arrays.observed[:, :k]),
            stability=np.ascontiguousarray(stability),
            distance=np.ascontiguousarray(distance),
            cover=np.ascontiguousarray(self.cover[:, :k, :groups]),
            mass=self.mass[:groups].copy(),
            constant=float(self.negative[k - 1]) if negative else 0.0,
            arrays=self.arrays,
        )


@njit(cache=True)
def _negative_log_sums(observations):
    """Bound on a negative log-sum by largest number of satellites on an orbit. A target that is
    seen at all has at least the least non-zero observations per satellite of any orbit."""
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
