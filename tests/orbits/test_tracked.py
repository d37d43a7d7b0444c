"""The 202 moving targets."""

from collections import Counter

import numpy as np
import pytest

from cislunar.constants import (
    GM_MOON_KM3_S2,
    LENGTH_UNIT_KM,
    MOON_RADIUS_KM,
    MU,
    SECONDS_PER_DAY,
    TIME_UNIT_S,
)
from cislunar.dynamics.cr3bp import primary_distances
from cislunar.dynamics.propagation import propagate
from cislunar.orbits.tracked import POLAR_ORBITS, polar_state, tracked_targets

PROGRESS = []


@pytest.fixture(scope="module")
def targets():
    PROGRESS.clear()
    return tracked_targets(progress=lambda *call: PROGRESS.append(call))


def test_two_hundred_and_two_targets_by_class(targets):
    counts = Counter(targets.family.tolist())
    polar = {name: counts.pop(name) for name in list(counts) if name.startswith("Polar_")}
    assert counts == {
        "Halo_L1_N": 30,
        "Halo_L1_S": 30,
        "Halo_L2_N": 30,
        "Halo_L2_S": 28,
        "NRHO_9:2": 1,
        "NRHO_4:1": 1,
        "DRO": 37,
        "Resonant_3:1": 18,
        "Resonant_3:1b": 19,
    }
    assert list(polar.values()) == [1] * 8
    assert len(targets.period) == 202
    assert len(np.unique(targets.state, axis=0)) == 202


def test_periodic_targets_close_and_start_on_y_zero(targets):
    assert np.all(targets.state[:, 1] == 0.0)
    for state, period in zip(targets.state[:-8], targets.period[:-8], strict=True):
        end = propagate(state, [period], method="dop853")[0]
        assert np.abs(end - state).max() < 1e-8


def test_near_rectilinear_halos_have_their_resonance(targets):
    for name, days, perilune in (("NRHO_9:2", 6.562353, 3249.0), ("NRHO_4:1", 7.382647, 5750.0)):
        (i,) = np.flatnonzero(targets.family == name)
        assert targets.period[i] * TIME_UNIT_S / SECONDS_PER_DAY == pytest.approx(days, abs=1e-5)
        assert targets.perilune_km[i] == pytest.approx(perilune, abs=1.0)
        assert targets.state[i, 2] < 0.0


def test_retrograde_orbits_span_their_perilunes_and_go_backwards(targets):
    rows = targets.family == "DRO"
    assert targets.perilune_km[rows].min() == pytest.approx(10_000.0, abs=1e-3)
    assert targets.perilune_km[rows].max() == pytest.approx(150_000.0, abs=1e-3)
    assert np.all(targets.state[rows, 4] > 0.0)
    assert np.all(targets.state[rows, 0] < 1 - MU)
    assert np.all(targets.stability_index[rows] < 1.0 + 1e-6)


@pytest.mark.parametrize(("family", "unstable"), [("Resonant_3:1", True), ("Resonant_3:1b", False)])
def test_resonant_orbits_turn_three_times_around_the_earth(targets, family, unstable):
    rows = np.flatnonzero(targets.family == family)
    indices = targets.stability_index[rows]
    assert indices.min() > 1.05 if unstable else indices.max() < 1.001
    for i in rows[::6]:
        assert targets.period[i] == pytest.approx(2.0 * np.pi, rel=0.05)
        times = np.linspace(0.0, targets.period[i], 4001)
        path = propagate(targets.state[i], times)
        # Angle in the inertial frame: the frame itself turns by the elapsed time.
        angle = np.unwrap(np.arctan2(path[:, 1], path[:, 0] + MU)) + times
        assert (angle[-1] - angle[0]) / (2.0 * np.pi) == pytest.approx(3.0, abs=0.05)


def test_polar_orbits_are_kepler_ellipses_over_the_south_pole(targets):
    for k, orbit in enumerate(POLAR_ORBITS):
        state, period = polar_state(orbit, 0.3 * k)
        moon = np.array([1.0 - MU, 0.0, 0.0])
        r = (state[:3] - moon) * LENGTH_UNIT_KM
        # To inertial axes: v + omega x r.
        v = state[3:] + np.cross([0.0, 0.0, 1.0], state[:3] - moon)
        v = v * LENGTH_UNIT_KM / TIME_UNIT_S
        gm = MU * LENGTH_UNIT_KM**3 / TIME_UNIT_S**2
        assert gm == pytest.approx(GM_MOON_KM3_S2, rel=1e-3)
        momentum = np.cross(r, v)
        eccentricity = np.cross(v, momentum) / gm - r / np.linalg.norm(r)
        semi_major = 1.0 / (2.0 / np.linalg.norm(r) - v @ v / gm)
        e = np.linalg.norm(eccentricity)
        assert semi_major * (1 - e) - MOON_RADIUS_KM == pytest.approx(orbit.perilune_altitude_km)
        assert semi_major * (1 + e) - MOON_RADIUS_KM == pytest.approx(orbit.apolune_altitude_km)
        assert np.allclose(r[:2], 0.0)
        assert r[2] < 0.0
        assert abs(momentum[2]) < 1e-9 * np.linalg.norm(momentum)
        kepler = 2.0 * np.pi * np.sqrt(semi_major**3 / gm) / TIME_UNIT_S
        assert period == pytest.approx(kepler, rel=1e-12)


def test_polar_orbits_stay_above_the_moon_for_a_day(targets):
    day = SECONDS_PER_DAY / TIME_UNIT_S
    for state in targets.state[-8:]:
        _, r = primary_distances(propagate(state, np.linspace(0.0, day, 2000)))
        assert r.min() * LENGTH_UNIT_KM > MOON_RADIUS_KM + 100.0
    assert np.all(np.isnan(targets.stability_index[-8:]))


@pytest.mark.usefixtures("targets")
def test_progress_reaches_the_total():
    assert PROGRESS[-1] == (202, 202)
    assert [done for done, _ in PROGRESS] == sorted(done for done, _ in PROGRESS)
