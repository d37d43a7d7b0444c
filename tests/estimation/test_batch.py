"""The batch estimator in the closed loop, with the paper's filter on the same truth and noise."""

import copy

import numpy as np
import pytest
from measured import SENSOR, during, measured_problem

from cislunar.attitude.quaternion import compose, inverse
from cislunar.campaign.settings.cell_settings import cell_settings
from cislunar.constants import MU
from cislunar.errors import ConfigurationError
from cislunar.estimation import ESTIMATORS, estimator_named
from cislunar.estimation.estimator import INSIDE_PRIMARY, Prediction
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.kalman.mukf import MultiplicativeUKF
from cislunar.estimation.light_curves.batch import BatchEstimator, batch
from cislunar.estimation.light_curves.batch_settings import PRESETS, BatchSettings
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.measurement import DETECTED
from cislunar.observation.records import no_measurements
from cislunar.observation.sensor import Sensor
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.planning.information import TaskingModel


def _batch(scene, surfaces, initial, sensor=SENSOR, seed=0, **settings):
    return BatchEstimator(
        scene, surfaces, sensor, initial, np.random.default_rng(seed),
        settings=BatchSettings(**settings),
    )  # fmt: skip


def kept_rows(estimator):
    """Numbers of rows that the light curves keep."""
    return [len(estimator.light_curve(j)[0]) for j in range(len(estimator.failed))]


def _in_intervals(estimator, measurements, steps=60):
    """Estimates at the end of each interval."""
    parts = [
        estimator.advance(during(measurements, i, i + steps))[:4]
        for i in range(0, measurements.offset.shape[1] - 1, steps)
    ]
    return [np.concatenate(pieces, axis=1) for pieces in zip(*parts, strict=True)]


def _without(measurements, target=slice(None), step=slice(None)):
    """The same observations, without detections of some targets and steps."""
    value = measurements.value.reshape(*np.diff(measurements.offset).shape, 3).copy()
    value[target, step] = np.nan
    return measurements._replace(value=value.reshape(-1, 3))


@pytest.fixture(scope="module")
def two_hours():
    return measured_problem(hours=2.0)


@pytest.fixture(scope="module")
def usual(two_hours):
    """Estimates of two hours with the usual settings."""
    scene, surfaces, initial, _, measurements, _ = two_hours
    return _batch(scene, surfaces, initial).advance(measurements)


def test_translation_is_that_of_the_papers_filter_on_angles(two_hours, usual):
    """A filter of twelve states without magnitudes and one of six are the same for the orbit."""
    scene, surfaces, initial, _, measurements, _ = two_hours
    filt = MultiplicativeUKF(scene, surfaces, SENSOR, initial, use_magnitude=False)
    twelve, six = filt.advance(measurements), usual
    np.testing.assert_array_equal(six.used, twelve.used)
    sigma = twelve.sigma[..., 6:]
    np.testing.assert_allclose(six.sigma[..., 6:], sigma, rtol=1e-6)
    assert np.max(np.abs(six.translation - twelve.translation) / sigma) < 1e-5


def test_without_measurements_the_prior_is_propagated():
    """The attitude uncertainty grows by the rate uncertainty times the time."""
    scene, surfaces, initial, _, measurements, _ = measured_problem(hours=1.0)
    out = _batch(scene, surfaces, initial).advance(_without(measurements))
    np.testing.assert_allclose(out.sigma[0, 0, :3], initial.sigma[:3], rtol=0.02)
    np.testing.assert_allclose(out.sigma[0, -1, 3:6], initial.sigma[3:6], rtol=1e-9)
    expected = np.hypot(initial.sigma[0], 3600.0 * initial.sigma[3])
    np.testing.assert_allclose(out.sigma[0, -1, :3], expected, rtol=0.05)
    assert not out.used.any()


