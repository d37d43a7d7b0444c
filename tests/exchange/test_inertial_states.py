"""States and covariances in inertial axes against differences, samples and the ephemeris."""

import numpy as np
import pytest
from halo_message import ELAPSED, HALO

from cislunar.constants import EPOCH_JD, LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.dynamics.propagation import propagate
from cislunar.ephemeris.sampling import sample_ephemeris
from cislunar.exchange.inertial import (
    CENTERS,
    inertial_covariances,
    inertial_states,
    rotating_states,
)


@pytest.mark.parametrize("center", CENTERS)
def test_inertial_states_round_trip(epoch, path_of_halo, center):
    there = inertial_states(path_of_halo, ELAPSED, epoch, center)
    back = rotating_states(there, ELAPSED, epoch, center)
    np.testing.assert_allclose(back, path_of_halo, rtol=0.0, atol=1e-14)


def test_inertial_velocities_are_those_of_the_positions(epoch):
    close = np.arange(-2.0, 3.0) * 10.0
    path = propagate(HALO, close / TIME_UNIT_S, method="dop853")
    there = inertial_states(path, close, epoch)
    slope = (there[0, :3] - 8 * there[1, :3] + 8 * there[3, :3] - there[4, :3]) / 120.0
    np.testing.assert_allclose(there[2, 3:], slope, rtol=0.0, atol=1e-9)


def test_the_moon_is_where_the_ephemeris_has_it_at_the_epoch(epoch):
    moon = inertial_states([[1.0 - MU, 0, 0, 0, 0, 0]], [0.0], epoch)[0]
    ephemeris = sample_ephemeris(EPOCH_JD, 0.0)
    assert moon[:3] @ ephemeris.moon_rotation[0][0] == pytest.approx(LENGTH_UNIT_KM, rel=1e-14)
    assert np.linalg.norm(moon[3:]) == pytest.approx(LENGTH_UNIT_KM / TIME_UNIT_S, rel=1e-14)


def test_covariances_are_those_of_the_states(epoch):
    random = np.random.default_rng(2)
    deviations = random.normal(size=(40, 1, 6)) * 1e-5
    moved = inertial_states(HALO + deviations, [5e4], epoch)[:, 0]
    wanted = inertial_covariances(np.cov(deviations[:, 0].T)[None], [5e4], epoch)[0]
    np.testing.assert_allclose(np.cov(moved.T), wanted, rtol=1e-6, atol=1e-12)
