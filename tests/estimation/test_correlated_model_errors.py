"""Cost and evidence of models with correlated errors against densities and quadrature."""

import numpy as np
import pytest
from oracles.light_curves import anchor_of, model_of
from scipy.special import logsumexp
from scipy.stats import multivariate_normal
from simulated_light_curves import observed_rows

from cislunar.estimation.light_curves.light_curve import cost, cost_and_derivatives
from cislunar.estimation.light_curves.model_selection.body_models import with_body_model
from cislunar.estimation.light_curves.model_selection.correlated import (
    CorrelatedFit,
    ModelError,
    bins_of_rows,
)
from cislunar.estimation.light_curves.model_selection.residual_tests import explains, p_values
from cislunar.estimation.light_curves.model_selection.rows import expected_rows
from cislunar.estimation.light_curves.row_blocks import MAGNITUDE, TIME, WEIGHT


def test_expected_rows_are_those_of_the_cost():
    """Residuals, gradient and Gauss-Newton matrix of the compiled cost, from rows."""
    model = with_body_model(model_of("triaxial"), "large deviations")
    size, data = model.sigma.size, observed_rows(90)
    rng = np.random.default_rng(3)
    u = 0.3 * rng.standard_normal(size)
    data[:, MAGNITUDE] = 15.0 + 0.3 * rng.standard_normal(90)
    data[:, WEIGHT] = rng.uniform(0.5, 1.0, 90)
    magnitude, directions, derivative = expected_rows(u, data, model)
    weight, residual = data[:, WEIGHT] / model.noise_variance, data[:, MAGNITUDE] - magnitude
    gradient, information = np.empty(size), np.empty((size, size))
    value = cost_and_derivatives(u, data, anchor_of(size), model, gradient, information)
    assert 0.5 * (u @ u + weight @ residual**2) == pytest.approx(value, rel=1e-10)
    np.testing.assert_allclose(u - derivative.T @ (weight * residual), gradient, rtol=1e-8)
    expected = np.eye(size) + (derivative.T * weight) @ derivative
    np.testing.assert_allclose(information, expected, rtol=1e-8, atol=1e-8 * expected.max())
    np.testing.assert_allclose(np.linalg.norm(directions[:, :3], axis=1), 1.0, rtol=1e-12)


def test_bins_belong_to_one_observer():
    data = observed_rows()
    bins = bins_of_rows(data, 100)
    assert 100 <= bins.first.size < 140
    np.testing.assert_array_equal(np.sort(bins.order), np.arange(len(data)))
    for part in np.split(bins.order, bins.first[1:]):
        assert np.unique(data[part, TIME] // 3600.0 % 2).size == 1
        assert np.ptp(data[part, TIME]) <= 900.0
    values = np.random.default_rng(0).standard_normal((len(data), 2))
    expected = [values[part].mean(axis=0) for part in np.split(bins.order, bins.first[1:])]
    np.testing.assert_allclose(bins.mean(values, data[:, WEIGHT]), expected, atol=1e-14)


@pytest.mark.parametrize("tau", [0.0, 0.2])
def test_cost_with_a_correlated_error_against_the_density(tau):
    """The joint normal density of all rows, with an error that is constant within a bin."""
    model, data = with_body_model(model_of(), "material"), observed_rows(60)
    rng = np.random.default_rng(5)
    data[:, MAGNITUDE] = 15.0 + 0.3 * rng.standard_normal(60)
    data[:, WEIGHT] = rng.uniform(0.5, 1.0, 60)
    bins = bins_of_rows(data, 20)
    fit = CorrelatedFit(data, bins, model, ModelError(tau, 0.35))
    noise = model.noise_variance / data[:, WEIGHT]

    def found(u):
        rows = fit.rows(u)
        fit.refresh(rows)
        return fit.cost(u, rows)

    def expected(u):
        magnitude, directions, _ = fit.rows(u)
        number = np.empty(60, dtype=int)
        number[bins.order] = np.repeat(np.arange(bins.first.size), np.diff(np.r_[bins.first, 60]))
        mean = np.array([
            np.average(directions[number == b], axis=0, weights=data[number == b, WEIGHT])
            for b in range(bins.first.size)
        ])  # fmt: skip
        apart = np.sum((mean[:, None] - mean) ** 2, axis=-1)
        kernel = tau**2 * np.exp(-apart / (2.0 * 0.35**2))[np.ix_(number, number)]
        density = multivariate_normal(magnitude, np.diag(noise) + kernel)
        return 0.5 * u @ u - density.logpdf(data[:, MAGNITUDE])

    points = 0.3 * rng.standard_normal((3, model.sigma.size))
    differences = [found(u)[0] - expected(u) for u in points]
    constant = -0.5 * np.sum(np.log(2.0 * np.pi * noise))
    np.testing.assert_allclose(differences, constant, rtol=1e-9)
    if tau == 0.0:
        assert found(points[0])[0] == pytest.approx(
            cost(points[0], data, anchor_of(model.sigma.size), model, np.inf), rel=1e-12
        )
    # gradient at a constant C
    value, gradient, _ = found(points[0])
    for i in range(model.sigma.size):
        step = 1e-6 * np.eye(model.sigma.size)[i]
        ends = [fit.cost(points[0] + s * step, fit.rows(points[0] + s * step))[0] for s in (1, -1)]
        assert gradient[i] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=2e-3 * abs(value))


