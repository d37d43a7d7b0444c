"""Cost, derivatives and modes of a light curve against plain NumPy and finite differences."""

import numpy as np
import pytest
from oracles.light_curves import (
    FACETS,
    INERTIAS,
    SIGMA,
    anchor_of,
    cost_differences,
    geometry,
    model_of,
)
from oracles.rigid_rotation import propagate_rotation
from scipy.optimize import approx_fprime, minimize
from scipy.stats import norm

from cislunar.attitude import grp
from cislunar.attitude.quaternion import compose
from cislunar.estimation.light_curves.batch_settings import SearchSettings
from cislunar.estimation.light_curves.effort import search_until_clear
from cislunar.estimation.light_curves.hypotheses import (
    Hypotheses,
    condense,
    mixture_points,
    prior_hypotheses,
    search,
)
from cislunar.estimation.light_curves.levenberg_marquardt import refine, squared_distance
from cislunar.estimation.light_curves.light_curve import (
    OTHER_CAUSES,
    Anchor,
    cost,
    cost_and_derivatives,
    fainter_than_limit,
)
from cislunar.estimation.light_curves.mixture import (
    mixture_moments,
    step_points,
    weighted_deviations,
)
from cislunar.estimation.light_curves.row_blocks import MAGNITUDE, RANGE, SEEN, SUN, TIME, VIEW
from cislunar.photometry.facets import apparent_magnitude
from cislunar.photometry.materials import PRINTED, SCALE


def _magnitudes(u, data, model):
    """Model magnitudes by the library's array functions, without any kernel of this estimator."""
    p0 = SIGMA[:3] * u[:3]
    start = compose(grp.to_quaternion(p0), model.quaternion)
    attitudes, _ = propagate_rotation(
        start, model.omega + SIGMA[3:] * u[3:], data[:, TIME], model.inertia
    )
    given = attitudes, data[:, SUN], data[:, VIEW], data[:, RANGE]
    return apparent_magnitude(*given, FACETS, model=PRINTED)  # as `model_of` has it


def _light_curve(u, model, hours=(0.0, 6.0), n=120, noise=0.1, seed=0):
    data = geometry(n, hours)
    error = noise * np.random.default_rng(seed).standard_normal(n)
    data[:, MAGNITUDE] = _magnitudes(u, data, model) + error
    return data


TRUE = np.array([0.4, -0.8, 0.6, 0.3, -0.5, 0.9])
NONE = np.empty((0, 6)), np.empty((0, 6, 6))


@pytest.mark.parametrize("inertia", INERTIAS)
def test_cost_is_prior_and_chi_squared(inertia):
    model = model_of(inertia)
    data = _light_curve(TRUE, model)
    u = np.array([0.2, 0.1, -0.3, 0.5, 0.0, -0.7])
    residuals = data[:, MAGNITUDE] - _magnitudes(u, data, model)
    expected = 0.5 * u @ u + 0.5 * np.sum(residuals**2) / 0.01
    assert cost(u, data, anchor_of(), model, np.inf) == pytest.approx(expected, rel=1e-6)


def test_non_detections_cost_the_probability_of_being_fainter():
    model = model_of()
    data = _light_curve(TRUE, model, n=30)
    data[::3, SEEN], data[::3, MAGNITUDE] = 0.0, 15.0
    u = 0.3 * np.ones(6)
    h = _magnitudes(u, data, model)
    seen = data[:, SEEN] == 1.0
    expected = 0.5 * u @ u + 0.5 * np.sum((data[seen, MAGNITUDE] - h[seen]) ** 2) / 0.01
    unseen = norm.cdf((h[~seen] - 15.0) / 0.1)
    expected -= np.log(OTHER_CAUSES + (1.0 - OTHER_CAUSES) * unseen).sum()
    assert cost(u, data, anchor_of(), model, np.inf) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("z", [-200.0, -4.0, -2.0, 0.0, 3.0, 40.0])
