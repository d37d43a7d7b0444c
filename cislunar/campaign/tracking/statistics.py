"""Statistics over realizations: means, differences and trends with confidence intervals.

Realizations of truth and noise are independent, so intervals are Student's t at 95 %. They speak
of the spread over realizations alone: geometry, targets and architecture stay as they are.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
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
    def around_zero(self) -> bool:
        """Whether it lies on neither side of zero."""
        return not (self.above_zero or self.below_zero)

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
