"""The CR3BP between maps to inertial axes, against the maps and an adaptive propagation."""

import numpy as np
import pytest
from numba import njit
from scipy.integrate import quad

from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.dynamics.bundle import propagate_bundle, step_bundle, step_cloud
from cislunar.dynamics.ephemeris import UNITS
from cislunar.dynamics.forces import of_state
from cislunar.dynamics.frames import from_inertial, lunar_frame, pulsating_frame, to_inertial
from cislunar.dynamics.instantaneous_frame_cr3bp import (
    inertial_states,
    instantaneous_frame_cr3bp,
    is_low_lunar,
)
from cislunar.dynamics.propagation import propagate
from cislunar.dynamics.tableau import STAGES8
from cislunar.ephemeris.bodies import tabulate_bodies
from cislunar.ephemeris.time_scales import tdb_seconds

START, STEP_S, STEPS = tdb_seconds("2024-10-05T00:00:00"), 60.0, 30
STEP = STEP_S / TIME_UNIT_S
SPEED = LENGTH_UNIT_KM / TIME_UNIT_S
LOW_RADIUS_KM = 1_900.0
LOW_SPEED = np.sqrt(4_902.8 / LOW_RADIUS_KM)
HALO = np.array([1.1458, 0.0, 0.154, 0.0, -0.2208, 0.0])
# circular about the Moon; a state at rest in inertial axes moves backward in the rotating frame
LOW = np.array(
    [1.0 - MU, -LOW_RADIUS_KM / LENGTH_UNIT_KM, 0.0, -LOW_RADIUS_KM / LENGTH_UNIT_KM, 0.0,
     LOW_SPEED / SPEED]
)  # fmt: skip


@pytest.fixture(scope="module")
def table():
    return tabulate_bodies(START, START + 86_400.0)


@njit
def _of_state(forces, j):
    return of_state(forces, j)


def _stepped(step, forces, state):
    """Three equal states after all steps."""
    bundle = np.ascontiguousarray(np.tile(state[:, None], (1, 3)))
    slopes, work = np.empty((STAGES8, *bundle.shape)), np.empty(bundle.shape)
    for k in range(STEPS):
        step(forces, k * STEP, bundle, STEP, slopes, work)
    return bundle


def test_low_lunar_orbits_are_identified():
    assert is_low_lunar([HALO, LOW]).tolist() == [False, True]
    faster = LOW.copy()
    faster[5] *= 1.38  # an apolune beyond 30,000 km
    assert not is_low_lunar(faster)


def test_steps_are_those_of_the_cr3bp_between_the_frames(table):
    """Thirty steps, maps before and after each, against one propagation between two maps."""
    start, low = inertial_states([HALO, LOW], table, START)
    assert low.tolist() == [False, True]
    forces = instantaneous_frame_cr3bp(table, START, STEP_S, STEPS, low)
    length_s = STEP_S * STEPS
    together = propagate_bundle(start, STEP, STEPS, forces=forces)[:, -1]
    for j, (make, state) in enumerate(((pulsating_frame, HALO), (lunar_frame, LOW))):
        first, last = make(table, START), make(table, START + length_s)
        np.testing.assert_allclose(from_inertial(start[j] * UNITS, first), state, atol=1e-14)
        passed, _ = quad(lambda s, make=make: 1.0 / make(table, START + s).time, 0.0, length_s)
        moved = propagate(state, [passed], method="dop853")[0]
        one = _of_state(forces, j)
        bundle = _stepped(step_bundle, one, start[j])
        wanted = to_inertial(moved, last) / UNITS
        atol = STEPS * 1e-13  # of a step near the Moon
        np.testing.assert_allclose(bundle, np.tile(wanted[:, None], (1, 3)), rtol=0, atol=atol)
        np.testing.assert_array_equal(together[j], bundle[:, 0])
        apart = np.max(np.abs(_stepped(step_cloud, one, start[j]) - bundle))
        assert (apart == 0.0) if make is lunar_frame else (0.0 < apart < 1e-12)
