"""Scratch of the cost of a light curve, compiled."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.departures import make_track
from cislunar.compiled import allocating
from cislunar.estimation.light_curves.row_blocks import sum_rows, work_rows
from cislunar.photometry.facet_blocks import BLOCK_ROWS, LANES

Array = NDArray[np.float64]


class CostWork(NamedTuple):
    """Scratch of the cost, reused from call to call.

    Attributes
    ----------
    start, omega : ndarray, shapes (4,) and (3,)
        Attitude and angular velocity at the epoch.
    body : tuple of ndarray, shapes (3, 3), (3, 3) and (3,)
        Inertia, its inverse and the forced acceleration.
    amounts : ndarray, shape (n,)
        Departures.
    track, times : ndarray
        As of `cislunar.attitude.departures.start_track`.
    block, rows, products : ndarray
        A block's magnitudes, its other rows, and sums of products of derivatives.
    """

    start: Array
    omega: Array
    body: tuple[Array, Array, Array]
    amounts: Array
    track: Array
    times: Array
    block: Array
    rows: Array
    products: Array


@allocating
def make_cost_work(unknowns):
    """Scratch for so many unknowns."""
    track, times = make_track()
    return CostWork(
        np.empty(4),
        np.empty(3),
        (np.empty((3, 3)), np.empty((3, 3)), np.empty(3)),
        np.empty(unknowns),
        track,
        times,
        np.empty((BLOCK_ROWS, LANES)),
        np.empty((work_rows(unknowns), LANES)),
        np.empty((sum_rows(unknowns), LANES)),
    )
