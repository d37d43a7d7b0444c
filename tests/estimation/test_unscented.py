import filterpy.kalman
import numpy as np
import pytest
from oracles.unscented import central_weights, moments, sigma_points

from cislunar.estimation.triangular import add_outer_product, cholesky
from cislunar.estimation.unscented import (
    UNSCENTED_WEIGHTS,
    information_gain,
    innovation_moments,
    square_root_update,
)


@pytest.fixture
def rng():
    return np.random.default_rng(20241001)


def _random_covariance(rng, n):
    # Components of very different size, as positions and angular rates are.
    factor = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-4, 2, size=(n, 1))
    return factor @ factor.T


def test_weights_are_those_of_the_paper():
    assert UNSCENTED_WEIGHTS.spread**2 == pytest.approx(0.75)
    assert central_weights(12) == pytest.approx((-15.0, -12.25))
    assert UNSCENTED_WEIGHTS.outer == pytest.approx(2.0 / 3.0)
    assert UNSCENTED_WEIGHTS.mean_shift == pytest.approx(1.75)


@pytest.mark.parametrize("n", [2, 6, 12])
def test_weights_and_points_match_filterpy(rng, n):
    reference = filterpy.kalman.MerweScaledSigmaPoints(n, alpha=0.5, beta=2.0, kappa=3.0 - n)
    covariance = _random_covariance(rng, n)
    mean = rng.normal(size=n)
    points = sigma_points(mean, np.linalg.cholesky(covariance), UNSCENTED_WEIGHTS)
    expected = reference.sigma_points(mean, covariance)
    np.testing.assert_allclose(points, expected, rtol=1e-9, atol=1e-9)
    outer = np.full(2 * n, UNSCENTED_WEIGHTS.outer)
    mean_central, covariance_central = central_weights(n)
    np.testing.assert_allclose(np.r_[mean_central, outer], reference.Wm, rtol=1e-12)
    np.testing.assert_allclose(np.r_[covariance_central, outer], reference.Wc, rtol=1e-12)


def test_difference_form_equals_the_weighted_sums_and_stays_definite(rng):
    """The identity holds for any function, here heavy-tailed random images."""
    n = 12
    mean_weights, covariance_weights = (
        np.r_[central, np.full(2 * n, UNSCENTED_WEIGHTS.outer)] for central in central_weights(n)
    )
    worst, smallest = 0.0, np.inf
    for _ in range(2000):
        images = rng.standard_t(2.0, size=(2 * n + 1, n))
        mean, covariance = moments(images[0], images[1:] - images[0], UNSCENTED_WEIGHTS)
        naive_mean = mean_weights @ images
        deviation = images - naive_mean
        naive = (covariance_weights[:, None] * deviation).T @ deviation
        scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
        worst = max(worst, np.max(np.abs(naive - covariance) / scale))
        np.testing.assert_allclose(mean, naive_mean, atol=1e-11 * np.max(np.abs(images)))
        smallest = min(smallest, np.linalg.eigvalsh(covariance / scale)[0])
    assert worst < 1e-11  # cancellation in the naive sum
    assert smallest > 0.0


