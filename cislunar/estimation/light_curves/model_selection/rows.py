"""Predicted magnitudes of the rows of a light curve, and their derivatives (compiled)."""

import numpy as np

from cislunar.compiled import njit_alloc, njit_noalloc
from cislunar.estimation.light_curves.light_curve import (
    differentiate_block,
    set_motion,
    surface_and_shares,
)
from cislunar.estimation.light_curves.row_blocks import (
    ROTATION,
    make_cost_work,
    parameter_rows,
    pull_back_matrix,
)
from cislunar.photometry.facet_blocks import LANES, MAGNITUDE, SUN, VIEW


@njit_noalloc
def _fill(u, data, model, surface, shares, work, out):
    """See `expected_rows`; derivatives by the rotation are those of `differentiate_block`."""
    magnitude, directions, derivative = out
    block, by_parameter = work.block, parameter_rows(work.rows, 0)
    for first in range(0, data.shape[0], LANES):
        rows = min(LANES, data.shape[0] - first)
        differentiate_block(first, rows, data, model, surface, shares, work)
        for k in range(rows):
            magnitude[first + k] = block[MAGNITUDE, k]
            for c in range(3):
                directions[first + k, c] = block[SUN + c, k]
                directions[first + k, 3 + c] = block[VIEW + c, k]
            for i in range(u.shape[0]):
                derivative[first + k, i] = by_parameter[i, k]


@njit_alloc
def expected_rows(u, data, model):
    """Predicted magnitudes of the rows of a light curve, and their derivatives.

    Parameters
    ----------
    u : ndarray, shape (p,)
        Estimated parameters, in prior standard deviations.
    data : ndarray, shape (n, ROW_COLUMNS)
        See `cislunar.estimation.light_curves.light_curve.cost`.
    model : LightCurveModel

    Returns
    -------
    magnitude : ndarray, shape (n,)
    directions : ndarray, shape (n, 6)
        Unit vectors to the Sun and to the observer, body frame.
    derivative : ndarray, shape (n, p)
        Derivatives of the magnitudes by the parameters.
    """
    n, size = data.shape[0], u.shape[0]
    out = np.empty(n), np.empty((n, 6)), np.empty((n, size))
    work = make_cost_work(size)
    set_motion(u, model, True, work)
    if model.surface_kinds.shape[0] > 0:
        surface, shares = surface_and_shares(u, model)
        _fill(u, data, model, surface, shares, work, out)
    else:
        _fill(u, data, model, model.surface, work.block[:0], work, out)
    by_rotation = out[2][:, :ROTATION].copy()
    out[2][:, :ROTATION] = by_rotation @ pull_back_matrix(u, work.start, model.sigma).T
    return out
