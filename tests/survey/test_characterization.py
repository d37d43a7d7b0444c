"""Characterization of cataloged objects from the magnitudes of their detections."""

from types import SimpleNamespace

import numpy as np
import pytest

from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.errors import ConfigurationError
from cislunar.estimation.light_curves.model_selection import (
    EstimateInterval,
    light_curve_rows,
    measured_brightness,
    spin_period,
    unknown_rotation_model,
)
from cislunar.observation import METERS, body_of
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.orbit_determination import make_angles
from cislunar.photometry import (
    Material,
    PhotometryModel,
    apparent_body_magnitude,
    icosahedron,
    phase_function,
)
from cislunar.survey import (
    CharacterizationSettings,
    CharacterizedOrbit,
    SurveySettings,
    characterization_quality,
    characterize_orbits,
    light_curve,
    uniform_attitude_sigma,
)

N, NOISE, RANGE_M = 120, 0.03, 2e8
ASSUMED = target_surfaces(icosahedron(), Material(), 1)
MODEL = unknown_rotation_model(ASSUMED, uniform_attitude_sigma(), 30.0)
TRUE = target_surfaces(
    icosahedron(), Material(diffuse_albedo=0.7), 1, PhotometryModel(reflection="lambert-phong")
)
AXIS = np.array([0.5, 0.3, 0.8]) / np.linalg.norm([0.5, 0.3, 0.8])
PRIOR_H = (7.80, 3.92, 25.83)
"""Median and central 95 % of the periods of a rate with components of 30 deg/h."""


def geometry(seed):
    """Times of a day, and directions to the Sun and to six observers that move."""
    rng = np.random.default_rng(seed)
    hours = 24.0 / N * (np.arange(N) + rng.uniform(0.0, 0.8, N))
    turn = np.deg2rad(rng.uniform(0.0, 360.0, 6)[rng.integers(6, size=N)] + 2.0 * hours)
    view = np.stack([np.cos(turn), np.sin(turn), np.full(N, 0.3)], axis=1)
    sun = np.tile([0.8, 0.0, 0.6], (N, 1))
    return 3600.0 * hours, sun, view / np.linalg.norm(view, axis=1)[:, None]


def attitudes(time_s, period_h):
    half = np.pi * time_s / (3600.0 * period_h)
    return np.column_stack([np.sin(half)[:, None] * AXIS, np.cos(half)])


def made_up(period_h, seed=1):
    """A light curve of a body with another reflection law and material than the assumed one."""
    time, sun, view = geometry(seed)
    given = attitudes(time, period_h), sun, view, np.full(N, RANGE_M)
    magnitude = apparent_body_magnitude(*given, body_of(TRUE, 0), PhotometryModel())
    magnitude += NOISE * np.random.default_rng(seed).standard_normal(N)
    return light_curve_rows(time, magnitude, np.full(N, NOISE**2), sun, view, RANGE_M)


@pytest.mark.parametrize("period_h", [5.0, 9.0])
def test_a_period_is_recovered_although_law_and_material_differ(period_h):
    found = spin_period(made_up(period_h), MODEL, np.random.default_rng(0))
    assert found.determined and found.interval.contains(period_h)
    assert found.interval.high / found.interval.low < 1.15


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"time_s": [0.0, 2.0, 1.0]}, "time_s: give times of at least 0 s in increasing order"),
        ({"time_s": [-1.0, 2.0, 3.0]}, "time_s: give times"),
        ({"magnitude": [15.0, np.nan, 15.0]}, "magnitude"),
        ({"variance": 0.0}, "variance and range_m must be positive"),
        ({"sun": 2.0 * np.eye(3)}, "sun of row 0 has norm 2"),
    ],
)
def test_impossible_light_curves_are_refused(given, words):
    usual = {"time_s": [0.0, 1.0, 2.0], "magnitude": [15.0] * 3, "variance": 0.01, "sun": np.eye(3),
             "view": np.eye(3), "range_m": 1e7}  # fmt: skip
    assert len(light_curve_rows(**usual)) == 3
    with pytest.raises(ConfigurationError, match=words):
        light_curve_rows(**usual | given)


def test_a_sphere_has_no_period_and_the_interval_is_that_of_the_prior():
    time, sun, view = geometry(2)
    alpha = np.arccos(np.sum(sun * view, axis=1))
    size_m2 = 2.0
    flux = size_m2 * 2.0 / (3.0 * np.pi) * phase_function(alpha) / (np.pi * RANGE_M**2)
    magnitude = SUN_APPARENT_MAGNITUDE - 2.5 * np.log10(flux)
    magnitude += NOISE * np.random.default_rng(2).standard_normal(N)
    data = light_curve_rows(time, magnitude, np.full(N, NOISE**2), sun, view, RANGE_M)
    rng = np.random.default_rng(0)
    found = spin_period(data, MODEL, rng)
    assert not found.determined
    np.testing.assert_allclose(found.interval, PRIOR_H, atol=0.01)
    rates = np.linalg.norm(np.random.default_rng(3).normal(0.0, 30.0, (40000, 3)), axis=1)
    np.testing.assert_allclose(np.quantile(360.0 / rates, [0.5, 0.025, 0.975]), PRIOR_H, rtol=0.02)
    amplitude, size = measured_brightness(data, False, rng)
    assert amplitude.value < 5.0 * NOISE and size.contains(size_m2)
    assert size.high / size.low < 1.05


