"""Means of realizations with confidence intervals.

Realizations of truth and noise are independent, so that intervals are Student's t at 95 %, limited
to possible values. Those of counts and shares of targets are at least as wide as the exact
intervals of Poisson and binomial counts. They describe the variation over realizations only:
geometry, targets and architecture are fixed.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import beta, chi2
from scipy.stats import t as student_t

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """A mean and its confidence interval from `count` finite values; NaN if there are too few."""

    mean: float
    low: float
    high: float
    count: int

    @property
    def above_zero(self) -> bool:
        """Whether the whole interval is positive."""
        return self.low > 0.0

    @property
    def below_zero(self) -> bool:
        """Whether the whole interval is negative."""
        return self.high < 0.0

    @property
    def floor(self) -> float:
        """The lower end; the value itself if it is the only one."""
        return self.low if self.count > 1 else self.mean

    @property
    def ceiling(self) -> float:
        """The upper end; the value itself if it is the only one."""
        return self.high if self.count > 1 else self.mean

    @property
    def reach(self) -> float:
        """Largest distance of the interval from zero."""
        return max(abs(self.low), abs(self.high))

    def __format__(self, form: str) -> str:
        """The mean with its interval in brackets, numbers in the form given."""
        if self.count < 2:
            return f"{self.mean:{form}}"
        return f"{self.mean:{form}} [{self.low:{form}}, {self.high:{form}}]"


def t_interval(values: ArrayLike) -> Interval:
    """Mean and 95 % confidence interval (Student's t) of the finite values."""
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    if finite.size == 0:
        return Interval(np.nan, np.nan, np.nan, 0)
    mean = float(finite.mean())
    if finite.size == 1:
        return Interval(mean, np.nan, np.nan, 1)
    error = finite.std(ddof=1) / np.sqrt(finite.size)
    half = float(student_t.ppf(0.5 + 0.5 * CONFIDENCE, finite.size - 1) * error)
    return Interval(mean, mean - half, mean + half, finite.size)


def count_interval(values: ArrayLike) -> Interval:
    """Mean of counts with a 95 % confidence interval: Student's t, and no narrower than Poisson's.

    The exact interval of the rate of a Poisson count (Garwood 1936) also applies if all
    realizations are equal: none in ten runs is a mean of 0 to 0.37.
    """
    found = t_interval(values)
    if not found.count:
        return found
    total, runs = found.mean * found.count, found.count
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = 0.5 * chi2.ppf(tail, 2.0 * total) / runs if total > 0.0 else 0.0
    high = 0.5 * chi2.ppf(1.0 - tail, 2.0 * total + 2.0) / runs
    low, high = np.fmin(low, found.low), np.fmax(high, found.high)
    return found._replace(low=max(0.0, float(low)), high=float(high))


def share_interval(values: ArrayLike, targets: int) -> Interval:
    """Mean share of `targets` targets with a 95 % interval: Student's t, and no narrower than
    exact.

    The exact interval of a binomial share (Clopper & Pearson 1934) of all targets of all
    realizations also applies if all realizations are equal: none of 20 in ten runs is 0 to 0.018.
    """
    found = t_interval(values)
    if not found.count:
        return found
    trials, tail = found.count * targets, 0.5 * (1.0 - CONFIDENCE)
    hits = min(found.mean, 1.0) * trials
    low = beta.ppf(tail, hits, trials - hits + 1.0) if hits > 0.0 else 0.0
    high = beta.ppf(1.0 - tail, hits + 1.0, trials - hits) if hits < trials else 1.0
    low, high = np.fmin(low, found.low), np.fmax(high, found.high)
    return found._replace(low=max(0.0, float(low)), high=min(1.0, float(high)))


COUNTS = (
    "never_observed",
    "never_visible",
    "missed",
    "inconsistent_rotation",
    "inconsistent_translation",
    "inconsistent_translation_lunar",
    "inconsistent_rotation_only",
    "failed",
)
"""Quantities that count targets."""

_SHARES = (
    "inconsistent_rotation_share",
    "inconsistent_translation_share",
    "translation_outside_share",
    "tracked_share",
    "custody_share",
    "position_custody_share",
    "attitude_custody_share",
)
"""Quantities that are shares of targets."""

SPANS_DECADES = ("anees", "bound_ratio")
"""Quantities that are averaged and compared by their logarithm."""


def interval_of(quantity: str, values: ArrayLike, targets: int) -> Interval:
    """Mean and 95 % confidence interval of a quantity of a cell with `targets` targets."""
    if quantity in COUNTS:
        return count_interval(values)
    if quantity in _SHARES:
        return share_interval(values, targets)
    if quantity.startswith(SPANS_DECADES):
        return log_interval(values)
    return within_bounds(quantity, t_interval(values))


def within_bounds(quantity: str, found: Interval) -> Interval:
    """An interval of a quantity of a cell, limited to possible values."""
    is_share = "coverage" in quantity or quantity.endswith(("_share", "_fraction"))
    # a mean of shares of 1 may round to a little more
    highest = max(1.0, found.mean) if is_share else np.inf
    return found._replace(
        low=float(np.maximum(found.low, 0.0)), high=float(np.minimum(found.high, highest))
    )


def prediction_interval(values: ArrayLike) -> Interval:
    """Median, and the interval of one more run with 95 % confidence (Student's t).

    Unlike the range of the runs it does not widen with their number.
    """
    found = t_interval(values)
    if found.count < 2:
        return found
    half = (found.high - found.mean) * np.sqrt(found.count + 1.0)
    finite = np.asarray(values, dtype=float)
    median = float(np.median(finite[np.isfinite(finite)]))
    return Interval(median, found.mean - half, found.mean + half, found.count)


def log_interval(values: ArrayLike) -> Interval:
    """Geometric mean and 95 % confidence interval of the positive values, for skewed quantities."""
    positive = np.asarray(values, dtype=float)
    positive = positive[np.isfinite(positive) & (positive > 0.0)]
    mean, low, high, count = t_interval(np.log(positive))
    return Interval(*(float(np.exp(value)) for value in (mean, low, high)), count)
