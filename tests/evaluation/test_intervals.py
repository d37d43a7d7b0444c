"""Intervals over days, contrasts of two samples, and tests of non-inferiority."""

import numpy as np
import pytest
from scipy import stats

from cislunar.campaign.tracking.comparisons import non_inferiority
from cislunar.evaluation.intervals import (
    Interval,
    contrast_interval,
    count_interval,
    interval_of,
    log_interval,
    share_interval,
    t_interval,
)


def test_the_mean_of_anees_is_arithmetic_and_that_of_geometric_errors_geometric():
    values = [1.0, 4.0, 100.0]
    assert interval_of("anees_mean", values, 20).mean == pytest.approx(35.0)
    assert interval_of("anees_median", values, 20) == t_interval(values)._replace(low=0.0)
    for name in ("final_error_geometric_all", "rmse_geometric_all", "bound_ratio_median"):
        assert interval_of(name, values, 20) == log_interval(values)
        assert interval_of(name, values, 20).mean == pytest.approx(stats.gmean(values))


def test_intervals_over_days_are_those_of_the_means_of_the_days():
    rng = np.random.default_rng(2)
    days = rng.lognormal(0.0, 0.3, (5, 1)) * rng.lognormal(0.0, 0.1, (5, 4))
    label = np.repeat(["", "day3", "day6", "day9", "day12"], 4)
    mean = days.mean(axis=1)
    low, high = stats.t.interval(0.95, 4, mean.mean(), stats.sem(mean))
    found = t_interval(days.ravel(), label)
    assert found == pytest.approx((mean.mean(), low, high, 5))
    geometric = log_interval(days.ravel(), label)
    logs = np.log(days).mean(axis=1)
    wanted = np.exp([logs.mean(), *stats.t.interval(0.95, 4, logs.mean(), stats.sem(logs))])
    assert geometric[:3] == pytest.approx(tuple(wanted))
    # a realization for each day is the case without groups, in any order and bit for bit
    single = days[:, 0]
    assert t_interval(single, label[::4]) == t_interval(single) == t_interval(single, np.arange(5))
    # unequal numbers: every day counts once, and a day without finite values not at all
    assert t_interval([1.0, 1.0, 1.0, 4.0, np.nan], [0, 0, 0, 1, 2])[0::3] == (2.5, 2)
    # exact floors of counts and shares hold for all realizations
    none = count_interval(np.zeros(20), label)
    assert (none.high, none.count) == (pytest.approx(-np.log(0.025) / 20.0), 5)
    assert share_interval(np.ones(20), 50, label).low == pytest.approx(0.025 ** (1 / 1000))
    hits = rng.binomial(50, np.repeat(rng.uniform(0.2, 0.8, 5), 4)) / 50
    wide = share_interval(hits, 50, label)
    assert wide[:3] == pytest.approx(t_interval(hits.reshape(5, 4).mean(axis=1))[:3])


def test_intervals_over_days_cover_the_mean_where_realizations_of_a_day_are_correlated():
    """Ten days with four realizations each, of intraclass correlation 0.9."""
    rng = np.random.default_rng(8)
    runs, days, each, rho = 4000, 10, 4, 0.9
    values = np.sqrt(rho) * rng.normal(size=(runs, days, 1))
    values = 2.0 + values + np.sqrt(1.0 - rho) * rng.normal(size=(runs, days, each))
    label = np.repeat(np.arange(days), each)

    def inside(groups):
        found = [t_interval(own.ravel(), groups) for own in values]
        return sum(own.low <= 2.0 <= own.high for own in found)

    assert stats.binomtest(inside(label), runs, 0.95).pvalue > 1e-3
    # realizations that count as independent would cover it in 70 % only
    assert inside(None) < 0.75 * runs


def test_quantities_with_a_sign_are_not_cut_at_zero():
    values = [-1.1, -0.9, -1.0, -1.02]
    found = interval_of("difference", values, 20)
    assert found == t_interval(values) and found.low < found.mean < found.high < 0.0


def test_contrasts_are_those_of_scipy():
    rng = np.random.default_rng(3)
    day = rng.normal(0.0, 1.0, 10)
    one, other = day + rng.normal(0.3, 0.1, 10), day + rng.normal(0.0, 0.1, 10)
    paired = contrast_interval(one, other)
    wanted = stats.ttest_rel(one, other).confidence_interval(0.95)
    assert paired == pytest.approx((np.mean(one - other), wanted.low, wanted.high, 10))
    ratio = contrast_interval(np.exp(one), np.exp(other), logarithmic=True)
    assert ratio[:3] == pytest.approx(tuple(np.exp(paired[:3])))
    # days of their own: independent samples
    apart = contrast_interval(one, np.append(other[:6], [np.nan] * 4))
    wanted = stats.ttest_ind(one, other[:6], equal_var=False).confidence_interval(0.95)
    assert apart[1:] == pytest.approx((wanted.low, wanted.high, 6))
    assert np.isnan(contrast_interval([1.0], [2.0]).low)
    assert contrast_interval([1.0], [2.0]).mean == -1.0


def test_non_inferiority_has_four_outcomes():
    def judged(low, high):
        return non_inferiority(Interval(0.5 * (low + high), low, high, 10), 0.03)

    assert judged(0.01, 0.5) == "better"
    assert judged(-0.02, 0.5) == judged(-0.02, -0.01) == "not worse within the margin"
    assert judged(-0.05, -0.01) == judged(-0.5, -0.4) == "worse"
    assert judged(-0.05, 0.01) == judged(np.nan, np.nan) == "not decided"


def test_the_chance_of_calling_a_loss_of_the_margin_none_is_a_fortieth():
    """The size of the test of non-inferiority, paired, at a true loss of just the margin."""
    rng = np.random.default_rng(9)
    day = rng.normal(0.9, 0.05, (4000, 10))
    own = day - 0.03 + rng.normal(0.0, 0.02, day.shape)
    passed = sum(
        non_inferiority(contrast_interval(*pair), 0.03) in ("better", "not worse within the margin")
        for pair in zip(own, day, strict=True)
    )
    assert stats.binomtest(passed, 4000, 0.025).pvalue > 1e-3
