"""J from the tables, compiled for searches with millions of evaluations.

J = |v s| / (N S d c), where v is the number of observations, s the sum over targets of log10, N the
number of satellites, S the sum of their stability indices, d the distances and c = targets x steps.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.objective import IMPROVES
from cislunar.architecture.tables import ArchitectureTables
from cislunar.compiled import njit

_E = np.e
_LOG10_E = np.log10(np.e)


class CostArrays(NamedTuple):
    """Arrays from which J is computed: counts (orbit, satellites, target) and their sum over
    targets, distances to both primaries (orbit, satellites), nondimensional, stability indices
    (orbit,), and the `scale`, targets x steps."""

    observations: NDArray[np.unsignedinteger]
    observed: NDArray[np.float64]
    distance: NDArray[np.float64]
    stability: NDArray[np.float64]
    scale: float


def cost_arrays(tables: ArchitectureTables) -> CostArrays:
    """Arrays of the compiled functions."""
    return CostArrays(
        np.ascontiguousarray(tables.observations),
        tables.observations.sum(axis=2, dtype=np.float64),
        np.ascontiguousarray(tables.distance, dtype=np.float64),
        np.ascontiguousarray(tables.stability_index, dtype=np.float64),
        float(tables.n_targets * tables.n_steps),
    )


@njit(cache=True)
def cost_factors(count, stability, observed, distance, logs, scale, unique):
    """lambda_1 .. lambda_6 from N, S, v, d, s, c and whether all orbits differ (1 or 0)
    (Paul & Fan, eqs. 54-58)."""
    return (1.0 / count, 1.0 / stability, observed / scale, logs / scale, scale / distance, unique)


@njit(cache=True)
def cost(count, stability, observed, distance, logs, scale, unique):
    """J, the size of the product of the factors (Paul & Fan, eq. 53)."""
    one, two, three, four, five, six = cost_factors(
        count, stability, observed, distance, logs, scale, unique
    )
    return abs(one * two * three * four * five * six)


@njit(cache=True)
def log_envelope(y):
    """Least concave function on y >= 0 above log10(y) for y > 0 and above 0 at y = 0. The paper
    replaces a zero argument of the logarithm by one, so that a target that is never seen
    contributes 0. The envelope is the tangent from the origin up to y = e, and log10 beyond."""
    if y < _E:
        return y * _LOG10_E / _E
    return np.log10(y)


@njit(cache=True)
def log_sum(base, row, scale):
    """Sum over targets of log10(base + scale * row), where zero arguments are replaced by one. Both
    arrays have shape (target,). Products of 32 arguments replace 32 logarithms: with arguments in
    [2**-31, 2**31] a product stays within the range of float64."""
    n = base.size
    argument = np.empty(128)
    total = 0.0
    start = 0
    while start + 128 <= n:
        some, counts = base[start : start + 128], row[start : start + 128]
        for i in range(128):  # a loop of its own, since the compiler vectorizes it
            a = some[i] + scale * counts[i]
            argument[i] = a if a > 0.0 else 1.0
        p0 = 1.0
        p1 = 1.0
        p2 = 1.0
        p3 = 1.0
        for i in range(0, 128, 4):
            p0 *= argument[i]
            p1 *= argument[i + 1]
            p2 *= argument[i + 2]
            p3 *= argument[i + 3]
        total += np.log10(p0) + np.log10(p1) + np.log10(p2) + np.log10(p3)
        start += 128
    for i in range(start, n):
        a = base[i] + scale * row[i]
        if a > 0.0:
            total += np.log10(a)
    return total


@njit(cache=True)
def seen_per_satellite(observations, orbit, satellites, skip):
    """Observations per satellite, shape (target,), summed over every slot except ``skip``."""
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
def _scalar_sums(arrays, orbit, satellites, skip):
    """N, S, v and d, summed over every slot except ``skip``."""
    count, stability, observed, distance = 0.0, 0.0, 0.0, 0.0
    for k in range(orbit.size):
        if k == skip:
            continue
        i, n = orbit[k], satellites[k]
        count += n
        stability += n * arrays.stability[i]
        observed += arrays.observed[i, n - 1]
        distance += arrays.distance[i, n - 1]
    return count, stability, observed, distance


@njit(cache=True)
def _sums(arrays, orbit, satellites):
    """Arguments of `cost` for an architecture."""
    count, stability, observed, distance = _scalar_sums(arrays, orbit, satellites, -1)
    unique = 1.0
    for i in range(orbit.size):
        for j in range(i):
            if orbit[i] == orbit[j]:
                unique = 0.0
    seen = seen_per_satellite(arrays.observations, orbit, satellites, -1)
    logs = log_sum(seen, arrays.observations[0, 0], 0.0)
    return count, stability, observed, distance, logs, arrays.scale, unique


@njit(cache=True)
def architecture_factors(arrays, orbit, satellites):
    """lambda_1 .. lambda_6 of an architecture."""
    return cost_factors(*_sums(arrays, orbit, satellites))


@njit(cache=True)
def architecture_cost(arrays, orbit, satellites):
    """J of an architecture."""
    return cost(*_sums(arrays, orbit, satellites))


@njit(cache=True)
def best_replacement(arrays, orbit, satellites, slot, lowest, highest, best):
    """Best (orbit, count, J, exact evaluations) of one slot with the others fixed; orbit -1 if
    none. A candidate is evaluated exactly only if a bound permits it to be best: the sum of log10
    over the targets is at most their number times the concave envelope of log10 at the mean
    (Jensen)."""
    n_orbits, _, n_targets = arrays.observations.shape
    base = seen_per_satellite(arrays.observations, orbit, satellites, slot)
    count, stability, observed, distance = _scalar_sums(arrays, orbit, satellites, slot)
    base_sum = base.sum()
    largest = highest
    free = np.ones(n_orbits, np.bool_)  # a duplicate orbit makes J zero
    for k in range(orbit.size):
        if k != slot:
            largest = max(largest, satellites[k])
            free[orbit[k]] = False
    # with n satellites an argument between 0 and 1 is at least 1/n: the log-sum may be negative
    negative = n_targets * np.log10(largest)
    width = highest - lowest + 1
    bound = np.zeros(n_orbits * width)
    for i in range(n_orbits):
        if not free[i]:
            continue
        for n in range(lowest, highest + 1):
            mean = (base_sum + arrays.observed[i, n - 1] / n) / n_targets
            bound[i * width + n - lowest] = cost(
                count + n,
                stability + n * arrays.stability[i],
                observed + arrays.observed[i, n - 1],
                distance + arrays.distance[i, n - 1],
                max(n_targets * log_envelope(mean), negative),
                arrays.scale,
                1.0,
            )
    best_orbit, best_count, evaluations = -1, 0, 0
    for position in np.argsort(-bound, kind="mergesort"):  # stable: ties by orbit and count
        if bound[position] <= best * IMPROVES:
            break
        i = position // width
        n = lowest + position % width
        value = cost(
            count + n,
            stability + n * arrays.stability[i],
            observed + arrays.observed[i, n - 1],
            distance + arrays.distance[i, n - 1],
            log_sum(base, arrays.observations[i, n - 1], 1.0 / n),
            arrays.scale,
            1.0,
        )
        evaluations += 1
        if value > best * IMPROVES:
            best_orbit, best_count, best = i, n, value
    return best_orbit, best_count, best, evaluations
