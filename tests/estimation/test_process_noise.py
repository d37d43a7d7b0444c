"""White acceleration against Van Loan's matrix exponential, steps of free motion against their sum,
and gaps in an orbit against particles."""

import numpy as np
import pytest
from scipy.linalg import expm

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.kalman.gaussian_mixture import carry_points, point_moments
from cislunar.estimation.kalman.workspace import filter_constants, make_workspace, noise_of_gap
from cislunar.estimation.unscented import sigma_points
from cislunar.orbits.tracked import POLAR_ORBITS, polar_state
from cislunar.tasking.demonstration import tracking_problem


def test_white_acceleration_is_that_of_van_loan():
    density, step_s = 3e-5, 45.0
    drift = np.array([[0.0, 1.0], [0.0, 0.0]])
    blocks = np.block(
        [[-drift, np.diag([0.0, density * 1e-6])], [np.zeros((2, 2)), drift.T]]
    )  # km^2/s^3
    whole = expm(blocks * step_s)
    wanted = whole[2:, 2:].T @ whole[:2, 2:]
    variance, covariance = ProcessNoise(acceleration_m2_s3=density).covariance(step_s)
    length, speed = LENGTH_UNIT_KM, LENGTH_UNIT_KM / TIME_UNIT_S
    np.testing.assert_allclose(variance[6:9] * length**2, wanted[0, 0], rtol=1e-12)
    np.testing.assert_allclose(variance[9:] * speed**2, wanted[1, 1], rtol=1e-12)
    np.testing.assert_allclose(covariance * length * speed, wanted[0, 1], rtol=1e-12)
    assert not variance[:6].any()


def test_the_noise_of_a_gap_is_that_of_its_steps():
    """Of all three kinds of noise: in free motion, and of acceleration alone that of one step."""
    scene, _, _, _, loop = tracking_problem(1, 1, duration_hours=0.1)
    process = ProcessNoise(position_km=0.3, velocity_m_s=2.0, acceleration_m2_s3=3e-5)
    given = (6, scene, loop.sensor)
    constants = filter_constants(*given, process, EARTH_MOON, False, True)
    variance, both = process.covariance(scene.step_s)
    step = np.array([[variance[6], both], [both, variance[9]]])
    drift = np.array([[1.0, scene.step], [0.0, 1.0]])
    total = np.zeros((2, 2))
    for n_steps in range(1, 30):
        total = drift @ total @ drift.T + step
        found = noise_of_gap(n_steps, scene.step, constants)
        np.testing.assert_allclose(found, total[[0, 0, 1], [0, 1, 1]], rtol=1e-12)
    white = ProcessNoise(acceleration_m2_s3=3e-5)
    constants = filter_constants(*given, white, EARTH_MOON, False, True)
    whole, covariance = white.covariance(29 * scene.step_s)
    wanted = whole[6], covariance, whole[9]
    np.testing.assert_allclose(noise_of_gap(29, scene.step, constants), wanted, rtol=1e-12)


@pytest.mark.parametrize("density", [1e-8, 1e-6])
def test_the_noise_of_two_revolutions_is_that_of_particles(density):
    """In a lunar orbit of 170 km by 4313 km, over 12 h. The largest and the smallest deviation of
    position differ by a factor of 70 to 280."""
    scene, _, _, _, loop = tracking_problem(1, 1, duration_hours=0.1)
    process, n_steps, stride, count = ProcessNoise(acceleration_m2_s3=density), 720, 4, 5000
    constants = filter_constants(6, scene, loop.sensor, process, EARTH_MOON, False, True)
    orbit = next(each for each in POLAR_ORBITS if each.perilune_altitude_km == 170.0)
    state, period = polar_state(orbit, 0.3)
    assert 1.9 < n_steps * scene.step / period < 2.1
    scale = np.repeat([0.1 / LENGTH_UNIT_KM, 1e-4 * TIME_UNIT_S / LENGTH_UNIT_KM], 3)
    points, noise, work = np.empty((6, 13)), np.zeros((6, 6)), make_workspace(6, 2)
    sigma_points(state, np.diag(scale), constants.weights.spread, points)
    carry_points(points, noise, 0, 0, n_steps, scene, constants, work)
    point_moments(points, constants.weights, work)
    found = np.tril(work.covariance) + np.tril(work.covariance, -1).T + noise

    rng = np.random.default_rng(0)
    states = state + rng.standard_normal((count, 6)) * scale
    variance, both = process.covariance(stride * scene.step_s)
    root = np.linalg.cholesky([[variance[6], both], [both, variance[9]]])
    for _ in range(n_steps // stride):
        states = propagate_bundle(states, stride * scene.step, 1)[:, 1]
        kicks = np.einsum("ab,pbx->pax", root, rng.standard_normal((count, 2, 3)))
        states += kicks.reshape(count, 6)
    # the sampling error of a deviation is 1 %; each part along its own principal axes
    for part in (slice(0, 3), slice(3, 6)):
        wanted = np.cov(states[:, part].T)
        values, axes = np.linalg.eigh(wanted)
        along = np.einsum("ai,ab,bi->i", axes, found[part, part], axes)
        np.testing.assert_allclose(np.sqrt(along / values), 1.0, atol=0.1)
        assert values[-1] / values[0] > 10.0
