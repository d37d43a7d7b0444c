"""How well the targets are tracked (Paul & Fan, section 5.2).

Components are ordered attitude error (GRP), angular velocity (rad/s), position, velocity
(nondimensional), three each, as in the error state of the filter.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import borrowing
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.errors import ConfigurationError

Array = NDArray[np.float64]

TRACKED, NEVER_OBSERVED, INCONSISTENT = range(3)
STATUS_NAMES = ("tracked", "never_observed", "diverged")
"""Names of the codes in data sets, where "diverged" is the older name of inconsistent."""

ROTATION, TRANSLATION = slice(0, 6), slice(6, 12)

PARTS = ("attitude", "angular_velocity", "position", "velocity")
"""Parts of the state, three components each."""

BOUND_SIGMAS = 3.0
"""Half-width of the bounds, standard deviations."""

CONSISTENT_COVERAGE = 0.5
"""Least share of the final hours within the bounds of a target that is tracked."""

FINAL_HOURS = 4.0
"""Hours at the end of a run that decide whether a target is tracked."""


@dataclass(frozen=True)
class Custody:
    """How well a target has to be known at the end of a run to count as held.

    Attributes
    ----------
    position_km : float
        Largest error of the position.
    attitude_deg : float
        Largest angle of the rotation between true and estimated attitude.

    Raises
    ------
    ConfigurationError
        If one is not positive.
    """

    position_km: float = 10.0
    attitude_deg: float = 5.0

    def __post_init__(self) -> None:
        for key in ("position_km", "attitude_deg"):
            if not getattr(self, key) > 0.0:
                raise ConfigurationError(f"custody.{key} = {getattr(self, key)} must be positive")

    def holds(self, error: Array) -> NDArray[np.bool_]:
        """Which errors lie within.

        Parameters
        ----------
        error : ndarray, shape (..., 12)
            Errors of states; those of a failed estimate are NaN, and not within.

        Returns
        -------
        ndarray of bool, shape (...)
        """
        away_km = LENGTH_UNIT_KM * np.sqrt((error[..., 6:9] ** 2).sum(axis=-1))
        near = away_km <= self.position_km
        return near & (attitude_angle_deg(error) <= self.attitude_deg)


class TrackingMetrics(NamedTuple):
    """Metrics of a run, per target.

    Attributes
    ----------
    coverage, final_coverage, anees, rmse : ndarray, shape (target, 12)
        Share of the time within three standard deviations, the same of the final hours, average
        normalised squared error (1 for a consistent filter, larger if it is overconfident), root
        mean square error.
    status, status_rotation, status_translation : ndarray of uint8, shape (target,)
        TRACKED, NEVER_OBSERVED or INCONSISTENT: of all states, of attitude and angular velocity, of
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
    custody : ndarray of bool, shape (target,)
        Whether the last state is known as well as a `Custody` asks; of every target, observed or
        not.
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


@borrowing
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
        NEVER_OBSERVED; INCONSISTENT if observed and, averaged over the components, less than half
        lies within; otherwise TRACKED.
    """
    status = np.where(covered.mean(axis=1) < CONSISTENT_COVERAGE, INCONSISTENT, TRACKED)
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
    custody : Custody
        What it takes to hold a target.
    """

    def __init__(
        self, n_targets: int, n_steps: int, step_s: float, custody: Custody = Custody()
    ) -> None:
        n_final = min(n_steps, max(1, round(FINAL_HOURS * 3600.0 / step_s)))
        self._begin, self._n_final = n_steps - n_final, n_final
        self._sums = _no_sums(n_targets, n_final)
        self._observed = np.zeros(n_targets, dtype=bool)
        self._custody, self._held = custody, np.zeros(n_targets, dtype=bool)
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
        self._held = self._custody.holds(error[:, -1])
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
            self._held,
        )
