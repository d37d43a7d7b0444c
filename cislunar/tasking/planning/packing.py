"""Best tasking with several observers per target: a set packing, solved by HiGHS. A column is a
target with the observers that observe it together. Each observer and each target is in at most one
chosen column."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from cislunar.errors import CislunarError
from cislunar.runtime import Array
from cislunar.tasking.planning.assignment import IDLE, INFORMATION_DECIMALS


class _Packing(NamedTuple):
    """A set packing: `target` (observer,) of each observer, or `IDLE`, the `value` of the chosen
    columns, and the relative amount `gap` by which another packing may have a larger value."""

    target: NDArray[np.int64]
    value: float
    gap: float


def best_packing(
    target: NDArray[np.int64], observers: NDArray[np.int64], value: Array, n_observers: int
) -> _Packing:
    """The best choice of columns that share neither target nor observer: `target` (column,),
    `observers` (column, k) filled up with `IDLE`, and `value` (column,); columns without
    value are left out."""
    value = np.round(value, INFORMATION_DECIMALS)
    kept = np.flatnonzero(value > 0.0)
    chosen = np.full(n_observers, IDLE, dtype=np.int64)
    if kept.size == 0:
        return _Packing(chosen, 0.0, 0.0)
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
        members = observers[c][observers[c] != IDLE]
        chosen[members] = target[c]
    total = float(value[kept][found.x > 0.5].sum())
    gap = max(0.0, -float(found.mip_dual_bound) - total) / total
    return _Packing(chosen, total, gap)