def test_non_detection_derivatives(z):
    def expected(x):
        return -np.log(OTHER_CAUSES + (1.0 - OTHER_CAUSES) * norm.cdf(x))

    value, slope, curvature = fainter_than_limit(z)
    assert value == pytest.approx(expected(z), rel=1e-12, abs=1e-15)
    h = 1e-4
    assert slope == pytest.approx((expected(z + h) - expected(z - h)) / (2.0 * h), abs=1e-7)
    second = (fainter_than_limit(z + h)[1] - fainter_than_limit(z - h)[1]) / (2.0 * h)
    assert curvature == pytest.approx(max(second, 0.0), abs=1e-6)


@pytest.mark.parametrize("inertia", INERTIAS)
@pytest.mark.parametrize("case", ["plain", "non-detections"])
def test_gradient_against_differences(inertia, case):
    model = model_of(inertia)
    data = _light_curve(TRUE, model)
    if case == "non-detections":
        data[::4, SEEN], data[::4, MAGNITUDE] = 0.0, 14.0
    u = np.array([0.3, -0.7, 0.5, 0.2, -0.4, 0.8])
    gradient, information = np.empty(6), np.empty((6, 6))
    value = cost_and_derivatives(u, data, anchor_of(), model, gradient, information)
    assert value == pytest.approx(cost(u, data, anchor_of(), model, np.inf), rel=1e-12)
    differences = cost_differences(u, data, model)
    np.testing.assert_allclose(gradient, differences, rtol=2e-5, atol=2e-5 * np.abs(gradient).max())


@pytest.mark.parametrize("inertia", INERTIAS)
def test_information_is_that_of_the_jacobian(inertia):
    model = model_of(inertia)
    data = _light_curve(TRUE, model)
    gradient, information = np.empty(6), np.empty((6, 6))
    cost_and_derivatives(TRUE, data, anchor_of(), model, gradient, information)
    jacobian = approx_fprime(TRUE, lambda u: _magnitudes(u, data, model), 1e-6)
    np.testing.assert_allclose(information, np.eye(6) + jacobian.T @ jacobian / 0.01, rtol=2e-3)


def test_information_of_non_detections_weighs_rows_by_their_curvature():
    model = model_of()
    data = _light_curve(TRUE, model, n=60)
    limit = float(np.median(_magnitudes(TRUE, data, model)[::3]))
    data[::3, SEEN], data[::3, MAGNITUDE] = 0.0, limit
    gradient, information = np.empty(6), np.empty((6, 6))
    cost_and_derivatives(TRUE, data, anchor_of(), model, gradient, information)
    jacobian = approx_fprime(TRUE, lambda u: _magnitudes(u, data, model), 1e-6)
    excess = (_magnitudes(TRUE, data, model) - limit) / 0.1
    curvature = np.array([fainter_than_limit(z)[2] for z in excess])
    weight = np.where(data[:, SEEN] == 1.0, 1.0, curvature) / 0.01
    assert np.ptp(curvature[::3]) > 0.1  # otherwise the weights would be equal
    expected = np.eye(6) + jacobian.T @ (weight[:, None] * jacobian)
    np.testing.assert_allclose(information, expected, rtol=2e-3, atol=1e-3 * expected.max())


def test_an_aborted_sum_is_at_most_the_whole_cost():
    model = model_of()
    data = _light_curve(TRUE, model)
    u = -TRUE
    whole = cost(u, data, anchor_of(), model, np.inf)
    partial = cost(u, data, anchor_of(), model, 0.1 * whole)
    assert 0.1 * whole < partial <= whole


def test_levenberg_marquardt_finds_the_minimum_scipy_finds():
    model = model_of()
    data = _light_curve(TRUE, model)
    u, information = TRUE + 0.1, np.empty((6, 6))
    value = refine(u, data, anchor_of(), model, 1e-2, 50, information, *NONE, 0.0)
    found = minimize(lambda v: cost(v, data, anchor_of(), model, np.inf), u, method="BFGS")
    assert value == pytest.approx(found.fun, abs=0.02)
    whitened = np.linalg.cholesky(information).T @ (u - found.x)
    assert np.linalg.norm(whitened) < 0.3


SEARCH = SearchSettings(8, 4, 8, 64, 3, 8, 3.0, 2.0, 12.0, 1)


