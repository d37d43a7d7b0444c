"""Global nearest neighbor: the most likely assignment of each exposure by itself."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from cislunar.association.likelihood import gate_threshold
from cislunar.association.window import (
    Association,
    Window,
    association,
    clusters,
    exposure_pairs,
    innovations,
    updated,
)


def nearest_neighbor(window: Window, gate_probability: float) -> Association:
    """Assign detections to tracks, one exposure after the other.

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
    """
    gate = gate_threshold(gate_probability, 2)
    shift, covariance = window.start()
    rows = []
    for rows_here in exposure_pairs(window):
        nu, s, squared, ratio = innovations(window, rows_here, shift, covariance)
        gain = ratio - window.miss(rows_here)
        kept = np.flatnonzero((squared <= gate) & (gain > 0.0))
        track, detection = window.track[rows_here[kept]], window.detection[rows_here[kept]]
        for own, _ in clusters(track, detection):
            for row in _assigned(track[own], detection[own], gain[kept[own]]):
                at = kept[own[row]]
                pair = rows_here[at]
                t = int(window.track[pair])
                rows.append((int(window.exposure[pair]), t, int(window.detection[pair]), 1.0))
                given = nu[at], s[at], window.design[pair], shift[t], covariance[t]
                shift[t], covariance[t] = updated(*given)
    return association(rows)


def _assigned(track: np.ndarray, detection: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Rows of the best assignment of a cluster; a pair without gain is never taken."""
    tracks, t = np.unique(track, return_inverse=True)
    detections, d = np.unique(detection, return_inverse=True)
    value, row = np.zeros((2, tracks.size, detections.size))
    value[t, d], row[t, d] = gain, np.arange(gain.size)
    chosen = linear_sum_assignment(value, maximize=True)
    return row[chosen][value[chosen] > 0.0].astype(np.int64)
