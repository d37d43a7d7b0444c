"""Transition matrices of the recursions for observer errors, against SciPy and the orbits."""

import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp

from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import EARTH_MOON, equations_of_motion, variational_matrix
from cislunar.dynamics.ephemeris import UNITS, forces_between
from cislunar.dynamics.frames import pulsating_frame, to_inertial
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.estimation.linearization import carry_estimates, make_scratch
from cislunar.observation.scene import make_scene

STEP, N_STEPS = 60.0 / TIME_UNIT_S, 120
HALO = np.array([1.0842, 0.0, -0.2010, 0.0, -0.2128, 0.0])
FIRST = "2024-10-01T00:00:00"
SHIFT = np.array([1.0, -2.0, 1.5, 0.1, 0.2, -0.1]) * 1e-8


def near_moon(distance_km):
    """State in a circular orbit about the Moon, rotating frame."""
    r = distance_km / LENGTH_UNIT_KM
    return np.array([1.0 - MU + r, 0.0, 0.0, 0.0, np.sqrt(MU / r) - r, 0.0])


@njit
def _carried(forces, scene, nominal, shift, measured, path, spread):
    work = make_scratch()
    for k in range(measured.size):
        place, state = nominal[k] + shift, nominal[k].copy()
        carry_estimates(forces, k, scene, place, state, measured[k], path, spread, work)
        shift[:] = place - state


def carried(forces, start, measured):
    """Transition matrix over all steps, difference of two estimates, and its square."""
    nominal = propagate_bundle(start[None], STEP, measured.size, forces=forces)[0]
    nowhere = np.zeros((measured.size + 1, 3))
    scene = make_scene(nowhere[None], nowhere + 1.0, 60.0)
    path, spread, shift = np.eye(6), np.outer(SHIFT, SHIFT), SHIFT.copy()
    _carried(forces, scene, nominal, shift, measured, path, spread)
    return path, shift, spread


def stm_by_scipy(start):
    """Transition matrix of the CR3BP with its closed-form variational matrix."""

    def rates(_, y):
        phi = variational_matrix(y[:6]) @ y[6:].reshape(6, 6)
        return np.concatenate([equations_of_motion(y[:6]), phi.ravel()])

    both, span = np.concatenate([start, np.eye(6).ravel()]), (0.0, N_STEPS * STEP)
    found = solve_ivp(rates, span, both, method="DOP853", rtol=1e-12, atol=1e-14)
    return found.y[6:, -1].reshape(6, 6)


# a step of 60 s is calm beyond 7 100 km from the Moon; nearer, the matrices are differences of
# orbits 38 m apart
@pytest.mark.parametrize(
    ("start", "share"), [(HALO, 1e-6), (near_moon(7_500.0), 1e-5), (near_moon(2_500.0), 1e-4)]
)
def test_transition_matrices_are_those_of_the_variational_equations(start, share):
    measured = np.arange(N_STEPS) % 3 == 0
    path, shift, spread = carried(EARTH_MOON, start, measured)
    expected = stm_by_scipy(start)
    np.testing.assert_allclose(path, expected, atol=share * np.abs(expected).max())
    square = np.outer(expected @ SHIFT, expected @ SHIFT)
    np.testing.assert_allclose(spread, square, atol=2.0 * share * np.abs(square).max())
    # the difference of two orbits
    both = propagate_bundle(np.stack([start, start + SHIFT]), STEP, N_STEPS)[:, -1]
    difference = both[1] - both[0]
    np.testing.assert_allclose(shift, difference, atol=5.0 * share * np.abs(difference).max())


def test_transition_matrices_of_ephemeris_forces_are_differences_of_orbits():
    forces = forces_between(FIRST, "2024-10-02", area_to_mass=0.01, reflectivity=1.4)
    start = to_inertial(HALO, pulsating_frame(forces.table, tdb_seconds(FIRST))) / UNITS
    path, _, _ = carried(forces, start, np.zeros(N_STEPS, dtype=bool))
    h = 1e-5
    states = np.concatenate([start + h * np.eye(6), start - h * np.eye(6)])
    moved = propagate_bundle(states, STEP, N_STEPS, forces=forces)[:, -1]
    expected = (moved[:6] - moved[6:]).T / (2.0 * h)
    np.testing.assert_allclose(path, expected, atol=1e-6 * np.abs(expected).max())
