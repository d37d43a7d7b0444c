"""Orbits that are lost without a detection, against the exposures that cover them."""

import numpy as np
import pytest
from maneuvered_arcs import BEFORE, PROBLEM, REGION, STEP, arcs, linked

from cislunar.detection import DetectionProcess
from cislunar.dynamics import EARTH_MOON, propagate
from cislunar.observation import Sensor, sensor_limits
from cislunar.orbit_determination import LinkingSettings
from cislunar.survey import LineageSettings, detection_probability, views
from cislunar.survey.maneuvers import (
    CURRENT,
    LOST,
    FieldHistory,
    Watch,
    maneuvered_orbits,
    misses,
    orbit_paths,
)


def watch(orbit, minutes, fits, offset_deg=0.0, observers=range(6)):
    """Exposures of some observers toward an orbit, or next to it, and states of the orbit."""
    scene, sensor = PROBLEM.scene, Sensor(limiting_magnitude=20)
    states = propagate(
        fits.state[orbit], np.asarray(minutes) * STEP - fits.epoch[orbit], method="dop853"
    )
    index, of = np.repeat(minutes, len(observers)), np.tile(list(observers), len(minutes))
    unit = np.repeat(states[:, :3], len(observers), axis=0) - scene.observer_position[of, index]
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    unit += np.deg2rad(offset_deg) * np.cross(unit, [0.0, 0.0, 1.0])
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    fields = FieldHistory(index, of, unit, np.full(index.size, 0.026))
    limits = sensor_limits(sensor, scene.observer_position.shape[0])
    return Watch(fields, scene, limits, 0.4, DetectionProcess().detection_loss), states


def test_an_orbit_that_fields_miss_is_lost_and_one_that_they_do_not_cover_is_not():
    angles, fits, _ = arcs((-20.0, 30.0, 5.0))
    fits, sure = fits.take([0, 1, 2]), [True, True, True]
    given = {"forces": EARTH_MOON, "region": REGION, "linking": LinkingSettings()}
    minutes, often = np.arange(200, 600, 25), LineageSettings(maneuvers_per_day=1)
    seen, track = watch(0, minutes, fits)
    found = maneuvered_orbits(linked(fits, sure), angles, settings=often, watch=seen, **given)
    assert found.status == (LOST, CURRENT, CURRENT)
    assert found.orbits.confirmed.tolist() == [False, True, True]
    aside, _ = watch(0, minutes, fits, offset_deg=4.0)
    # toward a single observer, of the two that have a clear view, the body may be dark
    single, _ = watch(0, minutes, fits, observers=[0])
    for other in (aside, single, None):
        same = maneuvered_orbits(linked(fits, sure), angles, settings=often, watch=other, **given)
        assert same.status == (CURRENT,) * 3 and same.orbits.confirmed.all()
    # an object behind the Moon, as seen from the Sun, cannot be detected
    shadow = seen.scene.primaries.copy()
    way = seen.scene.sun_position[minutes] - track[:, :3]
    shadow[minutes, 1] = track[:, :3] + 0.5 * way / np.linalg.norm(way, axis=1)[:, None]
    hidden = seen._replace(scene=seen.scene._replace(primaries=shadow))
    same = maneuvered_orbits(linked(fits, sure), angles, settings=often, watch=hidden, **given)
    assert same.status == (CURRENT,) * 3
    # an object that is too faint would not have been detected either
    faint = angles._replace(magnitude=angles.magnitude + 8.0)
    dark = maneuvered_orbits(linked(fits, sure), faint, settings=often, watch=seen, **given)
    assert dark.status == (CURRENT,) * 3


def test_the_probability_of_no_detection_is_that_of_single_exposures():
    from cislunar.orbit_determination import implied_size
    from cislunar.survey.maneuvers import log_missed

    angles, fits, _ = arcs((-20.0, 30.0, 5.0))
    minutes = np.array([140, 155, 165, 200, 260])
    seen, states = watch(0, minutes, fits, observers=[0, 1])
    paths = orbit_paths(fits, BEFORE[-1] * STEP, minutes[-1] * STEP, forces=EARTH_MOON)
    missed = log_missed(fits, angles, np.array([0]), paths, seen)
    own = slice(fits.begin[0], fits.begin[1])
    size = implied_size(fits.position[own], angles.rows(fits.row[own]))[0]
    sigma, offsets = np.sqrt(seen.limits.noise_variance[0, 0]), np.linspace(-3.2, 3.2, 4001)
    each = np.ones_like(offsets)
    for o in (0, 1):
        missed_at = []
        for k, state in zip(minutes.tolist(), states, strict=True):
            margin = views(seen.scene, seen.limits, k, state[None, :3]).margin[o] - offsets
            missed_at.append(1.0 - 0.9 * detection_probability(margin, size, sigma, seen.loss))
        # blocks of 20 minutes: 140 and 155, 165, 200, 260
        blocks = np.prod([np.minimum(*missed_at[:2]), *missed_at[2:]], axis=0)
        each *= 0.05 + 0.95 * blocks
    density = np.exp(-0.5 * (offsets / 0.4) ** 2) / (0.4 * np.sqrt(2.0 * np.pi))
    expected = np.log(np.sum(density * each) * (offsets[1] - offsets[0]))
    assert missed[0] == pytest.approx(expected, abs=0.05)
    assert missed[0] < -2.0


def test_no_field_that_contains_a_position_is_left_out():
    """Against angles by the arctangent, at random and near the edge of a field."""
    rng = np.random.default_rng(8)
    n_exposures, n_positions = 200, 6
    boresight = rng.standard_normal((n_exposures, 3))
    boresight /= np.linalg.norm(boresight, axis=1, keepdims=True)
    half_field, observer = rng.uniform(0.01, 0.4, n_exposures), rng.integers(3, size=n_exposures)
    observers, spread = rng.standard_normal((3, 3)), rng.uniform(0.0, 0.02, n_positions)
    position = rng.standard_normal((n_positions, 3))
    away = position - observers[observer, None]
    across = np.linalg.norm(np.cross(away, boresight[:, None]), axis=2)
    off = np.arctan2(across, np.einsum("eni,ei->en", away, boresight))
    margin = misses._MARGIN * spread / np.linalg.norm(away, axis=2)
    half_field[:50] = (off + margin)[:50, 0] + 1e-9
    half_field[50:100] = (off + margin)[50:100].min(axis=1) - 1e-9
    inside = np.array([
        [misses._within(tuple(way), boresight[e], half_field[e], spread[j])[0]
         for j, way in enumerate(away[e])] for e in range(n_exposures)
    ])  # fmt: skip
    np.testing.assert_array_equal(inside, off + margin <= half_field[:, None])
    near = np.flatnonzero(inside.any(axis=1))
    assert set(range(50)) <= set(near) and not set(range(50, 100)) & set(near)
    assert 50 < near.size < 150
