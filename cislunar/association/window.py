"""Detections of consecutive exposures beside the tracks that predict them.

Within a window a track is linear: its state at the begin of the window deviates from the estimate
by x with covariance P, and the direction in exposure k by H_k x. Every method works on this model,
so that it sees the innovation after the detections it has accepted before.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.association.likelihood import gaussian_log_likelihood

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Window(NamedTuple):
    """Candidate pairs of tracks and detections, ordered by exposure.

    A detection is any integer that identifies it; it belongs to one exposure.

    Attributes
    ----------
    covariance : ndarray, shape (track, n, n)
        Of the tracks' states at the begin of the window.
    exposure, track, detection : ndarray of int, shape (pair,)
        A pair: the detection might be of the track. Pairs of one exposure are consecutive.
    residual : ndarray, shape (pair, 2)
        Measured less predicted direction, rad.
    design : ndarray, shape (pair, 2, n)
        Derivative of the direction by the track's state at the begin of the window.
    noise : ndarray, shape (pair, 2)
        Variance of the detection's direction, rad^2.
    log_weight : ndarray, shape (pair,)
        Log-likelihood ratio of `cislunar.association.likelihood` without the direction: detection
        probability, magnitude, false alarms.
    seen : ndarray of int, shape (chance, 2)
        Exposure and track of every chance that a track had to be detected.
    log_miss : ndarray, shape (chance,)
        Logarithm of the probability that it was not, ln(1 - P_D P_G).
    """

    covariance: Array
    exposure: Indices
    track: Indices
    detection: Indices
    residual: Array
    design: Array
    noise: Array
    log_weight: Array
    seen: Indices
    log_miss: Array

    def start(self) -> tuple[Array, Array]:
        """Shifts (track, n) and covariances (track, n, n) before the first exposure."""
        return np.zeros(self.covariance.shape[:2]), self.covariance.copy()

    def miss(self, pairs: Indices) -> Array:
        """Log-probability that the tracks of pairs of one exposure were missed, shape (pair,)."""
        here = self.seen[:, 0] == self.exposure[pairs[0]]
        value = dict(zip(self.seen[here, 1].tolist(), self.log_miss[here].tolist(), strict=True))
        return np.array([value[t] for t in self.track[pairs].tolist()])


class Association(NamedTuple):
    """Detections that tracks take, with weights.

    Attributes
    ----------
    exposure, track, detection : ndarray of int, shape (row,)
    weight : ndarray, shape (row,)
        Probability of the pair; 1 where a method decides.
    """

    exposure: Indices
    track: Indices
    detection: Indices
    weight: Array


def association(rows: list[tuple[int, int, int, float]]) -> Association:
    """Rows as arrays, in the order of exposure, track and detection."""
    ordered = sorted(rows)
    exposure, track, detection = (
        np.array([row[i] for row in ordered], dtype=np.int64) for i in range(3)
    )
    return Association(exposure, track, detection, np.array([row[3] for row in ordered]))


def innovation(
    residual: Array, design: Array, noise: Array, shift: Array, covariance: Array
) -> tuple[Array, Array]:
    """Innovation (2,) and its covariance (2, 2) of a pair after a shift of the track's state."""
    return residual - design @ shift, design @ covariance @ design.T + np.diag(noise)


def exposure_pairs(window: Window) -> list[Indices]:
    """Rows of the pairs of each exposure that has some."""
    ends = np.flatnonzero(np.diff(window.exposure)) + 1
    return [rows for rows in np.split(np.arange(window.exposure.size), ends) if rows.size]


def innovations(
    window: Window, pairs: Indices, shift: Array, covariance: Array
) -> tuple[Array, Array, Array, Array]:
    """Innovations, covariances, squared distances and log-likelihood ratios of pairs."""
    design, track = window.design[pairs], window.track[pairs]
    nu = window.residual[pairs] - np.einsum("pij,pj->pi", design, shift[track])
    s = design @ covariance[track] @ design.swapaxes(1, 2)
    s[:, [0, 1], [0, 1]] += window.noise[pairs]
    squared, log_density = gaussian_log_likelihood(nu, s)
    return nu, s, squared, log_density + window.log_weight[pairs]


def updated(
    nu: Array, s: Array, design: Array, shift: Array, covariance: Array
) -> tuple[Array, Array]:
    """Shift and covariance of a track after the Kalman update by an innovation."""
    gain = np.linalg.solve(s, design @ covariance).T
    reduced = covariance - gain @ s @ gain.T
    return shift + gain @ nu, 0.5 * (reduced + reduced.T)


def clusters(track: Indices, detection: Indices) -> list[tuple[list[int], list[int]]]:
    """Rows of pairs that share tracks or detections, by the first row; and their tracks."""
    owner: dict[tuple[str, int], int] = {}
    members: dict[int, list[int]] = {}
    for row, (t, d) in enumerate(zip(track.tolist(), detection.tolist(), strict=True)):
        found = sorted({owner[key] for key in (("t", t), ("d", d)) if key in owner})
        home = found[0] if found else row
        members.setdefault(home, []).append(row)
        for other in found[1:]:
            members[home] += members.pop(other)
            for key, value in owner.items():
                if value == other:
                    owner[key] = home
        owner["t", t] = owner["d", d] = home
    return [
        (sorted(rows), sorted({int(track[row]) for row in rows}))
        for _, rows in sorted(members.items())
    ]
