"""Ephemeris-refined orbits and reference tracking, against propagation by SciPy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cislunar.constants import MU, TIME_UNIT_S
from cislunar.dynamics.ephemeris import UNITS
from cislunar.dynamics.ephemeris_forces import ephemeris_forces
from cislunar.dynamics.frames import from_inertial, pulsating_frame
from cislunar.dynamics.radiation import ASTRONOMICAL_UNIT_KM, SOLAR_PRESSURE_N_M2
from cislunar.ephemeris.bodies import (
    GM_EARTH,
    GM_MOON,
    GM_SUN,
    moon_axes,
    read_table,
    tabulate_bodies,
)
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.errors import ConvergenceError
from cislunar.orbits.ephemeris_refined.reference_tracking import (
    frame_clock,
    reference_states,
    tracking_cost,
)
from cislunar.orbits.ephemeris_refined.refinement import path_states, refined_path

START, DAYS = tdb_seconds("2024-10-01T00:00:00"), 10.0
# a halo about L2, (state, period)
HALO = np.array([1.119430692243942, 0.0, 0.18734899820606407, 0.0, -0.22460113555910552, 0.0])
PERIOD = 2.8912175505291513


@pytest.fixture(scope="module")
def forces():
    table = tabulate_bodies(START, START + DAYS * 86_400.0)
    return ephemeris_forces(table, START, area_to_mass=0.01)


def _derivative(t, y, table):
    """Point masses, sunlight without shadow, J2 and C22 of the Moon."""
    place = read_table(table, START + t)[0]
    earth, moon, sun = (place[i : i + 3] for i in (0, 3, 6))
    from_sun = y[:3] - sun
    light = 1e-3 * SOLAR_PRESSURE_N_M2 * 1.3 * 0.01 * ASTRONOMICAL_UNIT_KM**2
    pull = (light - GM_SUN) * from_sun / np.linalg.norm(from_sun) ** 3
    share = GM_EARTH / (GM_EARTH + GM_MOON)
    for body, gm, part in ((earth, GM_EARTH, share), (moon, GM_MOON, 1.0 - share)):
        pull = pull - gm * (y[:3] - body) / np.linalg.norm(y[:3] - body) ** 3
        pull = pull - part * GM_SUN * (sun - body) / np.linalg.norm(sun - body) ** 3
    x, east, pole = moon_axes(START + t)
    form = -0.5 * 2.0322e-4 * (3.0 * np.outer(pole, pole) - np.eye(3))
    form += 3.0 * 2.2382e-5 * (np.outer(x, x) - np.outer(east, east))
    r = y[:3] - moon
    d = np.linalg.norm(r)
    figure = 2.0 * form @ r / d**5 - 5.0 * (r @ form @ r) * r / d**7
    return np.concatenate([y[3:], pull + GM_MOON * 1_738.0**2 * figure])


def test_a_refined_orbit_is_continuous_and_near_its_cr3bp_orbit(forces):
    path = refined_path(forces, HALO, PERIOD, DAYS, ahead=0.25)
    assert np.all(np.diff(path.time) > 0.0)
    assert path.time[0] == 0.0 and path.time[-1] == DAYS * 86_400.0
    assert path.position_miss_km < 1e-6 and path.velocity_miss_km_s < 1e-9
    table = forces.table
    for k in (0, 7, len(path.time) - 2):
        span = path.time[k], path.time[k + 1]
        given = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-10, "args": (table,)}
        end = solve_ivp(_derivative, span, path.state[k] * UNITS, **given).y[:, -1]
        miss = np.abs(end - path.state[k + 1] * UNITS)
        assert miss[:3].max() < 1e-3 and miss[3:].max() < 1e-6
    reference = reference_states(table, START, HALO, PERIOD, path.time, ahead=0.25)
    distance = np.linalg.norm((path.state - reference)[:, :3], axis=1) * UNITS[0]
    assert 100.0 < distance.max() < 10_000.0
    between = path_states(forces, path, path.time)
    np.testing.assert_allclose(between[:-1], path.state[:-1], rtol=0, atol=1e-12)


def test_reference_tracking_stays_on_the_cr3bp_orbit(forces):
    time = frame_clock(forces.table, START, [0.0, 86_400.0 * DAYS])
    frame = pulsating_frame(forces.table, START + 86_400.0 * np.linspace(0.0, DAYS, 20_001))
    passed = np.trapezoid(1.0 / frame.time, dx=86_400.0 * DAYS / 20_000)
    np.testing.assert_allclose(time, [0.0, passed], rtol=1e-9)
    state = reference_states(forces.table, START, HALO, PERIOD, [0.0])[0]
    back = from_inertial(state * UNITS, pulsating_frame(forces.table, START))
    np.testing.assert_allclose(back, HALO, rtol=0, atol=1e-13)
    # the thrust by differences of velocities that SciPy's path of a minute from each state gives
    cost, step = 0.0, 43_200.0
    for time in np.arange(0.5 * step, DAYS * 86_400.0, step):
        kept = reference_states(forces.table, START, HALO, PERIOD, time + np.array([0.0, 60.0]))
        free = solve_ivp(
            _derivative, [time, time + 60.0], kept[0] * UNITS, method="DOP853", rtol=1e-12,
            atol=1e-12, args=(forces.table,),
        ).y[:, -1]  # fmt: skip
        cost += np.linalg.norm(kept[1, 3:] * UNITS[3] - free[3:]) / 60.0 * step * 1e3
    assert tracking_cost(forces, HALO, PERIOD, DAYS) == pytest.approx(cost, rel=0.05)


def test_a_refinement_that_fails_is_reported(forces):
    doomed = np.array([1.0 - MU + 0.02, 0.0, 0.0, 0.0, 0.0, 0.0])  # falls into the Moon
    with pytest.raises(ConvergenceError):
        refined_path(forces, doomed, 0.0, 10.0 * TIME_UNIT_S / 375_190.0)
