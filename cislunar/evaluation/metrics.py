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
        Share of the time within three standard deviations, average normalised squared error (1 for
        a consistent filter, larger if it is overconfident), root mean square error.
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


def _within_bounds(error: Array, sigma: Array) -> NDArray[np.bool_]:
    """Whether errors lie within three standard deviations; never where they are not finite."""
    return np.abs(error) <= BOUND_SIGMAS * sigma


def _quotient(total: Array, count: NDArray[np.int64]) -> Array:
    """Mean, given a sum and of how many values it is; NaN of none."""
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _mean_where_finite(values: Array) -> Array:
    """Mean over time, axis 1, of the finite values; NaN where there are none."""
    finite = np.isfinite(values)
    return _quotient(np.where(finite, values, 0.0).sum(axis=1), finite.sum(axis=1))


class _RunningMean:
    """Mean of the finite values of arrays (target, time, component), given one after the other."""

    def __init__(self) -> None:
        self._total, self._count = np.zeros(1), np.zeros(1, dtype=np.int64)

    def update(self, values: ArrayLike) -> None:
        given = np.asarray(values, dtype=float)
        finite = np.isfinite(given)
        # summed in the order of time, so that the lengths of the intervals do not matter
        before = np.broadcast_to(self._total, (given.shape[0], given.shape[2]))[:, None]
        kept = np.where(finite, given, 0.0)
        self._total = np.concatenate([before, kept], axis=1).sum(axis=1)
        self._count = self._count + finite.sum(axis=1)

    @property
    def mean(self) -> Array:
        return _quotient(self._total, self._count)


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


class Evaluation:
    """Metrics of a run, gathered from interval to interval (Paul & Fan, eq. 63).

    Only the final hours are kept; they are those before the last time given so far.

    Parameters
    ----------
    step_s : float
        Time between the steps, s.
    """

    def __init__(self, step_s: float) -> None:
        self._final = max(1, round(FINAL_HOURS * 3600.0 / step_s))
        self._covered, self._normalised, self._squared = (_RunningMean() for _ in range(3))
        self._observed: NDArray[np.bool_] | bool = False
        self._last: tuple[Array, ...] = ()

    def update(
        self, error: Array, sigma: Array, observed: ArrayLike, bound: Array | None = None
    ) -> None:
        """Add an interval.

        Parameters
        ----------
        error, sigma : ndarray, shape (target, time, 12)
            Errors (truth less estimate) and standard deviations at every step. Times after the end
            of a failed estimate are NaN: not within the bounds, and left out of averages.
        observed : array_like of bool, shape (target,)
            Whether a measurement of the target was used.
        bound : ndarray, shape (target, time, 12), optional
            Standard deviations of the Cramer-Rao bound; without it, what depends on it is NaN.
        """
        self._covered.update(_within_bounds(error, sigma))
        self._normalised.update((error / sigma) ** 2)
        self._squared.update(error**2)
        self._observed = self._observed | np.asarray(observed)
        given = (error, sigma, np.full(error.shape, np.nan) if bound is None else bound)
        if self._last:
            joined = zip(self._last, given, strict=True)
            given = tuple(np.concatenate(pair, axis=1) for pair in joined)
        self._last = tuple(each[:, -self._final :] for each in given)

    def result(self) -> TrackingMetrics:
        """Metrics of all intervals so far."""
        error, sigma, bound = self._last
        covered = _within_bounds(error, sigma).mean(axis=1)
        rotation = classify(covered[:, ROTATION], self._observed)
        translation = classify(covered[:, TRANSLATION], self._observed)
        angle = attitude_angle_deg(error)
        return TrackingMetrics(
            self._covered.mean,
            self._normalised.mean,
            np.sqrt(self._squared.mean),
            # the codes are ordered, and a target is seen or not as a whole
            np.maximum(rotation, translation),
            rotation,
            translation,
            np.sqrt(_mean_where_finite(angle**2)),
            bound_ratio(error, bound, self._observed),
            np.rad2deg(np.sqrt(_mean_where_finite((bound[..., :3] ** 2).sum(axis=2)))),
        )
