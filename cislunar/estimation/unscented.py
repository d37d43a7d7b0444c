"""The unscented transform in difference form (Paul & Fan, section 2.4).

With few states the weight of the central sigma point is harmless. With twelve states and the
paper's alpha = 0.5, beta = 2, kappa = 3 - n it is -15. Written in the differences d_i of the outer
points from the central one, the moments have no negative weight:

    mean        x_0 + m                                   with m = sum_i W_i d_i
    covariance  sum_i W_i d_i d_i^T + (beta - alpha^2) m m^T

This equals the paper's weighted sum and is positive semidefinite for beta >= alpha^2, whatever the
function. Only the differences of angles have to be wrapped.

The update is written likewise. With the cross-covariance U in units of the prior's Cholesky factor
L (P_xy = L U), the innovation covariance is the sum of two positive parts, P_vv = S + U^T U, where
S is the noise plus the even part of the differences. Then

    P+ = L (I - U P_vv^-1 U^T) L^T = L (I + U S^-1 U^T)^-1 L^T,

and the Cholesky factor of P+ follows from that of a matrix that is never smaller than the identity
and is obtained from the identity by rotations.
"""

from typing import NamedTuple

import numpy as np

from cislunar.compiled import njit_alloc, njit_noalloc
from cislunar.estimation.triangular import add_outer_product, cholesky, solve_lower


class UnscentedWeights(NamedTuple):
    """Weights of the 2n + 1 sigma points (Paul & Fan, eqs. 28-31): `spread` is sqrt(n + lambda),
    the factor on the columns of the covariance's root, `outer` the weight of each outer point, and
    `mean_shift` beta - alpha^2, the weight of m m^T in the difference form."""

    spread: float
    outer: float
    mean_shift: float


UNSCENTED_WEIGHTS = UnscentedWeights(
    spread=float(np.sqrt(0.75)), outer=0.5 / 0.75, mean_shift=2.0 - 0.5**2
)
"""Weights with the paper's alpha = 0.5, beta = 2 and kappa = 3 - n, for every number of states:
n + lambda = alpha^2 (n + kappa) is 0.75."""


@njit_noalloc
def sigma_points(mean, rows, spread, points):
    """Sigma points of a Gaussian, by column (Paul & Fan, eqs. 24-27).

    The columns of `points` (m, 2 n + 1) are the mean, mean + spread * column i of the root, and
    mean - spread * column i. `mean` (m,) and `rows` (m, n) of the covariance's lower Cholesky
    factor may be those of some of the states.
    """
    size = rows.shape[1]
    for c in range(mean.shape[0]):
        center = mean[c]
        points[c, 0] = center
        for i in range(size):
            delta = spread * rows[c, i]
            points[c, 1 + i] = center + delta
            points[c, 1 + size + i] = center - delta


@njit_noalloc
def difference_moments(differences, outer, mean_shift, shift, covariance):
    """Mean shift (m,) and covariance (m, m) of a transformed sigma set (Paul & Fan, eq. 40).

    `differences` (2 n, m), m at least four, are the outer points less the central one (angles
    wrapped). Only the lower triangle of the covariance is valid.
    """
    count, size = differences.shape
    for a in range(size):
        total = 0.0
        for i in range(count):
            total += differences[i, a]
        shift[a] = total * outer
    for a in range(size):
        for first in range(0, a + 1, 4):
            b = min(first, size - 4)
            s0 = s1 = s2 = s3 = 0.0  # four independent sums at a time
            for i in range(count):
                weighted = outer * differences[i, a]
                s0 += weighted * differences[i, b]
                s1 += weighted * differences[i, b + 1]
                s2 += weighted * differences[i, b + 2]
                s3 += weighted * differences[i, b + 3]
            shifted = mean_shift * shift[a]
            covariance[a, b] = s0 + shifted * shift[b]
            covariance[a, b + 1] = s1 + shifted * shift[b + 1]
            covariance[a, b + 2] = s2 + shifted * shift[b + 2]
            covariance[a, b + 3] = s3 + shifted * shift[b + 3]


