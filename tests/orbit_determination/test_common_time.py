"""Accuracy of propagated orbits; distances of states under covariances, some of which rounding has
spoiled."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cislunar.constants import MU, TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON
from cislunar.orbit_determination import (
    OrbitStates,
    orbits_at,
    propagated,
    propagated_each,
    squared_distances,
)


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


def test_an_orbit_without_a_finite_covariance_is_left_out():
    state = np.array([1.125424, 0.0, -0.1817, 0.0, -0.225458, 0.0])
    scales = np.array([1e-12, np.nan, 1e-10])
    covariance = scales[:, None, None] * np.eye(6)
    starts = OrbitStates(np.zeros(3), np.tile(state, (3, 1)), covariance, np.zeros((3, 6)))
    moved, kept = orbits_at(starts, 0.2, EARTH_MOON)
    assert kept.tolist() == [0, 2] and moved.state.shape == (2, 6)
    np.testing.assert_allclose(moved.covariance[1], 100.0 * moved.covariance[0], rtol=1e-9)


@pytest.mark.parametrize(
    "state",
    [
        [1.0220, 0.0, -0.1820, 0.0, -0.1033, 0.0],  # near-rectilinear halo orbit
        [0.82338, 0.0, -0.022278, 0.0, 0.13418, 0.0],  # halo orbit about L1
        [1.00785, 0.0, 0.0, 0.0, 0.75, 0.1],  # about the Moon
    ],
)
def test_integration_over_a_week_is_more_accurate_than_any_state_is_known(state):
    """Against SciPy. Detections of a week can determine one component of a state on an unstable
    orbit with a standard deviation of 1e-10 units of length."""

    def derivative(_, y):
        earth, moon = (y[:3] + np.array([x, 0.0, 0.0]) for x in (MU, MU - 1.0))
        pull = (1.0 - MU) * earth / np.linalg.norm(earth) ** 3
        pull += MU * moon / np.linalg.norm(moon) ** 3
        return [*y[3:], y[0] + 2.0 * y[4] - pull[0], y[1] - 2.0 * y[3] - pull[1], -pull[2]]

    week = -7.0 * 86_400.0 / TIME_UNIT_S
    expected = solve_ivp(derivative, (0.0, week), state, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    path, transition = propagated(np.array([state]), np.zeros(1), np.array([week]), EARTH_MOON)
    at_epoch = np.linalg.solve(transition[0, 0], path[0, 0] - expected)
    assert np.abs(at_epoch[:3]).max() < 3e-12


def test_orbits_with_times_of_their_own_are_those_that_are_propagated_alone():
    """Bit for bit, beside an orbit that meets the Moon and in other groups of orbits."""
    rng = np.random.default_rng(5)
    state = np.array([1.125424, 0.0, -0.1817, 0.0, -0.225458, 0.0]) + np.zeros((70, 1))
    state += 1e-2 * rng.standard_normal(state.shape)
    state[7] = [0.995, 0.0, 0.0, 0.0, 0.0, 0.0]
    epoch, sizes = rng.uniform(0.0, 1.0, 70), rng.integers(1, 30, 70).tolist()
    times = [np.sort(rng.uniform(-0.3, 1.3, size)) for size in sizes]
    found = list(propagated_each(state, epoch, times, EARTH_MOON))
    assert len(found) == 70
    for k, (path, transition, shift) in enumerate(found):
        alone = propagated(state[[k]], epoch[[k]], times[k], EARTH_MOON)
        for each, expected in zip((path, transition), alone, strict=True):
            np.testing.assert_array_equal(each, expected[0])
        assert shift.shape == (sizes[k], 6, 0)
        assert np.isnan(path).any() == (k == 7)
