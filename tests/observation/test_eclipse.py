"""Shadows of Earth and Moon on targets, against rays to the Sun and in the loop."""

import dataclasses

import numpy as np
import pytest

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.propagation import propagate
from cislunar.dynamics.radiation import SUN_RADIUS_KM
from cislunar.errors import ConfigurationError
from cislunar.estimation.eclipses import expected_dimming, without_dimming
from cislunar.estimation.estimator import Prediction
from cislunar.observation.measurement import FAINT
from cislunar.observation.records import Measurements
from cislunar.observation.sensor import ExclusionAngles, Sensor
from cislunar.observation.sightline import dimming, sunlit_share
from cislunar.tasking import realization
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.planning.detection_model import DetectionModel
from cislunar.tasking.planning.information import TaskingModel
from cislunar.tasking.planning.schedule_model import ScheduleModel

SUN = np.array([[389.17, 0.0, 0.0]])
PRIMARIES = np.array([[[-MU, 0.0, 0.0], [1.0 - MU, 0.0, 0.0]]])
RADII = np.array([EARTH_RADIUS_KM, MOON_RADIUS_KM]) / LENGTH_UNIT_KM


def _by_rays(place, count=250):
    """Share of the Sun's disk from which straight lines reach a position."""
    grid = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    y, z = np.meshgrid(grid, grid)
    inside = y**2 + z**2 < 1.0
    disk = SUN_RADIUS_KM / LENGTH_UNIT_KM * np.stack([0 * y[inside], y[inside], z[inside]], axis=1)
    way = SUN[0] + disk - place
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    free = np.ones(len(way), dtype=bool)
    for center, radius in zip(PRIMARIES[0], RADII, strict=True):
        along = way @ (center - place)
        miss = np.linalg.norm(center - place - along[:, None] * way, axis=1)
        free &= (along < 0.0) | (miss > radius)
    return free.mean()


def test_the_share_is_that_of_rays_from_the_disk():
    places = [np.array([0.9, y, 0.0]) for y in (0.0, 0.0035, 0.0045, 0.0051, 0.02)]
    places += [np.array([-1.1, 0.0, z]) for z in (0.005, 0.014, 0.017, 0.03)]
    # Earth and Moon may both be in front of the Sun: their shares are multiplied
    places += [np.array([0.4, 0.001, 0.002]), -places[0]]
    share = sunlit_share(np.array(places)[:, None], SUN, PRIMARIES)[:, 0]
    expected = [_by_rays(place) for place in places]
    np.testing.assert_allclose(share, expected, atol=3e-3)
    assert share.min() == 0.0 and share.max() == 1.0 and np.sum((share > 0) & (share < 1)) > 3
    fainter = dimming(np.array(places)[:, None], SUN, PRIMARIES)[:, 0]
    np.testing.assert_allclose(10.0 ** (-0.4 * fainter), share, atol=1e-12)


def test_an_annulus_of_the_sun_is_visible_around_a_distant_moon():
    sun, moon = np.array([0.0, 389.0, 0.0]), PRIMARIES[0, 1]
    away = (moon - sun) / np.linalg.norm(moon - sun)
    place = moon + 1.5 * away
    far = np.linalg.norm(place - sun)
    disk, ring = np.arcsin([RADII[1] / 1.5, SUN_RADIUS_KM / LENGTH_UNIT_KM / far])
    share = sunlit_share(place[None, None], sun[None], PRIMARIES)[0, 0]
    assert 0.3 < share < 1.0
    assert share == pytest.approx(1.0 - (disk / ring) ** 2, rel=1e-6)


@pytest.fixture(scope="module")
def problem():
    """The Sun is where the Moon's shadow falls on one target for part of the time."""
    sensor = Sensor(
        limiting_magnitude=26.0, exclusion_deg=ExclusionAngles(0.0, 0.0, 0.0), occultation=False
    )
    scene, surfaces, epoch, ids, loop = tracking_problem(4, 3, duration_hours=2.0, sensor=sensor)
    moon = scene.primaries[0, 1]
    toward = moon - epoch[0, :3]
    sun = moon + 388.0 * toward / np.linalg.norm(toward)
    lit = scene._replace(sun_position=np.tile(sun, (scene.sun_position.shape[0], 1)))
    return lit, surfaces, epoch, ids, loop


