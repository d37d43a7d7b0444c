"""Scratch of the cost of a light curve, compiled."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.parameter_deviations import make_track
from cislunar.compiled import njit_alloc
from cislunar.estimation.light_curves.row_blocks import sum_rows, work_rows
from cislunar.photometry.facet_blocks import BLOCK_ROWS, LANES

Array = NDArray[np.float64]


class _CostWork(NamedTuple):
    """Scratch of the cost, reused from call to call.
    `start` (4,), `omega` (3,): attitude and angular velocity at the epoch. `body`: inertia, its
    inverse and the forced acceleration. `amounts` (n,): rotation deviations. `track`, `times`: see
    `cislunar.attitude.parameter_deviations.begin_track`. `block`, `rows`, `products`: magnitudes of
    a block, its other rows, and sums of products of derivatives."""

    start: Array
    omega: Array
    body: tuple[Array, Array, Array]
    amounts: Array
    track: Array
    times: Array
    block: Array
    rows: Array
    products: Array


@njit_alloc
def make_cost_work(size):
    """Scratch for this number of estimated parameters."""
    track, times = make_track()
    return _CostWork(
        np.empty(4),
        np.empty(3),
        (np.empty((3, 3)), np.empty((3, 3)), np.empty(3)),
        np.empty(size),
        track,
        times,
        np.empty((BLOCK_ROWS, LANES)),
        np.empty((work_rows(size), LANES)),
        np.empty((sum_rows(size), LANES)),
    )
