"""Tree-structured Parzen estimator (TPE), compiled: Hyperopt's algorithm, many times faster.

Bergstra et al. (2011) model every label by two densities, one of the good trials and one of the
others. The next trial has the value, among some samples of the first density, with the largest
ratio of the two. This module is Hyperopt 0.2.7's ``tpe.suggest`` with its own settings: `STARTUP`
random trials, then the ``ceil(0.25 sqrt(n))`` best of n trials (at most `_MOST_GOOD`) against the
others, with `CANDIDATES` samples for each label. The density of an interval is a mixture of
normals, one for each trial and one for the prior, each as wide as the larger gap to its neighbors;
that of a category is a count. Trials before the last `_REMEMBERED` have less weight, linearly. The
random numbers differ from Hyperopt's, and ties in the loss go to the older trial on every machine.
"""

from bisect import insort_right

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import njit

Array = NDArray[np.float64]

STARTUP = 20
CANDIDATES = 24
_REMEMBERED = 25
_GOOD_SHARE = 0.25
_MOST_GOOD = 25

_LEAST_SHARE = 100.0  # largest ratio of the prior's width to that of a component
_REACH = 9.0  # deviations beyond which a narrow component contributes less than 1e-16


@njit(cache=True)
def forgetting_weights(number):
    """Weights of a number of trials, oldest first: a linear ramp up to the last ones."""
    weights = np.ones(number)
    ramp = number - _REMEMBERED
    for i in range(ramp):
        share = i / (ramp - 1) if ramp > 1 else 0.0
        weights[i] = 1.0 / number + share * (1.0 - 1.0 / number)
    return weights


@njit(cache=True)
def parzen_window(values, weights, low, high):
    """Weights, means and deviations of the mixture over an interval, in ascending order of the
    means. `values` (n,) are ascending, with their `weights`; the prior is a further component of
    weight 1."""
    n = values.size
    prior, wide = 0.5 * (high + low), high - low
    at = 0
    while at < n and (values[at] < prior or (n == 1 and values[at] == prior)):
        at += 1
    mean, share = np.empty(n + 1), np.empty(n + 1)
    mean[:at], mean[at], mean[at + 1 :] = values[:at], prior, values[at:]
    share[:at], share[at], share[at + 1 :] = weights[:at], 1.0, weights[at:]
    deviation = np.empty(n + 1)
    narrow = wide / min(_LEAST_SHARE, n + 2.0)
    for i in range(n + 1):
        if n == 1:
            gap = 0.5 * wide
        else:
            gap = 0.0
            if i > 0:
                gap = mean[i] - mean[i - 1]
            if i < n:
                gap = max(gap, mean[i + 1] - mean[i])
        deviation[i] = min(max(gap, narrow), wide)
    deviation[at] = wide
    return share / share.sum(), mean, deviation


@njit(cache=True)
def mixture(share, mean, deviation):
    """A mixture for `mixture_density`: heights, means, inverse deviations, the largest of these,
    and the wider components. Most components of many trials have the least width; the others are
    listed."""
    least = deviation.min()
    return share / deviation, mean, 1.0 / deviation, 1.0 / least, np.flatnonzero(deviation > least)


@njit(cache=True)
def mixture_density(x, height, mean, inverse, steepest, wider):
    """Density of a mixture at x, except for a factor common to the two mixtures of a label. Narrow
    components contribute only near x."""
    total = 0.0
    first = np.searchsorted(mean, x - _REACH / steepest)
    last = np.searchsorted(mean, x + _REACH / steepest)
    for i in range(first, last):
        away = (x - mean[i]) * steepest
        if inverse[i] == steepest:
            total += height[i] * np.exp(-0.5 * away * away)
    for i in wider:
        away = (x - mean[i]) * inverse[i]
        total += height[i] * np.exp(-0.5 * away * away)
    return total


@njit(cache=True, fastmath={"reassoc", "contract"})
def _least_density(x, height, mean, inverse, steepest, wider):
    """Lower bound of `mixture_density`, without exponential functions: (1 - z / 64)^64 <= exp(-z)
    for z < 64. It vectorizes; the order of the sum and rounding are within the factor at the end.
    """
    total = 0.0
    first = np.searchsorted(mean, x - _REACH / steepest)
    last = np.searchsorted(mean, x + _REACH / steepest)
    for i in range(first, last):
        away = (x - mean[i]) * steepest
        near = 1.0 - away * away / 128.0
        for _ in range(6):
            near *= near
        total += height[i] * near if inverse[i] == steepest else 0.0
    for i in wider:
        away = (x - mean[i]) * inverse[i]
        near = max(0.0, 1.0 - away * away / 128.0)
        for _ in range(6):
            near *= near
        total += height[i] * near
    return total * (1.0 - 1e-9)


@njit(cache=True)
def _pick(cumulative, rng):
    """Random index with probabilities given by their cumulative sum."""
    index = np.searchsorted(cumulative, rng.random() * cumulative[-1], side="right")
    return min(index, cumulative.size - 1)


