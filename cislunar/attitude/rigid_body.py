"""Rotation of rigid bodies, torque-free (Paul & Fan, section 5.2) or under a constant torque.

Attitude and angular velocity obey ``dq/dt = [omega; 0] (x) q / 2`` and Euler's equations
``I domega/dt = T - omega x (I omega)`` in the body frame. A torque-free body of spherical inertia
has a constant angular velocity and an attitude in closed form (`propagate_spherical`). Any other
motion is integrated numerically (`propagate_attitudes`); estimators use the fixed steps of
`cislunar.attitude.attitude_integrator`. Angles are in rad, times in any unit.
"""

import numpy as np

from cislunar.attitude.quaternion import (
    SMALL_ANGLE,
    multiply_components,
    rotate_components,
    rotation_vector_components,
)
from cislunar.compiled import njit, njit_alloc, njit_inline, njit_noalloc
from cislunar.dynamics.tableau import A8, ERROR8_3, ERROR8_5, STAGES8


@njit_alloc
def propagate_spherical(q, omega, dt):
    """Attitude ``dq(omega dt) (x) q`` of a torque-free body of spherical inertia after a time
    (compiled). The result is exact; omega is in rad per unit of time, body frame."""
    t1, t2, t3, t4 = rotation_vector_components(omega[0] * dt, omega[1] * dt, omega[2] * dt)
    r = np.empty(4)
    r[0], r[1], r[2], r[3] = multiply_components(t1, t2, t3, t4, q[0], q[1], q[2], q[3])
    return r


@njit_noalloc
def pull_back_gradient(omega, dt, gx, gy, gz):
    """Gradient over the initial attitude and rate from one over small rotations at dt (compiled).
    For a body of spherical inertia the result is ``(A(dq)^T g, dt J^T g)``, as six scalars. A small
    rotation e0 of the initial attitude and a change of omega cause the small rotation
    ``e(dt) = A(dq) e0 + dt J domega``, where dq is the quaternion of ``phi = omega dt`` and
    ``J = I - (1 - cos|phi|)/|phi|^2 [phi x] + (|phi| - sin|phi|)/|phi|^3 [phi x]^2``."""
    x, y, z = omega[0] * dt, omega[1] * dt, omega[2] * dt
    q1, q2, q3, q4 = rotation_vector_components(x, y, z)
    e1, e2, e3 = rotate_components(-q1, -q2, -q3, q4, gx, gy, gz)
    angle2 = x * x + y * y + z * z
    if angle2 < SMALL_ANGLE * SMALL_ANGLE:
        first, second = 0.5 - angle2 / 24.0, 1.0 / 6.0
    else:
        angle = np.sqrt(angle2)
        first = 2.0 * np.sin(0.5 * angle) ** 2 / angle2
        second = (angle - np.sin(angle)) / (angle2 * angle)
    cx, cy, cz = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
    w1 = dt * (gx + first * cx + second * (y * cz - z * cy))
    w2 = dt * (gy + first * cy + second * (z * cx - x * cz))
    w3 = dt * (gz + first * cz + second * (x * cy - y * cx))
    return e1, e2, e3, w1, w2, w3


@njit_noalloc
def spherical_transition(omega, dt, out):
    """Exact transition matrix of (small rotation, angular velocity) for spherical inertia
    (compiled). Written into `out`, shape (6, 6); see
    `cislunar.attitude.parameter_deviations.parameter_transition`."""
    out[:, :] = 0.0
    for i in range(3):
        a1, a2, a3, b1, b2, b3 = pull_back_gradient(
            omega, dt, 1.0 * (i == 0), 1.0 * (i == 1), 1.0 * (i == 2)
        )
        out[i, 0], out[i, 1], out[i, 2] = a1, a2, a3
        out[i, 3], out[i, 4], out[i, 5] = b1, b2, b3
        out[3 + i, 3 + i] = 1.0


@njit_inline
def matrix_times(matrix, x, y, z):
    """Product of a (3, 3) matrix and a vector, as three scalars."""
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
    )


@njit_inline
def angular_acceleration(x, y, z, inertia, inverse_inertia):
    """Angular acceleration of a torque-free body, as three scalars."""
    hx, hy, hz = matrix_times(inertia, x, y, z)
    return matrix_times(inverse_inertia, hy * z - hz * y, hz * x - hx * z, hx * y - hy * x)


@njit_noalloc
def _derivative(y, inertia, inverse_inertia, forced, dy):
    """Write the time derivative of ``y = (q, omega)`` into `dy`; `forced` is due to the torque."""
    x, v, z = y[4], y[5], y[6]
    dy[0], dy[1], dy[2], dy[3] = multiply_components(
        0.5 * x, 0.5 * v, 0.5 * z, 0.0, y[0], y[1], y[2], y[3]
    )
    ax, ay, az = angular_acceleration(x, v, z, inertia, inverse_inertia)
    dy[4], dy[5], dy[6] = ax + forced[0], ay + forced[1], az + forced[2]


