"""Student's t prior of the body parameters of a light curve."""

import numpy as np
import pytest
from oracles.light_curves import anchor_of, geometry, model_of
from scipy import stats

from cislunar.errors import ConfigurationError
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.light_curves.light_curve import cost, cost_and_derivatives
from cislunar.observation.body_parameters import BodyParameterPrior

PRIOR = BodyParameterPrior(log_albedo=0.25, log_slope=0.25, log_inertia=0.05)
SIZE = 6 + 4


@pytest.fixture(scope="module")
def data():
    rows = geometry(40)
    rows[:, 1] = 15.0 + np.random.default_rng(1).standard_normal(40)
    return rows


def test_the_cost_has_the_density_of_scipy(data):
    """Of the body parameters alone: those of the rotation's initial state stay normal."""
    normal = model_of(estimated_parameters=PRIOR)
    heavy = normal._replace(prior_freedom=4.0)
    density = stats.t(4.0, scale=np.sqrt(0.5)).logpdf
    zero = np.zeros(SIZE)
    for seed in range(5):
        u = 2.0 * np.random.default_rng(seed).standard_normal(SIZE)
        change, at_zero = (
            cost(each, data, anchor_of(SIZE), heavy, np.inf)
            - cost(each, data, anchor_of(SIZE), normal, np.inf)
            for each in (u, zero)
        )
        expected = -np.sum(density(u[6:]) - density(0.0)) - 0.5 * np.sum(u[6:] ** 2)
        assert at_zero == 0.0
        assert change == pytest.approx(expected, rel=1e-8, abs=1e-6)


def test_gradient_against_differences_and_a_curvature_from_above(data):
    normal = model_of(estimated_parameters=PRIOR)
    heavy = normal._replace(prior_freedom=4.0)
    u = np.random.default_rng(2).standard_normal(SIZE)
    u[6:] = [3.0, -0.5, 2.0, 0.1]
    found = []
    for model in (normal, heavy):
        gradient, information = np.empty(SIZE), np.empty((SIZE, SIZE))
        value = cost_and_derivatives(u, data, anchor_of(SIZE), model, gradient, information)
        assert value == pytest.approx(cost(u, data, anchor_of(SIZE), model, np.inf), rel=1e-12)
        found.append((gradient, information))
    h = 1e-5
    density = stats.t(4.0, scale=np.sqrt(0.5)).logpdf
    slope = -(density(u[6:] + h) - density(u[6:] - h)) / (2.0 * h) - u[6:]
    np.testing.assert_allclose((found[1][0] - found[0][0])[6:], slope, atol=1e-8)
    np.testing.assert_array_equal(found[1][0][:6], found[0][0][:6])
    weight = np.diag(found[1][1] - found[0][1])[6:] + 1.0
    assert np.all(np.linalg.eigvalsh(found[1][1]) > 0.0)
    # the parabola of this curvature that touches the cost lies above it everywhere
    x = np.linspace(-8.0, 8.0, 400)[:, None]
    parabola = 0.5 * weight * (x**2 - u[6:] ** 2)
    assert np.all(parabola >= -(density(x) - density(u[6:])) - 1e-12)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"prior_freedom": 2.0}, "prior_freedom = 2.0 must be a number above 2"),
        ({"prior_freedom": 4.0}, "prior_freedom = 4.0: the standard deviation of every body"),
        (
            {"prior_freedom": 4.0, "window_hours": 3.0, "estimated_parameters": PRIOR},
            "exclude each other: condensed data contain the prior",
        ),
    ],
)
def test_impossible_priors_are_refused_in_one_line(given, message):
    with pytest.raises(ConfigurationError, match=message) as error:
        BatchSettings(**given)
    assert "\n" not in str(error.value)
