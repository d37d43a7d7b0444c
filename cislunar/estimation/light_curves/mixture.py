"""Mean and spread of an attitude given as weighted points, step by step."""

import numpy as np

from cislunar.attitude.departures import departed_rotation
from cislunar.attitude.grp import (
    GRP_A,
    GRP_F,
    grp_from_quaternion_components,
    quaternion_from_grp_components,
)
from cislunar.attitude.quaternion import multiply_components, rotation_vector_components
from cislunar.attitude.short_steps import carry_rotation
from cislunar.compiled import allocating, borrowing, put

RECENTERINGS = 2
"""Times the reference of the mean attitude is moved to the mean error about it."""


@borrowing
def step_points(quaternion, omega, departures, dt, model):
    """Carry attitudes (n, 4) and rates (n, 3) of one body over dt seconds, in place.

    `departures` (n, m) are the amounts by which the rotation departs at each point, of the kinds
    of the `LightCurveModel`. Exact for a body that turns evenly.
    """
    if not model.even:
        _step_uneven_points(quaternion, omega, departures, dt, model)
        return
    for i in range(quaternion.shape[0]):
        q, w = quaternion[i], omega[i]
        t1, t2, t3, t4 = rotation_vector_components(w[0] * dt, w[1] * dt, w[2] * dt)
        q[0], q[1], q[2], q[3] = multiply_components(t1, t2, t3, t4, q[0], q[1], q[2], q[3])


@allocating
def _step_uneven_points(quaternion, omega, departures, dt, model):
    """`step_points` of a body that does not turn evenly."""
    body = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for i in range(quaternion.shape[0]):
        if i == 0 or departures.shape[1] > 0:
            kinds, believed = model.rotation_kinds, (model.inertia, model.inverse_inertia)
            departed_rotation(kinds, departures[i], *believed, body)
        carry_rotation(quaternion[i], omega[i], dt, body)


@borrowing
def mixture_moments(quaternion, omega, weight, mean_quaternion, mean_omega, differences):
    """Mean attitude (4,) and rate (3,) of weighted points, and what the points differ from them.

    The mean attitude is the one about which the mean GRP error vanishes; `differences` (n, 6)
    receives the GRP of ``q_i (x) q_mean^-1`` and ``omega_i - omega_mean``.
    """
    n = quaternion.shape[0]
    heaviest = 0
    for i in range(n):
        if weight[i] > weight[heaviest]:
            heaviest = i
    put(mean_quaternion, quaternion[heaviest])
    for repeat in range(RECENTERINGS + 1):
        m = mean_quaternion
        p1, p2, p3 = 0.0, 0.0, 0.0
        for i in range(n):
            q = quaternion[i]
            d1, d2, d3, d4 = multiply_components(q[0], q[1], q[2], q[3], -m[0], -m[1], -m[2], m[3])
            x, y, z = grp_from_quaternion_components(d1, d2, d3, d4, GRP_A, GRP_F)
            differences[i, 0], differences[i, 1], differences[i, 2] = x, y, z
            p1 += weight[i] * x
            p2 += weight[i] * y
            p3 += weight[i] * z
        if repeat == RECENTERINGS:
            break
        d1, d2, d3, d4 = quaternion_from_grp_components(p1, p2, p3, GRP_A, GRP_F)
        d1, d2, d3, d4 = multiply_components(d1, d2, d3, d4, m[0], m[1], m[2], m[3])
        scale = 1.0 / np.sqrt(d1 * d1 + d2 * d2 + d3 * d3 + d4 * d4)
        mean_quaternion[0], mean_quaternion[1] = scale * d1, scale * d2
        mean_quaternion[2], mean_quaternion[3] = scale * d3, scale * d4
    for c in range(3):
        mean_omega[c] = 0.0
        for i in range(n):
            mean_omega[c] += weight[i] * omega[i, c]
        for i in range(n):
            differences[i, 3 + c] = omega[i, c] - mean_omega[c]


@borrowing
def weighted_deviations(differences, weight, sigma):
    """Root of the second moment of each component of the differences (n, 6), into `sigma` (6,)."""
    for c in range(sigma.shape[0]):
        total = 0.0
        for i in range(weight.shape[0]):
            total += weight[i] * differences[i, c] * differences[i, c]
        sigma[c] = np.sqrt(total)
