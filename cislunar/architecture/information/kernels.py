"""Compiled arithmetic on sums of 6 x 6 information matrices: log-determinants, gains, gradients.

Matrices are packed as in `cislunar.architecture.information.looks`. The first `nuisance` of the six
states are known to nobody and asked by nobody: the pivots of an elimination that begins with them
belong, after theirs, to the Schur complement, which is the information about the others alone.
Sums run in one order whatever the machine.
"""

import numpy as np
from numba import njit

from cislunar.architecture.information.looks import PACKED
from cislunar.architecture.objective import IMPROVES


@njit(cache=True, error_model="numpy")
def _half_log_det(a, nuisance):
    """Half the log-determinant of the Schur complement of a matrix (21,), which is spoilt."""
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
def combined(matrix, place, weight):
    """Identity plus a weighted sum of the matrices (place, item, 21) of some places."""
    base = np.zeros(matrix.shape[1:])
    for i in range(base.shape[0]):
        for a in range(6):
            base[i, a * (a + 3) // 2] = 1.0
    for c in range(place.size):
        own, w = matrix[place[c]], weight[c]
        for i in range(base.shape[0]):
            for e in range(PACKED):
                base[i, e] += w * own[i, e]
    return base


@njit(cache=True, error_model="numpy")
def _gain(base, values, own, nuisance, work):
    """What matrices (item, 21) add to the half log-determinants `values` of a sum."""
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
def gains(base, values, matrix, place, nuisance):
    """Gain of each of some places over a sum (item, 21) with its `values` (item,): float64."""
    found, work = np.empty(place.size), np.empty(PACKED)
    for c in range(place.size):
        found[c] = _gain(base, values, matrix[place[c]], nuisance, work)
    return found


@njit(cache=True, error_model="numpy")
def greedy_places(matrix, number, nuisance):
    """Pick places one by one, each of the largest gain, the first of those equal to rounding.

    Without nuisances gains only fall as places are added, so that a stale one bounds the present
    one and only those that may still be largest are evaluated anew. Returns places and evaluations.
    """
    n_places, n_items = matrix.shape[:2]
    everywhere = np.arange(n_places)
    base = combined(matrix, everywhere[:0], np.empty(0))
    values, work = np.zeros(n_items), np.empty(PACKED)
    gain = gains(base, values, matrix, everywhere, nuisance)
    picked, evaluations = np.empty(number, np.int64), n_places
    for step in range(number):
        fresh = np.full(n_places, step == 0)
        while True:
            best = np.argmax(gain)
            largest = gain[best]
            if fresh[best]:
                # stale ones that may equal it to rounding
                rival = -1
                for c in range(n_places):
                    if not fresh[c] and gain[c] * IMPROVES >= largest:
                        rival = c
                        break
                if rival < 0:
                    break
                best = rival
            gain[best] = _gain(base, values, matrix[best], nuisance, work)
            fresh[best] = True
            evaluations += 1
        for c in range(n_places):
            if gain[c] * IMPROVES >= largest:
                best = c
                break
        picked[step] = best
        base += matrix[best]
        item_values(base, nuisance, values)
        gain[best] = -np.inf
        if nuisance > 0:
            for c in range(n_places):
                if gain[c] > -np.inf:
                    gain[c] = np.inf  # says nothing: an earlier gain is no bound
    return picked, evaluations


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
    """Derivatives of the half log-determinants by the entries of a sum (item, 21), into `out`.

    Half the inverse, less that of the block of the nuisances; an entry off the diagonal stands for
    two of the matrix.
    """
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
    """Sum over items and entries of each place's matrices times a slope (item, 21): (place,)."""
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
