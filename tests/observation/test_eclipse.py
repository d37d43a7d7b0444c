"""Shadows of Earth and Moon on targets, against rays to the Sun and in the loop."""

import dataclasses

import numpy as np
import pytest

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.dynamics.radiation import SUN_RADIUS_KM
from cislunar.observation.measurement import FAINT
from cislunar.observation.sensor import ExclusionAngles, Sensor
from cislunar.observation.sightline import dimming, sunlit_share
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
