"""Choice between models of a body by the evidence of its light curve."""

import numpy as np
import pytest
from oracles.light_curves import FACETS, anchor_of, geometry, model_of
from oracles.reflection import lambert_phong_magnitude
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from cislunar.attitude.grp import from_quaternion
from cislunar.attitude.quaternion import attitude_matrix, compose, from_rotation_vector
from cislunar.errors import ConfigurationError
from cislunar.estimation.light_curves.batch import batch
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.light_curves.light_curve import cost, cost_and_derivatives, initial_state
from cislunar.estimation.light_curves.model_selection.characterization import (
    AMBIGUOUS,
    UNIQUE,
    UNKNOWN_BODY,
    amplitude_of,
    area_albedo_of,
    attitude_status,
    characterize,
)
from cislunar.estimation.light_curves.model_selection.correlated import (
    CorrelatedFit,
    ModelError,
    bins_of_rows,
)
from cislunar.estimation.light_curves.model_selection.in_loop import updated_selection
from cislunar.estimation.light_curves.model_selection.ladder import select_model
from cislunar.estimation.light_curves.model_selection.report import rotation_at
from cislunar.estimation.light_curves.model_selection.residual_tests import explains, p_values
from cislunar.estimation.light_curves.model_selection.rows import expected_rows
from cislunar.estimation.light_curves.model_selection.rungs import RUNGS, model_of_rung
from cislunar.estimation.light_curves.model_selection.settings import ModelSelectionSettings
from cislunar.estimation.light_curves.row_blocks import (
    MAGNITUDE,
    RANGE,
    SEEN,
    SUN,
    TIME,
    VIEW,
    WEIGHT,
)
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material, PhotometryModel
from cislunar.photometry.shapes import scale_axes
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.truth import TruthModel

HOURS = 20.0
"""Duration of the light curves."""


def _observed(n=600):
    """Geometry of two observers that take turns every hour."""
    data = geometry(n, (0.0, HOURS))
    second = (data[:, TIME] // 3600.0) % 2 == 1
    data[second, VIEW] = data[second, VIEW] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0, 0], [0, 0, 1.0]])
    return data


def _motion(model, u, times):
    """Attitudes of a spherical body and its angular velocity."""
    quaternion, omega = np.empty(4), np.empty(3)
    initial_state(u, model, quaternion, omega)
    return [compose(from_rotation_vector(omega * t), quaternion) for t in times], omega


def _simulated(magnitude, seed=0):
    """Light curve of a body, its model and the final true attitude."""
    model, rng = model_of(), np.random.default_rng(seed)
    model = model._replace(irradiance_4pi=False)
    u, data = rng.standard_normal(6), _observed()
    attitudes, _ = _motion(model, u, data[:, TIME])
    data[:, MAGNITUDE] = magnitude(attitudes, data) + 0.1 * rng.standard_normal(len(data))
    data = np.ascontiguousarray(data[np.isfinite(data[:, MAGNITUDE])])
    return data, model, _motion(model, u, [3600.0 * HOURS])[0][0], u


def _as_believed(attitudes, data):
    model = model_of()._replace(irradiance_4pi=False)
    found = []
    for q, row in zip(attitudes, data, strict=True):
        still = model._replace(quaternion=np.asarray(q), omega=np.zeros(3))
        found.append(expected_rows(np.zeros(6), row[None], still)[0][0])
    return np.where(np.array(found) < 28.0, found, np.inf)


def _angle_deg(estimate, true):
    error = from_quaternion(compose(true, estimate.quaternion * np.array([-1.0, -1.0, -1.0, 1.0])))
    return np.rad2deg(np.linalg.norm(error)), error


def test_expected_rows_are_those_of_the_cost():
    """Residuals, gradient and Gauss-Newton matrix of the compiled cost, from rows."""
    model = model_of_rung(model_of("triaxial"), "large deviations")
    size, data = model.sigma.size, _observed(90)
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
    data = _observed()
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
    model, data = model_of_rung(model_of(), "material"), _observed(60)
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


class _LinearFit(CorrelatedFit):
    """A fit of magnitudes that are linear in the parameters, with fixed directions."""

    def __init__(self, design, directions, *args):
        super().__init__(*args)
        self._linear = design, directions

    def rows(self, u):
        return self._linear[0] @ u, self._linear[1], self._linear[0]


def test_evidence_of_an_unknown_noise_against_quadrature():
    """The marginal likelihood over all parameters and the noise variance, by quadrature over the
    variance, of models with different numbers of parameters and different model errors."""
    rng, n, freedom = np.random.default_rng(2), 90, 4.0
    data = _observed(n)
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
    data = _observed(n)
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
    data, rng, rejected = _observed(400), np.random.default_rng(6), []
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


