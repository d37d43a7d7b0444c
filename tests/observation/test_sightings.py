"""Sightings along trajectories agree with the tables of visibility and closed forms."""

import numpy as np
import pytest

from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.ephemeris.sampling import sample_ephemeris
from cislunar.errors import ConfigurationError
from cislunar.observation.measurement import DETECTED, EXCLUDED, FAINT, OCCULTED
from cislunar.observation.sensor import Atmosphere, ExclusionAngles, GroundSensor, Sensor
from cislunar.observation.sightings import sightings
from cislunar.orbits.catalog import periodic_orbits
from cislunar.photometry.sphere import sphere_magnitude
from cislunar.visibility.counts import VisibilitySettings, count_visibility
from cislunar.visibility.tracks import satellite_tracks

SUN = np.array([[0.0, -389.0, 0.0]])
OPEN = ExclusionAngles(0.0, 0.0, 0.0)


def test_sightings_are_as_many_as_in_the_tables():
    sky = sample_ephemeris(duration_days=5.0)
    halo = periodic_orbits("Halo_L2_S", jacobi=3.05)
    targets = np.random.default_rng(3).normal([1.0 - MU, 0.0, 0.0], 0.3, size=(40, 3))
    limit = 15.5
    table = count_visibility(
        halo.state,
        halo.period,
        targets,
        sky.time,
        sky.sun_position,
        VisibilitySettings(limiting_magnitude=limit),
        max_satellites=1,
    )
    tracks = satellite_tracks(halo.state, halo.period, [0.0], sky.time)[:, 0]
    sensor = Sensor(limiting_magnitude=limit, occultation=False)
    outcomes = np.array(
        [
            [
                sightings(track, np.broadcast_to(t, track.shape), sky.sun_position, sensor).outcome
                for t in targets
            ]
            for track in tracks
        ]
    )
    assert np.array_equal(np.sum(outcomes == DETECTED, axis=-1), table.observations[:, 0])
    assert {FAINT, EXCLUDED, DETECTED} == set(np.unique(outcomes))


def test_angles_range_and_magnitude():
    observer, target = np.array([[0.5, 0.0, 0.0]]), np.array([[0.5, 0.3, 0.0]])
    seen = sightings(observer, target, SUN, radius_m=2.0)
    assert seen.range_km == pytest.approx([0.3 * LENGTH_UNIT_KM])
    away = np.rad2deg(np.arctan2(0.5, 389.0))
    assert seen.body_angle_deg[0] == pytest.approx([180.0 - away, 90.0, 90.0])
    assert seen.phase_angle_deg == pytest.approx(np.rad2deg(np.arctan2(0.5, 389.3)))
    expected = sphere_magnitude(seen.range_km * 1e3, np.deg2rad(seen.phase_angle_deg), radius_m=2.0)
    assert seen.magnitude == pytest.approx(expected)


@pytest.mark.parametrize(
    ("sensor", "outcome"),
    [
        (Sensor(), EXCLUDED),
        (Sensor(exclusion_deg=OPEN), OCCULTED),
        (Sensor(exclusion_deg=OPEN, occultation=False), DETECTED),
        (Sensor(exclusion_deg=OPEN, occultation=False, limiting_magnitude=5.0), FAINT),
    ],
)
def test_outcome_of_an_observation_past_the_moon(sensor, outcome):
    """The target is just behind the limb of the Moon, the observer in front of it."""
    observer, target = np.array([[0.9, 0.0, 0.0]]), np.array([[1.05, 0.002, 0.0]])
    assert sightings(observer, target, SUN, sensor).outcome == [outcome]


@pytest.mark.parametrize(("mag", "outcome"), [(0.0, DETECTED), (20.0, FAINT)])
def test_the_atmosphere_limits_a_telescope_on_the_ground(mag, outcome):
    air = Atmosphere(extinction_mag=mag, min_elevation_deg=1.0, sun_below_deg=0.0)
    site, target = np.array([[-MU + 0.0166, 0.0, 0.0]]), np.array([[0.1, 0.03, 0.0]])
    sun = np.array([[-380.0, 1.0, 0.0]])
    found = sightings(site, target, sun, GroundSensor(exclusion_deg=OPEN, atmosphere=air))
    assert found.outcome == [outcome] and found.magnitude < 20.0


def test_impossible_inputs_are_refused():
    path = np.zeros((3, 3))
    with pytest.raises(ConfigurationError, match="shape"):
        sightings(path, path[:2], path)
    with pytest.raises(ConfigurationError, match="radius_m"):
        sightings(path, path, path, radius_m=-1.0)
    with pytest.raises(ConfigurationError, match="same position at time 0"):
        sightings(path, path, path)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"target": np.full((3, 3), np.nan)}, "target of time 0 is not finite"),
        ({"observer": "here"}, "observer = 'here' must be numbers of shape"),
        ({"sensor": "good"}, "sensor = 'good': give a Sensor"),
        ({"radius_m": "1"}, "radius_m = '1' must be a positive number"),
    ],
)
def test_impossible_arguments_are_named(given, message):
    usual = {"observer": np.zeros((3, 3)), "target": np.ones((3, 3)), "sun": np.ones((3, 3))}
    with pytest.raises(ConfigurationError, match=message):
        sightings(**usual | given)
