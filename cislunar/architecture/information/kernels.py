"""Sums of 6 x 6 information matrices: log-determinants, gains and gradients (compiled).

Matrices are packed as in `cislunar.architecture.information.observation_kernels`. The first
`nuisance` of the six states have to be estimated but do not count. In an elimination that starts
with them, the later pivots belong to the Schur complement, which is the information about the other
states alone. Sums run in one order on every machine.
"""

import numpy as np

from cislunar.architecture.information.observation_kernels import PACKED
from cislunar.architecture.objective import IMPROVES
from cislunar.compiled import njit


@njit(cache=True, error_model="numpy")
def _half_log_det(a, nuisance):
    """Half the log-determinant of the Schur complement of a matrix (21,), which is overwritten."""
    product = 1.0
    for j in range(6):
        start = j * (j + 1) // 2
        pivot = a[start + j]
        if j >= nuisance:
            product *= pivot
        inverse = 1.0 / pivot
        for i in range(j + 1, 6):
            row = i * (i + 1) // 2
            factor = a[row + j] * inverse
            for k in range(j + 1, i + 1):
                a[row + k] -= factor * a[k * (k + 1) // 2 + j]
    return 0.5 * np.log(product)


@njit(cache=True, error_model="numpy")
def item_values(base, nuisance, out):
    """Half log-determinants of all items of a sum (item, 21), into `out` (item,)."""
    work = np.empty(PACKED)
    for i in range(out.size):
        work[:] = base[i]
        out[i] = _half_log_det(work, nuisance)


@njit(cache=True)
def combined(matrix, slot, weight):
    """Identity plus a weighted sum of the matrices (slot, item, 21) of some orbit slots."""
    base = np.zeros(matrix.shape[1:])
    for i in range(base.shape[0]):
        for a in range(6):
            base[i, a * (a + 3) // 2] = 1.0
    for c in range(slot.size):
        own, w = matrix[slot[c]], weight[c]
        for i in range(base.shape[0]):
            for e in range(PACKED):
                base[i, e] += w * own[i, e]
    return base


@njit(cache=True, error_model="numpy")
def _gain(base, values, own, nuisance, work):
    """Increase of the half log-determinants `values` of a sum by matrices (item, 21)."""
    total = 0.0
    for i in range(values.size):
        trace = 0.0
        for a in range(6):
            trace += own[i, a * (a + 3) // 2]
        if trace == 0.0:
            continue
        for e in range(PACKED):
            work[e] = base[i, e] + own[i, e]
        total += _half_log_det(work, nuisance) - values[i]
    return total


@njit(cache=True, error_model="numpy")
def gains(base, values, matrix, slot, nuisance):
    """Gain of each of some orbit slots over a sum (item, 21) with its `values` (item,): float64."""
    found, work = np.empty(slot.size), np.empty(PACKED)
    for c in range(slot.size):
        found[c] = _gain(base, values, matrix[slot[c]], nuisance, work)
    return found


@njit(cache=True, error_model="numpy")
def greedy_orbit_slots(matrix, number, nuisance):
    """Pick orbit slots one by one, each of the largest gain; ties to rounding go to the first.
    Without nuisance states, gains never increase as orbit slots are added. An outdated gain is
    therefore an upper bound, and only those that may be largest are evaluated again."""
    n_slots, n_items = matrix.shape[:2]
    everywhere = np.arange(n_slots)
    base = combined(matrix, everywhere[:0], np.empty(0))
    values, work = np.zeros(n_items), np.empty(PACKED)
    gain = gains(base, values, matrix, everywhere, nuisance)
    picked = np.empty(number, np.int64)
    for step in range(number):
        fresh = np.full(n_slots, step == 0)
        while True:
            best = np.argmax(gain)
            largest = gain[best]
            if fresh[best]:
                # outdated gains that may equal it to rounding
                rival = -1
                for c in range(n_slots):
                    if not fresh[c] and gain[c] * IMPROVES >= largest:
                        rival = c
                        break
                if rival < 0:
                    break
                best = rival
            gain[best] = _gain(base, values, matrix[best], nuisance, work)
            fresh[best] = True
        for c in range(n_slots):
            if gain[c] * IMPROVES >= largest:
                best = c
                break
        picked[step] = best
        base += matrix[best]
        item_values(base, nuisance, values)
        gain[best] = -np.inf
        if nuisance > 0:
            for c in range(n_slots):
                if gain[c] > -np.inf:
                    gain[c] = np.inf  # an earlier gain is no bound here
    return picked


@njit(cache=True, error_model="numpy")
def _inverse(a, n, out):
    """Lower triangle of the inverse of the first n rows and columns of a packed matrix."""
    root = np.zeros((6, 6))
    for i in range(n):
        for j in range(i + 1):
            total = a[i * (i + 1) // 2 + j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            root[i, j] = np.sqrt(total) if i == j else total / root[j, j]
    back = np.zeros((6, 6))
    for j in range(n):
        back[j, j] = 1.0 / root[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= root[i, k] * back[k, j]
            back[i, j] = total / root[i, i]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += back[k, i] * back[k, j]
            out[i, j] = total


@njit(cache=True, error_model="numpy")
def slopes(base, nuisance, out):
    """Derivatives of the half log-determinants by the entries of a sum (item, 21), into `out`. Half
    the inverse, minus that of the block of the nuisance states; an off-diagonal entry represents
    two entries of the matrix."""
    whole, block = np.zeros((6, 6)), np.zeros((6, 6))
    for i in range(base.shape[0]):
        _inverse(base[i], 6, whole)
        if nuisance > 0:
            _inverse(base[i], nuisance, block)
        at = 0
        for a in range(6):
            for b in range(a + 1):
                out[i, at] = (0.5 if a == b else 1.0) * (whole[a, b] - block[a, b])
                at += 1


@njit(cache=True)
def along(matrix, slope):
    """Sum over items and entries of each slot's matrices times a slope (item, 21): (slot,)."""
    found = np.empty(matrix.shape[0])
    for c in range(found.size):
        total = 0.0
        own = matrix[c]
        for i in range(slope.shape[0]):
            part = 0.0
            for e in range(PACKED):
                part += own[i, e] * slope[i, e]
            total += part
        found[c] = total
    return found
