"""Information about moving targets as an objective: of position and velocity, or of attitude."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.architecture.information.kernels import combined, gains, item_values
from cislunar.architecture.information.tables import InformationTables
from cislunar.architecture.objective import IMPROVES, Objective, Replacement, first_best
from cislunar.errors import ConfigurationError


class InformationObjective(Objective):
    """Mean information that an architecture collects about an item (a target in a window).

    With G(c, i) the whitened Fisher information of the observations of item i by satellite c,

        F = mean over i of 1/2 log det(I + sum over c of G(c, i)),

    in nats, not negative. It is the entropy that a Kalman filter, linearized about the true
    trajectory, would remove from the state at the start of the window: one nat for each factor e by
    which the volume of the uncertainty decreases. If only some of the states count (the attitude,
    not the angular velocity), the determinant is that of the Schur complement, the information
    about these alone.

    The observations of a satellite are shared among the targets that it sees, independently of
    other satellites. The sum over satellites therefore has constant terms, and F is concave in
    their multiplicities. If all states count, F is monotone and submodular, so that lazy greedy
    equals greedy and greedy reaches at least 1 - 1/e of the optimum. With nuisance states it is
    monotone only.

    The "orbits" of the interface are the orbit slots of the tables, with one satellite each.

    Targets and observations are linearized about one trajectory, windows are independent of one
    another, observations are shared evenly although a scheduler would choose, and the initial
    uncertainty of each window is that of the epoch. Attitudes are averaged over, with one angular
    velocity.

    Parameters
    ----------
    tables : InformationTables
        Information about every item from every orbit slot.

    Raises
    ------
    ConfigurationError
        If `tables` are no `InformationTables`.
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

    def sums(self, slot: NDArray, weight: NDArray | None = None) -> NDArray[np.float64]:
        """Identity plus the weighted sum of the matrices of orbit slots, shape (item, 21)."""
        weight = np.ones(len(slot)) if weight is None else weight
        return combined(self.tables.matrix, np.asarray(slot, dtype=np.int64), weight)

    def item_values(self, base: NDArray) -> NDArray[np.float64]:
        """Information about each item, nats, shape (item,), from `sums`."""
        values = np.empty(len(base))
        item_values(base, self.tables.nuisance, values)
        return values

    def value(self, orbit: ArrayLike, satellites: ArrayLike) -> float:
        """Mean information, nats, of one architecture, shape (slot,) of orbit slots and one
        satellite at each; 0 with a duplicate orbit slot."""
        orbit, _ = self.checked(orbit, satellites)
        if np.unique(orbit).size < orbit.size:
            return 0.0
        # sorted, so that the value does not depend on the order
        return float(np.mean(self.item_values(self.sums(np.sort(orbit)))))

    def best_replacement(
        self, orbit: NDArray, satellites: NDArray, slot: int, lowest: int, highest: int, best: float
    ) -> Replacement:
        """See `Objective`; the sum over the other slots is computed once."""
        others = np.sort(np.delete(orbit, slot))
        base = self.sums(others)
        values = self.item_values(base)
        free = np.setdiff1d(np.arange(self.n_orbits), others)
        gain = gains(base, values, self.tables.matrix, free, self.tables.nuisance)
        found = np.mean(values) + gain / self.n_items
        largest = first_best(found)
        if found[largest] <= best * IMPROVES:
            return Replacement(-1, 0, best, gain.size)
        return Replacement(int(free[largest]), 1, float(found[largest]), gain.size)
