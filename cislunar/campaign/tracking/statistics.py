"""Statistics over realizations: means, differences and trends with confidence intervals.

Realizations of truth and noise are independent, so intervals are Student's t at 95 %, as far as
possible; of counts and shares of targets at least as wide as the exact ones of Poisson and binomial
counts. They speak of the spread over realizations alone: geometry, targets and architecture stay as
they are.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.stats import beta, chi2, norm
from scipy.stats import t as student_t

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """A mean and its confidence interval from `count` finite values; NaN where they are too few."""

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
        """The lower end; the value itself where there is one alone."""
        return self.low if self.count > 1 else self.mean

    @property
    def ceiling(self) -> float:
        """The upper end; the value itself where there is one alone."""
        return self.high if self.count > 1 else self.mean

    @property
    def reach(self) -> float:
        """How far it goes from zero."""
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

    The exact interval of the rate of a Poisson count (Garwood 1936) also holds where no realization
    differs from the others: none in ten runs is a mean of 0 to 0.37.
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
    """Mean share of so many targets with a 95 % interval: Student's t, and no narrower than exact.

    The exact interval of a binomial share (Clopper & Pearson 1934) of all targets of all
    realizations also holds where none differs from the others: none of 20 in ten runs is 0 to .018.
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


def pairs_interval(first: ArrayLike, other: ArrayLike) -> Interval:
    """Share of pairs of runs in which the first kind has more, with its 95 % interval.

    Runs that are equal to 1e-9 count as half. The interval is of the chance that a further run of
    the first kind has more than one of the other (Mann & Whitney's statistic). It is the score
    interval of Newcombe (2006, Statistics in Medicine 25, 559, method 5), in which runs and not
    pairs are independent; so it has a width even where all pairs agree. `count` is the number of
    runs of the smaller kind.
    """
    first, other = np.asarray(first, dtype=float), np.asarray(other, dtype=float)
    gain, least = first[:, None] - other, 1e-9 * np.abs(other)
    share = float(np.mean((gain > least) + 0.5 * (np.abs(gain) <= least)))
    if min(first.size, other.size) < 2:
        return Interval(share, np.nan, np.nan, min(first.size, other.size))
    z, more = norm.ppf(0.5 + 0.5 * CONFIDENCE), 0.5 * (first.size + other.size) - 1.0

    def beyond(chance: float) -> float:
        """How far the share is from a chance, squared, beyond z standard deviations."""
        spread = 1.0 + more * ((1.0 - chance) / (2.0 - chance) + chance / (1.0 + chance))
        variance = chance * (1.0 - chance) * spread / (first.size * other.size)
        return (share - chance) ** 2 - z**2 * variance

    least_width = 1e-12  # at 0 and 1 the share itself is a root
    low = brentq(beyond, 0.0, share - least_width) if share > 0.0 else 0.0
    high = brentq(beyond, share + least_width, 1.0) if share < 1.0 else 1.0
    return Interval(share, float(low), float(high), min(first.size, other.size))


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

SHARES = (
    "inconsistent_rotation_share",
    "inconsistent_translation_share",
    "translation_outside_share",
    "tracked_share",
    "custody_share",
)
"""Quantities that are shares of targets."""

SPANS_DECADES = ("anees", "bound_ratio")
"""Quantities that are averaged and compared by their logarithm."""


def interval_of(quantity: str, values: ArrayLike, targets: int) -> Interval:
    """Mean and 95 % confidence interval of a quantity of a cell, within what is possible.

    `targets` is how many the cell has.
    """
    if quantity in COUNTS:
        return count_interval(values)
    if quantity in SHARES:
        return share_interval(values, targets)
    if quantity.startswith(SPANS_DECADES):
        return log_interval(values)
    return within_bounds(quantity, t_interval(values))


def within_bounds(quantity: str, found: Interval) -> Interval:
    """An interval of a quantity of a cell, cut to what is possible."""
    is_share = "coverage" in quantity or quantity.endswith(("_share", "_fraction"))
    # a mean of shares of 1 may round to a little more
    highest = max(1.0, found.mean) if is_share else np.inf
    return found._replace(
        low=float(np.maximum(found.low, 0.0)), high=float(np.minimum(found.high, highest))
    )


def prediction_interval(values: ArrayLike) -> Interval:
    """Median, and where one more run lies with 95 % confidence (Student's t).

    Unlike the range of the runs it does not widen with their number.
    """
    found = t_interval(values)
    if found.count < 2:
        return found
    half = (found.high - found.mean) * np.sqrt(found.count + 1.0)
    finite = np.asarray(values, dtype=float)
    median = float(np.median(finite[np.isfinite(finite)]))
    return Interval(median, found.mean - half, found.mean + half, found.count)


def certain(difference: ArrayLike, low: ArrayLike, high: ArrayLike, count: ArrayLike):
    """Which of many differences are not zero, at 5 % for all of them together (Holm 1979).

    Each comes with its 95 % interval by Student's t and its number of realizations.
    """
    difference, low, high = (np.asarray(each, dtype=float) for each in (difference, low, high))
    freedom = np.maximum(np.asarray(count, dtype=float) - 1.0, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 0.5 * (high - low) / student_t.ppf(0.5 + 0.5 * CONFIDENCE, freedom)
        p = 2.0 * student_t.sf(np.abs(difference) / scale, freedom)
    p = np.where(np.isfinite(p), p, 1.0)
    order = np.argsort(p, kind="stable")
    fails = p[order] > (1.0 - CONFIDENCE) / np.arange(p.size, 0, -1)
    passed = np.zeros(p.size, dtype=bool)
    passed[order[: int(np.argmax(fails)) if fails.any() else p.size]] = True
    return passed


def log_interval(values: ArrayLike) -> Interval:
    """Geometric mean and 95 % confidence interval of the positive values, for skewed quantities."""
    positive = np.asarray(values, dtype=float)
    positive = positive[np.isfinite(positive) & (positive > 0.0)]
    mean, low, high, count = t_interval(np.log(positive))
    return Interval(*(float(np.exp(value)) for value in (mean, low, high)), count)


def slopes(x: ArrayLike, values: ArrayLike) -> NDArray[np.float64]:
    """Least-squares slope of each realization against log2(x): the change per doubling of x.

    Values, shape (seed, x), may be NaN; so is the slope of fewer than two.
    """
    octaves = np.log2(np.asarray(x, dtype=float))
    found = []
    for row in np.asarray(values, dtype=float):
        valid = np.isfinite(row)
        if np.unique(octaves[valid]).size < 2:
            found.append(np.nan)
            continue
        offset = octaves[valid] - octaves[valid].mean()
        # less the first value, so that equal values have no slope at all, not one of rounding
        rise = row[valid] - row[valid][0]
        found.append(float(offset @ rise / (offset @ offset)))
    return np.array(found)


class Paired(NamedTuple):
    """Means and largest values of two samples over their common realizations (NaN without any).

    `difference` is the other less the first, realization by realization.
    """

    first: float
    other: float
    first_largest: float
    other_largest: float
    difference: Interval


def paired(first: ArrayLike, other: ArrayLike) -> Paired:
    """Compare two samples over the realizations that are finite in both."""
    first, other = np.asarray(first, dtype=float), np.asarray(other, dtype=float)
    both = np.isfinite(first) & np.isfinite(other)
    first, other = first[both], other[both]
    difference = t_interval(other - first)
    if not difference.count:
        return Paired(np.nan, np.nan, np.nan, np.nan, difference)
    return Paired(first.mean(), other.mean(), first.max(), other.max(), difference)
