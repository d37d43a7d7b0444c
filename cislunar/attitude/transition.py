"""How small errors of attitude and angular velocity grow over a step (compiled).

The error of a torque-free rigid body is a small turn e of its attitude and a change w of its
angular velocity omega, both in the body frame. To first order

    de/dt = -omega x e + w,    I dw/dt = (I w) x omega + (I omega) x w.

The transition matrix of (e, w) over a step is

    [A  B]
    [0  C]

with A the turn of the body over the step. For a body of spherical inertia C is the identity and all
is known in closed form; any other is integrated.
"""

import numpy as np
from numba import njit

from cislunar.attitude.rigid_body import pull_back_gradient

LARGEST_TURN = 0.05
"""Angle of a Runge-Kutta step, rad: its error is of the order of 0.05^5 / 120 = 3e-9."""


@njit(cache=True, error_model="numpy")
def spherical_transition(omega, dt, out):
    """Transition matrix of a body of spherical inertia, exact (compiled).

    Parameters
    ----------
    omega : ndarray, shape (3,)
        Angular velocity, rad per unit of time, body frame.
    dt : float
        Step.
    out : ndarray, shape (6, 6)
        Receives the transition matrix of (small turn, angular velocity).
    """
    out[:, :] = 0.0
    for i in range(3):
        a1, a2, a3, b1, b2, b3 = pull_back_gradient(
            omega, dt, 1.0 * (i == 0), 1.0 * (i == 1), 1.0 * (i == 2)
        )
        out[i, 0], out[i, 1], out[i, 2] = a1, a2, a3
        out[i, 3], out[i, 4], out[i, 5] = b1, b2, b3
        out[3 + i, 3 + i] = 1.0


@njit(cache=True, error_model="numpy")
def _product(matrix, x, y, z):
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
    )


@njit(cache=True, error_model="numpy")
def _slopes(omega, errors, inertia, inverse_inertia, omega_slope, slope):
    """Time derivative of the angular velocity and of six columns of errors."""
    x, y, z = omega[0], omega[1], omega[2]
    hx, hy, hz = _product(inertia, x, y, z)
    tx, ty, tz = _product(inverse_inertia, hy * z - hz * y, hz * x - hx * z, hx * y - hy * x)
    omega_slope[0], omega_slope[1], omega_slope[2] = tx, ty, tz
    for c in range(6):
        e1, e2, e3 = errors[0, c], errors[1, c], errors[2, c]
        w1, w2, w3 = errors[3, c], errors[4, c], errors[5, c]
        slope[0, c] = w1 - (y * e3 - z * e2)
        slope[1, c] = w2 - (z * e1 - x * e3)
        slope[2, c] = w3 - (x * e2 - y * e1)
        g1, g2, g3 = _product(inertia, w1, w2, w3)
        tx, ty, tz = _product(
            inverse_inertia,
            g2 * z - g3 * y + hy * w3 - hz * w2,
            g3 * x - g1 * z + hz * w1 - hx * w3,
            g1 * y - g2 * x + hx * w2 - hy * w1,
        )
        slope[3, c], slope[4, c], slope[5, c] = tx, ty, tz


@njit(cache=True, error_model="numpy")
def rigid_transition(omega, dt, inertia, inverse_inertia, out):
    """Transition matrix of any rigid body, by Runge-Kutta steps of fourth order (compiled).

    Parameters
    ----------
    omega : ndarray, shape (3,)
        Angular velocity at the start of the step, rad per unit of time, body frame.
    dt : float
        Step.
    inertia, inverse_inertia : ndarray, shape (3, 3)
        Inertia matrix in any unit, body frame, and its inverse.
    out : ndarray, shape (6, 6)
        Receives the transition matrix of (small turn, angular velocity).

    Notes
    -----
    The step is divided so that the body turns by at most `LARGEST_TURN` in each part.
    """
    rate = np.sqrt(omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2)
    parts = max(1, int(np.ceil(rate * abs(dt) / LARGEST_TURN)))
    h = dt / parts
    now, trial = omega.copy(), np.empty(3)
    slope, total = np.empty(3), np.empty(3)
    errors, errors_trial = np.zeros((6, 6)), np.empty((6, 6))
    errors_slope, errors_total = np.empty((6, 6)), np.empty((6, 6))
    for i in range(6):
        errors[i, i] = 1.0
    for _ in range(parts):
        trial[:] = now
        errors_trial[:, :] = errors
        total[:] = 0.0
        errors_total[:, :] = 0.0
        for stage in range(4):
            _slopes(trial, errors_trial, inertia, inverse_inertia, slope, errors_slope)
            weight = h / 3.0 if stage == 1 or stage == 2 else h / 6.0
            ahead = h if stage == 2 else 0.5 * h
            for i in range(3):
                total[i] += weight * slope[i]
                trial[i] = now[i] + ahead * slope[i]
            for i in range(6):
                for c in range(6):
                    errors_total[i, c] += weight * errors_slope[i, c]
                    errors_trial[i, c] = errors[i, c] + ahead * errors_slope[i, c]
        for i in range(3):
            now[i] += total[i]
        for i in range(6):
            for c in range(6):
                errors[i, c] += errors_total[i, c]
    out[:, :] = errors
