"""Learned detection probabilities against Gaussians and brute force."""

import dataclasses

import numpy as np
import pytest
from measured import draw_truth
from scipy.integrate import quad
from scipy.stats import norm

from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.errors import ConfigurationError
from cislunar.estimation.kalman.mukf import MultiplicativeUKF
from cislunar.observation.measurement import DETECTED, EXCLUDED, FAINT, measure
from cislunar.observation.records import pointed_schedule
from cislunar.observation.sensor import Sensor
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.planning.brightness import facet_margins, sphere_magnitudes
from cislunar.tasking.planning.detection import LearnedDetection
from cislunar.tasking.planning.detection_model import DetectionModel
from cislunar.tasking.planning.information import TaskingModel, pair_information
from cislunar.tasking.truth import TruthModel

MODEL = DetectionModel(
    brightness="sphere", prior_mag=0.8, flicker_mag=0.5, never_detected_bonus=4.0
)


def test_probability_before_any_observation_is_that_of_two_gaussians():
    margin = np.array([[-3.0, -0.4, 0.0], [0.7, 2.5, np.nan]])
    expected = norm.cdf(margin / np.hypot(MODEL.prior_mag, MODEL.flicker_mag))
    expected[1, 2] = 0.0  # a target without an estimate
    learned = LearnedDetection(MODEL, 3)
    found = learned.probability(learned.detects(margin[..., None]))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_tabulated_probabilities_are_those_of_the_gaussian():
    margin = np.random.default_rng(3).normal(0.0, 3.0, (40, 12))
    margin[0] = -np.inf, np.inf, np.nan, -9.0, 9.0, *np.linspace(-8.4, 8.4, 7)
    learned = LearnedDetection(MODEL, 40)
    each = norm.cdf((margin[..., None] - learned.grid) / MODEL.flicker_mag)
    found = learned.detects(margin)
    np.testing.assert_allclose(found, np.nan_to_num(each).mean(axis=1), atol=5e-10)
    assert found.min() >= 0.0 and found.max() <= 1.0


def test_learning_from_outcomes_follows_bayes():
    learned = LearnedDetection(MODEL, 2)
    margin = np.array([[0.6, 0.0], [1.1, 0.0]])
    outcome = np.array([FAINT, FAINT, DETECTED, DETECTED + 1, EXCLUDED, FAINT])
    observations = np.zeros(6, dtype=int), np.array([0, 0, 0, 0, 0, 1])
    learned.learn(*observations, outcome, learned.detects(margin[..., None]))

    def posterior(b):
        bright, dim = (norm.logcdf(sign * (0.6 - b) / 0.5) for sign in (1.0, -1.0))
        last = norm.logcdf(-(1.1 - b) / 0.5)
        return norm.pdf(b, scale=0.8) * np.exp(0.5 * bright + 0.5 * dim + last)

    total = quad(posterior, -6, 6)[0]
    mean = quad(lambda b: b * posterior(b), -6, 6)[0] / total
    square = quad(lambda b: b * b * posterior(b), -6, 6)[0] / total
    means, sigmas = learned.offset()
    assert means[0] == pytest.approx(mean, abs=1e-4)
    assert sigmas[0] == pytest.approx(np.sqrt(square - mean**2), abs=1e-4)
    assert (means[1], sigmas[1]) == pytest.approx((0.0, 0.8), abs=1e-5)  # never observed
    assert learned.detected.tolist() == [True, False]


def test_the_value_of_a_pair_is_its_expected_information():
    learned = LearnedDetection(MODEL, 3)
    learned.detected[0] = True
    information, margin = np.array([[3.0, 3.0, 0.0]]), np.array([[0.0, 0.0, 9.0]])
    value = learned.pair_values(information, learned.detects(margin[..., None]))
    np.testing.assert_allclose(value, [[1.5, 3.5, 0.0]], atol=1e-9)


