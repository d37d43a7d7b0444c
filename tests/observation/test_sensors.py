"""Sensors of each observer, photon noise, and telescopes on the ground."""

import numpy as np
import pytest
from measured import draw_truth, observed_by
from scipy.stats import norm

from cislunar.constants import MU
from cislunar.dynamics.cr3bp import primary_positions
from cislunar.ephemeris.bodies import BODY_COLUMNS, read_table, tabulate_bodies
from cislunar.ephemeris.time_scales import julian_date, utc_to_tdb
from cislunar.errors import ConfigurationError
from cislunar.observation.ground import earth_rotation, station_positions, station_tracks
from cislunar.observation.measurement import (
    DETECTED,
    EXCLUDED,
    FAINT,
    OCCULTED,
    detectable_targets,
    measure,
)
from cislunar.observation.records import pointed_schedule
from cislunar.observation.sensor import (
    ARCSECOND,
    Atmosphere,
    ExclusionAngles,
    GroundSensor,
    PhotonNoise,
    Sensor,
    noise_at,
)
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.planning.information import (
    TaskingModel,
    information_bound,
    pair_information,
)

KEEN = Sensor(
    limiting_magnitude=35.0, exclusion_deg=ExclusionAngles(0.0, 0.0, 0.0), occultation=False
)
POOR = Sensor(limiting_magnitude=17.0, angle_noise_arcsec=6.0, field_of_view_deg=1.0)
PHOTONS = PhotonNoise(aperture_m=0.15)


@pytest.fixture(scope="module")
def problem():
    scene, surfaces, epoch, ids, settings = tracking_problem(2, 5, duration_hours=1.0)
    initial = initial_estimate(epoch, settings.initial.components())
    return scene, surfaces, draw_truth(initial, scene, np.ones(3), 0, ids)


def _image(sigma, n=401, half=8.0):
    """A Gaussian image of unit flux, by pixel, and its slope along one axis."""
    edges = np.linspace(-half, half, n + 1) * sigma
    line = np.diff(norm.cdf(edges / sigma))
    slope = -np.diff(norm.pdf(edges / sigma)) / sigma
    return np.outer(line, line), np.outer(slope, line), (edges[1] - edges[0]) ** 2


@pytest.mark.parametrize("magnitude", [10.0, 24.0])
def test_photon_noise_is_the_least_that_an_image_allows(magnitude):
    """Cramer-Rao bound of flux and position from all pixels, where source or sky dominates."""
    noise = PhotonNoise(0.15, sky_mag_arcsec2=22.0, read_noise_e=0.0)
    electrons, _, image = noise.constants()
    sigma = np.sqrt(image) / ARCSECOND
    star, slope, area = _image(sigma)
    flux = electrons * 10.0 ** (-0.4 * magnitude)
    count = flux * star + electrons * 10.0 ** (-0.4 * 22.0) * area
    sensor = Sensor(magnitude_noise=1e-9, angle_noise_arcsec=1e-9, photon_noise=noise)
    found = noise_at(sensor, magnitude)
    least = 2.5 / np.log(10.0) / np.sqrt(np.sum((flux * star) ** 2 / count))
    np.testing.assert_allclose(found[0], least, rtol=0.02)
    if magnitude < 15.0:
        angle = ARCSECOND / np.sqrt(np.sum((flux * slope) ** 2 / count))
        np.testing.assert_allclose(found[1:], angle, rtol=0.02)
    assert np.all(noise_at(sensor, magnitude + 1.0) > found)


