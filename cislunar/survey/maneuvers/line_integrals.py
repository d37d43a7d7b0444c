"""Integrals of normal densities along straight lines.

Two orbits differ by z at a time and by z + rate t at a time t after it. With the covariance P of
the difference, and impulses whose components are normal with the variance s^2,

    I = int N(z + rate t; 0, S) dt,   S = P + diag(0, s^2 1),   |t| <= width / 2.               (1)

With a = rate' S^-1 rate, b = rate' S^-1 z and c = z' S^-1 z, the exponent is quadratic in t. Thus
ln I is that of the mass of a normal distribution of the time within the interval, and constants:

    ln I = -(c - b^2 / a) / 2 - ln |2 pi S| / 2 + ln(2 pi / a) / 2 + ln mass.                   (2)
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from cislunar.compiled import njit
from cislunar.estimation.triangular import cholesky, solve_lower
from cislunar.runtime import Array

_WIDE, _MASS = 1e-3, 1e-9
"""Width of an interval in standard deviations, and probability of it, below which its moments are
taken to be uniform, or at its end."""


@njit(cache=True, error_model="numpy")
def _forms(z, rate, covariance, scales, out):
    """a, b and c of equation (2) and ln |S| of all scales and times into `out`, shape
    (4, scale, time); NaN where S is singular in double precision."""
    root, one, other = np.empty((6, 6)), np.empty(6), np.empty(6)
    for k in range(scales.size):
        for n in range(z.shape[0]):
            for i in range(6):
                one[i], other[i] = z[n, i], rate[n, i]
                for j in range(i + 1):
                    root[i, j] = covariance[n, i, j]
                if i >= 3:
                    root[i, i] += scales[k] * scales[k]
            if not cholesky(root):
                out[:, k, n] = np.nan
                continue
            solve_lower(root, one)
            solve_lower(root, other)
            a = b = c = log_det = 0.0
            for i in range(6):
                a += other[i] * other[i]
                b += other[i] * one[i]
                c += one[i] * one[i]
                log_det += 2.0 * np.log(root[i, i])
            out[0, k, n], out[1, k, n], out[2, k, n], out[3, k, n] = a, b, c, log_det


def log_line_integrals(
    z: Array, rate: Array, covariance: Array, scales: Array, width: float
) -> Array:
    """Logarithms of the integrals of equation (1).

    Parameters
    ----------
    z, rate : ndarray, shape (n, 6)
        Differences of states at the middles of the intervals, and their derivatives, of which the
        last three components are zero; nondimensional.
    covariance : ndarray, shape (n, 6, 6)
        P of equation (1).
    scales : ndarray, shape (scale,)
        s of equation (1).
    width : float
        Of the intervals.

    Returns
    -------
    ndarray, shape (scale, n)
        Minus infinity if a covariance is singular in double precision.
    """
    forms = np.empty((4, scales.size, len(z)))
    _forms(z, rate, covariance, scales, forms)
    if not np.all(np.isfinite(forms)):
        return np.full(forms.shape[1:], -np.inf)
    return _log_mass(*forms, width)[0]


def _log_mass(a: Array, b: Array, c: Array, log_det: Array, width: float) -> tuple[Array, ...]:
    """Equation (2); limits of the interval in standard deviations from the mean of the time, and
    whether these are mirrored, so that the mass is a difference in the tail where it is accurate.
    """
    closest, root = -b / a, np.sqrt(a)
    low, high = ((side * 0.5 * width - closest) * root for side in (-1.0, 1.0))
    flip = low > 0.0
    low, high = np.where(flip, -high, low), np.where(flip, -low, high)
    inside = log_ndtr(high) + np.log1p(-np.exp(log_ndtr(low) - log_ndtr(high)))
    log_2pi = np.log(2.0 * np.pi)
    constant = -0.5 * (log_det + 6.0 * log_2pi) + 0.5 * (log_2pi - np.log(a))
    return constant - 0.5 * (c - b * b / a) + inside, low, high, flip


def line_moments(
    z: Array, rate: Array, covariance: Array, mapped: Array, scale: float, width: float
) -> tuple[Array, ...]:
    """Integrals of one scale, and the moments of the distribution that each of them is the mass of.

    Parameters
    ----------
    z, rate, covariance, width
        See `log_line_integrals`.
    mapped : ndarray, shape (n, 6, 6)
        Covariances of z with the state of the later orbit at its epoch.
    scale : float
        Nondimensional.

    Returns
    -------
    log_integral : ndarray, shape (n,)
    shift, variance : ndarray, shape (n,)
        Mean and variance of the time after the middle of the interval.
    change, change_covariance : ndarray, shapes (n, 3) and (n, 3, 3)
        Change of velocity.
    correction, covariance_change : ndarray, shapes (n, 6) and (n, 6, 6)
        Of the state of the later orbit at its epoch.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a covariance is singular.
    """
    s = covariance.copy()
    s[:, range(3, 6), range(3, 6)] += scale**2
    # one factorization for z, its rate, the inverse and the mapped covariance
    every = np.broadcast_to(np.eye(6), s.shape)
    solved = np.linalg.solve(
        s, np.concatenate([z[..., None], rate[..., None], every, mapped], axis=2)
    )
    c, b, a = (
        np.einsum("ni,ni->n", one, solved[:, :, k]) for one, k in ((z, 0), (z, 1), (rate, 1))
    )
    log_weight, low, high, flip = _log_mass(a, b, c, np.linalg.slogdet(s)[1], width)
    closest, root = -b / a, np.sqrt(a)
    shift, variance = _truncated(low, high, flip, closest, root, width)
    there = solved[:, :, 0] + shift[:, None] * solved[:, :, 1]
    gain = scale**2 * solved[:, :, 2:8]
    along = scale**2 * solved[:, 3:, 1]
    change_spread = scale**2 * (np.eye(3) - gain[:, 3:, 3:])
    change_spread += variance[:, None, None] * along[:, :, None] * along[:, None]
    # P_b is of the epoch, z of the time: cov(x_b, z) is the transposed product
    cross = mapped.swapaxes(1, 2)
    correction = -np.einsum("nij,nj->ni", cross, there)
    drift = np.einsum("nij,nj->ni", cross, solved[:, :, 1])
    reduced = variance[:, None, None] * drift[:, :, None] * drift[:, None]
    reduced -= cross @ solved[:, :, 8:]
    return log_weight, shift, variance, scale**2 * there[:, 3:], change_spread, correction, reduced


def _truncated(
    low: Array, high: Array, flip: NDArray[np.bool_], closest: Array, root: Array, width: float
) -> tuple[Array, Array]:
    """Mean and variance of normal distributions of the mean `closest` and the standard deviation
    1 / `root` within +- width / 2; limits are standardized, and mirrored where `flip`."""
    mass = ndtr(high) - ndtr(low)
    usual = (high - low > _WIDE) & (mass > _MASS)
    mass = np.where(usual, mass, 1.0)
    first, last = (np.exp(-0.5 * each**2) / np.sqrt(2.0 * np.pi) for each in (low, high))
    offset = (first - last) / mass
    spread = 1.0 + (low * first - high * last) / mass - offset**2
    mean = closest + np.where(flip, -offset, offset) / root
    nearest = np.clip(closest, -0.5 * width, 0.5 * width)
    nearest = np.where(high - low > _WIDE, nearest, 0.0)
    return np.where(usual, mean, nearest), np.where(usual, spread / root**2, width**2 / 12.0)


def moments(share: Array, mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Mean and covariance of a mixture."""
    whole = share @ mean
    off = mean - whole
    return whole, np.einsum("n,nij->ij", share, covariance) + (share[:, None] * off).T @ off