def test_spheres_have_the_brightness_of_the_gate():
    scene, surfaces, epoch, _, loop = tracking_problem(4, 10, duration_hours=1.0)
    initial = initial_estimate(epoch, loop.initial.components())
    sensor = Sensor(limiting_magnitude=17.0)
    prediction = MultiplicativeUKF(scene, surfaces, sensor, initial).predict()
    gated = TaskingModel(pointing_uncertainty_gate=False)
    free = dataclasses.replace(gated, detection=MODEL)
    known = scene, surfaces, sensor
    clear = pair_information(prediction, *known, free) > 0.0
    bright = pair_information(prediction, *known, gated) > 0.0
    margin = 17.0 - sphere_magnitudes(
        prediction, scene, radius_m=1.0, diffuse_reflection_coefficient=0.5
    )
    np.testing.assert_array_equal(bright, clear & (margin > 0.0))
    assert 0 < bright.sum() < clear.sum()


def test_facet_margins_agree_with_measurements():
    scene, surfaces, epoch, ids, _ = tracking_problem(2, 4, duration_hours=1.0)
    initial = initial_estimate(epoch, np.full(12, 1e-9))
    given = scene, surfaces, Sensor(limiting_magnitude=99.0)
    prediction = MultiplicativeUKF(*given, initial).predict()
    wanted = np.ones((2, 2, 4), dtype=bool)
    wanted[1, 0, 2] = False
    slots = np.array([0, 30]), 60, wanted
    margin = facet_margins(prediction, *slots, *given, EARTH_MOON)
    assert margin.shape == (2, 2, 4, 24)  # two times of each half hour, twelve attitudes
    assert np.isnan(margin[1, 0, 2]).all() and np.isnan(margin).sum() == 24
    motion = draw_truth(initial, scene, np.zeros(3), 0, ids)
    for o in range(2):
        for j in range(4):
            pointing = np.full((60, 2), -1)
            pointing[:, o] = j
            schedule = pointed_schedule(pointing, 4)
            states = motion.translation, motion.quaternion, np.zeros((4, 61, 1, 3))
            found, outcome = measure(1, schedule, *given, *states)
            for slot, steps in ((0, (7, 22)), (1, (37, 52))):
                planned = margin[slot, o, j].reshape(12, 2).T
                for own, step in zip(planned, steps, strict=True):
                    if wanted[slot, o, j] and outcome[step] == DETECTED:
                        np.testing.assert_allclose(99.0 - own, found.value[step, 0], atol=1e-4)


def test_tasking_turns_away_from_a_target_that_is_never_seen():
    scene, surfaces, epoch, ids, plain = tracking_problem(1, 2, duration_hours=10.0)
    estimator = MultiplicativeUKF(
        scene, surfaces, plain.sensor, initial_estimate(epoch, plain.initial.components())
    )
    spheres = sphere_magnitudes(
        estimator.predict(), scene, radius_m=1.0, diffuse_reflection_coefficient=0.5
    )
    sensor = Sensor(limiting_magnitude=float(spheres.max()) + 0.7)
    plain = dataclasses.replace(plain, sensor=sensor)
    areas = surfaces.areas.copy()
    areas[surfaces.first[0] : surfaces.first[1]] *= 1e-9
    truth = TruthModel(surfaces._replace(areas=areas), sensor.noise, np.zeros(3), EARTH_MOON)
    learning = dataclasses.replace(plain, tasking=TaskingModel(detection=MODEL))
    at_undetectable = []
    for settings in (plain, learning):
        found = run_closed_loop(scene, surfaces, epoch, ids, [1], settings, truth=truth)
        at_undetectable.append(np.sum(found.assignment == 0))
        assert not np.any(found.valid[:, :, 0])
    assert at_undetectable[1] < at_undetectable[0]
    dim, seen = found.brightness_offset[0, -1]
    assert dim > max(0.5, seen) and found.brightness_offset_sigma.shape == (1, 10, 2)
    assert run_closed_loop(scene, surfaces, epoch, ids, [1], plain).brightness_offset is None


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("prior_mag", 0.0),
        ("flicker_mag", -1.0),
        ("never_detected_bonus", -1.0),
        ("brightness", "cube"),
    ],
)
def test_impossible_models_are_refused(key, value):
    with pytest.raises(ConfigurationError, match=key):
        DetectionModel(**{key: value})
