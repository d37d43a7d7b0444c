"""Metrics of tracking (Paul & Fan, section 5.2).

Components are ordered attitude error (GRP), angular velocity (rad/s), position, velocity
(nondimensional, propagation frame), three each, as in the error state of the filter.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erf

from cislunar.compiled import njit_noalloc
from cislunar.evaluation.custody import Custody, attitude_angle_deg
from cislunar.runtime import Array

TRACKED, NEVER_OBSERVED, INCONSISTENT = range(3)
TARGET_STATUS_NAMES = ("tracked", "never_observed", "inconsistent")
"""Names of the status codes in data sets. Inconsistent: observed, but inconsistent with its
covariance in the final hours."""

ROTATION, _TRANSLATION = slice(0, 6), slice(6, 12)

PARTS = ("attitude", "angular_velocity", "position", "velocity")
"""Parts of the state, three components each."""

BOUND_SIGMAS = 3.0
"""Half-width of the bounds, standard deviations."""

NOMINAL_COVERAGE = float(erf(BOUND_SIGMAS / np.sqrt(2.0)))
"""Share of a Gaussian error within the bounds, 0.9973."""

_CONSISTENT_COVERAGE = 0.5
"""Least share of the final hours within the bounds for a target to count as tracked."""

FINAL_HOURS = 4.0
"""Hours at the end of a run that decide whether a target is tracked."""

_CUSTODY = Custody()


class TrackingMetrics(NamedTuple):
    """Metrics of a run, per target.

    Attributes
    ----------
    coverage, final_coverage, anees, rmse : ndarray, shape (target, 12)
        Share of the time within three standard deviations, the same of the final hours, average
        normalized squared error (1 for a consistent filter, larger if it is overconfident), root
        mean square error.
    status, status_rotation, status_translation : ndarray of uint8, shape (target,)
        TRACKED, NEVER_OBSERVED or INCONSISTENT: of all states, of attitude and angular velocity, of
        position and velocity.
    final_attitude_error_deg, bound_attitude_deg : ndarray, shape (target,)
        Root mean square rotation angle of the attitude error over the final hours, and its bound.
    bound_ratio : ndarray, shape (target, 4)
        Error over Cramer-Rao bound in the final hours: root mean square length of the error vector
        of each of `PARTS` over the square root of the mean sum of the bound's variances, at steps
        at which both are finite. About 1 for an efficient estimator; NaN for a target that was
        never observed.
    custody : ndarray of bool, shape (target,)
        Whether the last state is within `Custody`; of every target, observed or not.
    custody_position, custody_attitude : ndarray of bool, shape (target,)
        The same of the position alone, and of the attitude alone if the estimator takes it as
        known.
    accurate_attitude : ndarray of bool, shape (target,)
        Whether the last attitude error is within `Custody`, also if the estimator does not take the
        attitude as known.
    unique_share, anees_unique : ndarray, shape (target,)
        Share of the time at whose steps the attitude was known by the last status before, and the
        normalized squared error of the attitude, a mean over axes and these steps.
    """

    coverage: Array
    final_coverage: Array
    anees: Array
    rmse: Array
    status: NDArray[np.uint8]
    status_rotation: NDArray[np.uint8]
    status_translation: NDArray[np.uint8]
    final_attitude_error_deg: Array
    bound_ratio: Array
    bound_attitude_deg: Array
    custody: NDArray[np.bool_]
    custody_position: NDArray[np.bool_]
    custody_attitude: NDArray[np.bool_]
    accurate_attitude: NDArray[np.bool_]
    unique_share: Array
    anees_unique: Array


class _Sums(NamedTuple):
    """Sums over time, and the angles of the final hours. Per component, shape (target, 12): steps
    `covered` by the bounds in all and in the final hours; `anees` and `square` of the error over
    the finite steps, and their numbers. Over the final steps with finite error and bound, shape
    (target,) and (target, 4): their number `both`, and the squared lengths `error` and `bound` of
    `PARTS`. At the final steps, shape (target, step): squared angles `turn` of the error and
    `least` of the bound."""

    covered: NDArray[np.int64]
    covered_finally: NDArray[np.int64]
    n_anees: NDArray[np.int64]
    n_square: NDArray[np.int64]
    anees: Array
    square: Array
    both: NDArray[np.int64]
    error: Array
    bound: Array
    turn: Array
    least: Array


def _no_sums(n_targets: int, n_final: int) -> _Sums:
    """Sums before the first step."""
    return _Sums(
        *np.zeros((4, n_targets, 12), dtype=np.int64),
        *np.zeros((2, n_targets, 12)),
        np.zeros(n_targets, dtype=np.int64),
        *np.zeros((2, n_targets, len(PARTS))),
        *np.full((2, n_targets, n_final), np.nan),
    )


@njit_noalloc
def _add(n_before, error, sigma, bound, sums):
    """Add the steps of an interval, the first `n_before` of which are before the final hours. The
    sums are in the order of time, so that they do not depend on the lengths of the intervals."""
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
    """Mean, given a sum and the number of values; NaN for none."""
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _mean_where_finite(values: Array) -> Array:
    """Mean over time, axis 1, of the finite values; NaN where there are none."""
    finite = np.isfinite(values)
    return _quotient(np.where(finite, values, 0.0).sum(axis=1), finite.sum(axis=1))


def _classify(covered: Array, observed: ArrayLike) -> NDArray[np.uint8]:
    """Status of targets from the shares of the final hours within the bounds (target, component),
    and from whether they were `observed`: INCONSISTENT if observed and less than half is within the
    bounds on average over the components."""
    status = np.where(covered.mean(axis=1) < _CONSISTENT_COVERAGE, INCONSISTENT, TRACKED)
    return np.where(np.asarray(observed), status, NEVER_OBSERVED).astype(np.uint8)


class Evaluation:
    """Metrics of a run, accumulated from interval to interval (Paul & Fan, eq. 63).

    Only sums are kept, and two angles per step of the final hours.

    Parameters
    ----------
    n_targets, n_steps : int
        Targets, and steps of the whole run.
    step_s : float
        Time between the steps, s.
    custody : Custody
        Limits of custody.
    """

    def __init__(
        self, n_targets: int, n_steps: int, step_s: float, custody: Custody = _CUSTODY
    ) -> None:
        n_final = min(n_steps, max(1, round(FINAL_HOURS * 3600.0 / step_s)))
        self._begin, self._n_final = n_steps - n_final, n_final
        self._sums = _no_sums(n_targets, n_final)
        self._observed = np.zeros(n_targets, dtype=bool)
        self._custody, self._within = custody, tuple(np.zeros((3, n_targets), dtype=bool))
        self._known, self._done = np.ones(n_targets, dtype=bool), 0
        self._unique = np.zeros((3, n_targets))  # steps; squares, and their number

    def final(self, n_steps: int) -> NDArray[np.bool_]:
        """Which of the next steps are in the final hours."""
        return np.arange(self._done, self._done + n_steps) >= self._begin

    def update(
        self,
        error: Array,
        sigma: Array,
        observed: ArrayLike,
        bound: Array | None = None,
        known: ArrayLike | None = None,
    ) -> None:
        """Add an interval.

        Parameters
        ----------
        error, sigma : ndarray, shape (target, time, 12)
            Errors (truth less estimate) and standard deviations at every step. After the end of a
            failed estimate they are NaN, which is outside the bounds and left out of averages.
        observed : array_like of bool, shape (target,)
            Whether a measurement of the target was used.
        bound : ndarray, shape (target, time, 12), optional
            Standard deviations of the Cramer-Rao bound, of which those of the final hours count.
            Metrics that depend on it are NaN without it.
        known : array_like of bool, shape (target,), optional
            Whether the estimator takes the attitude as known after the interval; all, if omitted.
            Other attitudes are not in custody.
        """
        least = np.full(error.shape, np.nan) if bound is None else bound
        before = min(max(self._begin - self._done, 0), error.shape[1])
        self._observed |= np.asarray(observed)
        position, accurate = self._custody.satisfied(error[:, -1])
        attitude = accurate if known is None else accurate & np.asarray(known)
        self._within = position, attitude, accurate
        _add(before, error, sigma, least, self._sums)
        squares = (error[self._known, :, :3] / sigma[self._known, :, :3]) ** 2
        finite = np.isfinite(squares)
        terms = np.where(finite, squares, 0.0).reshape(len(squares), 3 * error.shape[1])
        # one after the other, so that the lengths of the intervals do not matter
        terms = np.concatenate([self._unique[1, self._known, None], terms], axis=1)
        self._unique[1, self._known] = np.cumsum(terms, axis=1)[:, -1]
        self._unique[0, self._known] += error.shape[1]
        self._unique[2, self._known] += finite.sum(axis=(1, 2))
        if known is not None:
            self._known = np.array(known, dtype=bool)
        self._done += error.shape[1]
        last = slice(self._done - error.shape[1] + before - self._begin, self._done - self._begin)
        if last.stop > 0:
            self._sums.turn[:, last] = attitude_angle_deg(error[:, before:]) ** 2
            self._sums.least[:, last] = (least[:, before:, :3] ** 2).sum(axis=2)

    def result(self) -> TrackingMetrics:
        """Metrics of a completed run."""
        sums, steps = self._sums, np.full(self._sums.covered.shape, self._done)
        covered = sums.covered_finally / self._n_final
        rotation = _classify(covered[:, ROTATION], self._observed)
        translation = _classify(covered[:, _TRANSLATION], self._observed)
        both = np.where(self._observed, sums.both, 0)[:, None]
        return TrackingMetrics(
            _quotient(sums.covered, steps),
            covered,
            _quotient(sums.anees, sums.n_anees),
            np.sqrt(_quotient(sums.square, sums.n_square)),
            # the codes are ordered, and a target is seen or not as a whole
            np.maximum(rotation, translation),
            rotation,
            translation,
            np.sqrt(_mean_where_finite(sums.turn)),
            np.sqrt(_quotient(sums.error, both) / _quotient(sums.bound, both)),
            np.rad2deg(np.sqrt(_mean_where_finite(sums.least))),
            self._within[0] & self._within[1],
            *self._within,
            self._unique[0] / self._done,
            _quotient(self._unique[1], self._unique[2]),
        )
