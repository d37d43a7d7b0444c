"""Choice between models of a body by the evidence of its light curve."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from measured import SENSOR, during, measured_problem
from oracles.light_curves import FACETS, anchor_of, model_of
from oracles.reflection import lambert_phong_magnitude
from simulated_light_curves import HOURS, as_believed, observed_rows, rotation_at, simulated

from cislunar.attitude.grp import from_quaternion, to_quaternion
from cislunar.attitude.quaternion import compose, to_body, to_inertial
from cislunar.errors import ConfigurationError
from cislunar.estimation.light_curves.batch import BatchEstimator, batch
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.light_curves.hypotheses import prior_hypotheses
from cislunar.estimation.light_curves.light_curve import cost
from cislunar.estimation.light_curves.mixture import mixture_moments
from cislunar.estimation.light_curves.model_selection import in_loop
from cislunar.estimation.light_curves.model_selection.body_models import (
    BODY_MODELS,
    Candidate,
    SelectedModel,
    with_body_model,
)
from cislunar.estimation.light_curves.model_selection.characterization import (
    AMBIGUOUS,
    UNIQUE,
    UNKNOWN_BODY,
    attitude_status,
)
from cislunar.estimation.light_curves.model_selection.correlated import (
    CorrelatedFit,
    Minimum,
    ModelError,
    bins_of_rows,
)
from cislunar.estimation.light_curves.model_selection.in_loop import (
    Selection,
    parameter_deviations,
    report_points,
    reported_points,
    status_of,
    updated_selection,
    widened_points,
)
from cislunar.estimation.light_curves.model_selection.selection import (
    narrowed,
    refitted,
    select_model,
)
from cislunar.estimation.light_curves.model_selection.settings import ModelSelectionSettings
from cislunar.estimation.light_curves.row_blocks import MAGNITUDE, SEEN, SUN, TIME, VIEW
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material, PhotometryModel
from cislunar.photometry.shapes import scale_axes
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.truth import TruthModel


def _angle_deg(estimate, true):
    error = from_quaternion(compose(true, estimate.quaternion * np.array([-1.0, -1.0, -1.0, 1.0])))
    return np.rad2deg(np.linalg.norm(error)), error


def test_models_are_searched_again_only_where_that_is_needed():
    """A body as believed: the wide models are left out while its residuals are those of the noise.
    An error that varies with time brings them back."""
    data, model, _, _ = simulated(as_believed)
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
    # afterwards the modes wait for a growth by a quarter
    assert updated(again, data[:490]) is again
    # a result that fails the tests is replaced at once
    assert updated(first, wrong[:300]).searched == 300
    # so are narrow models that were fitted together with the wide ones
    wide = Selection(first.selected._replace(wide=True), 250, 250)
    assert updated(wide, data[:400]).searched == 250
    assert updated(wide, wrong).searched == 400


def test_a_search_begins_with_the_fits_that_led_to_it(monkeypatch):
    data, model, _, _ = simulated(as_believed)
    settings, begun = ModelSelectionSettings(effort=1), []

    def kept(data, model, rng, settings, previous, modes):
        begun.append(previous)
        return select_model(data, model, rng, settings, previous, modes)

    monkeypatch.setattr(in_loop, "select_model", kept)
    given = model, np.random.default_rng(1), settings
    first = updated_selection(None, data[:100], *given)
    wrong = data[:150].copy()
    wrong[:, MAGNITUDE] += 0.4 * np.sin(wrong[:, TIME] / 2500.0)
    updated_selection(first, wrong, *given)
    own, after = first.selected.candidates, begun[1].candidates
    assert begun[0] is None
    assert len(after) > len(own) and after[-len(own) :] == own
    found = narrowed(first.selected, wrong, model, settings)[0].candidates
    np.testing.assert_array_equal(after[0].minimum.u, found[0].minimum.u)


def test_the_rotation_of_an_unknown_body_is_more_uncertain():
    """At the epoch and twelve hours later: 1.8 times the standard deviations of the same modes if
    the model error is large, and 5 deg about each axis besides if the shape is unknown."""
    data, model, _, _ = simulated(as_believed)
    settings = ModelSelectionSettings(effort=1)
    selected = select_model(data[:100], model, np.random.default_rng(1), settings)
    assert selected.body in ("known", "material")

    def sigma(selected, hours):
        selection = Selection(selected, 100, 100)
        points, count = reported_points(selection, model, 3600.0 * hours, 0)
        quaternion, omega, found = np.empty(4), np.empty(3), np.empty(6)
        report_points(points, count, quaternion, omega, found)
        return found

    unknown = selected._replace(model_error_mag=0.3)
    evidence = dict.fromkeys(BODY_MODELS, -10.0) | {"medium deviations": 0.0}
    other = selected._replace(log_evidence=evidence)
    for hours in (0.0, 12.0):
        usual = sigma(selected, hours)
        np.testing.assert_allclose(sigma(unknown, hours), 1.8 * usual, rtol=1e-3)
        expected = np.hypot(1.8 * usual[:3], np.deg2rad(5.0))
        np.testing.assert_allclose(sigma(other, hours)[:3], expected, rtol=5e-3)


@pytest.mark.parametrize("apart_deg", [0.0, 40.0])
def test_wider_points_keep_their_mean_and_a_common_rate(apart_deg):
    """Two groups of points with a scatter of 10 deg, and one inertial angular velocity."""
    rng = np.random.default_rng(2)
    grp = np.deg2rad(10.0) * rng.standard_normal((50, 3))
    grp[:25, 0] += np.deg2rad(apart_deg)
    quaternion = compose(to_quaternion(grp), [0.5, -0.5, 0.5, 0.5])
    spin, weight = np.array([1e-4, 2e-4, -1e-4]), np.full(50, 0.02)
    wide, omega = widened_points(quaternion, to_body(quaternion, spin), weight)
    np.testing.assert_allclose(to_inertial(wide, omega), np.tile(spin, (50, 1)), rtol=1e-9)
    moments = []
    for attitudes in (quaternion, wide):
        center, rate, differences = np.empty(4), np.empty(3), np.empty((50, 6))
        mixture_moments(attitudes, omega, weight, center, rate, differences)
        moments.append((center, differences[:, :3]))
    assert abs(moments[0][0] @ moments[1][0]) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(moments[1][1], 1.8 * moments[0][1], atol=2e-3)


def test_parameters_are_those_of_the_chosen_models():
    """Albedo and reflectance of two models of the body, of which one has no deviations."""
    body = with_body_model(model_of(), "material")
    sigma = np.append(body.sigma[:6], [0.5, 1.0])
    model = body._replace(sigma=sigma, surface_kinds=body.surface_kinds[[0, 2]])
    candidates = []
    for name in ("known", "small deviations"):
        size = with_body_model(model, name).sigma.size
        information = np.diag(np.arange(1.0, size + 1.0))
        candidates.append(
            Candidate(name, ModelError(0.0, 1.0), Minimum(np.ones(size), information, 0.0))
        )
    selected = SelectedModel(tuple(candidates), np.array([0.25, 0.75]), {}, 0.0, 1.0)
    weight, mean, variance = parameter_deviations(selected, model)
    np.testing.assert_array_equal(weight, selected.weight)
    # prior standard deviations of 0.25 and 0.5, of which the information is 7 and 9
    np.testing.assert_allclose(mean, [[0.0, 0.0], [0.5, 0.5]])
    np.testing.assert_allclose(variance, [[0.0, 0.0], [0.25 / 7.0, 0.25 / 9.0]])


def test_an_unknown_noise_is_estimated_with_the_model():
    """Three times the assumed noise: an exact model is still recognized, and its cost is that of
    the fit without a choice."""
    data, model, true, _ = simulated(as_believed)
    data[:, MAGNITUDE] += 0.1 * np.sqrt(8.0) * np.random.default_rng(4).standard_normal(len(data))
    unknown = model._replace(noise_freedom=4.0)
    selected = select_model(data, unknown, np.random.default_rng(1))
    assert selected.body == "known" and selected.tempering == 1.0
    assert selected.noise_factor == pytest.approx(9.0, rel=0.15)
    estimate = rotation_at(selected, model, 3600.0 * HOURS)
    angle, error = _angle_deg(estimate, true)
    assert angle < 3.0
    assert np.all(np.abs(error) < 4.0 * np.sqrt(np.diag(estimate.covariance)[:3]))
    own = with_body_model(unknown, "known")
    fit = CorrelatedFit(data, bins_of_rows(data, 200), own, ModelError(0.0, 1.0))
    best = selected.candidates[0].minimum.u
    costs = [
        (fit.cost(u, fit.rows(u))[0], cost(u, data, anchor_of(6), own, np.inf))
        for u in (best, best + 0.01)
    ]
    (one, usual), (other, changed) = costs
    assert other - one == pytest.approx(changed - usual, rel=1e-9)


def test_a_body_as_believed_is_recognized():
    data, model, true, _ = simulated(as_believed)
    selected = select_model(data, model, np.random.default_rng(1))
    assert selected.body == "known" and selected.tempering == 1.0
    assert selected.model_error_mag < 0.02
    estimate = rotation_at(selected, model, 3600.0 * HOURS)
    angle, error = _angle_deg(estimate, true)
    sigma = np.sqrt(np.diag(estimate.covariance)[:3])
    assert angle < 1.0 and np.all(np.abs(error) < 4.0 * sigma)
    np.testing.assert_allclose(selected.weight.sum(), 1.0)
    # the same stream of random numbers gives the same modes
    again = select_model(data, model, np.random.default_rng(1))
    np.testing.assert_array_equal(again.candidates[0].minimum.u, selected.candidates[0].minimum.u)
    assert list(selected.log_evidence) == list(BODY_MODELS)


@pytest.mark.parametrize("truth", ["axes", "lambert-phong"])
def test_a_wrong_model_is_recognized_and_the_attitude_kept(truth):
    """Brightness of the truth by a formula of its own."""
    facets = scale_axes(FACETS, np.array([1.1, 1.0, 0.95])) if truth == "axes" else FACETS

    def magnitude(attitudes, data):
        if truth == "axes":
            return as_believed(attitudes, data, areas=facets.areas, normals=facets.normals)
        return lambert_phong_magnitude(attitudes, data, facets, Material())

    errors, distances = [], []
    for seed in range(4):
        data, model, true, _ = simulated(magnitude, seed)
        selected = select_model(data, model, np.random.default_rng(1))
        assert selected.body not in ("known", "material")
        assert selected.log_evidence["known"] < selected.log_evidence[selected.body] - 20.0
        estimate = rotation_at(selected, model, 3600.0 * HOURS)
        angle, error = _angle_deg(estimate, true)
        errors.append(angle)
        distances.append(error @ np.linalg.solve(estimate.covariance[:3, :3], error) / 3.0)
    assert np.median(errors) < 5.0
    assert np.mean(distances) < 2.0


def _darkening(attitudes, data, facets, change=0.0):
    """Lambert-Phong facets that darken by 0.5 mag/rad of phase angle, with a change of all
    magnitudes."""
    phase = np.arccos(np.clip(np.sum(data[:, SUN] * data[:, VIEW], axis=1), -1.0, 1.0))
    return lambert_phong_magnitude(attitudes, data, facets, Material()) + 0.5 * phase + change


def test_another_law_is_told_from_another_shape():
    """The law of `_darkening` differs more than in "small deviations", and the attitude is known.
    With all facets sixteen times as bright, which their prior makes improbable, this is so too.
    With a quarter of the facets eight times as bright, the body is that of an unknown shape."""
    bright = np.where(np.arange(FACETS.areas.size) % 4 == 0, 8.0, 1.0)
    uneven = replace(FACETS, areas=FACETS.areas * bright)
    cases = (
        (FACETS, 0.0, "other law", UNIQUE), (FACETS, -3.0, "other law", UNIQUE),
        (uneven, 0.0, "large deviations", UNKNOWN_BODY),
    )  # fmt: skip
    for facets, change, body, status in cases:
        data, model, true, _ = simulated(partial(_darkening, facets=facets, change=change), 1)
        selected = select_model(data, model, np.random.default_rng(1))
        assert selected.body == body
        assert attitude_status(selected, model) == status
        estimate = rotation_at(selected, model, 3600.0 * HOURS)
        angle, error = _angle_deg(estimate, true)
        assert angle < 5.0
        assert np.all(np.abs(error) < 4.0 * np.sqrt(np.diag(estimate.covariance)[:3]))


def test_models_that_are_fitted_again_are_weighed_as_after_a_search():
    """The likelihood is tempered. A search follows if a body is no longer unknown."""
    data, model, _, _ = simulated(partial(_darkening, facets=FACETS), 1)
    settings = ModelSelectionSettings(effort=1)
    first = select_model(data[:150], model, np.random.default_rng(1), settings)
    assert first.tempering < 0.9 and first.wide and not first.unknown_body
    rows = data[:220]
    grown, explained = refitted(first, rows, model, np.random.default_rng(2), settings)
    searched = select_model(rows, model, np.random.default_rng(3), settings)
    assert explained and not grown.unknown_body
    assert grown.body == searched.body
    for body, evidence in grown.log_evidence.items():
        assert evidence in (-np.inf, pytest.approx(searched.log_evidence[body], abs=1.0))
    assert grown.tempering == pytest.approx(searched.tempering, abs=0.1)
    again, _ = refitted(
        first._replace(untempered=2 * first.untempered), rows, model, np.random.default_rng(2),
        settings,
    )  # fmt: skip
    assert again.log_evidence == pytest.approx(grown.log_evidence, abs=1e-3)  # none counts twice
    moved = [
        each._replace(
            minimum=each.minimum._replace(u=each.minimum.u + np.eye(each.minimum.u.size)[0])
        )
        for each in first.untempered
    ]
    far = first._replace(untempered=tuple(moved))
    assert not refitted(far, rows, model, np.random.default_rng(2), settings)[1]
    unknown = Selection(first._replace(model_error_mag=0.3), 150, 150)
    again = updated_selection(unknown, rows, model, np.random.default_rng(2), settings)
    assert not again.selected.unknown_body and again.searched == len(rows)


def test_the_status_is_that_of_the_present_attitude():
    """Two modes with one attitude at the epoch, and angular velocities 2 deg/h apart."""
    model = model_of()._replace(irradiance_4pi=False)
    own, candidates = with_body_model(model, "known"), []
    information = 1e6 * np.eye(own.sigma.size)
    for rate in (0.0, np.deg2rad(2.0) / 3600.0 / own.sigma[3]):
        u = np.zeros(own.sigma.size)
        u[3] = rate
        candidates.append(Candidate("known", ModelError(0.0, 1.0), Minimum(u, information, 0.0)))
    selected = SelectedModel(tuple(candidates), np.array([0.6, 0.4]), {"known": 0.0}, 0.0, 1.0)
    selection, none = Selection(selected, 10, 10), prior_hypotheses(1, own.sigma.size)
    for hours, status in ((0.0, UNIQUE), (5.0, AMBIGUOUS)):
        given = reported_points(selection, model, 3600.0 * hours, 0)
        assert status_of(selection, none, *given) == status
        large = selection._replace(selected=selected._replace(model_error_mag=0.3))
        assert status_of(large, none, *given) == UNKNOWN_BODY


def test_a_model_that_another_has_replaced_is_not_fitted():
    """Those of all targets for an hour, and that of the first target for two hours."""
    scene, surfaces, initial, _, measurements, _ = measured_problem(hours=2.0)
    estimator = BatchEstimator(
        scene, surfaces, SENSOR, initial, np.random.default_rng(0), settings=BatchSettings()
    )
    fit = estimator._tracks.fit
    fit.replaced[:] = 1
    estimator.advance(during(measurements, 0, 60))
    assert np.any(fit.rows > 0) and np.all(fit.fitted == 0)
    fit.replaced[1:] = 0
    estimator.advance(during(measurements, 60, 120))
    assert fit.rows[0] > 0 and fit.fitted[0] == 0
    np.testing.assert_array_equal(fit.fitted[1:], fit.rows[1:])


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
    custody = chosen.metrics.custody_attitude[0]
    assert not np.any(custody & doubtful)
    assert np.all(chosen.metrics.accurate_attitude[0] >= custody)


@pytest.mark.parametrize("other", [{"window_hours": 2.0}, {"use_non_detections": True}])
def test_settings_that_exclude_the_choice(other):
    with pytest.raises(ConfigurationError, match="exclude each other"):
        BatchSettings(model_selection=ModelSelectionSettings(1), **other)


def test_rows_that_cannot_be_used_are_refused():
    model, data = model_of(), observed_rows(30)
    rng = np.random.default_rng(0)
    with pytest.raises(ConfigurationError, match="leave out non-detections"):
        select_model(data[:0], model, rng)
    data[3, SEEN] = 0.0
    with pytest.raises(ConfigurationError, match="leave out non-detections"):
        select_model(data, model, rng)