def test_models_are_searched_again_only_where_that_is_needed():
    """A body as believed: the wide models are left out while its residuals are those of the noise.
    An offset that grows with time brings them back."""
    data, model, _, _ = _simulated(_as_believed)
    given = np.random.default_rng(1), ModelSelectionSettings(effort=1)

    def updated(last, rows):
        return updated_selection(last, rows, model, *given)

    first = updated(None, data[:250])
    assert not first.selected.wide and first.searched == 250
    assert updated(first, data[:250]) is first
    grown = updated(first, data[:400])
    assert not grown.selected.wide and (grown.searched, grown.fitted) == (250, 400)
    searched = select_model(data[:400], model, np.random.default_rng(2))
    ends = [rotation_at(each, model, 3600.0 * HOURS) for each in (grown.selected, searched)]
    apart = from_quaternion(compose(ends[0].quaternion, ends[1].quaternion * [-1, -1, -1, 1]))
    assert np.linalg.norm(apart) < 0.1 * np.sqrt(np.trace(ends[1].covariance[:3, :3]))
    wrong = data[:400].copy()
    wrong[:, MAGNITUDE] += 0.4 * np.sin(wrong[:, TIME] / 2500.0)
    again = updated(first, wrong)
    assert again.selected.wide and (again.searched, again.fitted) == (400, 400)
    # afterwards the modes wait for a growth by half
    assert updated(again, data[:420]) is again


def test_an_unknown_noise_is_estimated_with_the_model():
    """Three times the assumed noise: an exact model is still recognized, and its cost is that of
    the fit without a choice."""
    data, model, true, _ = _simulated(_as_believed)
    data[:, MAGNITUDE] += 0.1 * np.sqrt(8.0) * np.random.default_rng(4).standard_normal(len(data))
    unknown = model._replace(noise_freedom=4.0)
    selected = select_model(data, unknown, np.random.default_rng(1))
    assert selected.rung == "known" and selected.tempering == 1.0
    assert selected.noise_factor == pytest.approx(9.0, rel=0.15)
    estimate = rotation_at(selected, model, 3600.0 * HOURS)
    angle, error = _angle_deg(estimate, true)
    assert angle < 3.0
    assert np.all(np.abs(error) < 4.0 * np.sqrt(np.diag(estimate.covariance)[:3]))
    own = model_of_rung(unknown, "known")
    fit = CorrelatedFit(data, bins_of_rows(data, 200), own, ModelError(0.0, 1.0))
    best = selected.candidates[0].minimum.u
    costs = [
        (fit.cost(u, fit.rows(u))[0], cost(u, data, anchor_of(6), own, np.inf))
        for u in (best, best + 0.01)
    ]
    (one, usual), (other, changed) = costs
    assert other - one == pytest.approx(changed - usual, rel=1e-9)


def test_a_body_as_believed_is_recognized():
    data, model, true, _ = _simulated(_as_believed)
    selected = select_model(data, model, np.random.default_rng(1))
    assert selected.rung == "known" and selected.tempering == 1.0
    assert selected.model_error_mag < 0.02
    estimate = rotation_at(selected, model, 3600.0 * HOURS)
    angle, error = _angle_deg(estimate, true)
    sigma = np.sqrt(np.diag(estimate.covariance)[:3])
    assert angle < 1.0 and np.all(np.abs(error) < 4.0 * sigma)
    np.testing.assert_allclose(selected.weight.sum(), 1.0)
    # the same stream of random numbers gives the same modes
    again = select_model(data, model, np.random.default_rng(1))
    np.testing.assert_array_equal(again.candidates[0].minimum.u, selected.candidates[0].minimum.u)
    assert list(selected.log_evidence) == list(RUNGS)


@pytest.mark.parametrize("truth", ["axes", "lambert-phong"])
def test_a_wrong_model_is_recognized_and_the_attitude_kept(truth):
    """Brightness of the truth by a formula of its own."""
    facets = scale_axes(FACETS, np.array([1.1, 1.0, 0.95])) if truth == "axes" else FACETS

    def magnitude(attitudes, data):
        if truth == "axes":
            body = model_of().surface._replace(areas=facets.areas, normals=facets.normals)
            still = model_of()._replace(irradiance_4pi=False, surface=body, omega=np.zeros(3))
            rows = [
                expected_rows(np.zeros(6), row[None], still._replace(quaternion=np.asarray(q)))
                for q, row in zip(attitudes, data, strict=True)
            ]
            found = np.array([each[0][0] for each in rows])
            return np.where(found < 28.0, found, np.inf)
        return lambert_phong_magnitude(attitudes, data, facets, Material())

    errors, distances = [], []
    for seed in range(4):
        data, model, true, _ = _simulated(magnitude, seed)
        selected = select_model(data, model, np.random.default_rng(1))
        assert selected.rung not in ("known", "material")
        assert selected.log_evidence["known"] < selected.log_evidence[selected.rung] - 20.0
        estimate = rotation_at(selected, model, 3600.0 * HOURS)
        angle, error = _angle_deg(estimate, true)
        errors.append(angle)
        distances.append(error @ np.linalg.solve(estimate.covariance[:3, :3], error) / 3.0)
    assert np.median(errors) < 5.0
    assert np.mean(distances) < 2.0


