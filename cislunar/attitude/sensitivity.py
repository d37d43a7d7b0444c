"""Torque-free rotation of a rigid body together with its derivative by the initial rate.

A small turn e of the attitude (body frame) and a small change w of the angular velocity obey

    de/dt = -omega x e + w,    I dw/dt = (I w) x omega + (I omega) x w

along the motion. The attitude at the start does not act on omega, so the derivative of e by a
turn e0 at the start is the rotation matrix from then to now and needs no integration; those of e
and w by the initial angular velocity are carried along. Fixed Runge-Kutta steps of fourth order,
short enough against the rate that a day of a slow tumble is good to 1e-6 rad.
"""

import numpy as np
from numba import njit

LARGEST_TURN = 0.05
"""Turn within one Runge-Kutta step, rad."""


@njit(cache=True, error_model="numpy")
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy")
def _matvec(matrix, x, out):
    for i in range(3):
        out[i] = matrix[i, 0] * x[0] + matrix[i, 1] * x[1] + matrix[i, 2] * x[2]


@njit(cache=True, error_model="numpy")
def _slope(y, inertia, inverse_inertia, columns, work, dy):
    """Time derivative of q, omega and `columns` columns of (e, w), packed in y (compiled)."""
    q, omega = y[:4], y[4:7]
    dy[0] = 0.5 * (omega[0] * q[3] + omega[2] * q[1] - omega[1] * q[2])
    dy[1] = 0.5 * (omega[1] * q[3] + omega[0] * q[2] - omega[2] * q[0])
    dy[2] = 0.5 * (omega[2] * q[3] + omega[1] * q[0] - omega[0] * q[1])
    dy[3] = -0.5 * (omega[0] * q[0] + omega[1] * q[1] + omega[2] * q[2])
    momentum, torque, extra = work[0], work[1], work[2]
    _matvec(inertia, omega, momentum)
    _cross(momentum, omega, torque)
    _matvec(inverse_inertia, torque, dy[4:7])
    for column in range(columns):
        e = y[7 + 6 * column : 10 + 6 * column]
        w = y[10 + 6 * column : 13 + 6 * column]
        de = dy[7 + 6 * column : 10 + 6 * column]
        _cross(e, omega, de)
        for i in range(3):
            de[i] += w[i]
        _matvec(inertia, w, extra)
        _cross(extra, omega, torque)
        _cross(momentum, w, extra)
        for i in range(3):
            torque[i] += extra[i]
        _matvec(inverse_inertia, torque, dy[10 + 6 * column : 13 + 6 * column])


@njit(cache=True, error_model="numpy")
def propagate_with_sensitivity(
    quaternion, omega, sensitivity, dt, inertia, inverse_inertia, with_sensitivity
):
    """Carry attitude, rate and their derivatives by the initial rate over a time, in place.

    Compiled.

    Parameters
    ----------
    quaternion, omega : ndarray, shapes (4,) and (3,)
        Unit quaternion, inertial to body, and angular velocity (rad per unit of time, body
        frame); updated.
    sensitivity : ndarray, shape (6, 3)
        Derivatives by the initial angular velocity of the small turn of the attitude (rows 0 .. 2)
        and of the angular velocity (rows 3 .. 5); updated. Zero and the identity at the start.
    dt : float
        Time, not negative.
    inertia, inverse_inertia : ndarray, shape (3, 3)
        Any unit.
    with_sensitivity : bool
        False leaves `sensitivity` alone and saves its cost.
    """
    if dt == 0.0:
        return
    columns = 3 if with_sensitivity else 0
    size = 7 + 6 * columns
    y, start, total = np.empty(size), np.empty(size), np.empty(size)
    slope, work = np.empty(size), np.empty((3, 3))
    y[:4], y[4:7] = quaternion, omega
    for column in range(columns):
        y[7 + 6 * column : 13 + 6 * column] = sensitivity[:, column]
    rate = np.sqrt(omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2)
    steps = max(1, int(np.ceil(rate * dt / LARGEST_TURN)))
    h = dt / steps
    for _ in range(steps):
        start[:] = y
        _slope(y, inertia, inverse_inertia, columns, work, slope)
        total[:] = slope
        for stage in range(3):
            y[:] = start + (h if stage == 2 else 0.5 * h) * slope
            _slope(y, inertia, inverse_inertia, columns, work, slope)
            total += (1.0 if stage == 2 else 2.0) * slope
        y[:] = start + (h / 6.0) * total
        y[:4] /= np.sqrt(y[0] ** 2 + y[1] ** 2 + y[2] ** 2 + y[3] ** 2)
    quaternion[:], omega[:] = y[:4], y[4:7]
    for column in range(columns):
        sensitivity[:, column] = y[7 + 6 * column : 13 + 6 * column]