def test_records_have_the_variance_of_their_errors(problem):
    scene, surfaces, truth = problem
    seen = {"limiting_magnitude": 90.0, "exclusion_deg": KEEN.exclusion_deg, "occultation": False}
    sensor = Sensor(0.02, 1.0, **seen, photon_noise=PHOTONS)
    motion = truth.translation, truth.quaternion
    observations = pointed_schedule(np.tile([0, 1], (60, 1)), 5)
    quiet = np.zeros_like(truth.noise)
    given = 1, observations, scene, surfaces, sensor
    exact, outcome = measure(*given, *motion, quiet, true=(sensor, sensor))
    noisy, _ = measure(*given, *motion, truth.noise, true=(sensor, sensor))
    assert np.all(outcome == DETECTED)
    np.testing.assert_allclose(
        np.sqrt(noisy.variance), noise_at(sensor, noisy.value[:, 0]), rtol=1e-12
    )
    error = noisy.value - exact.value
    error[:, 0] = (1.0 - 10.0 ** (-0.4 * error[:, 0])) * 2.5 / np.log(10.0)  # of the flux
    standard = (error / noise_at(sensor, exact.value[:, 0]))[:, [0, 2]]
    errors = truth.noise[:2, 1:, 0].reshape(-1, 3)[:, [0, 2]]
    np.testing.assert_allclose(standard, errors, rtol=1e-6, atol=1e-6)


def test_targets_far_below_the_photon_noise_are_not_detected(problem):
    """None of thousands of observations of targets dimmed by 20 magnitudes is a detection."""
    scene, surfaces, truth = problem
    sensor = KEEN.model_copy(update={"limiting_magnitude": 18.0, "photon_noise": PHOTONS})
    observations = pointed_schedule(np.tile([0, 1], (60, 1)), 5)
    dimmed = np.full(truth.translation.shape[:2], 20.0)
    given = 1, observations, scene, surfaces, sensor, truth.translation, truth.quaternion
    many = np.random.default_rng(3).standard_normal((40, *truth.noise.shape))
    for noise in many:
        _, outcome = measure(*given, noise, true=(sensor, sensor), dimmed=dimmed)
        assert np.all(outcome == FAINT)


def test_each_observer_has_its_sensor(problem):
    scene, surfaces, truth = problem
    at = np.array([0, 1, 0, 1, -1])
    mixed, outcomes = observed_by(at, scene, surfaces, (KEEN, POOR), truth)
    for observer, sensor in enumerate((KEEN, POOR)):
        records, outcome = observed_by(at, scene, surfaces, sensor, truth)
        own = records.observer == observer
        np.testing.assert_array_equal(outcomes[own], outcome[own])
        np.testing.assert_array_equal(mixed.value[own], records.value[own])
        np.testing.assert_array_equal(mixed.variance[own], records.variance[own])
    with pytest.raises(ConfigurationError, match=r"3 given for 2 observers; give one for all"):
        observed_by(at, scene, surfaces, (KEEN, POOR, POOR), truth)


def test_the_information_of_a_pair_is_that_of_its_sensor():
    from cislunar.estimation.kalman.mukf import mukf

    scene, surfaces, epoch, _, settings = tracking_problem(2, 5, duration_hours=1.0)
    initial = initial_estimate(epoch, settings.initial.components())
    prediction = mukf()(scene, surfaces, KEEN, initial, None, settings_forces()).predict()
    faint = Sensor(30.0, photon_noise=PHOTONS, limiting_magnitude=20.0)
    sensors, model = (POOR, faint), TaskingModel(pointing_uncertainty_gate=False)
    known = prediction, scene, surfaces
    mixed = pair_information(*known, sensors, model)
    for observer, sensor in enumerate(sensors):
        np.testing.assert_array_equal(
            mixed[observer], pair_information(*known, sensor, model)[observer]
        )
    assert np.all(information_bound(prediction, scene, sensors, model) >= mixed)
    constant = pair_information(*known, Sensor(30.0, limiting_magnitude=20.0), model)
    assert np.all(mixed[1] <= constant[1]) and np.any(mixed[1] < constant[1])


