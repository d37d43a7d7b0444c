"""Rotation of rigid bodies, torque-free (Paul & Fan, section 5.2) or under a constant torque.

Attitude and angular velocity obey ``dq/dt = [omega; 0] (x) q / 2`` and Euler's equations
``I domega/dt = T - omega x (I omega)``, both in the body frame. Without torque T a body of
spherical inertia keeps its angular velocity, so that its attitude is known in closed form
(`propagate_spherical`); any other motion is integrated numerically (`propagate_torque_free`,
`propagate_under_torque`; `torque_free_step` for the short steps of a filter). Angles are in rad,
times in any unit.
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import DOP853

from cislunar.attitude.inertia import inertia_matrix, is_spherical
from cislunar.attitude.quaternion import (
    SMALL_ANGLE,
    multiply_components,
    normalize,
    rotate_components,
    rotation_vector_components,
)
from cislunar.errors import ConfigurationError

Array = NDArray[np.float64]

_A = np.zeros((13, 12))
_A[:12] = DOP853.A
_A[12] = DOP853.B
_E3 = np.ascontiguousarray(DOP853.E3[:12])
_E5 = np.ascontiguousarray(DOP853.E5[:12])


@njit(cache=True)
def propagate_spherical(q, omega, dt):
    """Attitude of a body of spherical inertia after a time (compiled, exact).

    Without torque its angular velocity is constant, so the turn is the rotation by omega dt.

    Parameters
    ----------
    q : ndarray, shape (4,)
        Unit quaternion, inertial to body.
    omega : ndarray, shape (3,)
        Angular velocity, rad per unit of time, body frame.
    dt : float
        Elapsed time, same unit of time; may be negative.

    Returns
    -------
    ndarray, shape (4,)
        Unit quaternion ``dq(omega dt) (x) q``.
    """
    t1, t2, t3, t4 = rotation_vector_components(omega[0] * dt, omega[1] * dt, omega[2] * dt)
    r = np.empty(4)
    r[0], r[1], r[2], r[3] = multiply_components(t1, t2, t3, t4, q[0], q[1], q[2], q[3])
    return r


@njit(cache=True)
def pull_back_gradient(omega, dt, gx, gy, gz):
    """Carry a gradient at time dt back to the initial attitude and rate (compiled).

    For a body of spherical inertia. The small turn e(dt) of the attitude at dt that follows from
    a small turn e0 of the initial attitude and a change of omega is
    ``e(dt) = A(dq) e0 + dt J domega`` with ``phi = omega dt``, ``dq`` its quaternion and
    ``J = I - (1 - cos|phi|)/|phi|^2 [phi x] + (|phi| - sin|phi|)/|phi|^3 [phi x]^2``.

    Parameters
    ----------
    omega : ndarray, shape (3,)
        Angular velocity, rad per unit of time, body frame.
    dt : float
        Elapsed time.
    gx, gy, gz : float
        Derivative of a quantity with respect to a small turn at dt (body frame), as given by
        `cislunar.photometry.facets.facet_magnitude_gradient`.

    Returns
    -------
    e1, e2, e3 : float
        Its derivative with respect to e0, ``A(dq)^T g``, per rad.
    w1, w2, w3 : float
        Its derivative with respect to omega, ``dt J^T g``, per (rad per unit of time).
    """
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


@njit(cache=True, error_model="numpy")
def _euler(x, y, z, inertia, inverse_inertia):
    """Angular acceleration of a torque-free body, as three scalars."""
    hx = inertia[0, 0] * x + inertia[0, 1] * y + inertia[0, 2] * z
    hy = inertia[1, 0] * x + inertia[1, 1] * y + inertia[1, 2] * z
    hz = inertia[2, 0] * x + inertia[2, 1] * y + inertia[2, 2] * z
    tx, ty, tz = hy * z - hz * y, hz * x - hx * z, hx * y - hy * x
    return (
        inverse_inertia[0, 0] * tx + inverse_inertia[0, 1] * ty + inverse_inertia[0, 2] * tz,
        inverse_inertia[1, 0] * tx + inverse_inertia[1, 1] * ty + inverse_inertia[1, 2] * tz,
        inverse_inertia[2, 0] * tx + inverse_inertia[2, 1] * ty + inverse_inertia[2, 2] * tz,
    )


@njit(cache=True, error_model="numpy")
def _derivative(y, inertia, inverse_inertia, forced, dy):
    """Time derivative of ``y = (q, omega)`` into `dy`; `forced` is the torque's share."""
    x, v, z = y[4], y[5], y[6]
    dy[0], dy[1], dy[2], dy[3] = multiply_components(
        0.5 * x, 0.5 * v, 0.5 * z, 0.0, y[0], y[1], y[2], y[3]
    )
    ax, ay, az = _euler(x, v, z, inertia, inverse_inertia)
    dy[4], dy[5], dy[6] = ax + forced[0], ay + forced[1], az + forced[2]


