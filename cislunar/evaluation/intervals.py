"""Means of realizations with confidence intervals.

Realizations come in groups. Those of a group share conditions, such as the day of the month and the
targets, and are correlated; groups are independent of each other. A mean is the mean of the means
of the groups, and its interval is Student's t at 95 % over these means, with one degree of freedom
less than there are groups, limited to possible values: the analysis of a balanced sample in two
stages (W. G. Cochran, Sampling Techniques, 3rd ed., 1977, section 10.3). Without groups each
realization is a group of its own, and an interval describes the variation over realizations of one
day, geometry, set of targets and architecture.

Intervals of counts and shares of targets are at least as wide as the exact intervals of Poisson and
binomial counts.
"""

from collections.abc import Hashable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import beta, chi2
from scipy.stats import t as student_t

from cislunar.runtime import Array

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """A mean and its confidence interval from `count` independent values; NaN for too few."""

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


def group_means(values: ArrayLike, groups: ArrayLike | None = None) -> dict[Hashable, float]:
    """Means of the finite values of each group by its label, groups in the order of the values.

    `values` and `groups` are those of `t_interval`.
    """
    given = np.asarray(values, dtype=float).ravel()
    labels = range(given.size) if groups is None else np.asarray(groups).ravel().tolist()
    members: dict[Hashable, list[float]] = {}
    for label, value in zip(labels, given, strict=True):
        if np.isfinite(value):
            members.setdefault(label, []).append(value)
    return {label: float(np.mean(own)) for label, own in members.items()}


def t_interval(values: ArrayLike, groups: ArrayLike | None = None) -> Interval:
    """Mean of the group means of the finite values, and 95 % confidence interval (Student's t).

    Parameters
    ----------
    values : array_like
        Values of the realizations; NaN where there is none.
    groups : array_like, same shape, optional
        Label of the group of each realization; without them each is a group of its own.

    Returns
    -------
    Interval
        Its `count` is the number of groups with a finite value.
    """
    means = np.array(list(group_means(values, groups).values()))
    return _of_means(means)


def _of_means(means: Array) -> Interval:
    """Mean of independent values with its 95 % interval."""
    if means.size == 0:
        return Interval(np.nan, np.nan, np.nan, 0)
    mean = float(means.mean())
    if means.size == 1:
        return Interval(mean, np.nan, np.nan, 1)
    error = means.std(ddof=1) / np.sqrt(means.size)
    half = float(student_t.ppf(0.5 + 0.5 * CONFIDENCE, means.size - 1) * error)
    return Interval(mean, mean - half, mean + half, means.size)


def count_interval(values: ArrayLike, groups: ArrayLike | None = None) -> Interval:
    """Mean of counts with a 95 % confidence interval: Student's t, and no narrower than Poisson's.

    The exact interval of the rate of a Poisson count (Garwood 1936) also applies if all
    realizations are equal: none in ten runs is a mean of 0 to 0.37. Parameters as for `t_interval`.
    """
    found = t_interval(values, groups)
    runs = np.count_nonzero(np.isfinite(np.asarray(values, dtype=float)))
    if not found.count:
        return found
    total, tail = found.mean * runs, 0.5 * (1.0 - CONFIDENCE)
    low = 0.5 * chi2.ppf(tail, 2.0 * total) / runs if total > 0.0 else 0.0
    high = 0.5 * chi2.ppf(1.0 - tail, 2.0 * total + 2.0) / runs
    low, high = np.fmin(low, found.low), np.fmax(high, found.high)
    return found._replace(low=max(0.0, float(low)), high=float(high))


def share_interval(values: ArrayLike, targets: int, groups: ArrayLike | None = None) -> Interval:
    """Mean share of `targets` targets with a 95 % interval: Student's t, and no narrower than
    exact.

    The exact interval of a binomial share (Clopper & Pearson 1934) of all targets of all
    realizations also applies if all realizations are equal: none of 20 in ten runs is 0 to 0.018.
    Parameters as for `t_interval`.
    """
    found = t_interval(values, groups)
    runs = np.count_nonzero(np.isfinite(np.asarray(values, dtype=float)))
    if not found.count:
        return found
    trials, tail = runs * targets, 0.5 * (1.0 - CONFIDENCE)
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
    "bright",
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
    "accurate_attitude_share",
)
"""Quantities that are shares of targets."""

