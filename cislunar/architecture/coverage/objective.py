"""Coverage of static targets as an objective: of target-hours or target-days, single or k-fold."""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.architecture.coverage.kernels import add_layers, count_ones, gains, shared_ones
from cislunar.architecture.coverage.tables import CoverageTables
from cislunar.architecture.objective import IMPROVES, Objective, Replacement
from cislunar.errors import ConfigurationError


class CoverageObjective(Objective):
    """Share of the elements (target at a time, or target on a day) that an architecture sees.

    With c(e) the number of satellites that see element e, the value of k-fold coverage is

        f = sum over e of min(c(e), k) / (k x number of elements),

    dimensionless, 0 to 1. k = 1 is union coverage: the share of target-hours, or of target-days,
    seen by at least one satellite. For k > 1 an element seen by fewer counts in part; f is then the
    mean over j = 1 .. k of the share seen by at least j. The share seen by at least k alone would
    not be submodular: the first satellite would gain nothing.

    As a sum of concave functions of c, f is monotone and submodular in the set of satellites: what
    a satellite adds only falls as others are added. That makes lazy greedy exact greedy, and greedy
    at least 1 - 1/e of the best (Nemhauser, Wolsey & Fisher, 1978). In the paper's slots it holds
    for adding orbits; another satellite on an orbit moves those before it.

    The "orbits" of the interface are the places of the tables. At free phases a place carries one
    satellite, so that N satellites are N places.

    Limits. Targets stand still in the rotating frame and are spheres; every target and hour weighs
    the same; one observation suffices, whoever else the satellite would have to look at. Coverage
    is the objective of a search, not of custody.

    Parameters
    ----------
    tables : CoverageTables
        What every place and satellite count sees.

    Raises
    ------
    ConfigurationError
        If it is given anything else.
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
        """Layers of every (place, count): ndarray of shape (place * satellites, layer, word)."""
        layers = self.tables.layers
        return layers.reshape(-1, *layers.shape[2:])

    @cached_property
    def reachable(self) -> NDArray[np.uint64]:
        """Bits of the elements that any candidate sees, shape (word,)."""
        return np.bitwise_or.reduce(self.candidates[:, 0], axis=0)

    def _gains_again(
        self, orbit: NDArray, others: NDArray, candidate: NDArray
    ) -> NDArray[np.int64]:
        """Gains over all places but one, from those over all: few elements hang on the one.

        `others` (word,) are the elements that have enough satellites without it. Where each place
        carries one satellite, a candidate gains each element it sees that has not enough.
        """
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
        """Coverage of one architecture; 0 with a duplicate place.

        Parameters
        ----------
        orbit, satellites : array_like of int, shape (slot,)
            Places and satellites at each.

        Raises
        ------
        ConfigurationError
            If an index or a count is outside the tables.
        """
        orbit = np.asarray(orbit, dtype=np.int64)
        satellites = np.asarray(satellites, dtype=np.int64)
        self.check(orbit, satellites)
        if np.unique(orbit).size < orbit.size:
            return 0.0
        return count_ones(self._at_least(orbit, satellites).ravel()) / self.scale

    def seen(self, orbit: ArrayLike, satellites: ArrayLike, times: int = 1) -> NDArray[np.bool_]:
        """Which elements at least so many satellites see, up to the fold.

        Parameters
        ----------
        orbit, satellites : array_like of int, shape (slot,)
            The architecture.
        times : int
            Number of satellites, 1 .. fold.

        Returns
        -------
        ndarray of bool, shape (time or day, target)
        """
        orbit = np.asarray(orbit, dtype=np.int64)
        satellites = np.asarray(satellites, dtype=np.int64)
        self.check(orbit, satellites)
        words = self._at_least(orbit, satellites)[times - 1]
        bits = np.unpackbits(words.view(np.uint8), count=self.tables.n_elements, bitorder="little")
        return bits.astype(bool).reshape(self.tables.shape)

    def best_replacement(
        self, orbit: NDArray, satellites: NDArray, slot: int, lowest: int, highest: int, best: float
    ) -> Replacement:
        """As in `Objective`; what the other slots cover is gathered once."""
        others = np.delete(orbit, slot)
        covered = self._at_least(others, np.delete(satellites, slot))
        place = np.setdiff1d(np.arange(self.n_orbits), others)
        count = np.arange(lowest, highest + 1)
        candidate = (place[:, None] * self.max_satellites + count - 1).ravel()
        if self.max_satellites == 1:
            gain = self._gains_again(orbit, covered[-1], candidate)
        else:
            gain = gains(covered, self.candidates, candidate, self.reachable)
        largest = int(np.argmax(gain))
        value = (count_ones(covered.ravel()) + int(gain[largest])) / self.scale
        if value <= best * IMPROVES:
            return Replacement(-1, 0, best, gain.size)
        i, n = divmod(int(candidate[largest]), self.max_satellites)
        return Replacement(i, n + 1, value, gain.size)