def test_a_light_curve_without_rows_is_refused():
    with pytest.raises(ConfigurationError, match="light curve: it has no rows"):
        spin_period(made_up(5.0)[:0], MODEL, np.random.default_rng(0))


def cataloged(data):
    """A confirmed orbit with the detections of a light curve, one that is not confirmed, their
    angles, and a scene whose bodies are far away."""
    n, time, step = len(data), np.round(data[:, 0] / 60.0), 1e-3
    away = -data[:, 5:8] * RANGE_M / METERS
    observer = np.zeros((n, 3))
    angles = make_angles(
        step * time, np.zeros(n, dtype=int), observer, away, 1.0, magnitude=data[:, 1],
        magnitude_sigma=NOISE, sun=away + 400.0 * data[:, 2:5],
    )  # fmt: skip
    steps = int(time.max()) + 1
    scene = SimpleNamespace(
        step=step, step_s=60.0, frame_axes=np.tile(np.eye(3), (steps, 1, 1)),
        primaries=np.full((steps, 2, 3), 50.0),
    )  # fmt: skip
    order = np.arange(n)[::-1]
    fits = SimpleNamespace(position=away[order], begin=np.array([0, n, n]))
    orbits = SimpleNamespace(
        confirmed=np.array([True, False]), fits=fits, detections=lambda k: order[: n * (1 - k)]
    )  # fmt: skip
    return orbits, angles, scene


def test_light_curves_are_those_of_the_fitted_orbits():
    data = made_up(9.0)
    orbits, angles, scene = cataloged(data)
    row, found = light_curve(orbits, 0, angles, scene)
    assert row.tolist() == list(range(N))
    expected = data.copy()
    expected[:, 0] = 60.0 * np.round(data[:, 0] / 60.0)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    # detections without a magnitude, and one in the shadow of the Earth
    angles.magnitude_variance[3] = angles.magnitude[4] = np.nan
    index = int(np.round(data[7, 0] / 60.0))
    place = angles.direction[7] * RANGE_M / METERS
    scene.primaries[index, 0] = place + 0.05 * data[7, 2:5]
    row, _ = light_curve(orbits, 0, angles, scene)
    assert not {3, 4, 7} & {*row.tolist()} and row.size >= N - 5


def test_confirmed_orbits_of_bright_objects_are_characterized_and_compared_with_the_truth():
    period_h = 9.0
    given = *cataloged(made_up(period_h)), ASSUMED
    settings = CharacterizationSettings(least_detections=40)
    reports = []
    (found,) = characterize_orbits(*given, settings, 5, lambda *each: reports.append(each))
    assert reports == [(1, 1)]
    assert found.orbit == 0 and found.determined and found.spin_period_h.contains(period_h)
    assert found.noise_mag == pytest.approx(NOISE)
    (again,) = characterize_orbits(*given, settings, 5)
    assert again.spin_period_h == found.spin_period_h
    for change in (
        {"least_detections": 0},
        {"least_detections": N + 1},
        {"largest_noise_mag": 0.02},
    ):
        changed = CharacterizationSettings(**settings.model_dump() | change)
        assert characterize_orbits(*given, changed, 5) == ()
    # the objects 0 and 1 are the same but for the rate; object 1 has the detections
    rate = 2.0 * np.pi / (3600.0 * period_h)
    first = np.array([[0.0, 0.0, 0.0, 1.0]] * 2), np.outer([2.0 * rate, rate], AXIS)
    true = target_surfaces(
        icosahedron(), Material(diffuse_albedo=0.7), 2, PhotometryModel(reflection="lambert-phong")
    )
    attitude = attitudes(found.light_curve[:, 0], period_h)
    quality = characterization_quality([found], np.full(N, 1), attitude, *first, true)
    assert quality.bright == quality.determined == 1
    assert quality.period_covered == quality.amplitude_covered == 1.0
    assert quality.area_albedo_covered == quality.period_determined == 1.0
    half = 0.5 * np.log(found.spin_period_h.high / found.spin_period_h.low)
    assert quality.period_half_width == pytest.approx(half)
    quality = characterization_quality([found], np.full(N, 0), attitude, *first, true)
    assert quality.period_covered == 0.0
    wrong = found._replace(determined=False, area_albedo_m2=EstimateInterval(0.1, 0.05, 0.15))
    quality = characterization_quality([found, wrong], np.full(N, 1), attitude, *first, true)
    assert quality.period_determined == quality.area_albedo_covered == 0.5
    nothing = characterization_quality([found], np.full(N, -1), attitude, *first, true)
    assert nothing.bright == 1 and nothing.determined == 0 and np.isnan(nothing.period_covered)
    assert CharacterizedOrbit._fields[0] == "orbit"


def test_impossible_settings_are_named():
    for key, value in (("least_detections", -1), ("searches", 0), ("largest_noise_mag", 0.0)):
        with pytest.raises(ConfigurationError, match=key) as fault:
            CharacterizationSettings(**{key: value})
        assert "\n" not in str(fault.value)
    with pytest.raises(ConfigurationError, match=r"characterization\.least_detections"):
        SurveySettings(characterization={"least_detections": 1.5})