@pytest.mark.parametrize("estimator", ["mukf", "batch"])
def test_estimators_use_the_variance_of_each_measurement(estimator):
    """Errors agree with standard deviations where noise differs by magnitude and observer."""
    poor = POOR.model_copy(update={"limiting_magnitude": 24.0, "photon_noise": PHOTONS})
    keen = Sensor(0.02, 1.0, limiting_magnitude=24.0, photon_noise=PHOTONS)
    problem = tracking_problem(4, 6, duration_hours=4.0, sensor=(keen, poor, keen, poor))
    run = run_closed_loop(*problem[:4], [3], problem.loop, estimator=estimator)
    seen = run.valid.any(axis=1)[0]
    late = np.abs(run.error / run.sigma)[0, -60:, seen][..., 6:9]
    assert np.count_nonzero(seen) > 3 and np.mean(late < 3.0) > 0.95
    assert np.sqrt(np.mean(late**2)) > 0.4


def settings_forces():
    from cislunar.dynamics.cr3bp import EARTH_MOON

    return EARTH_MOON


def test_the_earth_rotates_with_sidereal_time():
    """Against the mean sidereal time of Meeus, whose equinox precesses 46.1 arcsec a year in RA."""
    days = julian_date("2024-10-01T05:00:00") - 2_451_545.0
    time = float(utc_to_tdb(days + 2_451_545.0))
    turned = earth_rotation([time])[0]
    sidereal = 280.46061837 + 360.98564736629 * days - 46.1 / 3600.0 * days / 365.25
    angle = np.rad2deg(np.arctan2(turned[0, 1], turned[0, 0]))
    assert abs((angle - sidereal + 180.0) % 360.0 - 180.0) < 0.1


def test_stations_see_sun_and_moon_at_their_elevations():
    """Greenwich at noon of an equinox; the Moon's elevation in the rotating frame and in J2000."""
    noon = float(utc_to_tdb(julian_date("2024-03-20T12:07:30")))
    table = tabulate_bodies(noon - 600.0, noon + 86_400.0)
    time = noon + np.arange(0.0, 86_400.0, 3600.0)
    site = station_positions([51.48], [0.0], [0.0])
    free, turning = (station_tracks(site, table, time, inertial=k)[0] for k in (True, False))
    bodies = read_table(table, time)[0] / 384_400.0
    earth, moon, sun = (bodies[:, BODY_COLUMNS[name]] for name in ("earth", "moon", "sun"))
    up = (free - earth) / np.linalg.norm(free - earth, axis=1)[:, None]
    height = np.rad2deg(np.arcsin(np.sum(up * sun, axis=1) / np.linalg.norm(sun, axis=1)))
    # the vertical of a sphere is that of latitude 51.29; the Sun is nine hours past the equator
    assert height[0] == pytest.approx(90.0 - 51.29 + 0.15, abs=0.05) and np.argmin(height) == 12
    place = turning - primary_positions(MU)[0]
    np.testing.assert_allclose(
        place[:, 0] / np.linalg.norm(place, axis=1),
        np.sum(up * (moon - earth), axis=1) / np.linalg.norm(moon - earth, axis=1),
        atol=1e-9,
    )
    with pytest.raises(ConfigurationError, match=r"latitude_deg = 91\.0.*not on the globe"):
        station_positions([91.0], [0.0], [0.0])
    for wrong, name in (
        ((51.48, [0.0], [0.0]), "latitude_deg"),
        (([51.48], [0.0, 1.0], [0.0]), "longitude_deg"),
        (([51.48], [0.0], [np.nan]), "height_m"),
    ):
        with pytest.raises(ConfigurationError, match=f"^{name}"):
            station_positions(*wrong)


