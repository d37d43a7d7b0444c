"""Torque-free rotation of rigid bodies, and angles seen from a spinning observer."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.attitude.quaternion import multiply_components, rotation_vector_components

Array = NDArray[np.float64]


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
