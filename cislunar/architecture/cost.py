"""The six-factor cost J of an observer architecture (Paul & Fan, section 3).

The paper speaks of minimising J but calls the larger values better (fewer, steadier satellites
that see more raise it), so J is a figure of merit here: it is *maximised*.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from cislunar.architecture.compiled_cost import (
    log_sum,
    scalar_sums,
    seen_per_satellite,
    table_arrays,
)
from cislunar.architecture.tables import ArchitectureTables
from cislunar.errors import ConfigurationError


@dataclass(frozen=True)
class CostFactors:
    """J and its six factors.

    Attributes
    ----------
    value : float
        J = |product of the factors|; larger is better.
    factors : ndarray, shape (6,)
        lambda_1 (satellite count), lambda_2 (stability), lambda_3 (cumulative observability),
        lambda_4 (observations per target), lambda_5 (proximity), lambda_6 (uniqueness).
    """

    value: float
    factors: NDArray[np.float64]


@njit(cache=True)
def log_observations(observations, orbit, satellites):
    """Sum over targets of log10(sum over orbits of observations / n); compiled.

    A target nobody sees contributes log10(1) = 0.

    Parameters
    ----------
    observations : ndarray of unsigned integers, shape (orbit, satellites, target)
        Table of counts.
    orbit, satellites : ndarray of int64, shape (slot,)
        The architecture.

    Returns
    -------
    float
        Dimensionless.
    """
    seen = seen_per_satellite(observations, orbit, satellites, -1)
    return log_sum(seen, observations[0, 0], 0.0)


@njit(cache=True)
def evaluate(observations, totals, distance, stability_index, n_steps, orbit, satellites, factors):
    """J from the tables; compiled, no allocation but one row.

    Parameters
    ----------
    observations : ndarray of unsigned integers, shape (orbit, satellites, target)
        Table of counts.
    totals : ndarray, shape (orbit, satellites)
        `observations` summed over targets.
    distance : ndarray, shape (orbit, satellites)
        Summed distances to both primaries, nondimensional.
    stability_index : ndarray, shape (orbit,)
        Stability indices.
    n_steps : float
        Number of evaluation times.
    orbit, satellites : ndarray of int64, shape (slot,)
        The architecture.
    factors : ndarray, shape (6,)
        Filled with lambda_1 .. lambda_6.

    Returns
    -------
    float
        J; larger is better.
    """
    count, weighted_stability, total, length = scalar_sums(
        totals, distance, stability_index, orbit, satellites, -1
    )
    unique = 1.0
    for i in range(len(orbit)):
        for j in range(i):
            if orbit[i] == orbit[j]:
                unique = 0.0
    scale = observations.shape[2] * n_steps
    factors[0] = 1.0 / count
    factors[1] = 1.0 / weighted_stability
    factors[2] = total / scale
    factors[3] = log_observations(observations, orbit, satellites) / scale
    factors[4] = scale / length
    factors[5] = unique
    product = 1.0
    for k in range(6):
        product *= factors[k]
    return abs(product)


class CostFunction:
    """J of architectures over one set of tables.

    Holds the tables with the target sums that every evaluation needs.

    Parameters
    ----------
    tables : ArchitectureTables
        Counts, distances and stability indices.
    """

    def __init__(self, tables: ArchitectureTables) -> None:
        self.tables = tables
        self._arrays = table_arrays(tables)

    def __call__(self, orbit: ArrayLike, satellites: ArrayLike) -> CostFactors:
        """Evaluate one architecture.

        Parameters
        ----------
        orbit : array_like of int, shape (slot,)
            Indices into the orbit library.
        satellites : array_like of int, shape (slot,)
            Satellites on each orbit, 1 .. ``max_satellites``.

        Returns
        -------
        CostFactors

        Raises
        ------
        ConfigurationError
            If an index or a count is outside the tables.
        """
        orbit = np.asarray(orbit, dtype=np.int64)
        satellites = np.asarray(satellites, dtype=np.int64)
        tables = self.tables
        if orbit.shape != satellites.shape or orbit.ndim != 1 or orbit.size == 0:
            raise ConfigurationError("orbit and satellites must be equally long, non-empty lists")
        if orbit.min() < 0 or orbit.max() >= tables.n_orbits:
            raise ConfigurationError(f"orbit indices must lie in 0 .. {tables.n_orbits - 1}")
        if satellites.min() < 1 or satellites.max() > tables.max_satellites:
            raise ConfigurationError(f"satellites must lie in 1 .. {tables.max_satellites}")
        factors = np.empty(6)
        value = evaluate(*self._arrays, orbit, satellites, factors)
        return CostFactors(value=float(value), factors=factors)
