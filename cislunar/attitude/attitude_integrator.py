"""Fixed-step integrator of rigid-body rotation (compiled).

A step advances the angular velocity by the classical fourth-order Runge-Kutta method and the
attitude by the exponential of the Magnus series of the same order (Iserles & Norsett 1999)::

    q -> exp(Omega) (x) q,
    Omega = h (omega_0 + omega_1) / 2 + h^2 (a_0 - a_1 + omega_0 x omega_1) / 12,

where omega and a are the angular velocity and acceleration at the ends of the step. The step is
exact for constant angular velocity. Any consistent units of inertia and time may be used. The
argument `body` is a tuple of the inertia, its inverse, and the angular acceleration (3,) due to a
torque that is constant in the body frame.
"""

import numpy as np

from cislunar.attitude.quaternion import SMALL_ANGLE, multiply_components
from cislunar.attitude.rigid_body import angular_acceleration
from cislunar.compiled import njit_inline, njit_noalloc
from cislunar.elementary import sine_and_cosine

TURN_PER_STEP = 0.03
"""Largest rotation angle of a step over the time between two measurements, rad."""

TURN_OF_LONG_STEP = 0.15
"""Largest rotation angle of a step over hours, rad. After 20 rad, attitudes err by less than 1e-5
rad for moments that differ by 20 %."""


@njit_inline
def acceleration(omega, body):
    """Angular acceleration at an angular velocity, as three scalars."""
    ax, ay, az = angular_acceleration(omega[0], omega[1], omega[2], body[0], body[1])
    return ax + body[2][0], ay + body[2][1], az + body[2][2]


@njit_inline
def _along(v, h, k):
    """Vector v + h k of three scalars."""
    return v[0] + h * k[0], v[1] + h * k[1], v[2] + h * k[2]


@njit_noalloc
def rate_after(omega, a, h, body):
    """Angular velocity after a step; `a` is the acceleration before it."""
    a2 = acceleration(_along(omega, 0.5 * h, a), body)
    a3 = acceleration(_along(omega, 0.5 * h, a2), body)
    a4 = acceleration(_along(omega, h, a3), body)
    return _along(_along(_along(_along(omega, h / 6.0, a), h / 3.0, a2), h / 3.0, a3), h / 6.0, a4)


@njit_noalloc
def turned(q, h, first, last):
    """Attitude after a step, given (angular velocity, acceleration) at its two ends."""
    w, a = first
    v, b = last
    half, twelfth = 0.5 * h, h * h / 12.0
    x = half * (w[0] + v[0]) + twelfth * (a[0] - b[0] + (w[1] * v[2] - w[2] * v[1]))
    y = half * (w[1] + v[1]) + twelfth * (a[1] - b[1] + (w[2] * v[0] - w[0] * v[2]))
    z = half * (w[2] + v[2]) + twelfth * (a[2] - b[2] + (w[0] * v[1] - w[1] * v[0]))
    angle2 = x * x + y * y + z * z
    if angle2 < SMALL_ANGLE * SMALL_ANGLE:
        scale, cosine = 0.5 - angle2 / 48.0, 1.0 - angle2 / 8.0
    else:
        angle = np.sqrt(angle2)
        sine, cosine = sine_and_cosine(0.5 * angle)
        scale = sine / angle
    return multiply_components(scale * x, scale * y, scale * z, cosine, q[0], q[1], q[2], q[3])


_TORQUE_FREE = (0.0, 0.0, 0.0)


@njit_noalloc
def _carried(q, w, dt, body, turn_per_step):
    """Attitude and angular velocity after a time, in steps that rotate by at most an angle."""
    rate = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    count = max(1, int(np.ceil(rate * abs(dt) / turn_per_step)))
    h, a = dt / count, acceleration(w, body)
    for _ in range(count):
        v = rate_after(w, a, h, body)
        b = acceleration(v, body)
        q = turned(q, h, (w, a), (v, b))
        w, a = v, b
    return q, w


@njit_noalloc
def torque_free_step(w1, w2, w3, inertia, inverse_inertia, dt):
    """Rotation (unit quaternion) and angular velocity of a torque-free body after a time, as
    scalars. The attitude becomes ``rotation (x) q``. The rotation does not depend on q, so an
    unscented filter computes it once for all sigma points with the same angular velocity."""
    body = inertia, inverse_inertia, _TORQUE_FREE
    q, w = _carried((0.0, 0.0, 0.0, 1.0), (w1, w2, w3), dt, body, TURN_PER_STEP)
    return q[0], q[1], q[2], q[3], w[0], w[1], w[2]


@njit_noalloc
def carry_rotation(quaternion, omega, dt, body, turn_per_step=TURN_PER_STEP):
    """Advance attitude (4,) and angular velocity (3,) by a time, in place, in steps that rotate by
    at most an angle."""
    q = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    q, w = _carried(q, (omega[0], omega[1], omega[2]), dt, body, turn_per_step)
    quaternion[0], quaternion[1], quaternion[2], quaternion[3] = q
    omega[0], omega[1], omega[2] = w