@pytest.mark.parametrize("freedom", [0.0, 4.0])
def test_compiled_descent_reaches_the_same_minimum(freedom):
    """Without a model error, from several starts and after any number of steps."""
    assumed, data = with_body_model(model_of(), "material"), observed_rows(80)
    rng, model = np.random.default_rng(8), assumed._replace(noise_freedom=freedom)
    data[:, MAGNITUDE] = expected_rows(np.full(model.sigma.size, 0.5), data, model)[0]
    data[:, MAGNITUDE] += 0.1 * rng.standard_normal(80)
    for start in 0.5 + 0.3 * rng.standard_normal((3, model.sigma.size)):
        for iterations in (0, 1, 8):
            fit = CorrelatedFit(data, bins_of_rows(data, 20), model, ModelError(0.0, 1.0))
            compiled, rows = fit.descent_without_error(start, iterations)
            np.testing.assert_allclose(compiled, fit.descent(start, iterations)[0], atol=1e-9)
            np.testing.assert_array_equal(rows[0], fit.rows(compiled)[0])
            assert iterations == 0 or not np.allclose(compiled, start, atol=1e-3)


class _LinearFit(CorrelatedFit):
    """A fit of magnitudes that are linear in the parameters, with fixed directions."""

    def __init__(self, design, directions, *args):
        super().__init__(*args)
        self._linear = design, directions

    def rows(self, u):
        return self._linear[0] @ u, self._linear[1], self._linear[0]

    def descent_without_error(self, start, iterations):
        return self.descent(start, iterations)


def test_evidence_of_an_unknown_noise_against_quadrature():
    """The marginal likelihood over all parameters and the noise variance, by quadrature over the
    variance, of models with different numbers of parameters and different model errors."""
    rng, n, freedom = np.random.default_rng(2), 90, 4.0
    data = observed_rows(n)
    data[:, WEIGHT] = rng.uniform(0.5, 1.0, n)
    model = model_of()._replace(noise_freedom=freedom)
    variance, bins = model.noise_variance, bins_of_rows(data, 30)
    assert bins.first.size < 0.6 * n
    directions = rng.standard_normal((n, 6))
    directions[bins.order] = np.repeat(
        directions[: bins.first.size], np.diff(np.r_[bins.first, n]), axis=0
    )
    apart = np.sum((directions[:, None] - directions) ** 2, axis=-1)
    design = rng.standard_normal((n, 5))
    noise = np.sqrt(2.2 * variance / data[:, WEIGHT]) * rng.standard_normal(n)
    data[:, MAGNITUDE] = design @ [0.5, -0.4, 0.3, 0.0, 0.0] + noise
    logs = np.linspace(np.log(0.5), np.log(50.0), 250)
    prior = -0.5 * freedom * (logs + np.exp(-logs))  # chi squared of nu / f, in ln f

    def quadrature(columns, tau):
        fixed = columns @ columns.T + tau**2 * np.exp(-apart / (2.0 * 0.35**2))
        found = []
        for f in np.exp(logs):
            noise = np.diag(f * variance / data[:, WEIGHT])
            whole = multivariate_normal(np.zeros(n), fixed + noise)
            # for linear parameters, the density at their most likely values differs by this
            more = (
                np.linalg.slogdet(fixed + noise)[1]
                - np.linalg.slogdet(fixed - columns @ columns.T + noise)[1]
            )
            found.append((whole.logpdf(data[:, MAGNITUDE]), 0.5 * more))
        return np.array(found).T + prior * [[1.0], [0.0]]

    expected, estimated = [], []
    for size, tau in ((5, 0.0), (3, 0.0), (5, 0.05), (5, 0.2), (2, 0.2)):
        columns = design[:, :size]
        fit = _LinearFit(columns, directions, data, bins, model, ModelError(tau, 0.35))
        found = fit.refined(np.zeros(size), 12)
        density, more = quadrature(columns, tau)
        expected.append(logsumexp(density))
        estimated.append(found.log_evidence)
        likely = logs[np.argmax(density + more)]
        assert np.log(found.noise_factor) == pytest.approx(likely, abs=logs[1] - logs[0])
    assert np.ptp(expected) > 5.0
    np.testing.assert_allclose(np.diff(estimated), np.diff(expected), atol=0.1)


