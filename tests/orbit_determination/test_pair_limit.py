"""Pairs of the tracklets of objects that fly in a group."""

import numpy as np
import pytest
from nights import OBJECTS, night

from cislunar.dynamics import propagate
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import AdmissibleRegion, attributables, pair_starts
from cislunar.orbit_determination.pairs import PairSettings, pairs_within

GROUP, HOURS = 6, [0.0, 1.0, 2.0]


def group_of_tracklets():
    """Tracklets of objects a hundred meters from each other."""
    apart = 2.6e-7 * np.arange(GROUP)[:, None] * np.array([1.0, 0.5, 0.2, 0.0, 0.0, 0.0])
    angles, origin = night(OBJECTS[0] + apart, HOURS, 0.0, seed=4)
    rows = [
        np.flatnonzero((angles.observer == o) & (origin == k)).reshape(-1, 2)
        for o in range(3)
        for k in range(GROUP)
    ]
    return attributables(angles, list(np.concatenate(rows)))


def test_the_starts_with_the_smallest_residuals_of_each_tracklet_remain():
    tracklets, region = group_of_tracklets(), AdmissibleRegion()
    pairs = pairs_within(tracklets, 8.0, 0.0, tracklets.time.size)
    every = pair_starts(tracklets, pairs, region, PairSettings(most_starts=10**6))
    few = pair_starts(tracklets, pairs, region, PairSettings(most_starts=4))
    numbers = np.bincount(every.first)
    assert numbers.max() > 4 and few.first.size < every.first.size
    for t in np.unique(every.first).tolist():
        own = np.flatnonzero(every.first == t)
        kept = np.sort(own[np.argsort(every.cost[own], kind="stable")[:4]])
        there = few.first == t
        np.testing.assert_array_equal(few.second[there], every.second[kept])
        np.testing.assert_array_equal(few.state[there], every.state[kept])
        np.testing.assert_array_equal(few.cost[there], every.cost[kept])


def test_starts_do_not_depend_on_the_order_of_the_pairs():
    tracklets, region = group_of_tracklets(), AdmissibleRegion()
    pairs = pairs_within(tracklets, 8.0, 0.0, tracklets.time.size)
    few = PairSettings(most_starts=4)
    usual = pair_starts(tracklets, pairs, region, few)
    other = pair_starts(tracklets, pairs[np.argsort(pairs[:, 1], kind="stable")], region, few)
    order = np.argsort(other.first, kind="stable")
    np.testing.assert_array_equal(other.first[order], usual.first)
    np.testing.assert_array_equal(other.state[order], usual.state)
    for wrong, words in (([[0, 999]], "pairs: 999 must be"), ([[3, 3]], "earlier tracklet of")):
        with pytest.raises(ConfigurationError, match=words):
            pair_starts(tracklets, wrong, region)


def test_fewer_starts_than_the_limit_are_all_there():
    tracklets, region = group_of_tracklets(), AdmissibleRegion()
    pairs = pairs_within(tracklets, 8.0, 0.0, tracklets.time.size)
    usual = pair_starts(tracklets, pairs, region)
    every = pair_starts(tracklets, pairs, region, PairSettings(most_starts=10**6))
    assert np.bincount(every.first).max() <= PairSettings().most_starts
    for one, other in zip(usual, every, strict=True):
        np.testing.assert_array_equal(one, other)
    truth = propagate(OBJECTS[0], [usual.time[0]])[0]
    assert np.min(np.linalg.norm(usual.state - truth, axis=1)) < 0.05
