"""k-means clustering, against brute force and its optimality conditions."""

from itertools import product

import numpy as np
import pytest
import sklearn.cluster
from scipy.spatial.distance import cdist

from cislunar.errors import ConfigurationError
from cislunar.targets import clustering
from cislunar.targets.clustering import DEFAULT_SEEDING, SEEDINGS, cluster, distinct_points
from cislunar.targets.sampling import SamplingSettings, sample_zero_velocity

COARSE = SamplingSettings(angular_step_deg=30.0, radial_points=5)


@pytest.fixture(scope="module")
def sampled():
    return sample_zero_velocity([2.91, 3.0466, 3.0466, 3.4, 5.49, 5.49, 5.49], COARSE)


@pytest.mark.parametrize("seeding", SEEDINGS)
@pytest.mark.parametrize("n_clusters", [1, 7, 100])
def test_result_is_a_fixed_point_of_lloyds_iteration(sampled, n_clusters, seeding):
    result = cluster(sampled.position, n_clusters, seed=3, seeding=seeding)
    distance2 = cdist(sampled.position, result.center, "sqeuclidean")
    assert result.center.shape == (n_clusters, 3)
    np.testing.assert_array_equal(result.members, np.bincount(result.label, minlength=n_clusters))
    assert result.members.min() > 0
    own = distance2[np.arange(len(distance2)), result.label]
    assert result.inertia == pytest.approx(own.sum(), rel=1e-9)
    # The rounds end when the centers hardly move, so a few points may be about to change sides.
    assert own.sum() == pytest.approx(distance2.min(axis=1).sum(), rel=1e-3)
    for index in range(n_clusters):
        mean = sampled.position[result.label == index].mean(axis=0)
        np.testing.assert_allclose(result.center[index], mean, atol=1e-12)


def test_best_of_many_seeds_is_the_global_optimum_of_a_small_problem():
    """Every way of splitting eight weighted points into two clusters, by brute force."""
    rng = np.random.default_rng(5)
    points = rng.normal(size=(8, 3))
    repeated = np.repeat(points, [1, 4, 1, 2, 1, 1, 3, 1], axis=0)
    owner = np.repeat(np.arange(8), [1, 4, 1, 2, 1, 1, 3, 1])
    best = np.inf
    for split in product([0, 1], repeat=8):
        side = np.array(split)[owner]
        if 0 < side.sum() < len(side):
            parts = [repeated[side == s] for s in (0, 1)]
            best = min(best, sum(((p - p.mean(axis=0)) ** 2).sum() for p in parts))
    found = min(cluster(repeated, 2, seed=seed).inertia for seed in range(20))
    assert found == pytest.approx(best, rel=1e-12)


def test_repeated_points_weigh_more():
    points = np.array([[0.0, 0, 0], [1.0, 0, 0], [10.0, 0, 0]])
    result = cluster(np.repeat(points, [1, 3, 1], axis=0), 2, seed=0)
    order = np.argsort(result.center[:, 0])
    np.testing.assert_allclose(result.center[order, 0], [0.75, 10.0], atol=1e-14)
    np.testing.assert_array_equal(result.members[order], [4, 1])


def test_as_many_clusters_as_distinct_points(sampled):
    points = distinct_points(sampled.position)[0][::40]
    result = cluster(np.concatenate([points, points]), len(points), seed=0)
    np.testing.assert_array_equal(result.members, 2)
    assert result.inertia == pytest.approx(0.0, abs=1e-20)
    assert {tuple(c) for c in np.round(result.center, 9)} == {tuple(p) for p in np.round(points, 9)}


def test_distinct_points_and_their_weights():
    points, weight, inverse = distinct_points([[1.0, 0, 0], [0.0, 0, 0], [1.0, 0, 0]])
    np.testing.assert_array_equal(points, [[0.0, 0, 0], [1.0, 0, 0]])
    np.testing.assert_array_equal(weight, [1.0, 2.0])
    np.testing.assert_array_equal(inverse, [1, 0, 1])


