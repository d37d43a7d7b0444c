"""Distances of states under covariances, some of which rounding has spoiled."""

import numpy as np
import pytest

from cislunar.orbit_determination import squared_distances


def test_distances_are_those_of_the_inverse_covariance():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((5, 6, 6)) * 10.0 ** rng.uniform(-6.0, 2.0, (5, 6, 1))
    covariance, vector = root @ root.swapaxes(1, 2), rng.standard_normal((5, 6))
    expected = [v @ np.linalg.inv(p) @ v for v, p in zip(vector, covariance, strict=True)]
    np.testing.assert_allclose(squared_distances(vector, covariance), expected, rtol=1e-6)


@pytest.mark.parametrize("spoiled", [np.nan, np.inf, 0.0, -1.0])
def test_a_covariance_that_is_none_has_no_distance_and_spoils_no_other(spoiled):
    covariance = np.tile(4.0 * np.eye(6), (3, 1, 1))
    covariance[1, 2, 2] = spoiled
    found = squared_distances(np.ones((3, 6)), covariance)
    assert np.isnan(found[1])
    np.testing.assert_allclose(found[[0, 2]], 1.5)
