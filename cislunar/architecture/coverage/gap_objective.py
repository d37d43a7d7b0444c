"""Gaps between observations of static targets as an objective."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.architecture.certified import Bound, ObjectiveCertificate, certified_search
from cislunar.architecture.coverage.certificate import greedy_coverage
from cislunar.architecture.coverage.objective import CoverageObjective
from cislunar.architecture.coverage.tables import CoverageTables
from cislunar.architecture.objective import IMPROVES, Replacement, first_best
from cislunar.compiled import njit
from cislunar.errors import ConfigurationError
from cislunar.runtime.arguments import require_choice

GAP_MEASURES = ("longest", "mean", "wait")
"""Measures of a target: longest gap, mean length of its gaps, mean time to wait for an
observation."""

_ONE = np.uint64(1)


@njit(cache=True)
def _close(measure, length, state, j):
    """Record that a gap of target j has ended."""
    if measure == 0:
        state[0, j] = max(state[0, j], length)
    else:
        state[0, j] += length * length if measure == 2 else length
        state[1, j] += 1


@njit(cache=True)
def _measured(seen, added, n_times, n_targets, measure, last, start, state):
    """Sum over the targets of a measure, in samples, given what is seen or added (word,). `last`
    and `start` (target,) are the last sample without an observer and the first of its gap; `state`
    (2, target) accumulates the measure. All three are scratch arrays."""
    last[:] = -2
    state[:] = 0
    size = n_times * n_targets
    for w in range(seen.size):
        dark = ~(seen[w] | added[w])
        first = 64 * w
        while dark:
            low = dark & (~dark + _ONE)
            element = first
            # position of the lowest one
            for half in (32, 16, 8, 4, 2, 1):
                if low >> np.uint64(half):
                    low >>= np.uint64(half)
                    element += half
            dark &= dark - _ONE
            if element >= size:
                break
            t, j = element // n_targets, element % n_targets
            if last[j] != t - 1:
                if last[j] >= 0:
                    _close(measure, last[j] - start[j] + 1, state, j)
                start[j] = t
            last[j] = t
    total = 0.0
    for j in range(n_targets):
        if last[j] >= 0:
            _close(measure, last[j] - start[j] + 1, state, j)
            if measure == 0:
                total += state[0, j]
            elif measure == 1:
                total += state[0, j] / state[1, j]
            else:
                total += state[0, j] / (2.0 * n_times)
    return total


@njit(cache=True)
def _all_measured(seen, layers, candidate, n_times, n_targets, measure):
    """The measure with each of some candidates, rows of `layers` (candidate, layer, word)."""
    last, start = np.empty((2, n_targets), dtype=np.int64)
    state = np.empty((2, n_targets), dtype=np.int64)
    found = np.empty(candidate.size)
    for c in range(candidate.size):
        added = layers[candidate[c], 0]
        found[c] = _measured(seen, added, n_times, n_targets, measure, last, start, state)
    return found


class GapObjective(CoverageObjective):
    """Shortness of the gaps of the targets, as a share of the horizon.

    With g(j) the longest gap of target j, the mean length of its gaps, or the mean time from any
    time to its next observation (`cislunar.architecture.coverage.measures.gaps`), and T the
    horizon,

        f = 1 - mean over j of g(j) / T,

    dimensionless, 0 to 1; (1 - f) T is the mean over the targets in hours.

    The longest gap and the wait never increase as satellites are added, but the improvement is not
    submodular: two satellites together may close a gap that neither of them shortens. The mean
    length may even increase when a short gap is closed, so that only the trivial bound holds for
    it. For further limits see `CoverageObjective`.

    Parameters
    ----------
    tables : CoverageTables
        Single coverage of samples: ``fold=1``, ``window="sample"``.
    measure : str
        One of `GAP_MEASURES`.

    Raises
    ------
    ConfigurationError
        If the measure is unknown, or the tables are not of single coverage.
    """

    def __init__(self, tables: CoverageTables, measure: str) -> None:
        require_choice("measure", measure, GAP_MEASURES)
        if tables.fold != 1:
            raise ConfigurationError(f"fold = {tables.fold}: gaps need single coverage, fold = 1")
        super().__init__(tables)
        self.measure = measure

    def _values(self, seen: NDArray, candidate: NDArray) -> NDArray[np.float64]:
        """Values with each of some candidates added to what is seen (word,)."""
        code = GAP_MEASURES.index(self.measure)
        found = _all_measured(seen, self.candidates, candidate, *self.tables.shape, code)
        return 1.0 - found / self.tables.n_elements

    def value(self, orbit: ArrayLike, satellites: ArrayLike) -> float:
        """1 - mean gap measure over the horizon of one architecture, as in
        `CoverageObjective.value`; 0 with a duplicate orbit slot."""
        orbit, satellites = self.checked(orbit, satellites)
        if np.unique(orbit).size < orbit.size:
            return 0.0
        seen = self._at_least(orbit, satellites)[0]
        return float(self._values(seen, orbit[:1] * self.max_satellites + satellites[:1] - 1)[0])

    def best_replacement(
        self, orbit: NDArray, satellites: NDArray, slot: int, lowest: int, highest: int, best: float
    ) -> Replacement:
        """See `Objective`; the coverage of the other slots is computed once."""
        (seen,), candidate = self._without(orbit, satellites, slot, lowest, highest)
        found = self._values(seen, candidate)
        largest = first_best(found)
        if found[largest] <= best * IMPROVES:
            return Replacement(-1, 0, best, found.size)
        i, n = divmod(int(candidate[largest]), self.max_satellites)
        return Replacement(i, n + 1, float(found[largest]), found.size)

    def ceiling(self) -> float:
        """Upper bound on all architectures: the value of all candidates together, or 1."""
        if self.measure == "mean":
            return 1.0
        return float(self._values(self.reachable, np.zeros(1, dtype=np.int64))[0])


def certify_gaps(
    objective: GapObjective,
    n_satellites: int,
    *,
    n_slots: int | None = None,
    restarts: int = 0,
    rng: np.random.Generator | None = None,
) -> ObjectiveCertificate:
    """Search for the architecture of the shortest gaps, from the greedy choice of largest coverage.
    The bound is the value of all candidates together. `restarts` is the number of further random
    starts of the search, with `rng` as their source; for the other arguments, and
    the errors, see `cislunar.architecture.coverage.certificate.certify_coverage`."""
    return certified_search(
        objective,
        lambda: greedy_coverage(objective, n_satellites, n_slots=n_slots),
        lambda known: Bound(max(objective.ceiling(), objective.value(*known)), 1, []),
        restarts=restarts,
        rng=rng,
    )