@njit_noalloc
def _try_step(y, h, inertia, inverse_inertia, forced, slopes, y_new, tolerance):
    """Attempt one DOP853 step into `y_new`; the returned error norm is acceptable below 1."""
    for stage in range(1, STAGES8 + 1):
        for i in range(7):
            change = 0.0
            for j in range(stage):
                change += A8[stage, j] * slopes[j, i]
            y_new[i] = y[i] + h * change
        if stage < STAGES8:
            _derivative(y_new, inertia, inverse_inertia, forced, slopes[stage])
    total3, total5 = 0.0, 0.0
    for i in range(7):
        e3, e5 = 0.0, 0.0
        for j in range(STAGES8):
            e3 += ERROR8_3[j] * slopes[j, i]
            e5 += ERROR8_5[j] * slopes[j, i]
        total3 += (e3 / tolerance) ** 2
        total5 += (e5 / tolerance) ** 2
    if total5 == 0.0:
        return 0.0
    return abs(h) * total5 / np.sqrt((total5 + 0.01 * total3) * 7.0)


@njit(cache=True, error_model="numpy")
def propagate_kernel(
    q, omega, inertia, inverse_inertia, dt, tolerance, q_out, omega_out, ax=0.0, ay=0.0, az=0.0
):
    """Attitude and angular velocity of a rigid body after a time, by adaptive DOP853 (compiled).
    The equations are scaled by the initial rate, or by the rate that the torque causes within a
    radian if that is greater. One tolerance (error per step of q, and of omega relative to its
    initial length) therefore suits slow and fast bodies. `q_out` and `omega_out` receive the result
    and may be `q` and `omega` themselves. The angular acceleration ax, ay, az is I^-1 T of a torque
    that is constant in the body frame."""
    rate = np.sqrt(omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2)
    rate = max(rate, np.sqrt(np.sqrt(ax * ax + ay * ay + az * az)))
    square = rate * rate if rate > 0.0 else 1.0
    forced = (ax / square, ay / square, az / square)
    y = np.empty(7)
    for i in range(4):
        y[i] = q[i]
    for i in range(3):
        y[4 + i] = omega[i] / rate if rate > 0.0 else 0.0
    y_new = np.empty(7)
    slopes = np.empty((STAGES8, 7))
    left = dt * rate  # remaining time, in units of 1 / rate
    h = min(1.0, abs(left))
    while h > 0.0:
        step = h if left > 0.0 else -h
        _derivative(y, inertia, inverse_inertia, forced, slopes[0])
        error = _try_step(y, step, inertia, inverse_inertia, forced, slopes, y_new, tolerance)
        if error < 1.0:
            left = 0.0 if abs(step) >= abs(left) else left - step
            norm = np.sqrt(y_new[0] ** 2 + y_new[1] ** 2 + y_new[2] ** 2 + y_new[3] ** 2)
            for i in range(7):
                y[i] = y_new[i] / norm if i < 4 else y_new[i]
        h = min(abs(left), h * min(5.0, max(0.2, 0.9 * max(error, 1e-12) ** -0.125)))
    for i in range(4):
        q_out[i] = y[i]
    for i in range(3):
        omega_out[i] = y[4 + i] * rate if rate > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def propagate_attitudes(elapsed_s, bodies, forced, tolerance, attitude, rate, quaternion, omega):
    """Attitudes (body, time, 4) and angular velocities (body, time, 3) of many bodies (compiled).

    `bodies` is a `RigidBodies`, `forced` (body, 3) their angular accelerations, rad/s^2. A
    torque-free spherical body is propagated in closed form from `attitude` (body, 4) and `rate`
    (body, 3) at the epoch. Any other body is integrated from its state at the first time (or at the
    epoch, if the first time is zero), and `attitude` and `rate` are overwritten by its state at the
    last time."""
    for j in range(attitude.shape[0]):
        if bodies.spherical[j] and not np.any(forced[j]):
            for i in range(elapsed_s.size):
                quaternion[j, i] = propagate_spherical(attitude[j], rate[j], elapsed_s[i])
                omega[j, i] = rate[j]
            continue
        now = elapsed_s[0]
        for i in range(elapsed_s.size):
            if i > 0 or now == 0.0:  # consecutive intervals share an end
                propagate_kernel(
                    attitude[j], rate[j], bodies.inertia[j], bodies.inverse[j], elapsed_s[i] - now,
                    tolerance, attitude[j], rate[j], forced[j, 0], forced[j, 1], forced[j, 2],
                )  # fmt: skip
            now = elapsed_s[i]
            quaternion[j, i] = attitude[j]
            omega[j, i] = rate[j]