@njit(cache=True)
def _best_in_interval(good, rest, low, high, rng):
    """Sample of the density of the good trials with the largest ratio to that of the others."""
    cumulative, above, below = np.cumsum(good[0]), mixture(*good), mixture(*rest)
    best, best_ratio = low, -1.0
    for _ in range(CANDIDATES):
        while True:
            i = _pick(cumulative, rng)
            x = good[1][i] + good[2][i] * rng.standard_normal()
            if low <= x < high:
                break
        density = mixture_density(x, *above)
        if density <= best_ratio * _least_density(x, *below):
            continue
        ratio = density / mixture_density(x, *below)
        if ratio > best_ratio:
            best, best_ratio = x, ratio
    return best


@njit(cache=True)
def _best_category(good, rest, rng):
    """Sampled category with the largest ratio of pseudo-counts."""
    cumulative = np.cumsum(good)
    best, best_ratio = 0, -1.0
    for _ in range(CANDIDATES):
        i = _pick(cumulative, rng)
        ratio = good[i] / rest[i]
        if ratio > best_ratio:
            best, best_ratio = i, ratio
    return float(best)


@njit(cache=True)
def _suggest(n, values, by_value, by_loss, low, high, categories, rng):
    """The next trial, shape (label,), given the first n of the `values` (label, trial). `by_value`
    (label, trial) sorts them by value, `by_loss` lists the best trials, best first."""
    labels = low.size
    n_good = min(int(np.ceil(_GOOD_SHARE * np.sqrt(n))), _MOST_GOOD)
    is_good = np.zeros(n, np.bool_)
    is_good[by_loss[:n_good]] = True
    weight, age = np.ones(n), 0
    ramp = forgetting_weights(n - n_good)
    for i in range(n):
        if not is_good[i]:
            weight[i] = ramp[age]
            age += 1
    found = np.empty(labels)
    for j in range(labels):
        if categories[j] > 0:
            good, rest = np.ones(categories[j]), np.ones(categories[j])
            for i in range(n):
                counted = good if is_good[i] else rest
                counted[int(values[j, i])] += weight[i]
            found[j] = _best_category(good / good.sum(), rest / rest.sum(), rng)
            continue
        # the good trials from the left, and the others from the right
        value, share, others, left = np.empty(n), np.empty(n), n, 0
        for i in by_value[j, :n][::-1]:
            if not is_good[i]:
                others -= 1
                value[others], share[others] = values[j, i], weight[i]
        for i in by_value[j, :n]:
            if is_good[i]:
                value[left], share[left] = values[j, i], weight[i]
                left += 1
        found[j] = _best_in_interval(
            parzen_window(value[:left], share[:left], low[j], high[j]),
            parzen_window(value[left:], share[left:], low[j], high[j]),
            low[j],
            high[j],
            rng,
        )
    return found


class ParzenSearch:
    """Sequential search that suggests trials and receives their losses; a smaller loss is better.
    Labels are intervals from `low` to `high` (label,), or have `categories` 0, 1, ... (label,), 0
    for an interval."""

    def __init__(
        self, low: ArrayLike, high: ArrayLike, categories: ArrayLike, rng: np.random.Generator
    ) -> None:
        self._low, self._high = (np.array(each, dtype=np.float64) for each in (low, high))
        self._categories = np.array(categories, dtype=np.int64)
        self._rng = rng
        self._trials = 0
        self._values = np.empty((self._low.size, 256))
        self._by_value = np.empty((self._low.size, 256), dtype=np.int64)
        self._by_loss: list[int] = []
        self._losses: list[float] = []

    def suggest(self) -> Array:
        """The next trial, shape (label,)."""
        n = self._trials
        if n < STARTUP:
            sample = self._low + (self._high - self._low) * self._rng.random(self._low.size)
            return np.where(self._categories > 0, np.floor(sample), sample)
        return _suggest(
            n,
            self._values,
            self._by_value,
            np.array(self._by_loss[:_MOST_GOOD]),
            self._low,
            self._high,
            self._categories,
            self._rng,
        )

    def tell(self, values: ArrayLike, loss: float) -> None:
        """Add a trial, shape (label,), with its loss."""
        n = self._trials
        if n == self._values.shape[1]:
            self._values = np.concatenate([self._values, np.empty_like(self._values)], axis=1)
            room = np.empty_like(self._by_value)
            self._by_value = np.concatenate([self._by_value, room], axis=1)
        _insert(self._values, self._by_value, n, np.asarray(values, dtype=np.float64))
        self._losses.append(float(loss))
        # trials of equal loss keep their order
        insort_right(self._by_loss, n, key=self._losses.__getitem__)
        self._trials = n + 1


@njit(cache=True)
def _insert(values, by_value, n, new):
    """Add the n-th trial and update the sorted order of all labels."""
    for j in range(new.size):
        values[j, n] = new[j]
        at = n
        while at > 0 and values[j, by_value[j, at - 1]] > new[j]:
            by_value[j, at] = by_value[j, at - 1]
            at -= 1
        by_value[j, at] = n