@pytest.mark.parametrize("minutes", [None, 30.0])
def test_a_target_in_the_umbra_is_neither_seen_nor_tasked(problem, minutes):
    scene, surfaces, epoch, ids, loop = problem
    runs = []
    for eclipse in (False, True):
        settings = dataclasses.replace(
            loop,
            eclipse=eclipse,
            record=("measurements", "truth"),
            tasking=TaskingModel(detection=DetectionModel()),
            schedule=ScheduleModel(slot_minutes=minutes),
        )
        runs.append(run_closed_loop(scene, surfaces, epoch, ids, [4], settings))
    plain, shaded = runs
    place = np.swapaxes(shaded.true_translation[0, ..., :3], 0, 1)
    share = sunlit_share(place, scene.sun_position[1:], scene.primaries[1:])
    assert np.any(share[0] == 0.0) and np.any(plain.valid[0, share[0] == 0.0, 0])
    assert not np.any(shaded.valid[0].T[share == 0.0])
    umbra = share[0, 0] == 0.0
    assert umbra and 0 in plain.assignment[0, 0] and 0 not in np.ravel(shaded.assignment[0, 0])[:4]
    # an observation in the shadow has no information on the brightness of the target
    assert np.all(shaded.brightness_offset[0, :, 0] < 0.5)
    missed = shaded.outcome[0].T == FAINT
    assert np.all(share[missed] < 1.0)


def test_far_from_shadows_nothing_changes(problem):
    scene, surfaces, epoch, ids, loop = problem
    away = scene._replace(sun_position=scene.sun_position * [-1.0, 1.0, 1.0] + [0.0, 200.0, 99.0])
    runs = [
        run_closed_loop(away, surfaces, epoch, ids, [4], dataclasses.replace(loop, eclipse=eclipse))
        for eclipse in (False, True)
    ]
    assert np.any(runs[0].valid)
    for name in ("assignment", "information", "error", "outcome"):
        np.testing.assert_array_equal(getattr(runs[0], name), getattr(runs[1], name))


def _behind_the_moon(height):
    """A place 5000 km behind the Moon, at a height across the shadow; nondimensional."""
    moon = PRIMARIES[0, 1]
    away = (moon - SUN[0]) / np.linalg.norm(moon - SUN[0])
    return moon + away * 5000.0 / LENGTH_UNIT_KM + [0.0, 0.0, height / LENGTH_UNIT_KM]


def _still(count):
    """A scene of some times with the Sun and the bodies at rest."""
    scene = tracking_problem(1, 1, duration_hours=1.0)[0]
    return scene._replace(
        sun_position=np.tile(SUN, (count, 1)), primaries=np.tile(PRIMARIES, (count, 1, 1))
    )


@pytest.mark.parametrize("sigma_km", [0.5, 10.0])
def test_the_expected_dimming_has_the_moments_of_samples(sigma_km):
    """Of positions drawn from the estimate, in full light, across the penumbra and in the umbra."""
    height = np.array([1600.0, 1718.0, 1728.0, 1738.0, 1750.0, 1900.0])
    place = np.array([_behind_the_moon(h) for h in height])
    sigma = sigma_km / LENGTH_UNIT_KM
    covariance = np.diag([sigma**2] * 3 + [1e-12] * 3)
    estimate = Prediction(
        0, np.hstack([place, np.zeros_like(place)]), np.tile(covariance, (height.size, 1, 1))
    )
    targets = np.arange(height.size)
    mean, variance = expected_dimming(estimate, targets, 1, _still(1), EARTH_MOON)
    rng = np.random.default_rng(5)
    drawn = place[:, None] + sigma * rng.normal(size=(height.size, 4000, 3))
    share = sunlit_share(drawn.reshape(-1, 1, 3), SUN, PRIMARIES).reshape(height.size, -1)
    samples = -2.5 * np.log10(np.maximum(share, 0.01))
    # a rule of third degree: near the umbra, where the dimming is far from linear, it is rough
    np.testing.assert_allclose(mean[:, 0], samples.mean(axis=1), atol=0.12 * sigma_km**0.5)
    width, drawn_width = np.sqrt(variance[:, 0]), samples.std(axis=1)
    np.testing.assert_allclose(width, drawn_width, rtol=0.35, atol=0.05 * sigma_km**0.5)
    assert mean[-1, 0] == 0.0 == variance[-1, 0] and mean[0, 0] == 5.0
    assert np.all(np.diff(mean[1:, 0]) < 0.0)


