"""Instantaneous Earth-Moon frames against SPICE, and their round trips."""

import numpy as np
import pytest
import spiceypy

from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.dynamics import frames
from cislunar.dynamics.frames import (
    from_inertial,
    lunar_frame,
    pulsating_frame,
    recenter,
    to_inertial,
)
from cislunar.ephemeris.bodies import BODY_COLUMNS, read_table, tabulate_bodies
from cislunar.ephemeris.kernel import EARTH, EARTH_MOON_BARYCENTER, MOON, SUN, kernel_path, loaded
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.errors import ConfigurationError

START = tdb_seconds("2024-10-01T00:00:00")
TIMES = START + 86_400.0 * np.linspace(0.0, 27.0, 40)
STATES = np.random.default_rng(1).uniform(-1.2, 1.2, (40, 6))
FRAMES = [pulsating_frame, lunar_frame]


@pytest.fixture(scope="module")
def table():
    return tabulate_bodies(TIMES[0], TIMES[-1])


@pytest.mark.parametrize("make", FRAMES)
def test_round_trip(table, make):
    frame = make(table, TIMES)
    back = from_inertial(to_inertial(STATES, frame), frame)
    np.testing.assert_allclose(back, STATES, rtol=0, atol=5e-15)
    one = make(table, TIMES[3])
    np.testing.assert_allclose(
        to_inertial(STATES[3], one), to_inertial(STATES, frame)[3], rtol=1e-15
    )


@pytest.mark.parametrize("make", FRAMES)
def test_matrix_is_the_derivative(table, make):
    frame = make(table, TIMES)
    linear = np.einsum("tij,tj->ti", frame.matrix(), STATES) + frame.origin
    np.testing.assert_allclose(linear, to_inertial(STATES, frame), rtol=1e-12, atol=1e-9)


def test_axes_and_their_rates_against_spice(table):
    """Against a two-vector frame of SPICE and its derivative."""
    number = 1_400_301
    definition = f"""
        FRAME_EARTH_MOON = {number}
        FRAME_{number}_NAME = 'EARTH_MOON'
        FRAME_{number}_CLASS = 5
        FRAME_{number}_CLASS_ID = {number}
        FRAME_{number}_CENTER = 399
        FRAME_{number}_RELATIVE = 'J2000'
        FRAME_{number}_DEF_STYLE = 'PARAMETERIZED'
        FRAME_{number}_FAMILY = 'TWO-VECTOR'
        FRAME_{number}_PRI_AXIS = 'X'
        FRAME_{number}_PRI_VECTOR_DEF = 'OBSERVER_TARGET_POSITION'
        FRAME_{number}_PRI_OBSERVER = 'EARTH'
        FRAME_{number}_PRI_TARGET = 'MOON'
        FRAME_{number}_PRI_ABCORR = 'NONE'
        FRAME_{number}_SEC_AXIS = 'Y'
        FRAME_{number}_SEC_VECTOR_DEF = 'OBSERVER_TARGET_VELOCITY'
        FRAME_{number}_SEC_OBSERVER = 'EARTH'
        FRAME_{number}_SEC_TARGET = 'MOON'
        FRAME_{number}_SEC_ABCORR = 'NONE'
        FRAME_{number}_SEC_FRAME = 'J2000'
    """
    frame = pulsating_frame(table, TIMES)
    with loaded(kernel_path()):
        spiceypy.lmpool([line.strip() for line in definition.split("\n") if line.strip()])
        try:
            transforms = np.array([spiceypy.sxform("J2000", "EARTH_MOON", t) for t in TIMES])
        finally:
            spiceypy.clpool()
    np.testing.assert_allclose(frame.axes, transforms[:, :3, :3], rtol=0, atol=1e-12)
    # d(axes)/dt applied to a fixed vector turns it by -w.
    rates = -np.cross(frame.rotation[:, None, :], np.swapaxes(frame.axes, 1, 2))
    np.testing.assert_allclose(np.swapaxes(rates, 1, 2), transforms[:, 3:, :3], rtol=0, atol=1e-13)
    assert np.abs(frame.rotation[:, 0]).max() > 1e-10  # the plane of the orbit does turn


def test_primaries_are_the_bodies(table):
    """Earth and Moon at rest in the CR3BP have the positions and velocities of the ephemeris."""
    frame = pulsating_frame(table, TIMES)
    position, velocity, _ = read_table(table, TIMES)
    for name, x in (("earth", -MU), ("moon", 1.0 - MU)):
        mapped = to_inertial(np.array([x, 0, 0, 0, 0, 0]), frame)
        at = BODY_COLUMNS[name]
        np.testing.assert_allclose(mapped[:, :3], position[:, at], rtol=0, atol=1e-8)
        np.testing.assert_allclose(mapped[:, 3:], velocity[:, at], rtol=0, atol=1e-13)
    assert frame.time == pytest.approx(TIME_UNIT_S * (frame.length / LENGTH_UNIT_KM) ** 1.5)


def test_lunar_frame_keeps_distance_and_speed_about_the_moon(table):
    frame = lunar_frame(table, TIMES)
    from_moon = recenter(to_inertial(STATES, frame), table, TIMES, old="barycenter", new="moon")
    offset = STATES[:, :3] - [1.0 - MU, 0.0, 0.0]
    speed = STATES[:, 3:] + np.cross([0.0, 0.0, 1.0], offset)
    np.testing.assert_allclose(
        np.linalg.norm(from_moon[:, :3], axis=1),
        LENGTH_UNIT_KM * np.linalg.norm(offset, axis=1),
        rtol=1e-13,
    )
    np.testing.assert_allclose(
        np.linalg.norm(from_moon[:, 3:], axis=1),
        LENGTH_UNIT_KM / TIME_UNIT_S * np.linalg.norm(speed, axis=1),
        rtol=1e-12,
    )


def test_origins_against_spice(table):
    t = START + 86_400.0 * 11
    with loaded(kernel_path()):
        for name, body in (("earth", EARTH), ("moon", MOON), ("sun", SUN)):
            center = spiceypy.spkgeo(body, t, "J2000", EARTH_MOON_BARYCENTER)[0]
            moved = recenter(STATES[0], table, t, old="barycenter", new=name)
            np.testing.assert_allclose(moved, STATES[0] - center, rtol=0, atol=1e-6)
    back = recenter(moved, table, t, old="sun", new="barycenter")
    np.testing.assert_allclose(back, STATES[0], rtol=0, atol=1e-7)
    with pytest.raises(ConfigurationError, match="center = 'mars' must be one of"):
        recenter(STATES[0], table, t, old="mars", new="earth")
    assert frames.CENTERS == ("barycenter", "earth", "moon", "sun")
