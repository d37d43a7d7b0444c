"""Information about moving targets as an objective: of position and velocity, or attitude."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.architecture.information.kernels import combined, gains, item_values
from cislunar.architecture.information.tables import InformationTables
from cislunar.architecture.objective import IMPROVES, Objective, Replacement, first_best
from cislunar.errors import ConfigurationError


class InformationObjective(Objective):
    """Mean information that an architecture gathers about an item (a target in a window).

    With G(c, i) the whitened Fisher information of the looks of satellite c at item i,

        F = mean over i of 1/2 log det(I + sum over c of G(c, i)),

    in nats, not negative. It is what a Kalman filter handed the true trajectory would gain over the
    window in the entropy of the state at its start: a nat for each factor e by which the volume of
    the uncertainty shrinks. Where only some of the states count (the attitude, not the angular
    velocity), the determinant is that of the Schur complement, the information about these alone.

    A satellite's looks are shared among the targets it sees, whoever else sees them, so that the
    sum over satellites is one of given matrices and F is concave in how often each flies. With all
    states counted, F is monotone and submodular, which makes lazy greedy exact greedy and greedy at
    least 1 - 1/e of the best; with nuisances it is monotone, but no more.

    The "orbits" of the interface are the places of the tables, which carry one satellite each.

    Limits. Targets and looks are linearised about one trajectory, windows do not know of each
    other, looks are shared evenly although tasking would choose, and a day's initial uncertainty is
    that of the epoch. Attitudes are averaged over, with one angular velocity.

    Parameters
    ----------
    tables : InformationTables
        What a satellite at every place tells of every item.

    Raises
    ------
    ConfigurationError
        If it is given anything else.
    """

    def __init__(self, tables: InformationTables) -> None:
        if not isinstance(tables, InformationTables):
            raise ConfigurationError(
                "tables: InformationTables, made by orbit_information or attitude_information, are "
                f"needed, not a {type(tables).__name__}"
            )
        super().__init__(tables.family, tables.stability_index, 1)
        self.tables = tables

    @property
    def n_items(self) -> int:
        """Number of items, over which the value is the mean."""
        return self.tables.matrix.shape[1]

    def sums(self, place: NDArray, weight: NDArray | None = None) -> NDArray[np.float64]:
        """Identity plus the weighted sum of the matrices of places (place,), shape (item, 21)."""
        weight = np.ones(len(place)) if weight is None else weight
        return combined(self.tables.matrix, np.asarray(place, dtype=np.int64), weight)

    def item_values(self, base: NDArray) -> NDArray[np.float64]:
        """Information about each item, nats, shape (item,), from `sums`."""
        values = np.empty(len(base))
        item_values(base, self.tables.nuisance, values)
        return values

    def value(self, orbit: ArrayLike, satellites: ArrayLike) -> float:
        """Mean information of one architecture, nats; 0 with a duplicate place.

        Parameters
        ----------
        orbit, satellites : array_like of int, shape (slot,)
            Places and satellites at each, one.

        Raises
        ------
        ConfigurationError
            If an index or a count is outside the tables.
        """
        orbit = np.asarray(orbit, dtype=np.int64)
        self.check(orbit, np.asarray(satellites, dtype=np.int64))
        if np.unique(orbit).size < orbit.size:
            return 0.0
        # in one order, so that an architecture has one value
        return float(np.mean(self.item_values(self.sums(np.sort(orbit)))))

    def best_replacement(
        self, orbit: NDArray, satellites: NDArray, slot: int, lowest: int, highest: int, best: float
    ) -> Replacement:
        """As in `Objective`; the sum over the other slots is made once."""
        others = np.sort(np.delete(orbit, slot))
        base = self.sums(others)
        values = self.item_values(base)
        place = np.setdiff1d(np.arange(self.n_orbits), others)
        gain = gains(base, values, self.tables.matrix, place, self.tables.nuisance)
        found = np.mean(values) + gain / self.n_items
        largest = first_best(found)
        if found[largest] <= best * IMPROVES:
            return Replacement(-1, 0, best, gain.size)
        return Replacement(int(place[largest]), 1, float(found[largest]), gain.size)