@njit_noalloc
def innovation_moments(differences, noise_variance, weights, shift, cross, even):
    """Moments of an expected measurement in units of the prior's root (Paul & Fan, eqs. 44-47).

    `differences` (2 n, m) are the measurements expected at the outer sigma points less the central
    one. Outputs: `shift` (m,), the mean less the central measurement; `cross` (n, m), U with P_xy =
    L U; `even` (m, m), S = P_vv - U^T U = R + sum_i (W_i / 2) s_i s_i^T + (beta - alpha^2) m m^T
    with s_i = d_{+i} + d_{-i}, none of whose terms is negative.
    """
    n = cross.shape[0]
    m = cross.shape[1]
    odd_factor = weights.outer * weights.spread
    half = 0.5 * weights.outer
    shift[:] = 0.0
    even[:, :] = 0.0
    for i in range(n):
        for a in range(m):
            cross[i, a] = odd_factor * (differences[i, a] - differences[n + i, a])
            sum_a = differences[i, a] + differences[n + i, a]
            shift[a] += sum_a
            for b in range(m):
                even[a, b] += half * sum_a * (differences[i, b] + differences[n + i, b])
    for a in range(m):
        shift[a] *= weights.outer
    for a in range(m):
        for b in range(m):
            even[a, b] += weights.mean_shift * shift[a] * shift[b]
        even[a, a] += noise_variance[a]


@njit_noalloc
def square_root_update(root, cross, even, innovation, correction, work):
    """Kalman update of a Cholesky factor L (n, n) that stays definite (Paul & Fan, eqs. 48-50).

    `cross` and `even` are U and S of `innovation_moments`; they and the innovation (m,), measured
    less mean expected, are overwritten. `correction` (n,) receives K times the innovation; `work`
    (n, n) is scratch. Returns False, with `root` unchanged, if S or the innovation is not finite.

    With V V^T = S and W = U V^-T the posterior is L (I + W W^T)^-1 L^T. From the upper triangular G
    with G G^T = I + W W^T the lower factor is L G^-T. The gain is K = L (I + W W^T)^-1 W V^-1 = (L
    G^-T) G^-1 W V^-1.
    """
    n, m = cross.shape
    if not cholesky(even):
        return False
    solve_lower(even, innovation)
    total = 0.0
    for i in range(n):
        solve_lower(even, cross[i])
        for a in range(m):
            total += cross[i, a] * cross[i, a]
    for a in range(m):
        total += innovation[a] * innovation[a]
    if not total < np.inf:
        return False
    work[:, :] = 0.0
    for i in range(n):
        work[i, i] = 1.0
    for a in range(m):
        for i in range(n):
            correction[i] = cross[i, a]
        add_outer_product(work, correction)
    _multiply_by_inverse_transpose(root, work)
    # z = G^-1 W V^-1 innovation by back substitution, then K innovation = L+ z.
    for i in range(n - 1, -1, -1):
        total = 0.0
        for a in range(m):
            total += cross[i, a] * innovation[a]
        for j in range(i + 1, n):
            total -= work[i, j] * correction[j]
        correction[i] = total / work[i, i]
    for i in range(n - 1, -1, -1):
        total = 0.0
        for j in range(i + 1):
            total += root[i, j] * correction[j]
        correction[i] = total
    return True


@njit_noalloc
def _multiply_by_inverse_transpose(root, upper):
    """Replace the lower triangular L by L G^-T for an upper triangular G."""
    n = root.shape[0]
    for column in range(n - 1, -1, -1):
        # Row i of X solves X G^T = L: X_ic = (L_ic - sum_{k > c} X_ik G_ck) / G_cc.
        inverse = 1.0 / upper[column, column]
        for i in range(column, n):
            total = root[i, column]
            for k in range(column + 1, i + 1):
                total -= root[i, k] * upper[column, k]
            root[i, column] = total * inverse


@njit_alloc
def information_gain(cross, even):
    """Mutual information of a state and a measurement, nats (Paul & Fan, eqs. 61, 62).

    U and S are those of `innovation_moments`; S is overwritten. NaN if S is not positive definite.
    (1/2) log(det P- / det P+) is computed as (1/2) log det(I + V^-1 U^T U V^-T), which avoids the
    determinant of a covariance and its underflow.
    """
    n, m = cross.shape
    if not cholesky(even):
        return np.nan
    scaled = np.empty(m)
    inner = np.zeros((m, m))
    for i in range(n):
        for a in range(m):
            scaled[a] = cross[i, a]
        solve_lower(even, scaled)
        for a in range(m):
            for b in range(m):
                inner[a, b] += scaled[a] * scaled[b]
    for a in range(m):
        inner[a, a] += 1.0
    if not cholesky(inner):
        return np.nan
    log_root = 0.0
    for a in range(m):
        log_root += np.log(inner[a, a])
    return log_root
