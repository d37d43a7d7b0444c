"""GOSPA and its parts against Stone Soup."""

from datetime import datetime

import numpy as np
import pytest
from stonesoup.metricgenerator.ospametric import GOSPAMetric
from stonesoup.types.state import State

from cislunar.evaluation.gospa import gospa

SIZES = [(0, 3), (3, 0), (1, 1), (2, 5), (5, 2), (4, 4), (7, 6)]
CUTOFF = 1.1


def states(positions):
    return [State(each, timestamp=datetime(2030, 1, 1)) for each in positions]


def assert_equal(true, found, order):
    own = gospa(true, found, CUTOFF, order)
    peer = GOSPAMetric(p=order, c=CUTOFF)
    metric, tracks = peer.compute_gospa_metric(states(found), states(true))
    value = metric.value
    assert own.distance == pytest.approx(value["distance"], rel=1e-12)
    assert own.localization == pytest.approx(value["localisation"], rel=1e-12, abs=1e-14)
    assert own.missed == pytest.approx(value["missed"], rel=1e-12)
    assert own.false == pytest.approx(value["false"], rel=1e-12)
    half = 0.5 * CUTOFF**order
    assert own.n_missed == round(value["missed"] / half)
    assert own.n_false == round(value["false"] / half)
    pairs = [(i, int(j)) for i, j in enumerate(tracks) if j >= 0]
    assert list(zip(own.target.tolist(), own.track.tolist(), strict=True)) == pairs


@pytest.mark.parametrize("order", [1.0, 2.0, 3.5])
@pytest.mark.parametrize("n, m", SIZES)
@pytest.mark.parametrize("seed", range(5))
def test_gospa_and_its_parts_are_those_of_stone_soup(seed, n, m, order):
    rng = np.random.default_rng([seed, n, m])
    assert_equal(rng.normal(size=(n, 3)), rng.normal(size=(m, 3)), order)


@pytest.mark.parametrize("order", [1.0, 2.0])
def test_a_pair_at_the_cutoff_is_a_missed_target_and_a_false_track(order):
    assert_equal(np.zeros((1, 3)), np.array([[CUTOFF, 0.0, 0.0]]), order)
    assert_equal(np.zeros((1, 3)), np.array([[np.nextafter(CUTOFF, 0.0), 0.0, 0.0]]), order)


def test_empty_sets_have_no_distance():
    """Which Stone Soup refuses, for want of a time."""
    assert gospa(np.zeros((0, 3)), np.zeros((0, 3)), CUTOFF)[:6] == (0.0, 0.0, 0.0, 0.0, 0, 0)
