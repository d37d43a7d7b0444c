"""Coverage of static targets as an objective: of target-hours or target-days, single or k-fold."""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.architecture.coverage.kernels import add_layers, gains, shared_ones
from cislunar.architecture.coverage.tables import CoverageTables
from cislunar.architecture.objective import IMPROVES, Objective, Replacement
from cislunar.errors import ConfigurationError


class CoverageObjective(Objective):
    """Share of the elements (target at a time, or target on a day) that an architecture sees.

    With c(e) the number of satellites that see element e, the value of k-fold coverage is

        f = sum over e of min(c(e), k) / (k x number of elements),

    dimensionless, 0 to 1. k = 1 is union coverage: the share of target-hours, or of target-days,
    seen by at least one satellite. For k > 1 an element seen by fewer satellites counts in part; f
    is then the mean over j = 1 .. k of the share seen by at least j satellites. The share seen by
    at least k would not be submodular, because the first satellite would gain nothing.

    As a sum of concave functions of c, f is monotone and submodular in the set of satellites: the
    gain of a satellite never increases as others are added. Therefore lazy greedy equals greedy,
    and greedy reaches at least 1 - 1/e of the optimum (Nemhauser, Wolsey & Fisher, 1978). With
    several satellites per orbit this holds for adding orbits; a further satellite on an orbit
    shifts the phases of the others.

    The "orbits" of the interface are the orbit slots of the tables. For free phases an orbit slot
    has one satellite, so that N satellites occupy N orbit slots.

    Targets are spheres at rest in the rotating frame, all targets and hours have equal weight, and
    one observation suffices, regardless of the other targets of the satellite. Coverage is the
    objective of a search strategy, not of custody.

    Parameters
    ----------
    tables : CoverageTables
        Elements seen from every orbit slot with every satellite count.

    Raises
    ------
    ConfigurationError
        If `tables` are no `CoverageTables`.
    """

    def __init__(self, tables: CoverageTables) -> None:
        if not isinstance(tables, CoverageTables):
            raise ConfigurationError(
                f"tables: CoverageTables, made by coverage_tables, are needed, not a "
                f"{type(tables).__name__}"
            )
        super().__init__(tables.family, tables.stability_index, tables.max_satellites)
        self.tables = tables
        self._over: tuple[NDArray, NDArray, NDArray] | None = None

    @property
    def scale(self) -> int:
        """Elements times the fold: the value is a whole number over this."""
        return self.tables.n_elements * self.tables.fold

    @property
    def candidates(self) -> NDArray[np.uint64]:
        """Layers of every (orbit slot, count), shape (slot * satellites, layer, word)."""
        layers = self.tables.layers
        return layers.reshape(-1, *layers.shape[2:])

    @cached_property
    def reachable(self) -> NDArray[np.uint64]:
        """Bits of the elements that any candidate sees, shape (word,)."""
        return np.bitwise_or.reduce(self.candidates[:, 0], axis=0)

    def _gains_again(
        self, orbit: NDArray, others: NDArray, candidate: NDArray
    ) -> NDArray[np.int64]:
        """Gains over all orbit slots but one, from the cached gains over all of them. `others`
        (word,) are the elements that have enough satellites without that one. With one satellite
        per orbit slot, a candidate gains each element that it sees and that has not enough
        satellites."""
        if self._over is None or not np.array_equal(self._over[0], orbit):
            every = self._at_least(orbit, np.ones_like(orbit))
            all_of_them = np.arange(self.n_orbits)
            over = gains(every, self.candidates, all_of_them, self.reachable)
            self._over = orbit.copy(), every[-1], over
        _, enough, gain = self._over
        return gain[candidate] + shared_ones(enough & ~others, self.candidates, candidate)

    def _at_least(self, orbit: NDArray, satellites: NDArray) -> NDArray[np.uint64]:
        """Bits of the elements seen by at least 1 .. fold satellites, shape (fold, word)."""
        layers = self.tables.layers
        found = np.zeros((self.tables.fold, layers.shape[-1]), dtype=np.uint64)
        for i, n in zip(orbit, satellites, strict=True):
            add_layers(found, layers[i, n - 1])
        return found

    def value(self, orbit: ArrayLike, satellites: ArrayLike) -> float:
        """Coverage of one architecture, shape (slot,) of orbit slots and satellites at each; 0 with
        a duplicate orbit slot."""
        orbit, satellites = self.checked(orbit, satellites)
        if np.unique(orbit).size < orbit.size:
            return 0.0
        return int(np.bitwise_count(self._at_least(orbit, satellites)).sum()) / self.scale

    def seen(self, orbit: ArrayLike, satellites: ArrayLike, times: int = 1) -> NDArray[np.bool_]:
        """Elements that at least `times` (1 .. fold) satellites see, (time or day, target)."""
        orbit, satellites = self.checked(orbit, satellites)
        words = self._at_least(orbit, satellites)[times - 1]
        bits = np.unpackbits(words.view(np.uint8), count=self.tables.n_elements, bitorder="little")
        return bits.astype(bool).reshape(self.tables.shape)

    def _without(
        self, orbit: NDArray, satellites: NDArray, slot: int, lowest: int, highest: int
    ) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
        """Bits of the elements seen without a slot, and the candidates that may replace it."""
        others = np.delete(orbit, slot)
        covered = self._at_least(others, np.delete(satellites, slot))
        free = np.setdiff1d(np.arange(self.n_orbits), others)
        count = np.arange(lowest, highest + 1)
        return covered, (free[:, None] * self.max_satellites + count - 1).ravel()

    def best_replacement(
        self, orbit: NDArray, satellites: NDArray, slot: int, lowest: int, highest: int, best: float
    ) -> Replacement:
        """See `Objective`; the coverage of the other slots is computed once."""
        covered, candidate = self._without(orbit, satellites, slot, lowest, highest)
        if self.max_satellites == 1:
            gain = self._gains_again(orbit, covered[-1], candidate)
        else:
            gain = gains(covered, self.candidates, candidate, self.reachable)
        largest = int(np.argmax(gain))
        value = (int(np.bitwise_count(covered).sum()) + int(gain[largest])) / self.scale
        if value <= best * IMPROVES:
            return Replacement(-1, 0, best, gain.size)
        i, n = divmod(int(candidate[largest]), self.max_satellites)
        return Replacement(i, n + 1, value, gain.size)
