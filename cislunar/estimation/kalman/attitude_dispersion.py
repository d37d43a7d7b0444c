"""Propagation of the attitudes and rates of an unscented filter's sigma points over a step.

The error of sigma point i after the step is ``Phi(omega_i) (x) dq_i (x) Phi(omega_0)^-1``, where
Phi is the rotation of a torque-free body over the step and index 0 the central point; the attitude
itself cancels. For spherical inertia Phi(omega) is the rotation by omega dt and the rates are
constant; otherwise attitude and rates are integrated.

The root of the covariance is lower triangular with the attitude first. The sigma points 6 .. 11 of
either sign therefore share attitude and rate with the central point.
"""

from cislunar.attitude.attitude_integrator import torque_free_step
from cislunar.attitude.grp import GRP_A, GRP_F, grp_from_quaternion_components
from cislunar.attitude.quaternion import multiply_components, rotation_vector_components
from cislunar.compiled import njit_noalloc
from cislunar.estimation.expected import attitude_error

_SIDE = 12
"""Sigma points of either sign."""


@njit_noalloc
def rotation_differences(omega, root, spread, step_s, bodies, j, differences):
    """Attitude and rate parts of the propagated differences (Paul & Fan, eq. 38), into columns 0 ..
    5 of `differences` (24, 12). `omega` (3,), the mean rate of target j, rad/s, becomes that of the
    central point after the step. Returns the rotation of the central point as a quaternion."""
    o1, o2, o3 = omega[0], omega[1], omega[2]
    inertia, inverse, spherical = bodies.inertia[j], bodies.inverse[j], bodies.spherical[j]
    v1, v2, v3 = 0.0, 0.0, 0.0
    if spherical:
        turn = rotation_vector_components(o1 * step_s, o2 * step_s, o3 * step_s)
    else:
        t1, t2, t3, t4, v1, v2, v3 = torque_free_step(o1, o2, o3, inertia, inverse, step_s)
        turn = (t1, t2, t3, t4)
        omega[0], omega[1], omega[2] = v1, v2, v3
    differences[:, 0:6] = 0.0
    for i in range(6):
        for sign in range(2):
            s = spread if sign == 0 else -spread
            row = differences[i if sign == 0 else _SIDE + i]
            d1, d2, d3, d4 = attitude_error(root, i, s)
            w1, w2, w3 = s * root[3, i], s * root[4, i], s * root[5, i]
            if spherical:
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
            row[0], row[1], row[2] = grp_from_quaternion_components(d1, d2, d3, d4, GRP_A, GRP_F)
            row[3], row[4], row[5] = w1 - v1, w2 - v2, w3 - v3
    return turn
