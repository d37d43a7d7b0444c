"""Reference tracking: CR3BP orbits placed in the instantaneous frame, and their thrust requirement.

Assumptions and limitations
---------------------------
- Navigation errors and station keeping are not included.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import cumulative_simpson

from cislunar.compiled import njit
from cislunar.constants import LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics.ephemeris import UNITS
from cislunar.dynamics.ephemeris_forces import EphemerisForces
from cislunar.dynamics.forces import acceleration, at
from cislunar.dynamics.frames import lunar_frame, pulsating_frame, to_inertial
from cislunar.dynamics.instantaneous_frame_cr3bp import is_low_lunar
from cislunar.dynamics.propagation import propagate, propagate_periodic
from cislunar.ephemeris.bodies import BodyTable
from cislunar.runtime import Array

CLOCK_STEP_S = 600.0
"""Interval between evaluations of the clock rate of the frame, s."""


def reference_states(
    table: BodyTable,
    epoch: float,
    state: ArrayLike,
    period: float,
    time: ArrayLike,
    *,
    ahead: float = 0.0,
) -> Array:
    """States of a CR3BP orbit in the barycentric frame, by way of the instantaneous frame.

    Parameters
    ----------
    table : BodyTable
        Positions of the bodies.
    epoch : float
        TDB seconds past J2000 at which the orbit is at `state`.
    state : array_like, shape (6,)
        Nondimensional, rotating frame.
    period : float
        Nondimensional; 0 for an open trajectory.
    time : array_like, shape (m,)
        Time since the epoch, s, not negative.
    ahead : float
        Fraction of the period by which the satellite is ahead of `state`.

    Returns
    -------
    ndarray, shape (m, 6)
        Barycentric frame, J2000 axes, nondimensional. Time along the orbit elapses in the units of
        the pulsating frame; low lunar orbits use the lunar frame (`cislunar.dynamics.frames`).

    Raises
    ------
    ConfigurationError
        If the table does not cover the times.
    ConvergenceError
        If the trajectory meets the center of a primary.
    """
    times = np.asarray(time, dtype=float)
    rigid = bool(is_low_lunar(state))
    passed = times / TIME_UNIT_S if rigid else frame_clock(table, epoch, times)
    if period > 0.0:
        path = propagate_periodic(state, period, passed + ahead * period, method="dop853")
    else:
        path = propagate(state, passed, method="dop853")
    frame = (lunar_frame if rigid else pulsating_frame)(table, epoch + times)
    return to_inertial(path, frame) / UNITS


def frame_clock(table: BodyTable, epoch: float, time: ArrayLike) -> Array:
    """Integral of dt / T (m,), the nondimensional time since an epoch (TDB seconds past J2000) in
    the units of the pulsating frame; `time` is in s, not negative."""
    times = np.asarray(time, dtype=float)
    last = max(float(times.max(initial=0.0)), CLOCK_STEP_S)
    nodes = np.linspace(0.0, last, int(np.ceil(last / CLOCK_STEP_S)) + 2)
    rate = 1.0 / pulsating_frame(table, epoch + nodes).time
    passed = cumulative_simpson(rate, x=nodes, initial=0.0)
    # cubic Hermite interpolation between nodes
    k = np.clip(np.searchsorted(nodes, times, side="right") - 1, 0, nodes.size - 2)
    h = nodes[k + 1] - nodes[k]
    w = np.divide(times - nodes[k], h, out=np.zeros_like(times), where=h > 0.0)
    step, first, second = passed[k + 1] - passed[k], h * rate[k], h * rate[k + 1]
    cubic = (first + second - 2.0 * step) * w + (3.0 * step - 2.0 * first - second)
    return passed[k] + w * (first + w * cubic)


@njit(cache=True)
def _pull(forces, times, states, out):
    for k in range(times.size):
        s = states[k]
        field = at(forces, times[k])
        out[k, 0], out[k, 1], out[k, 2] = acceleration(field, s[0], s[1], s[2], s[3], s[4], s[5])


def flow(forces: EphemerisForces, times: ArrayLike, states: ArrayLike) -> Array:
    """Time derivatives (n, 6) of states (n, 6) under a force model, all nondimensional, barycentric
    frame, J2000 axes."""
    states = np.ascontiguousarray(states, dtype=float)
    pulled = np.empty((len(states), 3))
    _pull(forces, np.ascontiguousarray(times, dtype=float), states, pulled)
    return np.concatenate([states[:, 3:], pulled], axis=1)


def tracking_cost(forces: EphemerisForces, state: ArrayLike, period: float, days: float) -> float:
    """Velocity change for reference tracking of a CR3BP orbit by continuous thrust, m/s.

    It is the integral of the difference between the acceleration along `reference_states` and that
    of the force model over a number of days. For the arguments see
    `cislunar.orbits.ephemeris_refined.refinement.refined_path`."""
    h = 600.0
    times = np.arange(0.0, days * SECONDS_PER_DAY + 0.5 * h, h)
    path = reference_states(forces.table, forces.epoch, state, period, times)
    position = path[:, :3] * LENGTH_UNIT_KM
    # fourth-order differences, accurate to some 1e-9 m/s^2
    required = (
        -position[4:]
        + 16.0 * position[3:-1]
        - 30.0 * position[2:-2]
        + 16.0 * position[1:-3]
        - position[:-4]
    )
    required /= 12.0 * h**2
    pulled = flow(forces, times[2:-2] / TIME_UNIT_S, path[2:-2])[:, 3:]
    thrust = np.linalg.norm(required - pulled * LENGTH_UNIT_KM / TIME_UNIT_S**2, axis=1)
    return float(1e3 * np.trapezoid(thrust, dx=h))
