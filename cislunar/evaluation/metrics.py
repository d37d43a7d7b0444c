"""How well the targets are tracked (Paul & Fan, section 5.2).

Components are ordered attitude error (GRP), angular velocity (rad/s), position, velocity
(nondimensional), three each, as in the error state of the filter.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
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
        Error over Cramer-Rao bound in the final hours: root mean square length of the error vector
        of each of `PARTS` over the square root of the mean sum of the bound's variances, at steps
        at which both are finite. About 1 for an efficient estimator; NaN for a target that was
        never observed.
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


class _Sums(NamedTuple):
    """Sums over time, and what is kept of the final hours.

    Of every component, shape (target, 12): steps `covered` by the bounds in all and in the final
    hours; `anees` and `square` of the error over the finite ones, and how many those are. Of the
    final steps at which error and bound are finite, shape (target,) and (target, 4): `both`, and
    the squared lengths `error` and `bound` of `PARTS`. At the final steps, shape (target, step):
    squared angles `turn` of the error and `least` of the bound.
    """

    covered: NDArray[np.int64]
    covered_finally: NDArray[np.int64]
    anees: Array
    n_anees: NDArray[np.int64]
    square: Array
    n_square: NDArray[np.int64]
    both: NDArray[np.int64]
    error: Array
    bound: Array
    turn: Array
    least: Array


def _no_sums(n_targets: int, n_final: int) -> _Sums:
    """Before the first step."""
    components, parts, final = (n_targets, 12), (n_targets, len(PARTS)), (n_targets, n_final)
    counts = [np.zeros(components, dtype=np.int64) for _ in range(4)]
    return _Sums(
        counts[0],
        counts[1],
        np.zeros(components),
        counts[2],
        np.zeros(components),
        counts[3],
        np.zeros(n_targets, dtype=np.int64),
        np.zeros(parts),
        np.zeros(parts),
        np.full(final, np.nan),
        np.full(final, np.nan),
    )


@njit(cache=True, error_model="numpy")
def _add(n_before, error, sigma, bound, sums):
    """Add the steps of an interval, the first `n_before` of which are before the final hours.

    Always in the order of time, so that the lengths of the intervals do not matter.
    """
    for j in range(error.shape[0]):
        for i in range(error.shape[1]):
            finite = True
            for c in range(error.shape[2]):
                e, s = error[j, i, c], sigma[j, i, c]
                if abs(e) <= BOUND_SIGMAS * s:
                    sums.covered[j, c] += 1
                    sums.covered_finally[j, c] += i >= n_before
                ratio, square = (e / s) ** 2, e**2
                if np.isfinite(ratio):
                    sums.anees[j, c] += ratio
                    sums.n_anees[j, c] += 1
                if np.isfinite(square):
                    sums.square[j, c] += square
                    sums.n_square[j, c] += 1
                finite &= np.isfinite(e) and np.isfinite(bound[j, i, c])
            if i < n_before or not finite:
                continue
            sums.both[j] += 1
            for part in range(sums.error.shape[1]):
                e, b = error[j, i, 3 * part :], bound[j, i, 3 * part :]
                sums.error[j, part] += e[0] ** 2 + e[1] ** 2 + e[2] ** 2
                sums.bound[j, part] += b[0] ** 2 + b[1] ** 2 + b[2] ** 2


def _quotient(total: Array, count: NDArray[np.int64]) -> Array:
    """Mean, given a sum and of how many values it is; NaN of none."""
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _mean_where_finite(values: Array) -> Array:
    """Mean over time, axis 1, of the finite values; NaN where there are none."""
    finite = np.isfinite(values)
    return _quotient(np.where(finite, values, 0.0).sum(axis=1), finite.sum(axis=1))


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

    Sums are carried on, not histories; of the final hours two angles a step are kept.

    Parameters
    ----------
    n_targets, n_steps : int
        Targets, and steps of the whole run.
    step_s : float
        Time between the steps, s.
    """

    def __init__(self, n_targets: int, n_steps: int, step_s: float) -> None:
        n_final = min(n_steps, max(1, round(FINAL_HOURS * 3600.0 / step_s)))
        self._begin, self._n_final = n_steps - n_final, n_final
        self._sums = _no_sums(n_targets, n_final)
        self._observed = np.zeros(n_targets, dtype=bool)
        self._done = 0

    def final(self, n_steps: int) -> NDArray[np.bool_]:
        """Which of the next steps are in the final hours."""
        return np.arange(self._done, self._done + n_steps) >= self._begin

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
            Standard deviations of the Cramer-Rao bound, of which those of the final hours count;
            without it, what depends on it is NaN.
        """
        least = np.full(error.shape, np.nan) if bound is None else bound
        before = min(max(self._begin - self._done, 0), error.shape[1])
        self._observed |= np.asarray(observed)
        _add(before, error, sigma, least, self._sums)
        self._done += error.shape[1]
        last = slice(self._done - error.shape[1] + before - self._begin, self._done - self._begin)
        if last.stop > 0:
            self._sums.turn[:, last] = attitude_angle_deg(error[:, before:]) ** 2
            self._sums.least[:, last] = (least[:, before:, :3] ** 2).sum(axis=2)

    def result(self) -> TrackingMetrics:
        """Metrics of a run that is done."""
        sums, steps = self._sums, np.full(self._sums.covered.shape, self._done)
        covered = sums.covered_finally / self._n_final
        rotation = classify(covered[:, ROTATION], self._observed)
        translation = classify(covered[:, TRANSLATION], self._observed)
        both = np.where(self._observed, sums.both, 0)[:, None]
        return TrackingMetrics(
            _quotient(sums.covered, steps),
            _quotient(sums.anees, sums.n_anees),
            np.sqrt(_quotient(sums.square, sums.n_square)),
            # the codes are ordered, and a target is seen or not as a whole
            np.maximum(rotation, translation),
            rotation,
            translation,
            np.sqrt(_mean_where_finite(sums.turn)),
            np.sqrt(_quotient(sums.error, both) / _quotient(sums.bound, both)),
            np.rad2deg(np.sqrt(_mean_where_finite(sums.least))),
        )
