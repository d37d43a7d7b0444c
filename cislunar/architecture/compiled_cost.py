"""Compiled sums behind the cost J for searches that evaluate it by the million.

J = |v s| / (N S d c) with v the observations, s the sum over targets of log10, N the satellites,
S their stability indices summed, d the distances and c = targets x steps.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.architecture.tables import ArchitectureTables

_E = np.e
_LOG10_E = np.log10(np.e)


@njit(cache=True)
def log_envelope(y):
    """Least concave function on y >= 0 above log10(y) for y > 0 and above 0 at y = 0.

    The paper replaces a zero argument of the logarithm with one, so a target never seen counts 0;
    the envelope is the tangent from the origin up to y = e and log10 beyond.
    """
    if y < _E:
        return y * _LOG10_E / _E
    return np.log10(y)


@njit(cache=True)
def log_sum(base, row, scale):
    """Sum over targets of log10(base + scale * row), zero arguments replaced with one.

    Products of 32 arguments replace 32 logarithms: with arguments in [2**-31, 2**31] a product
    stays within the range of float64.

    Parameters
    ----------
    base : ndarray, shape (target,)
        Observations per satellite of the other slots.
    row : ndarray of unsigned integers, shape (target,)
        Observations of the candidate.
    scale : float
        One over the candidate's satellite count.
    """
    n = base.size
    total = 0.0
    start = 0
    while start + 128 <= n:
        p0 = 1.0
        p1 = 1.0
        p2 = 1.0
        p3 = 1.0
        for i in range(start, start + 128, 4):
            a = base[i] + scale * row[i]
            b = base[i + 1] + scale * row[i + 1]
            c = base[i + 2] + scale * row[i + 2]
            d = base[i + 3] + scale * row[i + 3]
            p0 *= a if a > 0.0 else 1.0
            p1 *= b if b > 0.0 else 1.0
            p2 *= c if c > 0.0 else 1.0
            p3 *= d if d > 0.0 else 1.0
        total += np.log10(p0) + np.log10(p1) + np.log10(p2) + np.log10(p3)
        start += 128
    for i in range(start, n):
        a = base[i] + scale * row[i]
        if a > 0.0:
            total += np.log10(a)
    return total


@njit(cache=True)
def seen_per_satellite(observations, orbit, satellites, skip):
    """Observations of each target per satellite, summed over every slot but ``skip``.

    Returns
    -------
    ndarray, shape (target,)
    """
    seen = np.zeros(observations.shape[2])
    for k in range(orbit.size):
        if k == skip:
            continue
        row = observations[orbit[k], satellites[k] - 1]
        weight = 1.0 / satellites[k]
        for i in range(seen.size):
            seen[i] += weight * row[i]
    return seen


@njit(cache=True)
def scalar_sums(observed, distance, stability, orbit, satellites, skip):
    """N, S, v and d of every slot but ``skip``."""
    count, weighted, total, length = 0.0, 0.0, 0.0, 0.0
    for k in range(orbit.size):
        if k == skip:
            continue
        i, n = orbit[k], satellites[k]
        count += n
        weighted += n * stability[i]
        total += observed[i, n - 1]
        length += distance[i, n - 1]
    return count, weighted, total, length


@njit(cache=True)
def exact_cost(observations, observed, distance, stability, n_steps, orbit, satellites):
    """J of an architecture of distinct orbits."""
    n, s, v, d = scalar_sums(observed, distance, stability, orbit, satellites, -1)
    seen = seen_per_satellite(observations, orbit, satellites, -1)
    return v * abs(log_sum(seen, observations[0, 0], 0.0)) / (n * s * d * seen.size * n_steps)


def table_arrays(tables: ArchitectureTables) -> tuple:
    """Arrays the compiled search needs: observations, their sums, distance, stability, n_steps."""
    return (
        np.ascontiguousarray(tables.observations),
        tables.observations.sum(axis=2, dtype=np.float64),
        np.ascontiguousarray(tables.distance, dtype=np.float64),
        np.ascontiguousarray(tables.stability_index, dtype=np.float64),
        float(tables.n_steps),
    )


def architecture_cost(arguments: tuple, orbit: NDArray, satellites: NDArray) -> float:
    """J of one architecture from `table_arrays`; 0 with a duplicate orbit."""
    if np.unique(orbit).size < len(orbit):
        return 0.0
    return float(exact_cost(*arguments, np.asarray(orbit), np.asarray(satellites)))
