"""Several observers at a target: the best tasking is a set packing, solved by HiGHS.

A column is a target with the observers that look at it together. Each observer is in one column
chosen at most, and so is each target. The linear relaxation is nearly always whole, so that the
integer program takes hardly longer.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from cislunar.errors import CislunarError
from cislunar.tasking.planning.assignment import IDLE, INFORMATION_DECIMALS

Array = NDArray[np.float64]


class Packing(NamedTuple):
    """A set packing.

    Attributes
    ----------
    target : ndarray of int, shape (observer,)
        Target each observer looks at, or `IDLE`.
    value : float
        What it is worth.
    gap : float
        By how much, relative to `value`, another may be worth more.
    """

    target: NDArray[np.int64]
    value: float
    gap: float


def best_packing(
    target: NDArray[np.int64], observers: NDArray[np.int64], worth: Array, n_observers: int
) -> Packing:
    """The best choice of columns that share neither target nor observer.

    Parameters
    ----------
    target : ndarray of int, shape (column,)
    observers : ndarray of int, shape (column, k)
        Those of each column, filled up with `IDLE`.
    worth : ndarray, shape (column,)
        Columns that are worth nothing are left out.
    n_observers : int

    Returns
    -------
    Packing

    Raises
    ------
    CislunarError
        If HiGHS does not find it.
    """
    value = np.round(worth, INFORMATION_DECIMALS)
    kept = np.flatnonzero(value > 0.0)
    chosen = np.full(n_observers, IDLE, dtype=np.int64)
    if kept.size == 0:
        return Packing(chosen, 0.0, 0.0)
    column, place = np.nonzero(observers[kept] != IDLE)
    rows = np.concatenate([observers[kept][column, place], n_observers + target[kept]])
    columns = np.concatenate([column, np.arange(kept.size)])
    n_rows = n_observers + int(target[kept].max()) + 1
    matrix = coo_array((np.ones(rows.size), (rows, columns)), shape=(n_rows, kept.size))
    found = milp(
        -value[kept],
        integrality=np.ones(kept.size),
        bounds=Bounds(0.0, 1.0),
        constraints=LinearConstraint(matrix.tocsc(), -np.inf, 1.0),
        options={"mip_rel_gap": 0.0},
    )
    if found.x is None:
        raise CislunarError(f"set packing of {kept.size} columns: {found.message}")
    for c in kept[found.x > 0.5]:
        looking = observers[c][observers[c] != IDLE]
        chosen[looking] = target[c]
    total = float(value[kept][found.x > 0.5].sum())
    gap = max(0.0, -float(found.mip_dual_bound) - total) / total
    return Packing(chosen, total, gap)