@pytest.mark.parametrize(("n", "m"), [(12, 3), (6, 2)])
def test_transform_matches_filterpy_on_a_nonlinear_function(rng, n, m):
    mix = rng.normal(size=(m, n))

    def function(x):
        return np.sin(mix @ x) + (mix @ x) ** 2

    covariance = 0.1 * _random_covariance(rng, n) / 1e4
    points = sigma_points(rng.normal(size=n), np.linalg.cholesky(covariance), UNSCENTED_WEIGHTS)
    images = np.array([function(x) for x in points])
    reference = filterpy.kalman.MerweScaledSigmaPoints(n, alpha=0.5, beta=2.0, kappa=3.0 - n)
    expected = filterpy.kalman.unscented_transform(images, reference.Wm, reference.Wc)
    mean, got = moments(images[0], images[1:] - images[0], UNSCENTED_WEIGHTS)
    np.testing.assert_allclose(mean, expected[0], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(got, expected[1], rtol=1e-9, atol=1e-10 * np.max(np.abs(got)))


def _update(mean, root, images, measured, noise_variance):
    n = len(mean)
    m = len(measured)
    shift, cross, even = np.empty(m), np.empty((n, m)), np.empty((m, m))
    innovation_moments(
        images[1:] - images[0], noise_variance, UNSCENTED_WEIGHTS, shift, cross, even
    )
    gain = information_gain(cross.copy(), even.copy())
    correction = np.empty(n)
    root = root.copy()
    innovation = measured - images[0] - shift
    assert square_root_update(root, cross, even, innovation, correction, np.empty((n, n)))
    return mean + correction, root, gain


def test_update_equals_a_kalman_filter_on_a_linear_problem(rng):
    """Fifty steps of predict and update against filterpy's linear filter."""
    n, m = 12, 3
    transition = np.linalg.qr(rng.normal(size=(n, n)))[0]
    observe = rng.normal(size=(m, n))
    noise_variance = np.array([0.1, 0.2, 0.05]) ** 2
    reference = filterpy.kalman.KalmanFilter(dim_x=n, dim_z=m)
    reference.F, reference.H, reference.R = transition, observe, np.diag(noise_variance)
    reference.Q = np.diag(rng.uniform(0.0, 1e-3, n))
    reference.P = _random_covariance(rng, n)
    reference.x = rng.normal(size=(n, 1))
    mean, root = reference.x[:, 0].copy(), np.linalg.cholesky(reference.P)
    for _ in range(50):
        measured = rng.normal(size=m)
        reference.predict()
        points = sigma_points(mean, root, UNSCENTED_WEIGHTS) @ transition.T
        mean, covariance = moments(points[0], points[1:] - points[0], UNSCENTED_WEIGHTS)
        root = np.linalg.cholesky(covariance + reference.Q)
        before = reference.P.copy()
        reference.update(measured[:, None])
        images = sigma_points(mean, root, UNSCENTED_WEIGHTS) @ observe.T
        mean, root, gain = _update(mean, root, images, measured, noise_variance)
        ratio = np.linalg.slogdet(before)[1] - np.linalg.slogdet(reference.P)[1]
        assert gain == pytest.approx(0.5 * ratio, abs=1e-6)
        deviation = np.sqrt(np.diag(reference.P))
        np.testing.assert_allclose(mean / deviation, reference.x[:, 0] / deviation, atol=1e-8)
        scale = np.outer(deviation, deviation)
        np.testing.assert_allclose(root @ root.T / scale, reference.P / scale, atol=1e-8)
        assert np.all(np.triu(root, 1) == 0.0)


def test_update_survives_a_measurement_a_billion_times_sharper_than_the_prior(rng):
    n = 12
    root = np.linalg.cholesky(_random_covariance(rng, n))
    observe = rng.normal(size=(3, n))
    images = sigma_points(np.zeros(n), root, UNSCENTED_WEIGHTS) @ observe.T
    sharp = np.full(3, (1e-9 * np.max(np.abs(root))) ** 2)
    _, posterior, _ = _update(np.zeros(n), root, images, np.zeros(3), sharp)
    assert np.all(np.diag(posterior) > 0.0)
    assert np.all(np.linalg.norm(posterior, axis=1) <= np.linalg.norm(root, axis=1) * (1 + 1e-12))


def test_mutual_information_equals_the_ratio_of_determinants(rng):
    n, m = 6, 2
    covariance = _random_covariance(rng, n)
    root = np.linalg.cholesky(covariance)
    images = sigma_points(np.zeros(n), root, UNSCENTED_WEIGHTS)[:, :m] ** 3
    _, posterior, gain = _update(np.zeros(n), root, images, np.zeros(m), np.full(m, 1e-2))
    logs = np.log(np.diag(root)).sum() - np.log(np.abs(np.diag(posterior))).sum()
    assert gain == pytest.approx(logs, rel=1e-10)


def test_factorizations_match_numpy_and_refuse_indefinite_matrices(rng):
    matrix = _random_covariance(rng, 5)
    lower = matrix.copy()
    assert cholesky(lower)
    np.testing.assert_allclose(lower, np.linalg.cholesky(matrix), rtol=1e-8)
    upper = np.triu(rng.normal(size=(5, 5)), 1) + np.diag(rng.uniform(0.5, 2.0, 5))
    vector = 100.0 * rng.normal(size=5)
    expected = upper @ upper.T + np.outer(vector, vector)
    add_outer_product(upper, vector.copy())
    np.testing.assert_allclose(upper @ upper.T, expected, rtol=1e-12, atol=1e-9)
    assert np.all(np.tril(upper, -1) == 0.0)
    assert not cholesky(np.diag([1.0, -1.0]))
    assert not cholesky(np.array([[np.nan]]))
    assert not cholesky(np.array([[np.inf]]))
