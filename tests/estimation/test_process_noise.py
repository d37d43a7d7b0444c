"""White acceleration against Van Loan's matrix exponential."""

import numpy as np
from scipy.linalg import expm

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.estimation.spread import ProcessNoise


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
