"""The six-factor cost J of an observer architecture (Paul & Fan, section 3) as an objective.

The paper speaks of minimizing J but calls larger values better: fewer, more stable satellites that
observe more increase it. J is therefore a figure of merit here and is *maximized*.
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
from cislunar.errors import ConfigurationError
from cislunar.runtime.arguments import array_of, count_of, require_kind


class CostFunction(Objective):
    """J of architectures over one set of tables.

    Parameters
    ----------
    tables : ArchitectureTables
        Counts, distances and stability indices.
    n_groups : int
        Largest number of target groups of the relaxation; more groups give fewer, slower nodes.

    Raises
    ------
    ConfigurationError
        If `tables` are no `ArchitectureTables`, their shapes disagree, or a value is not finite.
    """

    def __init__(self, tables: ArchitectureTables, *, n_groups: int = 100) -> None:
        require_kind("tables", tables, ArchitectureTables, "give ArchitectureTables")
        shape = tables.observations.shape[:2]
        array_of("tables.observations", tables.observations, (*shape, "target"))
        array_of("tables.distance", tables.distance, shape)
        array_of("tables.stability_index", tables.stability_index, shape[:1])
        count_of("tables.n_steps", tables.n_steps)
        family = np.asarray(tables.family)
        if family.shape != shape[:1]:
            raise ConfigurationError(
                f"tables.family has shape {family.shape}; give the family of each of {shape[0]} "
                "orbits"
            )
        super().__init__(family, tables.stability_index, tables.max_satellites)
        self._arrays = cost_arrays(tables)
        self._n_groups = n_groups

    def value(self, orbit: ArrayLike, satellites: ArrayLike) -> float:
        """J = |product of the factors|; 0 with a duplicate orbit. `orbit` and `satellites`, shape
        (slot,), are indices into the orbit library and the satellites on each, 1 ..
        ``max_satellites``."""
        return architecture_cost(self._arrays, *self.checked(orbit, satellites))

    def factors(self, orbit: ArrayLike, satellites: ArrayLike) -> NDArray[np.float64]:
        """lambda_1 (satellite count), lambda_2 (stability), lambda_3 (cumulative observability),
        lambda_4 (observations per target), lambda_5 (proximity), lambda_6 (uniqueness), shape (6,),
        for the arguments of `value`."""
        return np.array(architecture_factors(self._arrays, *self.checked(orbit, satellites)))

    def best_replacement(
        self, orbit: NDArray, satellites: NDArray, slot: int, lowest: int, highest: int, best: float
    ) -> Replacement:
        """See `Objective`; a bound from five scalars discards most of the library."""
        found = best_replacement(self._arrays, orbit, satellites, slot, lowest, highest, best)
        return Replacement(*found)

    def levels(self, n_slots: int) -> list[Level]:
        """See `Objective`; each total has one level with a log-sum >= 0 and one below 0."""
        return cost_levels(self._arrays, n_slots, self._n_groups)