def _many_minima(true=TRUE):
    """A few magnitudes and a prior of 60 degrees leave several minima."""
    wide = np.repeat([np.deg2rad(60.0), np.deg2rad(2.4) / 3600.0], 3)
    return model_of()._replace(sigma=wide), _light_curve(true, model_of(), hours=(0.0, 2.0), n=8)


def _several_modes(model, data):
    """Modes after three searches, and their number."""
    modes = prior_hypotheses(8)
    for _ in range(3):
        search(modes, data, model, SEARCH, np.random.default_rng(2), False)
    assert modes.count[0] > 1
    return modes, modes.count[0]


def _lowest(model, data, settings, searches=4):
    """Lowest cost among the modes found."""
    modes, rng = prior_hypotheses(settings.modes), np.random.default_rng(5)
    for _ in range(searches):
        search(modes, data, model, settings, rng, False)
    live = modes.u[: modes.count[0]]
    return min(cost(u, data, anchor_of(), model, np.inf) for u in live)


def test_search_finds_the_global_minimum_where_one_start_does_not():
    """Brute force: the lowest of many local searches by SciPy from random starts."""
    one = SEARCH._replace(modes=1, starts=0, first_starts=0, pool=0)
    missed = []
    for number in range(4):
        # about ten standard deviations of the usual prior, so that the start is far away
        true = 8.0 * np.random.default_rng(number).standard_normal(6) * np.repeat([1.0, 0.1], 3)
        model, data = _many_minima(true)
        starts = np.random.default_rng(1).standard_normal((40, 6))
        best = min(
            minimize(lambda v, d=data, m=model: cost(v, d, anchor_of(), m, np.inf), s).fun
            for s in starts
        )
        assert _lowest(model, data, SEARCH) <= best + 0.05
        missed.append(_lowest(model, data, one) > best + 0.3)
    assert any(missed)


def test_doubtful_fits_are_searched_again_and_clear_fits_are_not():
    missed, searches = np.zeros(2, dtype=int), []
    for number in range(12):
        true = 8.0 * np.random.default_rng(number).standard_normal(6) * np.repeat([1.0, 0.1], 3)
        model, data = _many_minima(true)
        best = _lowest(model, data, SEARCH, 8)
        for k, most in enumerate((1, 3)):
            modes = prior_hypotheses(8)
            settings, rng = SEARCH._replace(searches=most), np.random.default_rng(5)
            search_until_clear(modes, data, model, settings, rng)
            missed[k] += cost(modes.u[0], data, anchor_of(), model, np.inf) > best + 0.5
        searches.append(modes.count[1])
    assert missed[0] > 0 and missed[1] == 0
    assert min(searches) == 1 and max(searches) == 3
    model, modes = model_of(), prior_hypotheses(8)
    modes.u[0] = TRUE
    settings, rng = SEARCH._replace(searches=12), np.random.default_rng(5)
    search_until_clear(modes, _light_curve(TRUE, model), model, settings, rng)
    assert modes.count[1] == 1  # the mode is there, and fits


def test_a_mode_that_was_missed_is_found_afresh_and_suspect_until_data_confirm_it():
    """The only live mode is far from the truth, and so certain that no point near it helps."""
    model, modes = model_of(), prior_hypotheses(8)
    data = _light_curve(TRUE, model)
    modes.u[0], modes.root[0], modes.count[1] = -2.0, 1e3 * np.eye(6), 1
    settings, rng = SEARCH._replace(searches=6), np.random.default_rng(5)
    search_until_clear(modes, data, model, settings, rng)
    assert squared_distance(TRUE, modes.u[0], modes.root[0]) < 25.0
    assert 2 < modes.count[1] <= 7 and modes.count[2] == 1
    search_until_clear(modes, data, model, settings, rng)
    assert modes.count[2] == 0


