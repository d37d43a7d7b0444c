"""Global nearest neighbor: the most likely assignment of each exposure by itself."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from cislunar.association.likelihood import gate_threshold
from cislunar.association.window import (
    Association,
    Window,
    batches,
    clusters,
    decided,
    innovations,
    lone,
    updated,
)


def nearest_neighbor(window: Window, gate_probability: float) -> Association:
    """Assign detections to tracks, one exposure after the other.

    Exposures without a track in common are worked through together.

    Parameters
    ----------
    window : Window
    gate_probability : float
        Probability that the gate keeps the detection of a target.

    Returns
    -------
    Association
        At most one detection of an exposure for a track, and one track for a detection, such that
        the sum of the log-likelihood ratios and those of missed detections is largest.

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
        kept = np.flatnonzero((squared <= gate) & (gain > 0.0))
        track, detection = window.track[here[kept]], window.detection[here[kept]]
        alone = lone(track, detection)
        taken = [kept[alone]]
        shared = kept[~alone]
        for own, _ in clusters(track[~alone], detection[~alone]):
            at = shared[own]
            pairs = here[at]
            taken.append(at[best_pairs(window.track[pairs], window.detection[pairs], gain[at])])
        at = np.concatenate(taken)
        pair = here[at]
        t = window.track[pair]
        given = nu[at], s[at], window.design[pair], shift[t], covariance[t]
        shift[t], covariance[t] = updated(*given)
        rows.append(pair)
    return decided(window, np.concatenate([[], *rows]))


def best_pairs(track: np.ndarray, detection: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Assignment of largest gain.

    Parameters
    ----------
    track, detection : ndarray of int, shape (pair,)
        Pairs, each once.
    gain : ndarray, shape (pair,)
        Not negative; a pair without gain is never taken.

    Returns
    -------
    ndarray of int, shape (n,)
        Rows of the pairs of the assignment.
    """
    tracks, t = np.unique(track, return_inverse=True)
    detections, d = np.unique(detection, return_inverse=True)
    value, row = np.zeros((2, tracks.size, detections.size))
    value[t, d], row[t, d] = gain, np.arange(gain.size)
    chosen = linear_sum_assignment(value, maximize=True)
    return row[chosen][value[chosen] > 0.0].astype(np.int64)