def test_what_is_known_without_an_attitude():
    """Intervals contain the truth, and an unknown frame widens the attitude, not the rate."""
    inside = []
    for seed in range(3):
        data, model, _, u = _simulated(
            lambda attitudes, rows: lambert_phong_magnitude(attitudes, rows, FACETS, Material()),
            seed,
        )
        selected = select_model(data, model, np.random.default_rng(1))
        found = characterize(selected, data, model, np.random.default_rng(2))
        attitudes, omega = _motion(model, u, data[:, TIME])
        clean = lambert_phong_magnitude(attitudes, data, FACETS, Material())
        axis = attitude_matrix(_motion(model, u, [0.0])[0][0]).T @ omega / np.linalg.norm(omega)
        inside += [
            found.spin_period_h.contains(2.0 * np.pi / np.linalg.norm(omega) / 3600.0),
            np.rad2deg(np.arccos(axis @ found.spin_axis)) < found.spin_axis_radius_deg,
            found.amplitude_mag.contains(amplitude_of(clean, data, False)),
            found.area_albedo_m2.contains(area_albedo_of(clean, data, False)),
        ]
        assert found.spin_period_h.high / found.spin_period_h.low < 1.05  # prior: a fifth
        assert found.status in (UNIQUE, AMBIGUOUS)
    assert np.sum(inside) >= 10
    wide = selected._replace(log_evidence={**selected.log_evidence, "large deviations": 1e6})
    assert attitude_status(wide, model) == UNKNOWN_BODY
    narrow, broad = (rotation_at(each, model, 7200.0) for each in (selected, wide))
    added = np.diag(broad.covariance - narrow.covariance)[:3]
    np.testing.assert_allclose(np.rad2deg(np.sqrt(added)), 5.0, rtol=0.03)
    assert attitude_status(selected._replace(model_error_mag=0.3), model) == UNKNOWN_BODY


def test_area_times_albedo_is_that_of_a_sphere():
    """A diffuse sphere of known radius, by the library's own magnitudes of spheres."""
    data = _observed(50)
    phase = np.arccos(np.sum(data[:, SUN] * data[:, VIEW], axis=1))
    light = 2.0 / 3.0 * 0.4 * 1.5**2 * (np.sin(phase) + (np.pi - phase) * np.cos(phase))
    magnitude = -26.74 - 2.5 * np.log10(light / (np.pi * data[:, RANGE] ** 2))
    assert area_albedo_of(magnitude, data, False) == pytest.approx(0.4 * np.pi * 1.5**2, rel=1e-9)
    assert amplitude_of(magnitude, data, False) == pytest.approx(0.0, abs=1e-9)
    faint = magnitude + 2.5 * np.log10(4.0 * np.pi)
    assert area_albedo_of(faint, data, True) == pytest.approx(0.4 * np.pi * 1.5**2, rel=1e-9)


def test_models_are_chosen_in_the_closed_loop():
    """With a Lambert-Phong truth, of which the estimators know nothing."""
    problem = tracking_problem(6, 4, PhotometryModel(), duration_hours=6.0)
    surfaces = target_surfaces(FACETS, Material(), 4, PhotometryModel(reflection="lambert-phong"))
    truth = TruthModel(surfaces, problem.loop.sensor.noise, np.zeros(3))
    found = {}
    for effort in (0, 1):
        settings = BatchSettings(model_selection=ModelSelectionSettings(effort))
        found[effort] = run_closed_loop(
            *problem[:4], [1], problem.loop, estimator=batch(settings), truth=truth
        )
    usual, chosen = found[0], found[1]
    assert usual.attitude_status is None
    assert chosen.attitude_status.shape == (1, 6, 4)
    consistent = [
        np.mean(np.abs(each.error[0, -1, :, :3]) <= 3.0 * each.sigma[0, -1, :, :3])
        for each in (usual, chosen)
    ]
    assert consistent[0] < 0.7 and consistent[1] > 0.9
    doubtful = chosen.attitude_status[0, -1] != UNIQUE
    assert not np.any(chosen.metrics.custody_attitude[0] & doubtful)


@pytest.mark.parametrize("other", [{"window_hours": 2.0}, {"use_non_detections": True}])
def test_settings_that_exclude_the_choice(other):
    with pytest.raises(ConfigurationError, match="exclude each other"):
        BatchSettings(model_selection=ModelSelectionSettings(1), **other)


def test_rows_that_cannot_be_used_are_refused():
    model, data = model_of(), _observed(30)
    rng = np.random.default_rng(0)
    with pytest.raises(ConfigurationError, match="leave out non-detections"):
        select_model(data[:0], model, rng)
    data[3, SEEN] = 0.0
    with pytest.raises(ConfigurationError, match="leave out non-detections"):
        select_model(data, model, rng)