def test_a_search_afresh_draws_body_parameters_from_their_prior():
    """Those of the live mode are wrong, and all its points have them."""
    plain = model_of()
    sigma, kinds = np.append(plain.sigma, 0.5), np.array([SCALE])
    model = plain._replace(sigma=sigma, surface_kinds=kinds)
    data = _light_curve(TRUE, plain)
    wrong = prior_hypotheses(8, 7)
    wrong.u[0, 6], wrong.root[0] = -3.0, np.diag([1.0] * 6 + [1e4])
    found = []
    for afresh in (False, True):
        modes = Hypotheses(*(part.copy() for part in wrong))
        alone = SEARCH._replace(warm_iterations=0, iterations=0)
        search(modes, data, model, alone, np.random.default_rng(1), afresh)
        found.append(modes.u[: modes.count[0], 6])
    assert np.abs(found[0] + 3.0).max() < 1e-3 < np.abs(found[1] + 3.0).max()


def test_points_of_a_search_are_from_the_stated_distributions():
    """One live mode is at 90 in all parameters. A search afresh draws all from the prior; another
    one draws half of the rotations around the mode, and all body parameters."""
    plain = model_of()
    model = plain._replace(sigma=np.append(plain.sigma, 0.5), surface_kinds=np.array([SCALE]))
    data = _light_curve(TRUE, plain)
    sizes = {"modes": 64, "starts": 40, "first_starts": 40, "pool": 40}
    unchanged = {"warm_iterations": 0, "iterations": 0, "merge_distance": 0.0, "drop": np.inf}
    for afresh, around in ((False, [20, 40]), (True, [0, 0])):
        modes = prior_hypotheses(64, 7)
        modes.u[0], modes.root[0] = 90.0, 0.5 * np.eye(7)
        settings, rng = SEARCH._replace(**sizes, **unchanged), np.random.default_rng(1)
        search(modes, data, model, settings, rng, afresh)
        near = modes.u[: modes.count[0]] > 45.0
        assert len(near) == 41
        assert near[:, :6].all(axis=1).sum() == near[:, :6].any(axis=1).sum() == 1 + around[0]
        assert near[:, 6].sum() == 1 + around[1]


def test_weights_are_those_of_laplace():
    model, data = _many_minima()
    modes, live = _several_modes(model, data)
    gradient, information = np.empty(6), np.empty((6, 6))
    logs = []
    for u, root in zip(modes.u[:live], modes.root[:live], strict=True):
        value = cost_and_derivatives(u, data, anchor_of(), model, gradient, information)
        np.testing.assert_allclose(root @ root.T, information, rtol=1e-9)
        logs.append(-value - 0.5 * np.linalg.slogdet(information)[1])
    expected = np.exp(np.array(logs) - max(logs))
    np.testing.assert_allclose(modes.weight[:live], expected / expected.sum(), rtol=1e-9)
    assert np.all(np.diff(modes.weight[:live]) <= 0.0)


def test_search_is_reproducible_and_keeps_no_duplicates():
    model, data = _many_minima()
    found = []
    for _ in range(2):
        modes = prior_hypotheses(8)
        search(modes, data, model, SEARCH, np.random.default_rng(2), False)
        found.append(modes)
    np.testing.assert_array_equal(found[0].u, found[1].u)
    live = modes.count[0]
    assert live > 1  # eight magnitudes and a wide prior leave several
    for j in range(live):
        for i in range(j):
            between = modes.root[i].T @ (modes.u[j] - modes.u[i])
            assert between @ between >= SEARCH.merge_distance


def test_condensed_data_leave_the_cost_near_a_mode():
    model = model_of()
    data = _light_curve(TRUE, model, n=200)
    modes = prior_hypotheses(2)
    for _ in range(3):
        search(modes, data, model, SEARCH, np.random.default_rng(4), False)
    u = modes.u[0].copy()
    nearby = u + np.linalg.solve(modes.root[0].T, 0.5 * np.ones(6))
    before = [cost(v, data, anchor_of(), model, np.inf) for v in (u, nearby)]
    condense(modes, data[:150], model, 1.0)
    anchor = Anchor(modes.anchor_mean[0], modes.anchor_information[0], modes.anchor_offset[0])
    after = [cost(v, data[150:], anchor, model, np.inf) for v in (u, nearby)]
    assert after[0] == pytest.approx(before[0], abs=1e-8)
    assert after[1] == pytest.approx(before[1], abs=0.25)


