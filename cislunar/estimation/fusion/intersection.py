"""Covariance intersection of estimates with unknown correlations.

Estimates x_i with covariances P_i of one state fuse (Julier & Uhlmann 1997) to

    P^-1 = sum w_i P_i^-1,   P^-1 x = sum w_i P_i^-1 x_i,   w_i >= 0,  sum w_i = 1,

which is never overconfident if none of the estimates is, whatever their correlations. The weights
minimize det P. The maximization of log det sum w_i J_i is the D-optimal design of experiments; its
multiplicative iteration w_i <- w_i tr(P J_i) / n increases from step to step (Titterington 1976),
and at the optimum no tr(P J_i) exceeds n. All is computed in units of the root of the best
estimate.
"""

import numpy as np

from cislunar.compiled import njit
from cislunar.estimation.triangular import cholesky, solve_lower, solve_transposed

TOLERANCE = 1e-2
"""Relative excess of tr(P J_i) over n at which the iteration ends."""

_MOST_ITERATIONS = 200


@njit(cache=True, error_model="numpy")
def best_of(covariance, informed):
    """Index of the covariance (estimate, n, n) with the smallest determinant; -1 for none."""
    best, least = -1, np.inf
    for i in range(informed.size):
        if not informed[i]:
            continue
        root = covariance[i].copy()
        if not cholesky(root):
            continue
        size = np.sum(np.log(np.diag(root)))
        if size < least:
            best, least = i, size
    return best


@njit(cache=True, error_model="numpy")
def intersect(mean, covariance, informed, weight, fused, spread):
    """Fuse the informed estimates (estimate, n) with covariances (estimate, n, n). `weight`
    (estimate,) has the initial and receives the final weights; `fused` (n,) and `spread` (n, n)
    receive the result. Returns False, with NaN there, if there is none to fuse."""
    count, n = mean.shape
    best = best_of(covariance, informed)
    fused[:], spread[:, :] = np.nan, np.nan
    if best < 0:
        return False
    root = covariance[best].copy()
    cholesky(root)
    scaled, away, usable = np.zeros((count, n, n)), np.zeros((count, n)), informed.copy()
    for i in range(count):
        own = covariance[i].copy()
        usable[i] = usable[i] and cholesky(own)
        if not usable[i]:
            weight[i] = 0.0
            continue
        columns = root.T.copy()  # rows are columns of the best root
        for c in range(n):
            solve_lower(own, columns[c])
        scaled[i] = columns @ columns.T
        offset = mean[i] - mean[best]
        solve_lower(own, offset)
        away[i] = columns @ offset
        weight[i] = max(weight[i], 1e-6)
    weight /= np.sum(weight)
    total, inverse = np.empty((n, n)), np.empty((n, n))
    for _ in range(_MOST_ITERATIONS):
        total[:, :] = 0.0
        for i in range(count):
            if usable[i]:
                total += weight[i] * scaled[i]
        cholesky(total)
        for c in range(n):
            inverse[c] = 0.0
            inverse[c, c] = 1.0
            solve_lower(total, inverse[c])
            solve_transposed(total, inverse[c])
        worst = 0.0
        for i in range(count):
            if usable[i]:
                gain = np.sum(inverse * scaled[i]) / n
                weight[i] *= gain
                worst = max(worst, gain)
        weight /= np.sum(weight)
        if worst <= 1.0 + TOLERANCE:
            break
    total[:, :] = 0.0
    shift = np.zeros(n)
    for i in range(count):
        if usable[i]:
            total += weight[i] * scaled[i]
            shift += weight[i] * away[i]
    cholesky(total)
    solve_lower(total, shift)
    solve_transposed(total, shift)
    fused[:] = mean[best] + root @ shift
    for a in range(n):
        row = root[a].copy()
        solve_lower(total, row)
        root[a] = row
    spread[:, :] = root @ root.T
    return True