def test_no_cluster_stays_empty_from_a_bad_start():
    """A start with centers that no point is nearest to."""
    rng = np.random.default_rng(2)
    points = rng.normal(size=(60, 3))
    start = np.array([[0.0, 0, 0], [1e3, 0, 0], [2e3, 0, 0]])
    label = clustering._lloyd(points, np.ones(60), start, lambda done, total: None)
    assert np.bincount(label, minlength=3).min() > 0


def test_cluster_left_empty_by_the_last_round_is_filled_again(monkeypatch):
    """The last assignment of scikit-learn may leave a cluster without points."""
    starts = []

    class Robbing(sklearn.cluster.KMeans):
        def fit(self, *args, **kwargs):
            starts.append(np.array(self.init))
            super().fit(*args, **kwargs)
            if len(starts) == 1:
                self.labels_ = np.where(self.labels_ == 1, 0, self.labels_)
            return self

    monkeypatch.setattr(sklearn.cluster, "KMeans", Robbing)
    rng = np.random.default_rng(2)
    points = np.concatenate([rng.normal(size=(20, 3)) + offset for offset in (0.0, 50.0, 100.0)])
    label = clustering._lloyd(points, np.ones(60), points[[0, 20, 40]], lambda done, total: None)
    assert len(starts) == 2
    assert np.any(np.all(points == starts[1][1], axis=1)), "the empty center moves to a point"
    assert np.bincount(label, minlength=3).min() > 0


def test_same_seed_same_clusters(sampled):
    first = cluster(sampled.position, 50, seed=9)
    second = cluster(sampled.position, 50, seed=9)
    np.testing.assert_array_equal(first.center, second.center)
    other = cluster(sampled.position, 50, seed=10)
    assert not np.array_equal(first.center, other.center)


def test_comparison_of_seedings():
    """Few widely distributed points and a dense cluster, as the Moon's lobe is."""
    rng = np.random.default_rng(6)
    crowd = rng.normal(size=(3000, 3)) * 0.01
    wide = rng.uniform(-1.0, 1.0, size=(600, 3))
    points = np.concatenate([crowd, wide])
    inertia = {name: cluster(points, 60, seed=1, seeding=name).inertia for name in SEEDINGS}
    assert inertia[DEFAULT_SEEDING] == cluster(points, 60, seed=1).inertia
    # A random draw puts most centers into the crowd.
    assert inertia["random"] > 1.5 * inertia[DEFAULT_SEEDING]
    assert 0.7 < inertia["k-means++"] / inertia[DEFAULT_SEEDING] < 1.4


@pytest.mark.parametrize("n_clusters", [0, -1, 5, 2.0, True, "3", None])
def test_impossible_numbers_of_clusters_are_refused(n_clusters):
    points = np.repeat(np.eye(4, 3), 3, axis=0)
    with pytest.raises(ConfigurationError, match="targets"):
        cluster(points, n_clusters, seed=0)


@pytest.mark.parametrize("points", [np.empty((0, 3)), [[np.nan, 0.0, 0.0]], [1.0, 2.0]])
def test_unusable_points_are_refused(points):
    with pytest.raises(ConfigurationError, match="targets"):
        cluster(points, 1, seed=0)


def test_unknown_seeding_is_refused(sampled):
    with pytest.raises(ConfigurationError, match="seeding"):
        cluster(sampled.position, 3, seed=0, seeding="magic")


def test_progress_counts_centers_and_rounds_and_changes_nothing(sampled):
    reported = {}

    def phases(name):
        return lambda done, total: reported.setdefault(name, []).append((done, total))

    points = sampled.position
    quiet = clustering.cluster(points, 40, seed=3)
    watched = clustering.cluster(points, 40, seed=3, progress=phases)
    np.testing.assert_array_equal(watched.center, quiet.center)
    assert reported["first centers"] == [(done, 40) for done in range(2, 41)]
    rounds = [done for done, _ in reported["k-means iterations"]]
    assert rounds == list(range(1, len(rounds) + 1))


def test_counted_draws_are_those_of_the_seed():
    counted = clustering._CountedDraws(11, 3, lambda done, total: None)
    plain = np.random.RandomState(11)  # what scikit-learn makes of the seed
    assert counted.randint(1000) == plain.randint(1000)
    np.testing.assert_array_equal(counted.uniform(size=5), plain.uniform(size=5))
