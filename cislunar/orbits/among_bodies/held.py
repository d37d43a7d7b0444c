"""Orbits of the CR3BP held among the bodies by the instantaneous frame, and what that takes.

Assumptions and limitations
---------------------------
- What navigation and station keeping add is not counted.
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_simpson

from cislunar.constants import LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics.ephemeris import UNITS
from cislunar.dynamics.ephemeris_forces import Ephemeris
from cislunar.dynamics.forces import acceleration, at
from cislunar.dynamics.framed_cr3bp import is_low_lunar
from cislunar.dynamics.frames import lunar_frame, pulsating_frame, to_inertial
from cislunar.dynamics.propagation import propagate, propagate_periodic
from cislunar.ephemeris.bodies import BodyTable

Array = NDArray[np.float64]

CLOCK_STEP_S = 600.0
"""Between the times at which the rate of the frame's clock is evaluated."""


def reference_states(
    table: BodyTable,
    epoch: float,
    state: ArrayLike,
    period: float,
    time: ArrayLike,
    *,
    ahead: float = 0.0,
) -> Array:
    """States of an orbit of the CR3BP among the bodies, held by the instantaneous frame.

    Parameters
    ----------
    table : BodyTable
        Places of the bodies.
    epoch : float
        TDB seconds past J2000 at which the orbit is at `state`.
    state : array_like, shape (6,)
        Nondimensional, rotating frame.
    period : float
        Nondimensional; 0 for a path that is not closed.
    time : array_like, shape (m,)
        Since the epoch, s, not negative.
    ahead : float
        Fraction of the period by which the satellite is ahead.

    Returns
    -------
    ndarray, shape (m, 6)
        About the Earth-Moon barycenter, axes of J2000, nondimensional. The time in the orbit is
        that passed in the units of the frame; an orbit low about the Moon has the rigid one.

    Raises
    ------
    ConfigurationError
        If the table does not cover the times.
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
    """Time since an epoch in the units of the pulsating frame.

    Parameters
    ----------
    table : BodyTable
        Places of the bodies.
    epoch : float
        TDB seconds past J2000.
    time : array_like, shape (m,)
        Since the epoch, s, not negative.

    Returns
    -------
    ndarray, shape (m,)
        The integral of dt / T, nondimensional.

    Raises
    ------
    ConfigurationError
        If the table does not cover the times.
    """
    times = np.asarray(time, dtype=float)
    last = max(float(times.max(initial=0.0)), CLOCK_STEP_S)
    nodes = np.linspace(0.0, last, int(np.ceil(last / CLOCK_STEP_S)) + 2)
    rate = 1.0 / pulsating_frame(table, epoch + nodes).time
    passed = cumulative_simpson(rate, x=nodes, initial=0.0)
    # a cubic between nodes, of which values and slopes are known
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


def flow(forces: Ephemeris, times: ArrayLike, states: ArrayLike) -> Array:
    """Derivatives of states by time under forces.

    Parameters
    ----------
    forces : Ephemeris
        The force model.
    times : array_like, shape (n,)
        Since its epoch, nondimensional.
    states : array_like, shape (n, 6)
        About the Earth-Moon barycenter, axes of J2000, nondimensional.

    Returns
    -------
    ndarray, shape (n, 6)
        Nondimensional.
    """
    states = np.ascontiguousarray(states, dtype=float)
    pulled = np.empty((len(states), 3))
    _pull(forces, np.ascontiguousarray(times, dtype=float), states, pulled)
    return np.concatenate([states[:, 3:], pulled], axis=1)


def holding_cost(forces: Ephemeris, state: ArrayLike, period: float, days: float) -> float:
    """Velocity change that holding an orbit of the CR3BP by thrust would take, m/s.

    Parameters
    ----------
    forces, state, period, days
        As of `refined_path`.

    Returns
    -------
    float
        The integral of how much the acceleration along `reference_states` differs from that of
        the forces.
    """
    h = 600.0
    times = np.arange(0.0, days * SECONDS_PER_DAY + 0.5 * h, h)
    path = reference_states(forces.table, forces.epoch, state, period, times)
    place = path[:, :3] * LENGTH_UNIT_KM
    # fourth-order differences, good to some 1e-9 m/s^2
    wanted = -place[4:] + 16.0 * place[3:-1] - 30.0 * place[2:-2] + 16.0 * place[1:-3] - place[:-4]
    wanted /= 12.0 * h**2
    pulled = flow(forces, times[2:-2] / TIME_UNIT_S, path[2:-2])[:, 3:]
    thrust = np.linalg.norm(wanted - pulled * LENGTH_UNIT_KM / TIME_UNIT_S**2, axis=1)
    return float(1e3 * np.trapezoid(thrust, dx=h))