@pytest.mark.parametrize("inertia", [1.0, (1.0, 1.2, 0.9)])
def test_errors_stay_within_three_standard_deviations(inertia):
    """Six hours of light curves, five targets, three seeds; spherical and triaxial inertia."""
    inside = []
    for seed in range(3):
        found = measured_problem(6.0, inertia=inertia, seed=seed)
        scene, surfaces, initial, truth, measured, outcome = found
        estimator = _batch(scene, surfaces, initial)
        quaternion, omega, _, sigma = _in_intervals(estimator, measured)
        seen = (outcome == DETECTED).sum(axis=1) > 100
        error = omega[seen, -1] - truth.angular_velocity[seen, -1]
        inside.append(np.abs(error) <= 3.0 * sigma[seen, -1, 3:6])
        propagated = np.hypot(initial.sigma[:3], 6.0 * 3600.0 * initial.sigma[3:6])
        assert np.all(sigma[seen, -1, :3] < 0.5 * propagated)
        alignment = np.abs(np.sum(quaternion[seen, -1] * truth.quaternion[seen, -1], axis=-1))
        angle = 2.0 * np.arccos(np.minimum(alignment, 1.0))
        inside.append(
            angle[:, None] <= 3.0 * np.sqrt(3.0) * sigma[seen, -1, :3].max(axis=1)[:, None]
        )
    assert np.concatenate([each.ravel() for each in inside]).mean() >= 0.95


def test_many_starts_succeed_where_one_start_fails():
    """Share of attitude errors beyond three standard deviations, over several seeds."""
    lost = {}
    for name in ("single-start", "default"):
        problem = tracking_problem(4, 8, duration_hours=12.0, sensor=SENSOR)
        result = run_closed_loop(*problem[:4], range(4), problem[4], estimator=batch(name))
        ratio = np.abs(result.error[..., -1, :, :3] / result.sigma[..., -1, :, :3])
        observed = result.valid.any(axis=1)
        lost[name] = (ratio.max(axis=-1)[observed] > 3.0).mean()
    assert lost["default"] <= 0.06
    assert lost["single-start"] >= lost["default"] + 0.1


def test_a_window_keeps_few_rows_and_loses_little_information():
    scene, surfaces, initial, _, measured, outcome = measured_problem(hours=8.0)
    whole = _batch(scene, surfaces, initial)
    short = _batch(scene, surfaces, initial, window_hours=2.0)
    _, omega, _, sigma = _in_intervals(whole, measured)
    _, near, _, wider = _in_intervals(short, measured)
    seen = (outcome == DETECTED).sum(axis=1) > 200
    assert max(kept_rows(short)) <= 121 < max(kept_rows(whole))
    np.testing.assert_allclose(wider[seen, -1, 3:6], sigma[seen, -1, 3:6], rtol=0.25)
    assert np.max(np.abs(near - omega)[seen, -1] / sigma[seen, -1, 3:6]) < 1.5


def test_non_detections_are_distinguished_from_obstruction():
    """Only a target in unobstructed view counts as fainter than the limit."""
    faint = Sensor(limiting_magnitude=13.0)
    scene, surfaces, initial, _, measured, outcome = measured_problem(hours=2.0, sensor=faint)
    assert (outcome == 1).any()
    estimator = _batch(scene, surfaces, initial, sensor=faint, use_non_detections=True)
    estimator.advance(measured)
    expected = (outcome == DETECTED).sum(axis=1) + (outcome == 1).sum(axis=1)
    np.testing.assert_allclose(kept_rows(estimator), expected, atol=2)
    plain = _batch(scene, surfaces, initial, sensor=faint)
    plain.advance(measured)
    np.testing.assert_array_equal(kept_rows(plain), (outcome == DETECTED).sum(axis=1))


def test_same_generator_same_estimates_and_targets_are_independent(two_hours):
    scene, surfaces, initial, _, measured, _ = two_hours
    runs = [_batch(scene, surfaces, initial, seed=5).advance(measured) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].quaternion, runs[1].quaternion)
    others = _without(measured, target=0)
    alone = _batch(scene, surfaces, initial, seed=5).advance(others)
    np.testing.assert_array_equal(alone.quaternion[1:], runs[0].quaternion[1:])