def test_condensed_modes_keep_their_anchors_when_their_order_changes():
    model, data = _many_minima()
    modes, live = _several_modes(model, data)
    before = modes.u[:live].copy()
    condense(modes, data, model, 1.0)
    pasts = [
        Anchor(modes.anchor_mean[j].copy(), modes.anchor_information[j].copy(), offset.copy())
        for j, offset in enumerate(modes.anchor_offset[:live])
    ]
    # the later data favor the least likely mode
    own_units = before[live - 1] * model.sigma / SIGMA
    later = _light_curve(own_units, model, hours=(2.0, 3.0), n=20, noise=0.0)
    whole = cost(before[-1], np.vstack([data, later]), anchor_of(), model, np.inf)
    assert cost(before[-1], later, pasts[-1], model, np.inf) == pytest.approx(whole, rel=1e-9)
    alone = SEARCH._replace(starts=0, first_starts=0)
    search(modes, later, model, alone, np.random.default_rng(3), False)
    origins = []
    for j in range(modes.count[0]):
        origin = int(np.argmin([np.abs(p.mean - modes.anchor_mean[j]).max() for p in pasts]))
        np.testing.assert_array_equal(modes.anchor_mean[j], pasts[origin].mean)
        np.testing.assert_array_equal(modes.anchor_information[j], pasts[origin].information)
        np.testing.assert_array_equal(modes.anchor_offset[j], pasts[origin].offset)
        u, steps = before[origin].copy(), alone.warm_iterations
        refine(u, later, pasts[origin], model, 1e-2, steps, np.empty((6, 6)), *NONE, 0.0)
        np.testing.assert_allclose(modes.u[j], u, atol=1e-9)
        origins.append(origin)
    assert origins[0] != 0


@pytest.mark.parametrize("inertia", INERTIAS)
def test_points_carry_mean_and_covariance(inertia):
    """A narrow mixture, against the linear propagation of its covariance by random draws."""
    model = model_of(inertia)
    modes = prior_hypotheses(1)
    modes.u[0], modes.root[0] = TRUE, 20.0 * np.eye(6)
    q, w, weight = np.zeros((12, 4)), np.zeros((12, 3)), np.zeros(12)
    deviations = np.zeros((12, 0))
    assert mixture_points(modes, model, q, w, weight, deviations) == 12
    step_points(q, w, deviations, 7200.0, model)
    mean_q, mean_w = np.empty(4), np.empty(3)
    differences, sigma = np.empty((12, 6)), np.empty(6)
    mixture_moments(q, w, weight, mean_q, mean_w, differences)
    weighted_deviations(differences, weight, sigma)
    draws = TRUE + np.random.default_rng(0).standard_normal((4000, 6)) / 20.0
    ends = [
        propagate_rotation(
            compose(grp.to_quaternion(SIGMA[:3] * u[:3]), model.quaternion),
            model.omega + SIGMA[3:] * u[3:], [7200.0], model.inertia,
        )
        for u in draws
    ]  # fmt: skip
    errors = grp.from_quaternion(
        compose(np.array([e[0][0] for e in ends]), mean_q * [-1, -1, -1, 1])
    )
    np.testing.assert_allclose(errors.std(axis=0), sigma[:3], rtol=0.05)
    np.testing.assert_allclose(errors.mean(axis=0) / sigma[:3], 0.0, atol=0.08)
    rates = np.array([e[1][0] for e in ends])
    np.testing.assert_allclose(rates.std(axis=0), sigma[3:], rtol=0.05)


def test_a_fading_memory_returns_to_the_prior():
    model = model_of()
    data = _light_curve(TRUE, model, n=100)
    modes = prior_hypotheses(1)
    search(modes, data, model, SEARCH, np.random.default_rng(4), False)
    u = modes.u[0].copy()
    before = cost(u, data, anchor_of(), model, np.inf)
    condense(modes, data, model, 0.5)
    anchor = Anchor(modes.anchor_mean[0], modes.anchor_information[0], modes.anchor_offset[0])
    assert cost(u, data[:0], anchor, model, np.inf) == pytest.approx(before, rel=1e-9)
    for _ in range(60):
        condense(modes, data[:0], model, 0.5)
    np.testing.assert_allclose(modes.anchor_mean[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(modes.anchor_information[0], np.eye(6), atol=1e-9)
