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
    association,
    clusters,
    exposure_pairs,
    innovations,
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
    """
    gate = gate_threshold(gate_probability, 2)
    shift, covariance = window.start()
    rows = []
    for here in exposure_pairs(window):
        nu, s, squared, ratio = innovations(window, here, shift, covariance)
        gain = ratio - window.miss(here)
        kept = np.flatnonzero(squared <= gate)
        track, detection = window.track[here[kept]], window.detection[here[kept]]
        for own, tracks in clusters(track, detection):
            pairs = kept[own]
            weight = marginals(track[own], detection[own], gain[pairs])
            for t in tracks:
                mine = (track[own] == t) & (weight > _LEAST_WEIGHT)
                if not mine.any():
                    continue
                at, w = pairs[mine], weight[mine]
                pair = here[at]
                rows += [
                    (int(window.exposure[p]), t, int(window.detection[p]), float(each))
                    for p, each in zip(pair, w, strict=True)
                ]
                shift[t], covariance[t] = _combined(
                    nu[at], s[at], window.design[pair], w, shift[t], covariance[t]
                )
    return association(rows)


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


def _combined(nu, s, design, weight, shift, covariance):
    """Shift and covariance of a track after the update by weighted innovations."""
    mean = weight @ nu
    gain = np.linalg.solve(s[0], design[0] @ covariance).T
    scatter = np.einsum("p,pi,pj->ij", weight, nu, nu) - np.outer(mean, mean)
    reduced = covariance - gain @ (weight.sum() * s[0] - scatter) @ gain.T
    return shift + gain @ mean, 0.5 * (reduced + reduced.T)