@pytest.mark.parametrize("freedom", [0.0, 4.0])
def test_evidence_of_an_unknown_model_error_against_quadrature(freedom):
    """The marginal likelihood over the parameters and over the logarithm of the standard deviation,
    with the noise variance known or estimated, by quadrature over that deviation."""
    rng, n, limits = np.random.default_rng(3), 90, (0.02, 1.3)
    data = observed_rows(n)
    model = model_of()._replace(noise_freedom=freedom)
    bins = bins_of_rows(data, 30)
    directions = rng.standard_normal((n, 6))
    directions[bins.order] = np.repeat(
        directions[: bins.first.size], np.diff(np.r_[bins.first, n]), axis=0
    )
    apart = np.sum((directions[:, None] - directions) ** 2, axis=-1)
    kernel = np.exp(-apart / (2.0 * 0.35**2))
    design = rng.standard_normal((n, 8))
    root = np.linalg.cholesky(0.15**2 * kernel + model.noise_variance * np.eye(n))
    data[:, MAGNITUDE] = design[:, :2] @ [0.5, -0.4] + root @ rng.standard_normal(n)
    logs = np.linspace(*np.log(limits), 81)
    for size in (2, 8):
        columns, fixed = design[:, :size], []
        for tau in np.exp(logs):
            error = ModelError(float(tau), 0.35)
            fit = _LinearFit(columns, directions, data, bins, model, error)
            fixed.append(fit.refined(np.zeros(size), 30).log_evidence)
        fixed = np.array(fixed)
        expected = logsumexp(fixed) - np.log(logs.size)
        fit = _LinearFit(
            columns, directions, data, bins, model, ModelError(0.25, 0.35), 1.0, limits
        )
        found = fit.refined(np.zeros(size), 30)
        assert np.log(found.tau) == pytest.approx(logs[np.argmax(fixed)], abs=0.1)
        assert found.log_evidence == pytest.approx(expected, abs=0.2)


def test_residuals_of_the_noise_and_of_a_wrong_model():
    """The tests reject white noise as rarely as stated, and correlated errors below the noise."""
    data, rng, rejected = observed_rows(400), np.random.default_rng(6), []
    data[:, WEIGHT] = rng.uniform(0.5, 1.0, 400)
    white = rng.standard_normal((400, 400)) * np.sqrt(0.01 / data[:, WEIGHT])
    for freedom in (0.0, 4.0):
        values = np.array([p_values(each, data, 0.01, freedom, 0) for each in white])
        rejected.append(np.mean(values < 0.1, axis=0))
    # a binomial share of 0.1 has a standard deviation of 0.015
    np.testing.assert_allclose(rejected[0], 0.1, atol=0.05)
    np.testing.assert_allclose(rejected[1][1:], 0.1, atol=0.05)
    assert explains(white[0], data, 0.01, 0.0, 0)
    slow = 0.08 * np.sin(data[:, TIME] / 2000.0)
    assert not explains(white[0] + slow, data, 0.01, 0.0, 0)
    assert not explains(white[0] + slow, data, 0.01, 4.0, 0)
    # noise of a wrong size matters only where its size is known
    assert not explains(1.5 * white[0], data, 0.01, 0.0, 0)
    assert explains(1.5 * white[0], data, 0.01, 4.0, 0)
