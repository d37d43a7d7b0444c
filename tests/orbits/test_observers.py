"""Tables of observers: the orbits of their rows, and refused tables."""

import re

import numpy as np
import pytest
from message_files import refused, table
from scipy.integrate import solve_ivp

from cislunar.constants import MU, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.orbits.catalog import periodic_orbits
from cislunar.orbits.observers import load_observers, observer_orbits
from cislunar.visibility.tracks import satellite_tracks

STATES = "id,x,y,z,vx,vy,vz,period,family,jacobi,phase"
FREE = "free,0.8,0.1,0.05,0.1,-0.2,0.1,,,,"
MEMBER = ",,,,,,,,Vertical_L1,3.1,"


def flown(state, times):
    """States at rising times by SciPy and equations of motion written out here."""

    def rates(_, s):
        x, y, z, vx, vy, vz = s
        earth = (1.0 - MU) / ((x + MU) ** 2 + y**2 + z**2) ** 1.5
        moon = MU / ((x - 1.0 + MU) ** 2 + y**2 + z**2) ** 1.5
        ax = 2.0 * vy + x - earth * (x + MU) - moon * (x - 1.0 + MU)
        return [vx, vy, vz, ax, -2.0 * vx + y - (earth + moon) * y, -(earth + moon) * z]

    span = (0.0, times[-1])
    return solve_ivp(rates, span, state, "DOP853", times, rtol=1e-12, atol=1e-12).y.T


def test_observers_are_on_the_orbits_of_their_rows(tmp_path):
    vertical = periodic_orbits("Vertical_L1", jacobi=3.1)
    start, period = vertical.state[0], vertical.period[0]
    closed = ",".join(["closed", *map(repr, start.tolist()), repr(float(period)), ",,0.5"])
    rows = load_observers(table(tmp_path, STATES, FREE, "ahead" + MEMBER + "0.25", closed))
    calls = []
    orbits = observer_orbits(rows, 10.0, lambda *call: calls.append(call))
    assert [row.name for row in rows] == ["free", "ahead", "closed"]
    assert list(orbits.family) == ["own", "Vertical_L1", "own"]
    assert calls[-1] == (3, 3)
    quarter, half = flown(start, [0.25 * period, 0.5 * period])
    np.testing.assert_allclose(orbits.state[1:], [quarter, half], atol=1e-8)
    np.testing.assert_allclose(orbits.period, [0.0, period, period], rtol=1e-12)
    np.testing.assert_allclose(orbits.stability_index[1:], vertical.stability_index[0], rtol=1e-6)
    assert np.isnan(orbits.stability_index[0])
    # an observer without a period is propagated from its state
    times = np.linspace(0.5, 2.0, 4)
    track = satellite_tracks(orbits.state[:1], [0.0], [0.0], times)[0, 0]
    np.testing.assert_allclose(track, flown(orbits.state[0], times)[:, :3], atol=1e-7)


def test_a_member_may_be_chosen_by_its_period_in_days(tmp_path):
    rows = ["id,family,period_days", "one,DRO,14"]
    orbits = observer_orbits(load_observers(table(tmp_path, *rows)), 10.0)
    assert orbits.period[0] * TIME_UNIT_S / SECONDS_PER_DAY == pytest.approx(14.0, rel=1e-9)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([STATES], "contains no observer"),
        ([STATES, FREE, FREE], "row 3, observer 'free': the id is taken already in row 2"),
        ([STATES, "one,0.8,0,0,0,.1,0,,DRO,,"], "'one': both a state and a family"),
        ([STATES, "one,,,,,,,,,3.1,"], "'one': neither a state nor a family"),
        ([STATES, "one,0.8,,0,0,.1,0,,,,"], "'one': y = '' must be a finite number"),
        ([STATES, "one,0.8,0,0,0,.1,0,,,3.1,"], "a state has its own Jacobi constant"),
        ([STATES, FREE + "0.5"], "'free': phase is a share of the period; give period_days"),
        ([STATES, "one" + MEMBER + "1.5"], "'one': phase = 1.5 must be within 0 .. 1"),
        ([STATES, "one,,,,,,,,Halo_L4,3.1,"], "'one': unknown orbit family 'Halo_L4'; the"),
        ([STATES, "one,,,,,,,,Halo_L1N,3.1,"], "orbit family 'Halo_L1N'; did you mean 'Halo_L1_N'"),
        ([STATES, "one,,,,,,,3,DRO,3.1,"], "'one': give one of jacobi and period_days"),
        ([STATES, "one,,,,,,,,DRO,,"], "'one': give one of jacobi and period_days"),
        ([STATES, "one,388000,0,0,0,.1,0,,,,"], "x = 388000 is taken in units of 384400 km"),
        ([STATES, "one,0.988,0,0,0,.1,0,,,,"], "'one': lies inside the Moon"),
        (["id,family,aperture", "one,DRO,19"], "column 'aperture' is unknown"),
        (["id,family,magnitude_noise", "one,DRO,-1"], "magnitude_noise = -1 must be above 0"),
        ([STATES, "one,,,,,,,,Vertical_L1,5,"], "has jacobi = 5; the family has about -0.83"),
        ([STATES, "one,,,,,,,,Halo_L1_N,3,"], "3 members of Halo_L1_N have jacobi = 3: jacobi 3, "),
        ([STATES, "one,0.95,0,0,0,0,0,,,,"], "'one': its orbit meets the Moon: it comes within"),
        ([STATES, FREE.replace(",,,,", ",2,,,")], "'free': not closed: half a period ahead and"),
    ],
)
def test_faults_of_observer_tables_are_one_line_that_names_the_field(tmp_path, rows, message):
    path = table(tmp_path, *rows)
    refused(lambda each: observer_orbits(load_observers(each), 10.0), path, re.escape(message))