def test_prediction_is_the_next_step(two_hours):
    scene, surfaces, initial, _, measured, _ = two_hours
    estimator = _batch(scene, surfaces, initial)
    estimator.advance(during(measured, 0, 60))
    predicted: Prediction = estimator.predict()
    following = estimator.advance(no_measurements(5, 1))
    np.testing.assert_array_equal(predicted.translation, following.translation[:, 0])
    np.testing.assert_array_equal(predicted.quaternion, following.quaternion[:, 0])
    deviations = np.sqrt(np.einsum("jab,jab->ja", predicted.root, predicted.root))
    np.testing.assert_allclose(deviations, following.sigma[:, 0], rtol=1e-9)


def test_an_estimate_inside_the_moon_ends_and_the_others_continue():
    scene, surfaces, initial, _, measured, _ = measured_problem(hours=1.0)
    initial.translation[1] = [1.0 - MU, 0.001, 0.0, 0.0, 0.0, 0.0]
    estimator = _batch(scene, surfaces, initial)
    out = estimator.advance(measured)
    assert estimator.failed[1] == INSIDE_PRIMARY
    assert np.isnan(out.quaternion[1]).all() and np.isfinite(out.quaternion[0]).all()
    assert np.isnan(estimator.predict().translation[1]).all()


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_runs_in_the_loop_by_name(name):
    problem = tracking_problem(3, 4, duration_hours=2.0, tasking=TaskingModel(states="full"))
    result = run_closed_loop(*problem[:4], [0], problem[4], estimator=name)
    assert np.isfinite(result.error).all()


def test_an_unknown_name_is_refused():
    with pytest.raises(ConfigurationError, match="'ekf' must be one of mukf, batch"):
        estimator_named("ekf")
    with pytest.raises(ConfigurationError, match="settings = 'best' must be one of"):
        batch("best")


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"modes": 0}, "modes"),
        ({"most_searches": 0}, "most_searches"),
        ({"starts": -1}, "starts"),
        ({"pool": 2}, "pool"),
        ({"refit_growth": -0.1}, "refit_growth"),
        ({"window_hours": 0.0}, "window_hours"),
        ({"memory_hours": 3.0}, "needs window_hours"),
        ({"magnitude_noise_factor": 0.0}, "magnitude_noise_factor"),
    ],
)
def test_impossible_settings_are_refused(wrong, match):
    with pytest.raises(ConfigurationError, match=match):
        BatchSettings(**wrong)


def test_noise_on_the_rotation_is_refused():
    scene, surfaces, epoch, _, loop = tracking_problem(2, 2, duration_hours=1.0)
    initial = initial_estimate(epoch, loop.initial.components())
    make = batch(process_noise=ProcessNoise(attitude_deg=0.1))
    with pytest.raises(ConfigurationError, match="window_hours"):
        make(scene, surfaces, loop.sensor, initial, np.random.default_rng(0), 0.0121)


def test_presets_are_those_of_the_configuration(task2):
    assert BatchSettings(**task2["batch"]) == PRESETS["default"]
    for name in ("accurate", "single-start"):
        assert BatchSettings(**cell_settings(task2, name)["batch"]) == PRESETS[name]


def test_later_measurements_do_not_change_earlier_estimates(two_hours, usual):
    scene, surfaces, initial, _, measured, _ = two_hours
    cut = _without(measured, step=slice(70, None))
    half = _batch(scene, surfaces, initial).advance(cut)
    np.testing.assert_array_equal(half.quaternion[:, :70], usual.quaternion[:, :70])
    np.testing.assert_array_equal(half.sigma[:, :70], usual.sigma[:, :70])


