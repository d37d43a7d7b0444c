"""GOSPA against the definition by enumeration, and the parts of a catalog's quality."""

from itertools import combinations, permutations

import numpy as np
import pytest

from cislunar.errors import ConfigurationError
from cislunar.evaluation.gospa import FALSE_ALARM, catalog_quality, gospa


def by_definition(true, found, c, p):
    """The least cost over all partial assignments (Rahmathullah et al. 2017, proposition 1)."""
    best = np.inf
    for size in range(min(len(true), len(found)) + 1):
        for some in combinations(range(len(true)), size):
            for others in permutations(range(len(found)), size):
                pairs = sum(
                    min(np.linalg.norm(true[i] - found[j]), c) ** p
                    for i, j in zip(some, others, strict=True)
                )
                unassigned = len(true) + len(found) - 2 * size
                best = min(best, pairs + c**p / 2.0 * unassigned)
    return best ** (1.0 / p)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("order", [1.0, 2.0])
def test_gospa_is_the_least_cost_of_all_assignments(seed, order):
    rng = np.random.default_rng(seed)
    true = rng.normal(size=(rng.integers(0, 5), 3))
    found = rng.normal(size=(rng.integers(0, 5), 3))
    made = gospa(true, found, 1.3, order)
    assert made.distance == pytest.approx(by_definition(true, found, 1.3, order), rel=1e-12)
    whole = made.localization + made.missed + made.false
    assert made.distance**order == pytest.approx(whole, rel=1e-12)
    assert made.n_missed == len(true) - made.target.size
    assert made.n_false == len(found) - made.track.size


def test_every_missed_target_counts():
    """Which OSPA hides, since it divides by the number of targets."""
    true = np.zeros((10, 3)) + np.arange(10)[:, None] * 100.0
    costs = [gospa(true, true[:n], 10.0).distance for n in range(11)]
    np.testing.assert_allclose(costs, np.sqrt(50.0 * np.arange(10, -1, -1)))


def test_parts_of_a_catalog():
    found = catalog_quality(
        track=[1, 1, 1, 2, 2, 3, 3], origin=[0, 0, 1, 0, 0, FALSE_ALARM, FALSE_ALARM]
    )
    assert found.purity == pytest.approx(4 / 7)
    assert found.wrong_associations == 3
    assert (found.false_tracks, found.fragments) == (1, 2.0)


def test_a_track_half_of_false_alarms_belongs_to_its_target():
    found = catalog_quality([0, 0, 1, 1], [FALSE_ALARM, 3, 3, 2])
    assert (found.purity, found.wrong_associations, found.false_tracks) == (0.5, 2, 0)


@pytest.mark.parametrize(
    "change, words",
    [({"cutoff": 0.0}, "cutoff = 0"), ({"order": 0.5}, "order = 0.5"),
     ({"order": np.inf}, "order = inf"), ({"tracks": [1.0, 0.0]}, r"shapes \(1, 2\) and \(2,\)"),
     ({"targets": [[np.nan, 0.0]]}, "not finite")],
)  # fmt: skip
def test_impossible_arguments_are_one_line(change, words):
    given = {"targets": [[0.0, 0.0]], "tracks": [[1.0, 0.0]], "cutoff": 1.0} | change
    with pytest.raises(ConfigurationError, match=words):
        gospa(**given)
