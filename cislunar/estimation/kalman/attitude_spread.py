"""How the attitudes and rates of an unscented filter's sigma points spread over a step.

The error of sigma point i after the step is ``Phi(omega_i) (x) dq_i (x) Phi(omega_0)^-1``, where
Phi is the turn of a torque-free body over the step and index 0 the central point: the attitude
itself drops out. For spherical inertia Phi(omega) is the rotation by omega dt and the rates stay;
any other body is integrated, with its rates.

The root of the covariance being lower triangular with the attitude first, the sigma points
6 .. 11 of either sign share attitude and rate with the central one; they differ from it by nothing.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.grp import (
    GRP_A,
    GRP_F,
    grp_from_quaternion_components,
    quaternion_from_grp_components,
)
from cislunar.attitude.inertia import inertia_matrix, is_spherical
from cislunar.attitude.quaternion import multiply_components, rotation_vector_components
from cislunar.attitude.short_steps import torque_free_step

Array = NDArray[np.float64]

_SIDE = 12
"""Sigma points of either sign."""


class RigidBodies(NamedTuple):
    """Inertia of the targets, in the layout of the compiled kernels.

    Attributes
    ----------
    inertia, inverse : ndarray, shape (target, 3, 3)
        Inertia matrices, body frame, any unit, and their inverses.
    spherical : ndarray of bool, shape (target,)
        Whether the closed form holds.
    """

    inertia: Array
    inverse: Array
    spherical: NDArray[np.bool_]


def rigid_bodies(inertia: ArrayLike) -> RigidBodies:
    """Lay out the inertia of the targets for the kernels.

    Parameters
    ----------
    inertia : array_like, shape (target, 3, 3)
        Body frame, any unit.

    Returns
    -------
    RigidBodies

    Raises
    ------
    ConfigurationError
        If no rigid body has such an inertia.
    """
    matrices = np.array([inertia_matrix(matrix) for matrix in np.asarray(inertia, dtype=float)])
    spherical = np.array([is_spherical(matrix) for matrix in matrices])
    return RigidBodies(matrices, np.linalg.inv(matrices), spherical)


@njit(cache=True, error_model="numpy")
def spherical_differences(omega, root, spread, step_s, turn, differences):
    """Attitude and rate parts of the propagated differences, spherical inertia (compiled).

    Parameters
    ----------
    omega : ndarray, shape (3,)
        Mean angular velocity, rad/s, body frame.
    root : ndarray, shape (12, 12)
        Lower Cholesky factor of the covariance.
    spread : float
        Distance of the sigma points in standard deviations.
    step_s : float
        Step, s.
    turn : tuple of 4 floats
        Turn of the central point over the step.
    differences : ndarray, shape (24, 12)
        Columns 0 .. 5 receive the GRP of the attitude error and the difference of the rate.
    """
    differences[:, 0:6] = 0.0
    for i in range(6):
        for sign in range(2):
            s = spread if sign == 0 else -spread
            row = i if sign == 0 else _SIDE + i
            d1, d2, d3, d4 = quaternion_from_grp_components(
                s * root[0, i], s * root[1, i], s * root[2, i], GRP_A, GRP_F
            )
            w1, w2, w3 = s * root[3, i], s * root[4, i], s * root[5, i]
            t1, t2, t3, t4 = rotation_vector_components(
                (omega[0] + w1) * step_s, (omega[1] + w2) * step_s, (omega[2] + w3) * step_s
            )
            d1, d2, d3, d4 = multiply_components(t1, t2, t3, t4, d1, d2, d3, d4)
            d1, d2, d3, d4 = multiply_components(
                d1, d2, d3, d4, -turn[0], -turn[1], -turn[2], turn[3]
            )
            p1, p2, p3 = grp_from_quaternion_components(d1, d2, d3, d4, GRP_A, GRP_F)
            differences[row, 0] = p1
            differences[row, 1] = p2
            differences[row, 2] = p3
            differences[row, 3] = w1
            differences[row, 4] = w2
            differences[row, 5] = w3


@njit(cache=True, error_model="numpy")
def general_differences(omega, root, spread, step_s, inertia, inverse, differences):
    """Attitude and rate parts of the propagated differences, any inertia
    (Paul & Fan, eq. 38; compiled).

    Parameters
    ----------
    omega : ndarray, shape (3,)
        Mean angular velocity, rad/s, body frame; becomes that of the central point after the step.
    root, spread, step_s, differences
        As in `spherical_differences`.
    inertia, inverse : ndarray, shape (3, 3)
        Inertia matrix and its inverse.

    Returns
    -------
    tuple of 4 floats
        Turn of the central point over the step.
    """
    t1, t2, t3, t4, v1, v2, v3 = torque_free_step(
        omega[0], omega[1], omega[2], inertia, inverse, step_s
    )
    turn = (t1, t2, t3, t4)
    differences[:, 0:6] = 0.0
    for i in range(6):
        for sign in range(2):
            s = spread if sign == 0 else -spread
            row = i if sign == 0 else _SIDE + i
            d1, d2, d3, d4 = quaternion_from_grp_components(
                s * root[0, i], s * root[1, i], s * root[2, i], GRP_A, GRP_F
            )
            t1, t2, t3, t4, w1, w2, w3 = torque_free_step(
                omega[0] + s * root[3, i],
                omega[1] + s * root[4, i],
                omega[2] + s * root[5, i],
                inertia,
                inverse,
                step_s,
            )
            d1, d2, d3, d4 = multiply_components(t1, t2, t3, t4, d1, d2, d3, d4)
            d1, d2, d3, d4 = multiply_components(
                d1, d2, d3, d4, -turn[0], -turn[1], -turn[2], turn[3]
            )
            p1, p2, p3 = grp_from_quaternion_components(d1, d2, d3, d4, GRP_A, GRP_F)
            differences[row, 0] = p1
            differences[row, 1] = p2
            differences[row, 2] = p3
            differences[row, 3] = w1 - v1
            differences[row, 4] = w2 - v2
            differences[row, 5] = w3 - v3
    omega[0], omega[1], omega[2] = v1, v2, v3
    return turn
