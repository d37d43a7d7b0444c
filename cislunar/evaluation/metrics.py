"""How well the targets are tracked (Paul & Fan, section 5.2).

Components are ordered attitude error (GRP), angular velocity (rad/s), position, velocity
(nondimensional), three each, as in the error state of the filter.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

TRACKED, NEVER_OBSERVED, DIVERGED = range(3)
STATUS_NAMES = ("tracked", "never_observed", "diverged")

ROTATION, TRANSLATION = slice(0, 6), slice(6, 12)

PARTS = ("attitude", "angular_velocity", "position", "velocity")
"""Parts of the state, three components each."""

BOUND_SIGMAS = 3.0
"""Half-width of the bounds, standard deviations."""

DIVERGED_COVERAGE = 0.5
"""Least share of the final hours within the bounds of a target that is tracked."""

FINAL_HOURS = 4.0
"""Hours at the end of a run that decide whether a target is tracked."""


class TrackingMetrics(NamedTuple):
    """Metrics of a run, per target.

    Attributes
    ----------
    coverage, anees, rmse : ndarray, shape (target, 12)
        Share of the time within three standard deviations, average normalised squared error,
        root mean square error.
    status, status_rotation, status_translation : ndarray of uint8, shape (target,)
        TRACKED, NEVER_OBSERVED or DIVERGED: of all states, of attitude and angular velocity, of
        position and velocity.
    final_attitude_error_deg : ndarray, shape (target,)
        Root mean square rotation angle of the attitude error over the final hours.
    bound_ratio : ndarray, shape (target, 4)
        Error over Cramer-Rao bound in the final hours, see `bound_ratio`.
    bound_attitude_deg : ndarray, shape (target,)
        Root mean square attitude error the bound allows over the final hours.
    """

    coverage: Array
    anees: Array
    rmse: Array
    status: NDArray[np.uint8]
    status_rotation: NDArray[np.uint8]
    status_translation: NDArray[np.uint8]
    final_attitude_error_deg: Array
    bound_ratio: Array
    bound_attitude_deg: Array


def within_bounds(error: ArrayLike, sigma: ArrayLike) -> NDArray[np.bool_]:
    """Whether errors lie within three standard deviations; never where they are not finite.

    Parameters
    ----------
    error, sigma : array_like, one shape
        Errors and standard deviations.

    Returns
    -------
    ndarray of bool, same shape
    """
    return np.abs(np.asarray(error)) <= BOUND_SIGMAS * np.asarray(sigma)


def coverage(error: Array, sigma: Array) -> Array:
    """Share of the time within three standard deviations.

    Parameters
    ----------
    error, sigma : ndarray, shape (target, time, component)
        Errors and standard deviations.

    Returns
    -------
    ndarray, shape (target, component)
    """
    return within_bounds(error, sigma).mean(axis=1)


def _mean_where_finite(values: Array) -> Array:
    """Mean over time, axis 1, of the finite values; NaN where there are none."""
    finite = np.isfinite(values)
    count = finite.sum(axis=1)
    total = np.where(finite, values, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def anees(error: Array, sigma: Array) -> Array:
    """Component-wise average normalised estimation error squared (Paul & Fan, eq. 63).

    Parameters
    ----------
    error, sigma : ndarray, shape (target, time, component)
        Errors and standard deviations. Times after the end of a failed estimate (NaN) are left
        out.

    Returns
    -------
    ndarray, shape (target, component)
        1 for a consistent filter; larger if it is overconfident.
    """
    return _mean_where_finite((error / sigma) ** 2)


def bound_ratio(error: Array, bound: Array, observed: ArrayLike) -> Array:
    """Error over Cramer-Rao bound of the parts of the state.

    Parameters
    ----------
    error, bound : ndarray, shape (target, time, 12)
        Errors, and standard deviations of the bound. Times at which either is NaN are left out.
    observed : array_like of bool, shape (target,)
        Whether any measurement of the target was used.

    Returns
    -------
    ndarray, shape (target, 4)
        Root mean square length of the error vector of each of `PARTS` over the square root of the
        mean sum of the bound's variances. About 1 for an efficient estimator; NaN for a target
        that was never observed.
    """
    both = np.isfinite(error).all(axis=2) & np.isfinite(bound).all(axis=2)
    counted = both & np.asarray(observed)[:, None]

    def squared(values: Array) -> Array:
        kept = np.where(counted[..., None], values, np.nan)
        return _mean_where_finite((kept**2).reshape(*kept.shape[:2], len(PARTS), 3).sum(axis=3))

    return np.sqrt(squared(error) / squared(bound))


def rmse(error: Array) -> Array:
    """Root mean square error.

    Parameters
    ----------
    error : ndarray, shape (target, time, component)
        Times after the end of a failed estimate (NaN) are left out.

    Returns
    -------
    ndarray, shape (target, component)
        In the units of the error.
    """
    return np.sqrt(_mean_where_finite(error**2))


def classify(covered: Array, observed: ArrayLike) -> NDArray[np.uint8]:
    """Status of targets from how much of the final hours lies within the bounds.

    Parameters
    ----------
    covered : ndarray, shape (target, component)
        Share of the final hours within the bounds, of the components that count.
    observed : array_like of bool, shape (target,)
        Whether any measurement of the target was used.

    Returns
    -------
    ndarray of uint8, shape (target,)
        NEVER_OBSERVED; DIVERGED if observed and, averaged over the components, less than half
        lies within; otherwise TRACKED.
    """
    status = np.where(covered.mean(axis=1) < DIVERGED_COVERAGE, DIVERGED, TRACKED)
    return np.where(np.asarray(observed), status, NEVER_OBSERVED).astype(np.uint8)


def attitude_angle_deg(error: Array, a: float = 0.5) -> Array:
    """Rotation angle of attitude errors given as GRP vectors.

    Parameters
    ----------
    error : ndarray, shape (..., >= 3)
        Attitude errors in the first three components, with f = 2 (a + 1).
    a : float
        Parameter of the GRP.

    Returns
    -------
    ndarray, shape (...)
        Degrees in [0, 180].
    """
    f = 2.0 * (a + 1.0)
    squared = np.sum(error[..., :3] ** 2, axis=-1)
    scalar = (-a * squared + f * np.sqrt(f * f + (1.0 - a * a) * squared)) / (f * f + squared)
    # |rho| = (a + q4) |p| / f; the arctangent keeps its precision at small angles.
    return np.rad2deg(2.0 * np.arctan2((a + scalar) / f * np.sqrt(squared), scalar))


def evaluate(
    error: Array,
    sigma: Array,
    used: NDArray[np.bool_],
    step_s: float,
    bound: Array | None = None,
) -> TrackingMetrics:
    """All metrics of a run.

    Parameters
    ----------
    error, sigma : ndarray, shape (target, time, 12)
        Errors (truth less estimate) and standard deviations at every step.
    used : ndarray of bool, shape (target, time)
        Whether a measurement was used.
    step_s : float
        Time between the steps, s.
    bound : ndarray, shape (target, time, 12), optional
        Standard deviations of the Cramer-Rao bound; without it, what depends on it is NaN.

    Returns
    -------
    TrackingMetrics
    """
    bound = np.full(error.shape, np.nan) if bound is None else bound
    final = min(error.shape[1], max(1, round(FINAL_HOURS * 3600.0 / step_s)))
    last_error = error[:, -final:]
    covered = coverage(last_error, sigma[:, -final:])
    observed = used.any(axis=1)
    rotation = classify(covered[:, ROTATION], observed)
    translation = classify(covered[:, TRANSLATION], observed)
    angle = attitude_angle_deg(last_error)
    last_bound = bound[:, -final:]
    return TrackingMetrics(
        coverage(error, sigma),
        anees(error, sigma),
        rmse(error),
        # the codes are ordered, and a target is seen or not as a whole
        np.maximum(rotation, translation),
        rotation,
        translation,
        np.sqrt(_mean_where_finite(angle**2)),
        bound_ratio(last_error, last_bound, observed),
        np.rad2deg(np.sqrt(_mean_where_finite((last_bound[..., :3] ** 2).sum(axis=2)))),
    )