def test_the_ground_sees_at_night_above_its_limit_through_air(problem):
    """Against elevations by hand; a point near the Earth represents a station."""
    scene, surfaces, truth = problem
    earth = np.array(primary_positions(MU)[0])
    toward = truth.translation[0, :, :3] - earth
    toward /= np.linalg.norm(toward, axis=1)[:, None]
    side = np.cross(toward, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1)[:, None]
    tilt = np.deg2rad(np.linspace(0.0, 89.0, toward.shape[0]))[:, None]
    track = earth + 0.0166 * (np.cos(tilt) * toward + np.sin(tilt) * side)
    site = scene._replace(observer_position=np.array([track, track]))
    air = Atmosphere(min_elevation_deg=30.0, extinction_mag=0.3)
    ground = GroundSensor(limiting_magnitude=35.0, exclusion_deg=KEEN.exclusion_deg, atmosphere=air)
    given = 1, pointed_schedule(np.tile([0, 1], (60, 1)), 5), site, surfaces
    motion = truth.translation, truth.quaternion, np.zeros_like(truth.noise)
    records, outcome = measure(*given, ground, *motion)
    way, light = truth.translation[0, 1:, :3] - track[1:], scene.sun_position[1:] - track[1:]
    up = track[1:] - earth
    up /= np.linalg.norm(up, axis=1)[:, None]
    high, day = (np.sum(up * each, axis=1) / np.linalg.norm(each, axis=1) for each in (way, light))
    expected = np.where(
        day > np.sin(np.deg2rad(-12.0)), EXCLUDED, np.where(high < 0.5, OCCULTED, DETECTED)
    )
    np.testing.assert_array_equal(outcome[:60], expected)
    assert len(set(expected)) > 1
    seen = outcome[:60] == DETECTED
    free = measure(*given, KEEN, *motion)[0]
    np.testing.assert_allclose(records.value[:60][seen, 0], free.value[:60][seen, 0], rtol=1e-12)
    # the limit is that of the light that arrives
    limit = float(np.median(free.value[:60][seen, 0] + 0.3 / high[seen]))
    dim = GroundSensor(limiting_magnitude=limit, exclusion_deg=KEEN.exclusion_deg, atmosphere=air)
    passed = measure(*given, dim, *motion)[1][:60][seen] == DETECTED
    np.testing.assert_array_equal(passed, free.value[:60][seen, 0] + 0.3 / high[seen] <= limit)


def test_targets_within_reach_are_those_detected_without_noise(problem):
    """Every observer measures every target at every step; some targets are never detected."""
    scene, surfaces, truth = problem
    motion = truth.translation, truth.quaternion
    dimmed = np.linspace(0.0, 1.0, truth.translation.shape[1]) + np.zeros((5, 1))
    brightest = np.full(5, np.inf)
    quiet = np.zeros_like(truth.noise)
    for observer in range(2):
        for target in range(5):
            at = np.full((60, 2), -1)
            at[:, observer] = target
            given = 1, pointed_schedule(at, 5), scene, surfaces, KEEN, *motion
            records, outcome = measure(*given, quiet, dimmed=dimmed)
            arriving = records.value[:, 0] + dimmed[target, 1:]
            if np.any(outcome == DETECTED):
                brightest[target] = min(brightest[target], arriving[outcome == DETECTED].min())
    limit = np.sort(brightest)[2] + 1e-9
    sensor = KEEN.model_copy(update={"limiting_magnitude": limit})
    found = detectable_targets(1, scene, surfaces, sensor, *motion, dimmed=dimmed)
    np.testing.assert_array_equal(found, brightest <= limit)
    assert found.sum() == 3
    # the last half hour, from its states only
    late = tuple(each[:, 30:] for each in motion)
    whole = detectable_targets(31, scene, surfaces, sensor, *motion, dimmed=dimmed)
    later = detectable_targets(31, scene, surfaces, sensor, *late, origin=30, dimmed=dimmed[:, 30:])
    np.testing.assert_array_equal(whole, later)
    with pytest.raises(ConfigurationError, match="first = 0: the times from 0 to before"):
        detectable_targets(0, scene, surfaces, sensor, *motion, origin=2)
    with pytest.raises(ConfigurationError, match=r"states has shape \(4, "):
        detectable_targets(1, scene, surfaces, sensor, *(each[:4] for each in motion))
