"""Propagation of the attitudes and rates of an unscented filter's sigma points over a step.

The error of sigma point i after the step is ``Phi(omega_i) (x) dq_i (x) Phi(omega_0)^-1``, where
Phi is the rotation of a torque-free body over the step and index 0 the central point; the attitude
itself cancels. For spherical inertia Phi(omega) is the rotation by omega dt and the rates are
constant; otherwise attitude and rates are integrated.

The root of the covariance is lower triangular, with estimated body parameters first and then
attitude and rate. The sigma points of position and velocity therefore share attitude and rate with
the central point.
"""

import numpy as np

from cislunar.attitude.attitude_integrator import carry_rotation, torque_free_step
from cislunar.attitude.grp import grp_from_quaternion_components
from cislunar.attitude.parameter_deviations import perturbed_rotation
from cislunar.attitude.quaternion import multiply_components, rotation_vector_components
from cislunar.compiled import njit_alloc, njit_noalloc
from cislunar.estimation.expected import attitude_error

_FASTEST_RAD_S = 10.0
"""Rates beyond which an estimate has diverged, and would take ever more steps, rad/s."""


@njit_alloc
def _perturbed_step(w1, w2, w3, parameters, root, i, scale, kinds, inertia, inverse, step_s):
    """`torque_free_step` of the body of sigma point i, whose deviations of the `kinds` may include
    a torque. They are the first of ``parameters + scale * root[:, i]``."""
    body = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    amounts = parameters[: kinds.size] + scale * root[: kinds.size, i]
    perturbed_rotation(kinds, amounts, inertia, inverse, body)
    turn, omega = np.array([0.0, 0.0, 0.0, 1.0]), np.array([w1, w2, w3])
    carry_rotation(turn, omega, step_s, body)
    return turn[0], turn[1], turn[2], turn[3], omega[0], omega[1], omega[2]


@njit_noalloc
def _is_slow(omega, root, constants):
    """Whether no sigma point can rotate faster than `_FASTEST_RAD_S`."""
    mean, deviation = 0.0, 0.0
    first = len(constants.parameters) + 3
    for c in range(3):
        mean += omega[c] * omega[c]
        for i in range(root.shape[1]):
            deviation += root[first + c, i] * root[first + c, i]
    return np.sqrt(mean) + constants.weights.spread * np.sqrt(deviation) < _FASTEST_RAD_S


@njit_noalloc
def rotation_differences(omega, parameters, root, step_s, bodies, j, constants, differences):
    """Parameter, attitude and rate parts of the propagated differences (Paul & Fan, eq. 38), into
    columns 0 .. p + 5 of `differences` (2 n, n). `omega` (3,), the mean rate of target j, rad/s,
    becomes that of the central point after the step. `parameters` (p,) are the mean deviations of
    the body, and `constants` those of the filter. Returns the rotation of the central point as a
    quaternion, NaN if a point rotates too fast."""
    o1, o2, o3 = omega[0], omega[1], omega[2]
    if not _is_slow(omega, root, constants):
        return np.nan, np.nan, np.nan, np.nan
    inertia, inverse, spherical = bodies.inertia[j], bodies.inverse[j], bodies.spherical[j]
    p, spread = len(constants.parameters), constants.weights.spread
    kinds = constants.rotation_kinds
    side, perturbed = 12 + p, p > 0 and kinds.shape[0] > 0
    v1, v2, v3 = 0.0, 0.0, 0.0
    fixed = kinds, inertia, inverse, step_s
    if perturbed:
        t1, t2, t3, t4, v1, v2, v3 = _perturbed_step(o1, o2, o3, parameters, root, 0, 0.0, *fixed)
        turn = (t1, t2, t3, t4)
        omega[0], omega[1], omega[2] = v1, v2, v3
    elif spherical:
        turn = rotation_vector_components(o1 * step_s, o2 * step_s, o3 * step_s)
    else:
        t1, t2, t3, t4, v1, v2, v3 = torque_free_step(o1, o2, o3, inertia, inverse, step_s)
        turn = (t1, t2, t3, t4)
        omega[0], omega[1], omega[2] = v1, v2, v3
    motion = root[p:]
    differences[:, 0 : p + 6] = 0.0
    for i in range(p + 6):
        for sign in range(2):
            s = spread if sign == 0 else -spread
            row = differences[i if sign == 0 else side + i]
            for c in range(p):
                row[c] = s * root[c, i]
            d1, d2, d3, d4 = attitude_error(motion, i, s)
            w1, w2, w3 = s * motion[3, i], s * motion[4, i], s * motion[5, i]
            if perturbed:
                t1, t2, t3, t4, w1, w2, w3 = _perturbed_step(
                    o1 + w1, o2 + w2, o3 + w3, parameters, root, i, s, *fixed
                )
            elif spherical:
                t1, t2, t3, t4 = rotation_vector_components(
                    (o1 + w1) * step_s, (o2 + w2) * step_s, (o3 + w3) * step_s
                )
            else:
                t1, t2, t3, t4, w1, w2, w3 = torque_free_step(
                    o1 + w1, o2 + w2, o3 + w3, inertia, inverse, step_s
                )
            d1, d2, d3, d4 = multiply_components(t1, t2, t3, t4, d1, d2, d3, d4)
            d1, d2, d3, d4 = multiply_components(
                d1, d2, d3, d4, -turn[0], -turn[1], -turn[2], turn[3]
            )
            row = row[p:]
            row[0], row[1], row[2] = grp_from_quaternion_components(d1, d2, d3, d4)
            row[3], row[4], row[5] = w1 - v1, w2 - v2, w3 - v3
    return turn
