"""Intervals of realizations, and comparisons between them."""

import numpy as np
import pytest
from scipy import stats

from cislunar.campaign.tracking.comparisons import certain, pairs_interval, slopes
from cislunar.evaluation.intervals import (
    count_interval,
    interval_of,
    log_interval,
    prediction_interval,
    share_interval,
    t_interval,
)


def test_intervals_are_those_of_scipy():
    values = np.random.default_rng(1).normal(3.0, 1.0, 12)
    found = t_interval([*values, np.nan])
    low, high = stats.t.interval(0.95, 11, values.mean(), stats.sem(values))
    assert (found.mean, found.low, found.high) == pytest.approx((values.mean(), low, high))
    assert found.count == 12 and found.above_zero and not found.below_zero
    single = t_interval([2.0])
    assert single.mean == 2.0 and np.isnan(single.low) and not single.above_zero
    assert np.isnan(t_interval([]).mean)
    geometric = log_interval(np.exp(values))
    assert geometric.low == pytest.approx(np.exp(low))
    assert log_interval([0.0, np.nan]).count == 0


def test_counts_have_exact_intervals():
    none = count_interval(np.zeros(10))
    assert (none.low, none.high) == (0.0, pytest.approx(-np.log(0.025) / 10.0))
    # Poisson's: the chance of as many or more, or of as few or fewer, is a fortieth at the ends
    same = count_interval(np.full(6, 2.0))
    assert stats.poisson.sf(11, 6 * same.low) == pytest.approx(0.025)
    assert stats.poisson.cdf(12, 6 * same.high) == pytest.approx(0.025)
    wild = [0.0, 40.0, 2.0, 90.0]
    assert count_interval(wild).high == t_interval(wild).high and count_interval(wild).low == 0.0


def test_shares_of_targets_have_exact_intervals():
    """As SciPy's own Clopper and Pearson, where realizations agree; never narrower than that."""
    for share in (0.0, 0.05, 1.0):
        found = interval_of("custody_share", np.full(10, share), 20)
        exact = stats.binomtest(round(200 * share), 200).proportion_ci(0.95, "exact")
        np.testing.assert_allclose(found[:3], (share, exact.low, exact.high), atol=1e-12)
    wild = [0.3, 0.7, 0.4, 0.5]
    assert share_interval(wild, 20)[1:3] == pytest.approx(t_interval(wild)[1:3])


def test_pairs_of_runs_have_the_score_interval():
    """Ends by Hanley and McNeil's variance; the true share lies within as often as said."""
    rng = np.random.default_rng(6)
    found = pairs_interval(rng.normal(1.2, 1.0, 20), rng.normal(size=20))
    for end in (found.low, found.high):
        one, two = end / (2.0 - end), 2.0 * end**2 / (1.0 + end)
        variance = end * (1.0 - end) + 19.0 * (one + two - 2.0 * end**2)
        limit = stats.norm.ppf(0.975) ** 2 * variance / 400.0
        assert (found.mean - end) ** 2 == pytest.approx(limit)
    truth = stats.norm.cdf(1.2 / np.sqrt(2.0))
    several = [pairs_interval(rng.normal(1.2, 1.0, 20), rng.normal(size=20)) for _ in range(600)]
    assert 0.93 <= np.mean([own.low <= truth <= own.high for own in several]) <= 0.98
    apart = pairs_interval(np.arange(20) + 50.0, np.arange(20))
    assert apart.mean == apart.high == 1.0 and 0.89 < apart.low < 0.91
    turned = pairs_interval(-np.arange(20.0), 1.0 + np.arange(20))
    assert (turned.mean, turned.low, turned.high) == pytest.approx((0.0, 0.0, 1.0 - apart.low))
    equal = pairs_interval([2.0, 3.0], [2.0 + 1e-12, 3.0])
    assert equal.mean == 0.5 and equal.low + equal.high == pytest.approx(1.0)


def test_nothing_impossible_is_within_an_interval():
    shares = [1.0, 1.0, 0.9, 1.0]
    assert interval_of("coverage", shares, 20).high == 1.0 < t_interval(shares).high
    assert interval_of("final_coverage", shares, 20).high == 1.0
    assert interval_of("custody_share", [0.0, 0.0, 0.1], 20).low >= 0.0
    assert interval_of("valid_fraction", [0.0, 0.0, 0.1], 20).low == 0.0
    assert interval_of("rmse_median", [0.0, 0.0, 9.0], 20).low == 0.0


def test_one_more_run_lies_where_it_is_predicted():
    rng = np.random.default_rng(4)
    runs = rng.normal(3.0, 2.0, (4000, 6))
    found = [prediction_interval(own[:-1]) for own in runs]
    inside = [one.low <= own[-1] <= one.high for one, own in zip(found, runs, strict=True)]
    assert stats.binomtest(sum(inside), len(inside), 0.95).pvalue > 1e-3


def test_many_differences_are_judged_together():
    rng = np.random.default_rng(3)
    values = rng.normal(0.0, 1.0, (40, 10)) + np.r_[3.0, np.zeros(39)][:, None]
    found = [t_interval(row) for row in values]
    mean, low, high, count = np.array(found).T
    p = stats.ttest_1samp(values, 0.0, axis=1).pvalue
    expected = np.zeros(40, dtype=bool)
    for rank, at in enumerate(np.argsort(p)):
        if p[at] > 0.05 / (40 - rank):
            break
        expected[at] = True
    np.testing.assert_array_equal(certain(mean, low, high, count), expected)
    assert expected[0] and expected.sum() < sum(
        each.above_zero or each.below_zero for each in found
    )
    assert not certain([0.0, np.nan], [0.0, np.nan], [0.0, np.nan], [5, 0]).any()


def test_slopes_are_per_doubling_and_skip_gaps():
    x = np.array([20, 40, 80])
    values = [[1.0, 3.0, 5.0], [0.0, np.nan, 2.0], [np.nan, np.nan, 1.0]]
    np.testing.assert_allclose(slopes(x, values), [2.0, 1.0, np.nan])
