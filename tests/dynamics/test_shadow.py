"""The visible share of the Sun's disk against geometry."""

import numpy as np
import pytest
from scipy.optimize import brentq

from cislunar.constants import MOON_RADIUS_KM
from cislunar.dynamics.radiation import (
    ASTRONOMICAL_UNIT_KM,
    SUN_RADIUS_KM,
    visible_sun,
)


def edge(distance, radius=MOON_RADIUS_KM):
    """Visible fraction behind a body at one astronomical unit, as a function of the height."""
    sun = np.array([-ASTRONOMICAL_UNIT_KM, 0.0, 0.0])

    def at(height, tilt=0.3):
        place = np.array([distance, height * np.cos(tilt), height * np.sin(tilt)])
        return visible_sun(tuple(place), tuple(place - sun), radius, SUN_RADIUS_KM)

    return at


def test_shadow_against_geometry():
    """Umbra and penumbra end on the tangent cones; an annulus is the ratio of two disks."""
    d = ASTRONOMICAL_UNIT_KM
    for distance in (2_000.0, 50_000.0, 200_000.0):
        at = edge(distance)
        for sign, seen in ((-1.0, 0.0), (1.0, 1.0)):
            # Tangent to both spheres, on one side of the axis or across it.
            sine = (SUN_RADIUS_KM + sign * MOON_RADIUS_KM) / d
            height = (MOON_RADIUS_KM + sign * distance * sine) / np.sqrt(1.0 - sine**2)
            assert at(height - 0.01 * sign)[0] == pytest.approx(seen, abs=1e-4)
            assert at(height + 0.01 * sign)[0] == seen
            assert 0.0 < at(height - 5.0 * sign)[0] < 1.0
    far = edge(600_000.0)(0.0)[0]
    ratio = np.arcsin(MOON_RADIUS_KM / 600_000.0) / np.arcsin(SUN_RADIUS_KM / (d + 600_000.0))
    assert far == pytest.approx(1.0 - ratio**2, rel=1e-12)


def test_share_of_the_disk_by_counting():
    """Points of the Sun's disk that the body does not cover."""
    distance, height = 300_000.0, 1_200.0
    seen = edge(distance)(height)[0]
    a = np.arcsin(SUN_RADIUS_KM / (ASTRONOMICAL_UNIT_KM + distance))
    b, c = np.arcsin(MOON_RADIUS_KM / distance), height / distance
    grid = np.linspace(-a, a, 2_001)
    x, y = np.meshgrid(grid, grid)
    disk = x * x + y * y < a * a
    count = np.sum(disk & ((x - c) ** 2 + y * y > b * b)) / np.sum(disk)
    assert seen == pytest.approx(count, abs=2e-3)


@pytest.mark.parametrize("distance", [2_000.0, 60_000.0, 500_000.0])
def test_gradient_of_the_shadow(distance):
    sun = np.array([-ASTRONOMICAL_UNIT_KM, 0.0, 0.0])

    def fraction(place):
        return visible_sun(tuple(place), tuple(place - sun), MOON_RADIUS_KM, SUN_RADIUS_KM)

    half = brentq(lambda h: fraction([distance, h, 0.0])[0] - 0.7, 1.0, 8_000.0)
    place = np.array([distance, 0.6 * half, 0.8 * half])
    slopes = [(fraction(place + e)[0] - fraction(place - e)[0]) / 0.02 for e in 0.01 * np.eye(3)]
    np.testing.assert_allclose(fraction(place)[1:], slopes, rtol=1e-5, atol=1e-9)


def test_shadow_is_defined_within_a_body():
    """A trial trajectory may enter the body, where its disk has no angular radius."""
    sun = np.array([-ASTRONOMICAL_UNIT_KM, 0.0, 0.0])
    for place in ([1_000.0, 300.0, 0.0], [-10.0, 1_700.0, 0.0]):
        seen = visible_sun(tuple(place), tuple(place - sun), MOON_RADIUS_KM, SUN_RADIUS_KM)
        assert np.all(np.abs(seen[1:]) < 0.1), place