SPANS_DECADES = ("anees", "bound_ratio")
"""Beginnings of quantities that two cells are compared in by their logarithm."""

GEOMETRIC_MEANS = ("bound_ratio", "rmse_geometric", "final_error_geometric")
"""Beginnings of quantities with geometric means over realizations. The mean of ANEES is arithmetic:
a single overconfident realization is to show in it."""


def interval_of(
    quantity: str, values: ArrayLike, targets: int, groups: ArrayLike | None = None
) -> Interval:
    """Mean and 95 % confidence interval of a quantity of a cell with `targets` targets.

    `values` and `groups` are those of `t_interval`. Counts, shares and `GEOMETRIC_MEANS` have
    intervals of their own; those of all others without negative values are limited to possible
    values.
    """
    if quantity in COUNTS:
        return count_interval(values, groups)
    if quantity in _SHARES:
        return share_interval(values, targets, groups)
    if quantity.startswith(GEOMETRIC_MEANS):
        return log_interval(values, groups)
    found = t_interval(values, groups)
    if np.any(np.asarray(values, dtype=float) < 0.0):
        return found
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


def log_interval(values: ArrayLike, groups: ArrayLike | None = None) -> Interval:
    """Geometric mean and 95 % confidence interval of the positive values, for skewed quantities:
    those of `t_interval` for the logarithm."""
    given = np.asarray(values, dtype=float)
    logarithm = np.log(np.where(given > 0.0, given, np.nan))
    mean, low, high, count = t_interval(logarithm, groups)
    return Interval(*(float(np.exp(value)) for value in (mean, low, high)), count)


def contrast_interval(one: ArrayLike, other: ArrayLike, *, logarithmic: bool = False) -> Interval:
    """Difference or ratio of the means of two samples of group means with its 95 % interval.

    Parameters
    ----------
    one, other : array_like, shape (group,)
        Means of the same groups, NaN where a sample lacks a group. If both have the same groups,
        their differences are taken group by group (paired); otherwise the samples count as
        independent, with the degrees of freedom of B. L. Welch (Biometrika 34, 1947).
    logarithmic : bool
        Ratio `one` / `other` of geometric means of positive values, in place of the difference
        `one` - `other` of means.

    Returns
    -------
    Interval
        Its `count` is the number of groups of the smaller sample.
    """
    pair = [np.asarray(each, dtype=float).ravel() for each in (one, other)]
    if logarithmic:
        pair = [np.log(np.where(each > 0.0, each, np.nan)) for each in pair]
    kept = [np.isfinite(each) for each in pair]
    if np.array_equal(*kept):
        found = _of_means(pair[0][kept[0]] - pair[1][kept[1]])
    else:
        found = _welch(*(each[own] for each, own in zip(pair, kept, strict=True)))
    if not logarithmic:
        return found
    return Interval(*(float(np.exp(end)) for end in found[:3]), found.count)


def _welch(one: Array, other: Array) -> Interval:
    """Difference of the means of independent samples with unequal variances."""
    count = min(one.size, other.size)
    difference = float(one.mean() - other.mean()) if count else np.nan
    if count < 2:
        return Interval(difference, np.nan, np.nan, count)
    each = [own.var(ddof=1) / own.size for own in (one, other)]
    variance = sum(each)
    if variance == 0.0:
        return Interval(difference, difference, difference, count)
    freedom = variance**2 / sum(
        part**2 / (own.size - 1) for part, own in zip(each, (one, other), strict=True)
    )
    half = float(student_t.ppf(0.5 + 0.5 * CONFIDENCE, freedom) * np.sqrt(variance))
    return Interval(difference, difference - half, difference + half, count)
