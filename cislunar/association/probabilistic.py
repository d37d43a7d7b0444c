"""Joint probabilistic data association (Bar-Shalom & Li 1995, section 6.2).

Every assignment of an exposure that gives no detection to two tracks and no track two detections
has a probability proportional to the product of its likelihood ratios. The marginal probability of
a pair is the sum over the assignments that hold it. A forward and a backward sum over subsets of
detections gives all marginals of a cluster exactly.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cislunar.association.likelihood import gate_threshold
from cislunar.association.window import (
    Association,
    Window,
    batches,
    clusters,
    decided,
    innovations,
    lone,
)

_LEAST_WEIGHT = 1e-6
"""Pairs of a smaller probability are left out."""


def joint_probabilities(window: Window, gate_probability: float) -> Association:
    """Marginal probabilities of all pairs, one exposure after the other.

    Parameters
    ----------
    window : Window
    gate_probability : float
        Probability that the gate keeps the detection of a target.

    Returns
    -------
    Association
        Weights of a track in an exposure add to one less the probability of a missed detection.

    Raises
    ------
    ConfigurationError
        If `gate_probability` does not lie between 0 and 1.
    """
    gate = gate_threshold(gate_probability, 2)
    shift, covariance = window.start()
    miss, rows = window.misses(), []
    for here in batches(window):
        nu, s, squared, ratio = innovations(window, here, shift, covariance)
        gain = ratio - miss[here]
        kept = np.flatnonzero(squared <= gate)
        track, detection = window.track[here[kept]], window.detection[here[kept]]
        weight = np.exp(gain[kept] - np.logaddexp(0.0, gain[kept]))
        alone = lone(track, detection)
        shared = np.flatnonzero(~alone)
        for own, _ in clusters(track[shared], detection[shared]):
            mine = shared[own]
            weight[mine] = marginals(track[mine], detection[mine], gain[kept[mine]])
        rows.append(_weighted(window, here[kept], nu[kept], s[kept], weight, shift, covariance))
    columns = [np.concatenate(column) for column in zip(*rows, strict=True)] if rows else [[]]
    found = decided(window, columns[0])
    if not rows:
        return found
    order = np.argsort(columns[0])
    weight, offset, noise = (column[order] for column in columns[1:])
    return found._replace(weight=weight, offset=offset, noise=noise)


def _weighted(window, pairs, nu, s, weight, shift, covariance):
    """Update tracks by weighted pairs; rows of the association that does the same: pair, weight,
    offset and noise."""
    kept = np.flatnonzero(weight > _LEAST_WEIGHT)
    # of each track the most probable pair comes first
    kept = kept[np.lexsort((-weight[kept], window.track[pairs[kept]]))]
    t, first, own = np.unique(window.track[pairs[kept]], return_index=True, return_inverse=True)
    best = kept[first]
    w, mean, second = np.zeros(t.size), np.zeros((t.size, 2)), np.zeros((t.size, 2, 2))
    np.add.at(w, own, weight[kept])
    np.add.at(mean, own, weight[kept, None] * nu[kept])
    outer = nu[kept, :, None] * nu[kept, None]
    np.add.at(second, own, weight[kept, None, None] * outer)
    effective = w[:, None, None] * s[best] - (second - mean[:, :, None] * mean[:, None])
    # the moments of the mixture, each detection with its own gain
    n = shift.shape[1]
    crossed = window.design[pairs[kept]] @ covariance[t][own]
    gain = np.linalg.solve(s[kept], crossed).swapaxes(1, 2)
    moved = (gain @ nu[kept, :, None])[..., 0]
    center, change = np.zeros((t.size, n)), np.zeros((t.size, n, n))
    np.add.at(center, own, weight[kept, None] * moved)
    told = moved[:, :, None] * moved[:, None] - gain @ crossed
    np.add.at(change, own, weight[kept, None, None] * told)
    reduced = covariance[t] + change - center[:, :, None] * center[:, None]
    shift[t] += center
    covariance[t] = 0.5 * (reduced + reduced.swapaxes(1, 2))
    innovation, noise = equivalent_direction(mean, effective, s[best], window.noise[pairs[best]])
    return pairs[best], w, innovation - nu[best], noise


def equivalent_direction(
    mean: NDArray, effective: NDArray, s: NDArray, noise: NDArray
) -> tuple[NDArray, NDArray]:
    """Innovations and variances with which an ordinary update does what a probabilistic one does.

    With innovations nu_i of covariance S and weights w_i, the probabilistic update has the gain of
    S and the mean innovation, and takes K E K^T from the covariance, where E = sum(w) S less the
    spread of the innovations. So does an update by the innovation S E^-1 sum(w nu) with the
    covariance S E^-1 S. Its noise is made diagonal by adding the moduli beside the diagonal, which
    only enlarges it.

    Parameters
    ----------
    mean : ndarray, shape (track, 2)
        Sum of the weighted innovations.
    effective, s : ndarray, shape (track, 2, 2)
        E and S.
    noise : ndarray, shape (track, 2)
        Variance of a detection, a part of S.

    Returns
    -------
    innovation, variance : ndarray, shape (track, 2)
        The variance is infinite if the spread exceeds what the detections tell, so that the
        covariance would grow.
    """
    least = 1e-6 * np.linalg.det(s)
    able = (effective[:, 0, 0] > 0.0) & (np.linalg.det(effective) > least)
    factor = np.linalg.solve(effective[able], s[able]).swapaxes(1, 2)  # both are symmetric
    extra = factor @ s[able] - s[able]
    innovation, variance = mean.copy(), np.full(noise.shape, np.inf)
    innovation[able] = (factor @ mean[able][..., None])[..., 0]
    variance[able] = noise[able] + np.diagonal(extra, axis1=1, axis2=2) + np.abs(extra[:, :1, 1])
    return innovation, variance


def marginals(track: Sequence[int], detection: Sequence[int], gain: NDArray) -> NDArray[np.float64]:
    """Marginal probabilities of the pairs of a cluster.

    Parameters
    ----------
    track, detection : sequence of int, shape (pair,)
    gain : ndarray, shape (pair,)
        Log-likelihood ratio of the pair less that of a missed detection of its track.

    Returns
    -------
    ndarray, shape (pair,)
    """
    tracks = sorted(set(map(int, track)))
    bit = {d: 1 << k for k, d in enumerate(sorted(set(map(int, detection))))}
    options: list[list[tuple[int, int, float]]] = [[] for _ in tracks]
    # One scale for each track: its largest likelihood ratio, or one for the missed detection.
    for row, (t, d) in enumerate(zip(track, detection, strict=True)):
        options[tracks.index(int(t))].append((row, bit[int(d)], float(gain[row])))
    scale = [max(0.0, *(each[2] for each in own)) for own in options]
    forward: list[dict[int, float]] = [{0: 1.0}]
    for own, top in zip(options, scale, strict=True):
        ahead: dict[int, float] = {}
        for used, value in forward[-1].items():
            ahead[used] = ahead.get(used, 0.0) + value * np.exp(-top)
            for _, mine, log_value in own:
                if not used & mine:
                    more = value * np.exp(log_value - top)
                    ahead[used | mine] = ahead.get(used | mine, 0.0) + more
        forward.append(ahead)
    backward: dict[int, float] = dict.fromkeys(forward[-1], 1.0)
    out = np.zeros(len(gain))
    for k in range(len(tracks) - 1, -1, -1):
        before = dict.fromkeys(forward[k], 0.0)
        for used, value in forward[k].items():
            total = np.exp(-scale[k]) * backward[used]
            for row, mine, log_value in options[k]:
                if not used & mine:
                    part = np.exp(log_value - scale[k]) * backward[used | mine]
                    out[row] += value * part
                    total += part
            before[used] = total
        backward = before
    return out / backward[0]
