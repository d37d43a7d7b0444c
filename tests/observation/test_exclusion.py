"""Exclusion angles against angles measured one by one."""

import numpy as np
import pytest
from oracles.visibility import directions_to_bodies, outside_exclusion

from cislunar.constants import MU
from cislunar.dynamics.cr3bp import primary_positions
from cislunar.errors import ConfigurationError
from cislunar.observation import sightline
from cislunar.observation.sensor import ExclusionAngles

SUN = np.array([0.0, 389.0, 3.0])


def angle_between(a, b):
    """Angle in degrees, accurate at 0 and 180 degrees (Kahan)."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return np.rad2deg(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def turned(direction, degrees):
    """A vector at a given angle from a direction."""
    across = np.cross(direction, [0.3, -0.5, 0.8])
    across /= np.linalg.norm(across)
    along = direction / np.linalg.norm(direction)
    return np.cos(np.deg2rad(degrees)) * along + np.sin(np.deg2rad(degrees)) * across


def test_defaults_are_the_papers():
    angles = ExclusionAngles()
    assert (angles.sun, angles.moon, angles.earth) == (35.0, 5.0, 15.0)


def test_directions_are_unit_vectors_to_sun_moon_and_earth():
    position = np.array([0.4, -0.3, 0.2])
    toward = directions_to_bodies(position, SUN)
    bodies = [SUN, np.array([1.0 - MU, 0.0, 0.0]), np.array([-MU, 0.0, 0.0])]
    for unit, body in zip(toward, bodies, strict=True):
        assert np.linalg.norm(unit) == pytest.approx(1.0, abs=1e-15)
        assert angle_between(unit, body - position) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("body, limit", [(0, 35.0), (1, 5.0), (2, 15.0)])
@pytest.mark.parametrize("length", [1e-6, 1.0, 30.0])
def test_each_body_excludes_a_cone(body, limit, length):
    # Off the Earth-Moon line and away from the Sun, so that the three cones do not meet.
    position = np.array([0.5, 0.1, 0.9])
    toward = directions_to_bodies(position, SUN)
    just = 1e-9
    outside = length * turned(toward[body], limit + just)
    inside = length * turned(toward[body], limit - just)
    angles = ExclusionAngles()
    assert outside_exclusion(outside, toward, angles)
    assert not outside_exclusion(inside, toward, angles)


def test_random_lines_against_measured_angles():
    rng = np.random.default_rng(5)
    position = rng.uniform(-1.5, 1.5, (300, 3))
    line = rng.normal(size=(300, 3))
    sun = 389.0 * turned(SUN, 40.0)
    angles = ExclusionAngles(sun=60.0, moon=40.0, earth=50.0)
    clear = outside_exclusion(line, directions_to_bodies(position, sun), angles)
    compiled = [
        sightline.outside_exclusion(*here, *way, sun, angles.cosines, primary_positions(MU))
        for way, here in zip(line, position, strict=True)
    ]
    np.testing.assert_array_equal(compiled, clear)
    expected = [
        angle_between(way, sun - here) > 60.0
        and angle_between(way, np.array([1.0 - MU, 0.0, 0.0]) - here) > 40.0
        and angle_between(way, np.array([-MU, 0.0, 0.0]) - here) > 50.0
        for way, here in zip(line, position, strict=True)
    ]
    assert 0.2 < np.mean(expected) < 0.8
    np.testing.assert_array_equal(clear, expected)


def test_zero_angles_exclude_only_the_body_itself():
    toward = directions_to_bodies(np.array([0.5, 0.2, 0.1]), SUN)
    none = ExclusionAngles(0.0, 0.0, 0.0)
    assert outside_exclusion(turned(toward[0], 0.01), toward, none)
    assert not outside_exclusion(2.0 * np.array([1.0, 0.0, 0.0]), np.eye(3), none)


def test_shapes_broadcast():
    position = np.full((4, 1, 3), 0.3)
    toward = directions_to_bodies(position, np.tile(SUN, (4, 1, 1)))
    assert toward.shape == (4, 1, 3, 3)
    lines = np.random.default_rng(0).normal(size=(4, 7, 3))
    assert outside_exclusion(lines, toward, ExclusionAngles()).shape == (4, 7)


@pytest.mark.parametrize("name", ["sun", "moon", "earth"])
@pytest.mark.parametrize("value", [-1.0, 180.0, float("nan")])
def test_impossible_angle_is_refused(name, value):
    with pytest.raises(ConfigurationError, match=name):
        ExclusionAngles(**{name: value})