@njit(cache=True, error_model="numpy")
def _try_step(y, h, inertia, inverse_inertia, forced, slopes, y_new, tolerance):
    """One DOP853 trial step into `y_new`; returns the error norm (acceptable below 1)."""
    for stage in range(1, 13):
        for i in range(7):
            change = 0.0
            for j in range(stage):
                change += _A[stage, j] * slopes[j, i]
            y_new[i] = y[i] + h * change
        if stage < 12:
            _derivative(y_new, inertia, inverse_inertia, forced, slopes[stage])
    total3, total5 = 0.0, 0.0
    for i in range(7):
        e3, e5 = 0.0, 0.0
        for j in range(12):
            e3 += _E3[j] * slopes[j, i]
            e5 += _E5[j] * slopes[j, i]
        total3 += (e3 / tolerance) ** 2
        total5 += (e5 / tolerance) ** 2
    if total5 == 0.0:
        return 0.0
    return abs(h) * total5 / np.sqrt((total5 + 0.01 * total3) * 7.0)


@njit(cache=True, error_model="numpy")
def propagate_kernel(
    q,
    omega,
    inertia,
    inverse_inertia,
    dt,
    tolerance,
    q_out,
    omega_out,
    ax=0.0,
    ay=0.0,
    az=0.0,
):
    """Attitude and rate of any rigid body after a time, by adaptive DOP853 (compiled).

    The equations are scaled by the initial rate (or that which the torque gives within a radian,
    if greater), so that one tolerance suits slow and fast bodies.

    Parameters
    ----------
    q : ndarray, shape (4,)
        Unit quaternion, inertial to body.
    omega : ndarray, shape (3,)
        Angular velocity, rad per unit of time, body frame.
    inertia, inverse_inertia : ndarray, shape (3, 3)
        Inertia matrix in any unit, and its inverse.
    dt : float
        Elapsed time; may be negative.
    tolerance : float
        Error per step: of q, and of omega relative to its initial length.
    q_out, omega_out : ndarray, shapes (4,) and (3,)
        Receive the result; may be `q` and `omega` themselves.
    ax, ay, az : float
        Angular acceleration I^-1 T by a torque T constant in the body frame, rad per unit of time
        squared.
    """
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
    slopes = np.empty((12, 7))
    left = dt * rate  # time to go, in units of 1 / rate
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


TURN_PER_STEP = 0.03
"""Largest turn of a step of `torque_free_step`, rad; the error is then below 1e-9 rad a step."""


@njit(cache=True, error_model="numpy")
def torque_free_step(w1, w2, w3, inertia, inverse_inertia, dt):
    """Turn and rate of a torque-free body after a short time, by Runge-Kutta of order 4 (compiled).

    The turn does not depend on the attitude, so a filter that spreads attitude and rate needs it
    once for each rate. Long times are divided so that no step turns by more than `TURN_PER_STEP`.

    Parameters
    ----------
    w1, w2, w3 : float
        Angular velocity, rad per unit of time, body frame.
    inertia, inverse_inertia : ndarray, shape (3, 3)
        Inertia matrix in any unit, and its inverse.
    dt : float
        Elapsed time.

    Returns
    -------
    q1, q2, q3, q4 : float
        Unit quaternion of the turn: the attitude becomes ``turn (x) q``.
    w1, w2, w3 : float
        Angular velocity after it.
    """
    rate = np.sqrt(w1 * w1 + w2 * w2 + w3 * w3)
    count = max(1, int(np.ceil(rate * abs(dt) / TURN_PER_STEP)))
    h = dt / count
    q1, q2, q3, q4 = 0.0, 0.0, 0.0, 1.0
    for _ in range(count):
        a1, a2, a3 = _euler(w1, w2, w3, inertia, inverse_inertia)
        x1, x2, x3 = w1 + 0.5 * h * a1, w2 + 0.5 * h * a2, w3 + 0.5 * h * a3
        b1, b2, b3 = _euler(x1, x2, x3, inertia, inverse_inertia)
        y1, y2, y3 = w1 + 0.5 * h * b1, w2 + 0.5 * h * b2, w3 + 0.5 * h * b3
        c1, c2, c3 = _euler(y1, y2, y3, inertia, inverse_inertia)
        z1, z2, z3 = w1 + h * c1, w2 + h * c2, w3 + h * c3
        d1, d2, d3 = _euler(z1, z2, z3, inertia, inverse_inertia)
        k1, k2, k3, k4 = multiply_components(w1, w2, w3, 0.0, q1, q2, q3, q4)
        s = 0.25 * h  # half a step of the equation dq/dt = [omega; 0] (x) q / 2
        l1, l2, l3, l4 = multiply_components(
            x1, x2, x3, 0.0, q1 + s * k1, q2 + s * k2, q3 + s * k3, q4 + s * k4
        )
        m1, m2, m3, m4 = multiply_components(
            y1, y2, y3, 0.0, q1 + s * l1, q2 + s * l2, q3 + s * l3, q4 + s * l4
        )
        s = 0.5 * h
        n1, n2, n3, n4 = multiply_components(
            z1, z2, z3, 0.0, q1 + s * m1, q2 + s * m2, q3 + s * m3, q4 + s * m4
        )
        s = h / 12.0
        q1 += s * (k1 + 2.0 * (l1 + m1) + n1)
        q2 += s * (k2 + 2.0 * (l2 + m2) + n2)
        q3 += s * (k3 + 2.0 * (l3 + m3) + n3)
        q4 += s * (k4 + 2.0 * (l4 + m4) + n4)
        s = h / 6.0
        w1 += s * (a1 + 2.0 * (b1 + c1) + d1)
        w2 += s * (a2 + 2.0 * (b2 + c2) + d2)
        w3 += s * (a3 + 2.0 * (b3 + c3) + d3)
    s = 1.0 / np.sqrt(q1 * q1 + q2 * q2 + q3 * q3 + q4 * q4)
    return s * q1, s * q2, s * q3, s * q4, w1, w2, w3


