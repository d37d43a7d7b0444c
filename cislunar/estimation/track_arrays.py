"""Values of the tracks of an estimator, to which tracks are added and from which they are removed.

Values are arrays or lists by track, or NamedTuples of them.
"""

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError
from cislunar.runtime import Array

Values = TypeVar("Values", NDArray, list, tuple)


def joined_tracks(first: Values, second: Values) -> Values:
    """Values of the tracks of `first`, then of those of `second`."""
    if isinstance(first, tuple):
        return type(first)(*map(joined_tracks, first, second))
    return first + second if isinstance(first, list) else np.concatenate([first, second])


def selected_tracks(values: Values, tracks: NDArray[np.int64]) -> Values:
    """Values of some of the tracks, given by indices, shape (n,)."""
    if isinstance(values, tuple):
        return type(values)(*(selected_tracks(each, tracks) for each in values))
    return [values[j] for j in tracks] if isinstance(values, list) else values[tracks]


def remaining_tracks(n_tracks: int, removed: ArrayLike) -> NDArray[np.int64]:
    """Indices of the tracks that remain; raises ConfigurationError if a track does not exist, or a
    mask is given."""
    given = np.atleast_1d(np.asarray(removed))
    targets = given.astype(np.int64)
    wrong = given.dtype == bool or np.any(targets != given)
    if wrong or np.any((targets < 0) | (targets >= n_tracks)):
        raise ConfigurationError(
            f"tracks {given.tolist()} cannot be removed: indices are from 0 to {n_tracks - 1}"
        )
    return np.delete(np.arange(n_tracks), targets)


def starting_index(index: int | None, present: int) -> int:
    """Time index from which a new track is propagated to the present; raises ConfigurationError if
    it is later."""
    if index is not None and not 0 <= index <= present:
        raise ConfigurationError(
            f"index = {index}: tracks are added from a time between 0 and the present, {present}"
        )
    return present if index is None else int(index)


def replaced_roots(root: Array, covariance: Array, tracks: ArrayLike) -> Array:
    """Lower Cholesky factors (track, n, n) in which, for some tracks, the covariance of the last m
    states is replaced by a new one (changed, m, m), without correlation with the others."""
    out, m = root.copy(), covariance.shape[-1]
    out[tracks, -m:] = 0.0
    out[tracks, -m:, -m:] = covariance_roots(covariance)
    return out


def widened_roots(root: Array, covariance: Array, tracks: NDArray[np.bool_]) -> Array:
    """Lower Cholesky factors of covariances to which others are added.

    Parameters
    ----------
    root : ndarray, shape (track, n, n)
        Lower Cholesky factors.
    covariance : ndarray, shape (track, m, m)
        Covariances that are added to those of the last m states. A factor to which nothing is added
        stays as it is.
    tracks : ndarray of bool, shape (track,)
        Tracks whose factors may change.
    """
    out, m = root.copy(), covariance.shape[-1]
    changed = tracks & np.any(covariance != 0.0, axis=(1, 2))
    whole = root[changed] @ root[changed].swapaxes(1, 2)
    whole[:, -m:, -m:] += covariance[changed]
    out[changed] = covariance_roots(whole)
    return out


def covariance_roots(covariance: Array) -> Array:
    """Lower Cholesky factors of covariances.

    They are computed from the correlations, so that rounding cannot make one indefinite.

    Parameters
    ----------
    covariance : ndarray, shape (track, n, n)
        In any units.

    Returns
    -------
    ndarray, shape (track, n, n)
        In the units of the standard deviations.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a covariance is not positive semidefinite.
    """
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    if not (np.all(variance >= 0.0) and np.all(np.isfinite(covariance))):
        raise np.linalg.LinAlgError("a covariance is not positive semidefinite")
    scale = np.sqrt(variance)
    units = scale[:, :, None] * scale[:, None]
    correlation = np.divide(covariance, units, out=np.zeros(units.shape), where=units > 0.0)
    correlation += 1e-12 * np.eye(covariance.shape[-1])
    return scale[:, :, None] * np.linalg.cholesky(correlation)
