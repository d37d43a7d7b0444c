"""Comparisons of samples: paired differences, trends, rank correlations, Holm's test, and tests of
non-inferiority."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.stats import norm, spearmanr
from scipy.stats import t as student_t

from cislunar.campaign.settings.cells import FEWEST_RANKED
from cislunar.evaluation.intervals import CONFIDENCE, Interval, t_interval

_DIGITS = 9  # values that agree in these are ties: ranks must not hang on rounding


def rank_correlation(one: ArrayLike, other: ArrayLike) -> Interval:
    """Spearman's rank correlation with its 95 % confidence interval; NaN for too few.

    The interval is symmetric in Fisher's z with the variance (1 + rho^2 / 2) / (n - 3) of
    D. G. Bonett and T. A. Wright, Psychometrika 65 (2000). Values equal in nine digits are ties.
    """
    pairs = np.array([one, other], dtype=float)
    pairs = pairs[:, np.isfinite(pairs).all(axis=0)]
    count = pairs.shape[1]
    rounded = [[float(f"{value:.{_DIGITS}g}") for value in row] for row in pairs]
    if count < FEWEST_RANKED or any(len(set(row)) == 1 for row in rounded):
        return Interval(np.nan, np.nan, np.nan, count)
    rho = float(spearmanr(*rounded).statistic)
    # z is infinite where all ranks agree
    z = np.arctanh(np.clip(rho, -1.0 + 1e-12, 1.0 - 1e-12))
    half = norm.ppf(0.5 + 0.5 * CONFIDENCE) * np.sqrt((1.0 + 0.5 * rho**2) / (count - 3))
    return Interval(rho, *np.tanh([z - half, z + half]).tolist(), count)


def pairs_interval(first: ArrayLike, other: ArrayLike) -> Interval:
    """Share of pairs of runs in which the first kind has more, with its 95 % interval.

    Runs that are equal to 1e-9 count as half. The interval is that of the probability that a
    further run of the first kind has more than one of the other (Mann & Whitney's statistic). It is
    the score interval of Newcombe (2006, Statistics in Medicine 25, 559, method 5), in which runs
    and not pairs are independent, so that it has a width even if all pairs agree. `count` is the
    number of runs of the smaller kind.
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


def certain(difference: ArrayLike, low: ArrayLike, high: ArrayLike, count: ArrayLike):
    """Which of many differences are nonzero, at 5 % for all of them together (Holm 1979).

    Each has its 95 % interval by Student's t and its number of realizations.
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


def slopes(x: ArrayLike, values: ArrayLike) -> NDArray[np.float64]:
    """Least-squares slope of each realization against log2(x): the change per doubling of x.

    Values, shape (seed, x), may be NaN; the slope of fewer than two is NaN.
    """
    octaves = np.log2(np.asarray(x, dtype=float))
    found = []
    for row in np.asarray(values, dtype=float):
        valid = np.isfinite(row)
        if np.unique(octaves[valid]).size < 2:
            found.append(np.nan)
            continue
        offset = octaves[valid] - octaves[valid].mean()
        # less the first value, so that equal values have a slope of exactly zero
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


BETTER, WITHIN_MARGIN = "better", "not worse within the margin"
WORSE, NOT_DECIDED = "worse", "not decided"


def non_inferiority(gain: Interval, margin: float) -> str:
    """Whether one sample is better than another, not worse by more than a margin, or worse.

    Parameters
    ----------
    gain : Interval
        By how much it is better, with its 95 % interval: a difference, or the logarithm of a ratio.
    margin : float
        Largest loss that still counts as none, positive and in the unit of `gain`.

    Returns
    -------
    str
        `BETTER` if the whole interval is a gain; `WITHIN_MARGIN` if none of it is a loss beyond
        the margin, which is a one-sided test of non-inferiority at 2.5 % (ICH E9, section 3.3.2,
        1998); `WORSE` if the whole interval is a loss that may be beyond the margin; otherwise
        `NOT_DECIDED`, also without an interval.
    """
    if gain.low > 0.0:
        return BETTER
    if gain.low > -margin:
        return WITHIN_MARGIN
    return WORSE if gain.high < 0.0 else NOT_DECIDED
