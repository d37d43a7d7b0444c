"""Tracklets: detections of one pass of an object by one observer, and their attributable."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError

Array = NDArray[np.float64]


class Tracklet(NamedTuple):
    """Direction and rate of an object as seen by one observer (Milani et al. 2004, Icarus 168, 1).

    Attributes
    ----------
    observer : int
    detections : ndarray of int, shape (n,)
        Rows of its detections.
    time_s : float
        Weighted mean time of the detections.
    attributable : ndarray, shape (4,)
        Right ascension and declination, rad, and their rates, rad/s, at that time, in the frame of
        the detections.
    covariance : ndarray, shape (4, 4)
    chi_squared : float
        Squared residuals of the fit, in variances; 2 n - 4 degrees of freedom.
    """

    observer: int
    detections: NDArray[np.int64]
    time_s: float
    attributable: Array
    covariance: Array
    chi_squared: float


def tracklet(
    observer: int,
    detections: ArrayLike,
    time_s: ArrayLike,
    direction: ArrayLike,
    variance: ArrayLike,
) -> Tracklet:
    """Fit a uniform motion to detections of one pass.

    The motion is uniform in right ascension and declination; the curvature of a path biases it, so
    that a pass should be short, and orbits be fitted to the detections themselves.

    Parameters
    ----------
    observer : int
    detections : array_like of int, shape (n,)
        Rows of the detections, at least two.
    time_s : array_like, shape (n,)
    direction, variance : array_like, shape (n, 2)
        Right ascension and declination, rad, in a frame that does not rotate during the pass, and
        their variances, rad^2.

    Raises
    ------
    ConfigurationError
        If shapes disagree, there are fewer than two different times, or a value is not finite.
    """
    time, angles, noise = (np.asarray(each, dtype=float) for each in (time_s, direction, variance))
    rows = np.asarray(detections, dtype=np.int64)
    shapes = [each.shape for each in (rows, time, angles, noise)]
    if time.ndim != 1 or shapes != [time.shape, time.shape, (time.size, 2), (time.size, 2)]:
        raise ConfigurationError(
            f"tracklet: detections, times, directions and variances have shapes {shapes}; give "
            "(n,), (n,), (n, 2) and (n, 2)"
        )
    if np.unique(time).size < 2:
        raise ConfigurationError("tracklet: a rate needs detections at two different times")
    if not (all(np.all(np.isfinite(each)) for each in (time, angles, noise)) and noise.min() > 0.0):
        raise ConfigurationError(
            "tracklet: times, directions and variances must be finite, variances positive"
        )
    turns = angles.copy()
    turns[:, 0] = angles[0, 0] + (angles[:, 0] - angles[0, 0] + np.pi) % (2.0 * np.pi) - np.pi
    weight = 1.0 / noise
    middle = float((weight.sum(axis=1) * time).sum() / weight.sum())
    design = np.stack([np.ones(time.size), time - middle], axis=1)
    found, covariance, chi_squared = np.empty(4), np.zeros((4, 4)), 0.0
    for axis in range(2):
        normal = np.linalg.inv((weight[:, axis, None] * design).T @ design)
        fit = normal @ (design.T @ (weight[:, axis] * turns[:, axis]))
        found[axis::2] = fit
        covariance[axis::2, axis::2] = normal
        chi_squared += float((weight[:, axis] * (turns[:, axis] - design @ fit) ** 2).sum())
    found[0] %= 2.0 * np.pi
    return Tracklet(observer, rows, middle, found, covariance, chi_squared)