def test_a_growing_light_curve_is_fitted_within_an_interval(two_hours, usual):
    scene, surfaces, initial, _, measured, outcome = two_hours
    seen = (outcome == DETECTED).all(axis=1)
    assert seen.any()
    hourly = _batch(scene, surfaces, initial, refit_growth=0.0).advance(measured)
    before, after = (np.linalg.norm(e.sigma[seen, 60, :3], axis=-1) for e in (hourly, usual))
    assert np.all(after < before) and np.median(after) < 0.8 * np.median(before)


@pytest.mark.parametrize("inertia", [(1.0, 1.0, 1.0), (1.0, 1.2, 0.9)])
def test_without_histories_the_estimate_at_the_end_is_the_same(inertia):
    """Attitudes are propagated in longer steps; light curves are fitted at the same times."""
    scene, surfaces, initial, _, measurements, _ = measured_problem(inertia=inertia, hours=4.0)
    unknown = BodyParameterPrior(log_inertia=0.1, angular_acceleration_deg_h2=0.05)
    settings = {"refit_growth": 0.0, "estimated_parameters": unknown}
    full, brief = (_batch(scene, surfaces, initial, **settings) for _ in range(2))
    for first, known in ((0, True), (60, True), (120, False), (180, False)):
        part = during(measurements, first, first + 60)
        if not known:
            part = _without(part)
        found, kept = full.advance(part), brief.advance(part, histories=False)
        np.testing.assert_array_equal(kept.used, found.used)
        assert kept.sigma.shape == (found.sigma.shape[0], 0, 12)
    np.testing.assert_array_equal(brief.orbits().covariance, full.orbits().covariance)
    np.testing.assert_array_equal(brief.searches, full.searches)
    before, after = full.predict().rotation, brief.predict().rotation
    sigma = np.sqrt((before.root**2).sum(axis=2))
    np.testing.assert_allclose(np.sqrt((after.root**2).sum(axis=2)), sigma, rtol=2e-4)
    turn = 2.0 * compose(after.quaternion, inverse(before.quaternion))[:, :3]
    assert np.max(np.abs(turn) / sigma[:, :3]) < 1e-3
    rate = np.abs(after.angular_velocity - before.angular_velocity)
    assert np.max(rate / sigma[:, 3:]) < 1e-3


def test_without_histories_a_light_curve_is_fitted_at_the_end_only(two_hours):
    scene, surfaces, initial, _, measurements, _ = two_hours
    full, brief = (_batch(scene, surfaces, initial, refit_growth=0.1) for _ in range(2))
    full.advance(measurements)
    brief.advance(measurements, histories=False)
    seen = np.array(kept_rows(brief)) > 0
    assert np.any(seen) and np.all(brief.searches[seen] == 1)
    assert np.all(full.searches[seen] > 1)


def test_a_copy_does_not_share_the_tracks(two_hours):
    scene, surfaces, initial, _, measurements, _ = two_hours
    own = _batch(scene, surfaces, initial)
    first = during(measurements, 0, 60)
    own.advance(first)
    kept, again = copy.deepcopy(own), copy.deepcopy(own)
    second = during(measurements, 60, 120)
    expected = own.advance(second)
    for one in (kept, again):
        for found, known in zip(one.advance(second), expected, strict=True):
            np.testing.assert_array_equal(found, known)


def test_the_bound_is_reached_in_the_median():
    """Thirty targets, observed for twelve hours."""
    problem = tracking_problem(5, 10, duration_hours=12.0, sensor=SENSOR)
    found = {
        name: run_closed_loop(*problem[:4], range(3), problem[4], estimator=name)
        for name in ESTIMATORS
    }
    ratio = {
        name: np.nanmedian(result.metrics.bound_ratio[..., 0]) for name, result in found.items()
    }
    assert 0.75 <= ratio["batch"] <= 1.25
    result = found["batch"]
    claimed = result.sigma[:, -1, :, :3] / result.bound[:, -1, :, :3]
    assert 0.9 <= np.nanmedian(claimed) <= 1.3
