"""Operations on sets stored as bits: gains, lazy greedy, weighted sums (compiled)."""

import numpy as np

from cislunar.compiled import njit, njit_inline

_TILE = 32  # bytes of a row whose tables of partial sums fit the first-level cache

_M1 = np.uint64(0x5555555555555555)
_M2 = np.uint64(0x3333333333333333)
_M4 = np.uint64(0x0F0F0F0F0F0F0F0F)
_H1 = np.uint64(0x0101010101010101)


@njit_inline
def _ones(x):
    """Number of set bits of a word."""
    x -= (x >> np.uint64(1)) & _M1
    x = (x & _M2) + ((x >> np.uint64(2)) & _M2)
    x = (x + (x >> np.uint64(4))) & _M4
    return np.int64((x * _H1) >> np.uint64(56))


@njit(cache=True)
def add_layers(at_least, layer):
    """Add layers (layer, word), "seen by at least j", to a multiplicity (fold, word) in place.
    Layer j of both holds the elements counted at least j + 1 times; the sum saturates at the fold.
    """
    for j in range(layer.shape[0]):
        for w in range(at_least.shape[1]):
            new = layer[j, w]
            for k in range(at_least.shape[0] - 1, 0, -1):
                at_least[k, w] |= at_least[k - 1, w] & new
            at_least[0, w] |= new


@njit(cache=True)
def _open_words(at_least, reachable):
    """Words of a multiplicity (fold, word) with reachable (word,) elements below the fold."""
    return np.flatnonzero(reachable & ~at_least[-1])


@njit(cache=True)
def _gain(at_least, layer, word):
    """Increase of the sum of a multiplicity (fold, word) by layers (layer, word), in some words. A
    residual of at least j + 1 is a multiplicity below fold - j."""
    total = 0
    fold = at_least.shape[0]
    for j in range(layer.shape[0]):
        reached = at_least[fold - 1 - j]
        row = layer[j]
        for w in word:
            total += _ones(row[w] & ~reached[w])
    return total


@njit(cache=True)
def gains(at_least, layers, candidate, reachable):
    """Gain of each candidate, rows of ``layers`` (candidate, layer, word): int64. ``reachable``
    (word,) holds the elements that any candidate sees."""
    found, word = np.empty(candidate.size, dtype=np.int64), _open_words(at_least, reachable)
    for c in range(candidate.size):
        found[c] = _gain(at_least, layers[candidate[c]], word)
    return found


@njit(cache=True)
def shared_ones(mask, layers, candidate):
    """Elements of a mask (word,) in the first layer of each candidate: int64."""
    found, word = np.zeros(candidate.size, dtype=np.int64), np.flatnonzero(mask)
    for c in range(candidate.size):
        row = layers[candidate[c], 0]
        for w in word:
            found[c] += _ones(row[w] & mask[w])
    return found


@njit(cache=True)
def lazy_greedy(layers, candidate, number, fold, reachable):
    """Pick ``number`` candidates one by one, each of the largest gain; ties go to the first. Gains
    never increase as coverage grows. An outdated gain is therefore an upper bound, and only the
    largest bounds are evaluated again. Returns positions in ``candidate`` in order."""
    at_least = np.zeros((fold, layers.shape[2]), dtype=np.uint64)
    bound, word = gains(at_least, layers, candidate, reachable), _open_words(at_least, reachable)
    evaluated = np.zeros(candidate.size, dtype=np.int64)
    picked = np.empty(number, dtype=np.int64)
    for step in range(number):
        while True:
            best = np.argmax(bound)
            if evaluated[best] == step:
                break
            bound[best] = _gain(at_least, layers[candidate[best]], word)
            evaluated[best] = step
        picked[step] = best
        add_layers(at_least, layers[candidate[best]])
        word = _open_words(at_least, reachable)
        bound[best] = -1
        evaluated[best] = number
    return picked


@njit(cache=True)
def weighted_sums(layers, candidate, weight):
    """Sum of the weights (byte, 8) of the elements in all layers of each candidate: float64.

    ``layers`` (candidate, layer, byte) are the bytes of the words. One table of the 256 partial
    sums of a byte serves all candidates, so that a byte costs one addition, and one without weight
    none."""
    total = np.zeros(candidate.size)
    n_bytes = weight.shape[0]
    table, byte = np.zeros((_TILE, 256)), np.empty(_TILE, dtype=np.int64)
    for start in range(0, n_bytes, _TILE):
        size = 0
        for b in range(start, min(start + _TILE, n_bytes)):
            if not weight[b].any():
                continue
            byte[size], filled = b, 1
            for bit in range(8):
                for v in range(filled):
                    table[size, filled + v] = table[size, v] + weight[b, bit]
                filled *= 2
            size += 1
        if size == 0:
            continue
        for c in range(candidate.size):
            subtotal = 0.0
            for j in range(layers.shape[1]):
                row = layers[candidate[c], j]
                for b in range(size):
                    subtotal += table[b, row[byte[b]]]
            total[c] += subtotal
    return total


@njit(cache=True)
def times_seen(layers, candidate, n_bits):
    """Number of layers of some candidates (candidate, layer, word) that hold each bit: int64."""
    found = np.zeros(n_bits, dtype=np.int64)
    for c in candidate:
        for j in range(layers.shape[1]):
            row = layers[c, j]
            for w in range(row.size):
                rest = row[w]
                while rest != 0:
                    lowest = rest & (~rest + np.uint64(1))
                    found[64 * w + _ones(lowest - np.uint64(1))] += 1
                    rest ^= lowest
    return found
