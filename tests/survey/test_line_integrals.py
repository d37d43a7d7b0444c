"""Integrals of normal densities along lines, against quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from cislunar.survey.maneuvers.line_integrals import line_moments, log_line_integrals

WIDTH, SCALES = 0.4, np.array([0.05, 2.0])


def lines(count=6, seed=4):
    rng = np.random.default_rng(seed)
    z, rate = rng.normal(size=(count, 6)), np.zeros((count, 6))
    rate[:, :3] = rng.normal(scale=5.0, size=(count, 3))
    root = rng.normal(size=(count, 6, 6))
    return z, rate, root @ root.swapaxes(1, 2) + 0.05 * np.eye(6)


def test_integrals_and_moments_of_time_are_those_of_quadrature():
    z, rate, covariance = lines()
    found = log_line_integrals(z, rate, covariance, SCALES, WIDTH)
    for k, scale in enumerate(SCALES):
        log_integral, shift, variance, *_ = line_moments(
            z, rate, covariance, covariance, scale, WIDTH
        )
        for n in range(len(z)):
            s = covariance[n] + np.diag([0.0] * 3 + [scale**2] * 3)

            def density(t, power=0, n=n, s=s):
                return t**power * multivariate_normal.pdf(z[n] + t * rate[n], np.zeros(6), s)

            mass, first, second = (
                quad(density, -0.5 * WIDTH, 0.5 * WIDTH, args=(power,), epsabs=0.0)[0]
                for power in range(3)
            )
            assert found[k, n] == pytest.approx(np.log(mass), abs=1e-6)
            assert log_integral[n] == pytest.approx(np.log(mass), abs=1e-6)
            assert shift[n] == pytest.approx(first / mass, abs=1e-6)
            assert variance[n] == pytest.approx(second / mass - (first / mass) ** 2, rel=1e-5)


def test_a_singular_covariance_has_no_integral():
    z, rate, covariance = lines()
    covariance[2, 0] = covariance[2, :, 0] = 0.0
    assert np.all(np.isneginf(log_line_integrals(z, rate, covariance, SCALES, WIDTH)))
