"""Detections of consecutive exposures beside the tracks that predict them.

Within a window a track is linear: its state at the begin of the window deviates from the estimate
by x with covariance P, and the direction in exposure k by H_k x. Every method works on this model,
so that it sees the innovation after the detections it has accepted before.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.association.likelihood import gaussian_log_likelihood
from cislunar.compiled import njit
from cislunar.runtime import Array, Indices


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

    def misses(self) -> Array:
        """Log-probability of every pair that its exposure misses its track, shape (pair,)."""
        n_tracks = self.covariance.shape[0]
        keys = self.seen @ np.array([n_tracks, 1])
        order = np.argsort(keys)
        rows = np.searchsorted(keys, self.exposure * n_tracks + self.track, sorter=order)
        return self.log_miss[order[rows]]


class Association(NamedTuple):
    """Detections that tracks take, with weights.

    Attributes
    ----------
    exposure, track, detection : ndarray of int, shape (row,)
        A track has at most one row of an exposure. Of several detections with weights it is the
        most probable one.
    weight : ndarray, shape (row,)
        Probability that one of the track's detections is of it; 1 where a method decides.
    offset : ndarray, shape (row, 2)
        Direction by which the track is to be updated less that of the detection, rad.
    noise : ndarray, shape (row, 2)
        Variance of that direction, rad^2; infinite if the track is not to be updated.
    """

    exposure: Indices
    track: Indices
    detection: Indices
    weight: Array
    offset: Array
    noise: Array


def decided(window: Window, pairs: Sequence[int]) -> Association:
    """The association that takes these pairs of a window as they are."""
    rows = np.sort(np.asarray(pairs, dtype=np.int64))
    return Association(
        window.exposure[rows],
        window.track[rows],
        window.detection[rows],
        np.ones(rows.size),
        np.zeros((rows.size, 2)),
        window.noise[rows],
    )


@njit(cache=True)
def _mark_batches(exposure, track, last, out):
    """Number of the batch of each pair; `last` (track,) begins with -1."""
    batch, begin = 0, 0
    while begin < exposure.size:
        end = begin
        while end < exposure.size and exposure[end] == exposure[begin]:
            if last[track[end]] == batch:
                batch += 1
            end += 1
        for row in range(begin, end):
            last[track[row]] = out[row] = batch
        begin = end


def batches(window: Window) -> list[Indices]:
    """Rows of the pairs of consecutive exposures that have no track in common."""
    number = np.empty(window.exposure.size, dtype=np.int64)
    last = np.full(window.covariance.shape[0], -1)
    _mark_batches(window.exposure, window.track, last, number)
    ends = np.flatnonzero(np.diff(number)) + 1
    return [rows for rows in np.split(np.arange(number.size), ends) if rows.size]


def lone(track: Indices, detection: Indices) -> NDArray[np.bool_]:
    """Which pairs share neither track nor detection with another, ndarray of bool, (pair,)."""
    found = np.ones(track.size, dtype=bool)
    for column in (track, detection):
        _, inverse, counts = np.unique(column, return_inverse=True, return_counts=True)
        found &= counts[inverse] == 1
    return found


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
    """Shifts (..., n) and covariances (..., n, n) of tracks after Kalman updates by innovations."""
    gain = np.linalg.solve(s, design @ covariance).swapaxes(-1, -2)
    reduced = covariance - gain @ s @ gain.swapaxes(-1, -2)
    moved = shift + (gain @ nu[..., None])[..., 0]
    return moved, 0.5 * (reduced + reduced.swapaxes(-1, -2))


def clusters(track: Indices, detection: Indices) -> list[tuple[list[int], list[int]]]:
    """Rows of pairs that share tracks or detections, by the first row; and their tracks."""
    members: dict[int, list[int]] = {}
    keys = (np.ascontiguousarray(each, dtype=np.int64) for each in (track, detection))
    for row, first in enumerate(_first_rows(*keys).tolist()):
        members.setdefault(first, []).append(row)
    of = track.tolist()
    return [(rows, sorted({of[row] for row in rows})) for rows in members.values()]


@njit(cache=True, error_model="numpy")
def _first_rows(track, detection):
    """First row of the cluster of each row."""
    home = np.arange(track.size)
    for keys in (track, detection):
        order = np.argsort(keys)
        for k in range(1, order.size):
            if keys[order[k]] == keys[order[k - 1]]:
                here, there = _root(home, order[k]), _root(home, order[k - 1])
                home[max(here, there)] = min(here, there)
    for row in range(track.size):
        home[row] = _root(home, row)
    return home


@njit(cache=True, error_model="numpy")
def _root(home, row):
    while home[row] != row:
        home[row] = row = home[home[row]]
    return row