def test_points_of_an_estimate_move_with_the_assumed_forces():
    scene = _still(6)
    start = np.array([[*_behind_the_moon(1690.0), 0.0, 0.1, 0.3]])
    known = Prediction(0, start, 1e-20 * np.eye(6)[None])
    mean, variance = expected_dimming(known, np.zeros(1, dtype=int), 6, scene, EARTH_MOON)
    times = scene.step * np.arange(6)
    path = propagate(start[0], times)[:, :3]
    alone = dimming(path[None], scene.sun_position, scene.primaries)
    np.testing.assert_allclose(mean, np.minimum(alone, 5.0), atol=1e-6)
    assert np.sum((mean > 0.0) & (mean < 5.0)) == 2 and variance.max() < 1e-9


def test_the_estimator_never_sees_the_true_shadow(problem, monkeypatch):
    """A shadow on the truth alone leaves its dimming in the magnitudes that the estimator gets."""
    scene, surfaces, epoch, ids, loop = problem
    away = scene._replace(sun_position=scene.sun_position * [-1.0, 1.0, 1.0] + [0.0, 200.0, 99.0])
    settings = dataclasses.replace(loop, eclipse=True, record=("measurements",))

    def first_hour():
        log = run_closed_loop(away, surfaces, epoch, ids, [4], settings).observations
        return log, log.step < loop.steps_per_interval

    log, first = first_hour()
    shadow = lambda place, *sky: np.full(place.shape[:2], 0.3)  # noqa: E731
    monkeypatch.setattr(realization, "dimming", shadow)
    shaded, again = first_hour()
    np.testing.assert_array_equal(log.target[first], shaded.target[again])
    value, dimmer = log.value[first], shaded.value[again]
    assert np.isfinite(value[:, 0]).any()
    np.testing.assert_allclose(dimmer[:, 0] - value[:, 0], 0.3 + 0.0 * value[:, 0], atol=1e-12)
    np.testing.assert_array_equal(dimmer[:, 1:], value[:, 1:])


def test_magnitudes_are_corrected_at_the_estimated_position():
    """One estimate in the penumbra, one in full light, and both with a wide covariance."""
    offset = np.array([[0, 1], [1, 2]])
    records = Measurements(
        offset, np.zeros(2, dtype=int), np.array([[12.0, 0.1, 0.2]] * 2), np.full((2, 3), 1e-4)
    )
    still = _still(2)
    place = np.array([_behind_the_moon(1745.0), _behind_the_moon(9000.0)])
    estimate = Prediction(0, np.hstack([place, 0 * place]), np.tile(1e-16 * np.eye(6), (2, 1, 1)))
    found, shaded = without_dimming(records, estimate, still, EARTH_MOON)
    alone = dimming(place[:, None], SUN, PRIMARIES)[:, 0]
    assert 0.1 < alone[0] < 5.0 and shaded.tolist() == [True, False]
    assert found.value[0] == pytest.approx([12.0 - alone[0], 0.1, 0.2], abs=1e-3)
    np.testing.assert_array_equal(found.value[1], records.value[1])
    np.testing.assert_array_equal(found.variance[1], records.variance[1])
    wide = estimate._replace(covariance=np.tile(1e-8 * np.eye(6), (2, 1, 1)))
    uncertain, _ = without_dimming(records, wide, still, EARTH_MOON)
    assert uncertain.variance[0, 0] > 0.1 and records.variance[0, 0] == 1e-4


@pytest.mark.parametrize("wrong", ["place", "sun", "primaries"])
def test_positions_of_different_times_are_refused(wrong):
    given = {"place": np.ones((2, 6, 3)), "sun": np.ones((6, 3)), "primaries": np.ones((6, 2, 3))}
    given[wrong] = given[wrong][:1] if wrong != "place" else given[wrong][:, :, :2]
    with pytest.raises(ConfigurationError, match=wrong):
        sunlit_share(**given)
