"""Torque-free rotation of rigid bodies (Paul & Fan, section 5.2).

Attitude and angular velocity obey ``dq/dt = [omega; 0] (x) q / 2`` and Euler's equations
``I domega/dt = -omega x (I omega)``, both in the body frame. A body of spherical inertia keeps
its angular velocity, so that its attitude is known in closed form (`propagate_spherical`); any
other is integrated numerically (`propagate_torque_free`). Angles are in rad, times in any unit.
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import DOP853

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
def _derivative(y, inertia, inverse_inertia, dy):
    """Time derivative of ``y = (q, omega)`` into `dy`."""
    x, v, z = y[4], y[5], y[6]
    dy[0], dy[1], dy[2], dy[3] = multiply_components(
        0.5 * x, 0.5 * v, 0.5 * z, 0.0, y[0], y[1], y[2], y[3]
    )
    hx = inertia[0, 0] * x + inertia[0, 1] * v + inertia[0, 2] * z
    hy = inertia[1, 0] * x + inertia[1, 1] * v + inertia[1, 2] * z
    hz = inertia[2, 0] * x + inertia[2, 1] * v + inertia[2, 2] * z
    tx, ty, tz = hy * z - hz * v, hz * x - hx * z, hx * v - hy * x
    for i in range(3):
        dy[4 + i] = (
            inverse_inertia[i, 0] * tx + inverse_inertia[i, 1] * ty + inverse_inertia[i, 2] * tz
        )


@njit(cache=True, error_model="numpy")
def _try_step(y, h, inertia, inverse_inertia, slopes, y_new, tolerance):
    """One DOP853 trial step into `y_new`; returns the error norm (acceptable below 1)."""
    for stage in range(1, 13):
        for i in range(7):
            change = 0.0
            for j in range(stage):
                change += _A[stage, j] * slopes[j, i]
            y_new[i] = y[i] + h * change
        if stage < 12:
            _derivative(y_new, inertia, inverse_inertia, slopes[stage])
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
def propagate_kernel(q, omega, inertia, inverse_inertia, dt, tolerance, q_out, omega_out):
    """Attitude and rate of any rigid body after a time, by adaptive DOP853 (compiled).

    The equations are scaled by the initial rate, so that one tolerance suits slow and fast
    bodies, and so that only ratios of inertia matter.

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
    """
    rate = np.sqrt(omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2)
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
        _derivative(y, inertia, inverse_inertia, slopes[0])
        error = _try_step(y, step, inertia, inverse_inertia, slopes, y_new, tolerance)
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


@njit(cache=True)
def _propagate_series(q, omega, inertia, inverse_inertia, times, tolerance, q_out, omega_out):
    """`propagate_kernel` from time to time, starting at time 0."""
    attitude, rate, now = q.copy(), omega.copy(), 0.0
    for i in range(times.size):
        propagate_kernel(
            attitude, rate, inertia, inverse_inertia, times[i] - now, tolerance, attitude, rate
        )
        now = times[i]
        q_out[i] = attitude
        omega_out[i] = rate


def inertia_matrix(inertia: ArrayLike) -> Array:
    """Inertia as a checked (3, 3) matrix.

    Parameters
    ----------
    inertia : array_like, shape (), (3,) or (3, 3)
        Moment of a spherical body, principal moments, or matrix in the body frame; kg m^2.

    Returns
    -------
    ndarray, shape (3, 3)
        Symmetric positive definite matrix.

    Raises
    ------
    ConfigurationError
        If no rigid body has such an inertia: not symmetric, not positive definite, or one
        principal moment above the sum of the others.
    """
    given = np.asarray(inertia, dtype=float)
    if given.shape not in ((), (3,), (3, 3)) or not np.all(np.isfinite(given)):
        raise ConfigurationError(
            f"inertia {given.tolist()} must be one moment, three moments or a 3 x 3 matrix, kg m^2"
        )
    matrix = given if given.ndim == 2 else np.eye(3) * given
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-9 * np.abs(matrix).max()):
        raise ConfigurationError(f"inertia {matrix.tolist()} must be symmetric")
    moments = np.linalg.eigvalsh(matrix)
    if moments[0] <= 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
        raise ConfigurationError(
            f"principal moments of inertia {moments.tolist()} must be positive, and none may "
            "exceed the sum of the other two"
        )
    return np.ascontiguousarray(0.5 * (matrix + matrix.T))


def is_spherical(inertia: ArrayLike) -> bool:
    """Whether the three principal moments agree to 1e-12, so that omega is constant.

    Parameters
    ----------
    inertia : array_like, shape (), (3,) or (3, 3)
        As for `inertia_matrix`.

    Returns
    -------
    bool
        True for a body on which `propagate_spherical` is exact.
    """
    matrix = inertia_matrix(inertia)
    mean = np.trace(matrix) / 3.0
    return bool(np.abs(matrix - mean * np.eye(3)).max() <= 1e-12 * mean)


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
    matrix = inertia_matrix(inertia)
    start = normalize(quaternion)
    rate = np.array(omega, dtype=float)
    times = np.atleast_1d(np.asarray(times, dtype=float))
    for name, value in (("quaternion", start), ("omega", rate), ("times", times)):
        if not np.all(np.isfinite(value)):
            raise ConfigurationError(f"{name} of a rigid body must be finite, not {value.tolist()}")
    quaternions, rates = np.empty((times.size, 4)), np.empty((times.size, 3))
    if is_spherical(matrix):
        turns = rate * times[:, None]
        for i, turn in enumerate(turns):
            quaternions[i] = propagate_spherical(start, turn, 1.0)
        rates[:] = rate
        return quaternions, rates
    inverse = np.linalg.inv(matrix)
    _propagate_series(start, rate, matrix, inverse, times, tolerance, quaternions, rates)
    return quaternions, rates
