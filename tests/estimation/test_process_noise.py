"""White acceleration against Van Loan's matrix exponential, and gaps against many steps."""

import numpy as np
from scipy.linalg import expm

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.kalman.workspace import filter_constants, noise_of_gap
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
