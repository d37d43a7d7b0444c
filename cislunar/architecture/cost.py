"""The six-factor cost J of an observer architecture (Paul & Fan, section 3) as an objective.

The paper speaks of minimising J but calls the larger values better (fewer, steadier satellites
that see more raise it), so J is a figure of merit here: it is *maximised*.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.architecture.cost_kernels import (
    architecture_cost,
    architecture_factors,
    best_replacement,
    cost_arrays,
)
from cislunar.architecture.objective import Level, Objective, Replacement
from cislunar.architecture.optimality.cost_levels import cost_levels
from cislunar.architecture.tables import ArchitectureTables


class CostFunction(Objective):
    """J of architectures over one set of tables.

    Parameters
    ----------
    tables : ArchitectureTables
        Counts, distances and stability indices.
    n_groups : int
        Most target groups of the relaxation behind a proof: more give fewer, slower nodes.
    """

    def __init__(self, tables: ArchitectureTables, *, n_groups: int = 100) -> None:
        super().__init__(tables.family, tables.stability_index, tables.max_satellites)
        self._arrays = cost_arrays(tables)
        self._n_groups = n_groups

    def _checked(self, orbit: ArrayLike, satellites: ArrayLike) -> tuple[NDArray, NDArray]:
        orbit = np.asarray(orbit, dtype=np.int64)
        satellites = np.asarray(satellites, dtype=np.int64)
        self.check(orbit, satellites)
        return orbit, satellites

    def value(self, orbit: ArrayLike, satellites: ArrayLike) -> float:
        """J = |product of the factors|; 0 with a duplicate orbit.

        Parameters
        ----------
        orbit, satellites : array_like of int, shape (slot,)
            Indices into the orbit library and satellites on each, 1 .. ``max_satellites``.

        Raises
        ------
        ConfigurationError
            If an index or a count is outside the tables.
        """
        return architecture_cost(self._arrays, *self._checked(orbit, satellites))

    def factors(self, orbit: ArrayLike, satellites: ArrayLike) -> NDArray[np.float64]:
        """lambda_1 (satellite count), lambda_2 (stability), lambda_3 (cumulative observability),
        lambda_4 (observations per target), lambda_5 (proximity), lambda_6 (uniqueness).

        Parameters and errors as for `value`.

        Returns
        -------
        ndarray, shape (6,)
        """
        return np.array(architecture_factors(self._arrays, *self._checked(orbit, satellites)))

    def best_replacement(
        self, orbit: NDArray, satellites: NDArray, slot: int, lowest: int, highest: int, best: float
    ) -> Replacement:
        """As in `Objective`; most of the library is discarded by a bound from five scalars."""
        found = best_replacement(self._arrays, orbit, satellites, slot, lowest, highest, best)
        return Replacement(*found)

    def levels(self, n_slots: int) -> list[Level]:
        """As in `Objective`: for each total, architectures with a log-sum >= 0 and those below."""
        return cost_levels(self._arrays, n_slots, self._n_groups)
