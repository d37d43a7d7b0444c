"""Tests for the gates of tracks whose targets may have maneuvered."""

import numpy as np

from cislunar.association.maneuvered import reachable
from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S
from cislunar.estimation.estimator import OrbitEstimates


def test_covariance_after_a_maneuver():
    """Against samples: a uniform time, a normal change of velocity, straight motion."""
    rng = np.random.default_rng(1)
    waited, sigma = 0.07, 50.0
    time = waited * rng.random(400_000)
    change = sigma / VELOCITY_UNIT_M_S * rng.standard_normal((time.size, 3))
    samples = np.concatenate([time[:, None] * change, change], axis=1)
    orbits = OrbitEstimates(7, np.ones((2, 6)), np.stack([1e-12 * np.eye(6)] * 2))
    found = reachable(orbits, np.array([waited, np.nan]), sigma)
    unit = np.sqrt(np.diag(found.covariance[0]))
    expected = np.cov(samples.T) / np.outer(unit, unit)
    np.testing.assert_allclose(found.covariance[0] / np.outer(unit, unit), expected, atol=0.01)
    assert np.all(np.isnan(found.translation[1])) and np.all(found.translation[0] == 1.0)