@njit(cache=True)
def _propagate_series(q, omega, inertia, inverse_inertia, a, times, tolerance, q_out, omega_out):
    """`propagate_kernel` from time to time, starting at time 0."""
    attitude, rate, now = q.copy(), omega.copy(), 0.0
    for i in range(times.size):
        propagate_kernel(
            attitude,
            rate,
            inertia,
            inverse_inertia,
            times[i] - now,
            tolerance,
            attitude,
            rate,
            a[0],
            a[1],
            a[2],
        )
        now = times[i]
        q_out[i] = attitude
        omega_out[i] = rate


def propagate_torque_free(
    quaternion: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    inertia: ArrayLike,
    *,
    tolerance: float = 1e-13,
) -> tuple[Array, Array]:
    """Attitude and angular velocity of a torque-free rigid body at given times.

    Parameters
    ----------
    quaternion : array_like, shape (4,)
        Attitude at time 0, inertial to body, scalar last.
    omega : array_like, shape (3,)
        Angular velocity at time 0, rad per unit of time, body frame.
    times : array_like, shape (T,)
        Times, in that unit and any order (neighboring times close together are fastest).
    inertia : array_like, shape (), (3,) or (3, 3)
        As for `inertia_matrix`. A spherical body is propagated in closed form.
    tolerance : float
        Error per step of the numerical integration, see `propagate_kernel`.

    Returns
    -------
    quaternions : ndarray, shape (T, 4)
        Unit quaternions.
    rates : ndarray, shape (T, 3)
        Angular velocities, rad per unit of time, body frame.

    Raises
    ------
    ConfigurationError
        If the inertia is impossible or an input is not finite.
    """
    if not is_spherical(inertia):
        still = np.zeros(3)
        return propagate_under_torque(quaternion, omega, times, inertia, still, tolerance=tolerance)
    start, rate, times, _ = _checked(quaternion, omega, times, np.zeros(3))
    quaternions = np.empty((times.size, 4))
    for i, turn in enumerate(rate * times[:, None]):
        quaternions[i] = propagate_spherical(start, turn, 1.0)
    return quaternions, np.tile(rate, (times.size, 1))


def propagate_under_torque(
    quaternion: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    inertia: ArrayLike,
    acceleration: ArrayLike,
    *,
    tolerance: float = 1e-13,
) -> tuple[Array, Array]:
    """Attitude and angular velocity of a rigid body under a torque constant in the body frame.

    Parameters
    ----------
    quaternion, omega, times, inertia, tolerance
        As for `propagate_torque_free`; every body is integrated numerically.
    acceleration : array_like, shape (3,)
        Angular acceleration I^-1 T by the torque T, rad per unit of time squared, body frame.

    Returns
    -------
    quaternions, rates
        As of `propagate_torque_free`.

    Raises
    ------
    ConfigurationError
        If the inertia is impossible or an input is not finite.
    """
    matrix = inertia_matrix(inertia)
    start, rate, times, forced = _checked(quaternion, omega, times, acceleration)
    quaternions, rates = np.empty((times.size, 4)), np.empty((times.size, 3))
    inverse = np.linalg.inv(matrix)
    _propagate_series(start, rate, matrix, inverse, forced, times, tolerance, quaternions, rates)
    return quaternions, rates


def _checked(
    quaternion: ArrayLike, omega: ArrayLike, times: ArrayLike, acceleration: ArrayLike
) -> tuple[Array, Array, Array, Array]:
    """The inputs of a propagation as arrays; those that are not finite are refused."""
    given = {
        "quaternion": normalize(quaternion),
        "omega": np.array(omega, dtype=float),
        "times": np.atleast_1d(np.asarray(times, dtype=float)),
        "acceleration": np.array(acceleration, dtype=float),
    }
    for name, value in given.items():
        if not np.all(np.isfinite(value)):
            raise ConfigurationError(f"{name} of a rigid body must be finite, not {value.tolist()}")
    return tuple(given.values())
