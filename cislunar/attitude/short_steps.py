"""Short steps of a rigid body and how errors of attitude and rate grow over them.

A small turn e of the attitude and a change w of the angular velocity omega (both body frame) obey

    de/dt = -omega x e + w,    I dw/dt = (I w) x omega + (I omega) x w

along the motion. One Runge-Kutta step of fourth order serves all: the motion gives the angular
velocities at the four stages, and the equations of the errors, which are linear, are integrated
with them. Compiled; inertia in any unit, times in any. A torque constant in the body frame may add
an angular acceleration `forced` (3,) to the motion; it drops out of the equations of the errors.
"""

import numpy as np
from numba import njit

from cislunar.attitude.rigid_body import angular_acceleration, matrix_times

TURN_PER_STEP = 0.03
"""Largest turn of a step of `torque_free_step`, rad; the error is then below 1e-9 rad a step."""

TURN_WITH_ERRORS = 0.05
"""Largest turn of a step that carries errors along, rad: 0.05^5 / 120 = 3e-9 rad a step."""


@njit(cache=True, error_model="numpy")
def slope(y, inertia, inverse_inertia, forced):
    """Time derivative of attitude and angular velocity, packed in seven numbers."""
    q1, q2, q3, q4, x, v, z = y
    ax, ay, az = angular_acceleration(x, v, z, inertia, inverse_inertia)
    return (
        0.5 * (x * q4 + z * q2 - v * q3),
        0.5 * (v * q4 + x * q3 - z * q1),
        0.5 * (z * q4 + v * q1 - x * q2),
        -0.5 * (x * q1 + v * q2 + z * q3),
        ax + forced[0],
        ay + forced[1],
        az + forced[2],
    )


@njit(cache=True, error_model="numpy")
def _along(y, h, k):
    """y + h k of seven numbers."""
    return (
        y[0] + h * k[0],
        y[1] + h * k[1],
        y[2] + h * k[2],
        y[3] + h * k[3],
        y[4] + h * k[4],
        y[5] + h * k[5],
        y[6] + h * k[6],
    )


@njit(cache=True, error_model="numpy")
def rigid_step(y, h, inertia, inverse_inertia, forced):
    """Attitude and angular velocity after a step, and at its four stages."""
    k1 = slope(y, inertia, inverse_inertia, forced)
    second = _along(y, 0.5 * h, k1)
    k2 = slope(second, inertia, inverse_inertia, forced)
    third = _along(y, 0.5 * h, k2)
    k3 = slope(third, inertia, inverse_inertia, forced)
    fourth = _along(y, h, k3)
    k4 = slope(fourth, inertia, inverse_inertia, forced)
    total = _along(_along(_along(k1, 2.0, k2), 2.0, k3), 1.0, k4)
    q1, q2, q3, q4, w1, w2, w3 = _along(y, h / 6.0, total)
    norm = np.sqrt(q1 * q1 + q2 * q2 + q3 * q3 + q4 * q4)
    return (q1 / norm, q2 / norm, q3 / norm, q4 / norm, w1, w2, w3), (y, second, third, fourth)


@njit(cache=True, error_model="numpy")
def _steps(w1, w2, w3, dt, largest_turn):
    """Number of steps that turn by at most an angle, at least one."""
    rate = np.sqrt(w1 * w1 + w2 * w2 + w3 * w3)
    return max(1, int(np.ceil(rate * abs(dt) / largest_turn)))


@njit(cache=True, error_model="numpy")
def _error_slope(e, y, inertia, inverse_inertia):
    """Time derivative of one error (e, w), packed in six numbers, at a stage of the motion."""
    e1, e2, e3, w1, w2, w3 = e
    x, v, z = y[4], y[5], y[6]
    hx, hy, hz = matrix_times(inertia, x, v, z)
    gx, gy, gz = matrix_times(inertia, w1, w2, w3)
    ax, ay, az = matrix_times(
        inverse_inertia,
        gy * z - gz * v + (hy * w3 - hz * w2),
        gz * x - gx * z + (hz * w1 - hx * w3),
        gx * v - gy * x + (hx * w2 - hy * w1),
    )
    return e2 * z - e3 * v + w1, e3 * x - e1 * z + w2, e1 * v - e2 * x + w3, ax, ay, az


