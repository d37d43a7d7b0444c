"""Baselines of maneuver detection: CUSUM of squared innovations and control distance."""

import numpy as np
import pytest

from cislunar.errors import ConfigurationError
from cislunar.estimation.maneuvers import control_distance, control_gramian, cusum


def test_baselines():
    rng = np.random.default_rng(1)
    squared = rng.chisquare(2, 200)
    found, total = cusum(squared, 0.3), 0.3
    for k, each in enumerate(squared):
        total = max(0.0, total + 0.25 * each - np.log(2.0))
        assert found[k] == pytest.approx(total, abs=1e-9)
    np.testing.assert_allclose(cusum(squared[50:], found[49]), found[50:], atol=1e-9)
    # a body at rest that moves by s in the time T without changing its velocity: with constant
    # acceleration bounded by effort, the least is sqrt(12) s / T^1.5
    times = np.linspace(0.0, 2.0, 4001)
    phi = np.tile(np.eye(6), (times.size, 1, 1))
    phi[:, :3, 3:] = (2.0 - times)[:, None, None] * np.eye(3)
    gramian = control_gramian(phi, times[1])
    effort = control_distance([3.0, 0, 0, 0, 0, 0], gramian)
    assert effort == pytest.approx(np.sqrt(12.0) * 3.0 / 2.0**1.5, rel=1e-6)
    for wrong, name in (
        ((np.ones(3), gramian), "difference has shape"),
        ((np.ones(6), np.eye(3)), "gramian has shape"),
        ((np.ones(6), np.zeros((6, 6))), "gramian is singular"),
    ):
        with pytest.raises(ConfigurationError, match=name):
            control_distance(*wrong)