@njit(cache=True, error_model="numpy")
def _error_along(e, h, k):
    """e + h k of six numbers."""
    return (
        e[0] + h * k[0],
        e[1] + h * k[1],
        e[2] + h * k[2],
        e[3] + h * k[3],
        e[4] + h * k[4],
        e[5] + h * k[5],
    )


@njit(cache=True, error_model="numpy")
def _carry_error(e, h, stages, inertia, inverse_inertia):
    """One error after a step whose motion has passed through the four stages."""
    k1 = _error_slope(e, stages[0], inertia, inverse_inertia)
    k2 = _error_slope(_error_along(e, 0.5 * h, k1), stages[1], inertia, inverse_inertia)
    k3 = _error_slope(_error_along(e, 0.5 * h, k2), stages[2], inertia, inverse_inertia)
    k4 = _error_slope(_error_along(e, h, k3), stages[3], inertia, inverse_inertia)
    total = _error_along(_error_along(_error_along(k1, 2.0, k2), 2.0, k3), 1.0, k4)
    return _error_along(e, h / 6.0, total)


_TORQUE_FREE = (0.0, 0.0, 0.0)


@njit(cache=True, error_model="numpy")
def torque_free_step(w1, w2, w3, inertia, inverse_inertia, dt):
    """Turn (unit quaternion) and rate of a torque-free body after a short time, in seven numbers.

    The attitude becomes ``turn (x) q``. The turn does not depend on it, so a filter that spreads
    attitude and rate needs it once for each rate. No step turns by more than `TURN_PER_STEP`.
    """
    count = _steps(w1, w2, w3, dt, TURN_PER_STEP)
    y = (0.0, 0.0, 0.0, 1.0, w1, w2, w3)
    for _ in range(count):
        y = rigid_step(y, dt / count, inertia, inverse_inertia, _TORQUE_FREE)[0]
    return y


@njit(cache=True, error_model="numpy")
def propagate_with_errors(quaternion, omega, errors, dt, inertia, inverse_inertia, forced):
    """Carry attitude, rate and columns of their small errors over a time, in place (compiled).

    Errors, shape (6, n), are small turns (rows 0 .. 2) and changes of the angular velocity, body
    frame; n may be zero. Zero above the identity become the derivatives by the initial rate.
    """
    if dt == 0.0:
        return
    q, w, e = quaternion, omega, errors
    count = _steps(w[0], w[1], w[2], dt, TURN_WITH_ERRORS)
    h = dt / count
    y = (q[0], q[1], q[2], q[3], w[0], w[1], w[2])
    given = (forced[0], forced[1], forced[2])
    for _ in range(count):
        y, stages = rigid_step(y, h, inertia, inverse_inertia, given)
        for c in range(e.shape[1]):
            e[0, c], e[1, c], e[2, c], e[3, c], e[4, c], e[5, c] = _carry_error(
                (e[0, c], e[1, c], e[2, c], e[3, c], e[4, c], e[5, c]),
                h,
                stages,
                inertia,
                inverse_inertia,
            )
    q[0], q[1], q[2], q[3], w[0], w[1], w[2] = y


@njit(cache=True, error_model="numpy")
def rigid_transition(omega, dt, inertia, inverse_inertia, out):
    """Transition matrix [[A, B], [0, C]] of (small turn, angular velocity) over a step (compiled).

    Into `out`, shape (6, 6); A is the turn of the body over the step.
    """
    turn = np.array([0.0, 0.0, 0.0, 1.0])
    out[:, :] = np.eye(6)
    propagate_with_errors(turn, omega.copy(), out, dt, inertia, inverse_inertia, np.zeros(3))
