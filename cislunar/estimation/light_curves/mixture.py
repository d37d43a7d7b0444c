"""Mean and deviations of an attitude given as weighted points."""

from typing import NamedTuple

import numpy as np

from cislunar.attitude.attitude_integrator import TURN_PER_STEP, carry_rotation
from cislunar.attitude.grp import (
    grp_from_quaternion_components,
    quaternion_from_grp_components,
)
from cislunar.attitude.parameter_deviations import perturbed_rotation
from cislunar.attitude.quaternion import multiply_components, rotation_vector_components
from cislunar.compiled import copy_into, njit_alloc, njit_noalloc
from cislunar.runtime import Array

_RECENTERINGS = 2
"""Number of times the reference of the mean attitude is moved to the mean error about it."""


class PointBodies(NamedTuple):
    """Bodies of points whose angular velocity changes: `inertia` and its `inverse` (n, 3, 3), and
    the angular acceleration `forced` (n, 3) by their torques."""

    inertia: Array
    inverse: Array
    forced: Array


@njit_alloc
def make_bodies(room, model):
    """Uninitialized bodies of up to `room` points; none for a constant angular velocity."""
    n = 0 if model.even else room
    return PointBodies(np.empty((n, 3, 3)), np.empty((n, 3, 3)), np.empty((n, 3)))


@njit_noalloc
def set_bodies(bodies, deviations, model):
    """Bodies of points with rotation deviations (n, m), of the kinds of the `LightCurveModel`."""
    if model.even:
        return
    kinds, assumed_inertia = model.rotation_kinds, (model.inertia, model.inverse_inertia)
    for i in range(deviations.shape[0]):
        body = bodies.inertia[i], bodies.inverse[i], bodies.forced[i]
        perturbed_rotation(kinds, deviations[i], *assumed_inertia, body)


@njit_noalloc
def turn_points(quaternion, omega, bodies, dt, model, turn_per_step):
    """Propagate attitudes (n, 4) and rates (n, 3) of points with given bodies over dt seconds, in
    place. The result is exact for a constant angular velocity; any other is integrated in steps
    that rotate by at most an angle."""
    for i in range(quaternion.shape[0]):
        q, w = quaternion[i], omega[i]
        if not model.even:
            body = bodies.inertia[i], bodies.inverse[i], bodies.forced[i]
            carry_rotation(q, w, dt, body, turn_per_step)
            continue
        t1, t2, t3, t4 = rotation_vector_components(w[0] * dt, w[1] * dt, w[2] * dt)
        q[0], q[1], q[2], q[3] = multiply_components(t1, t2, t3, t4, q[0], q[1], q[2], q[3])


@njit_alloc
def step_points(quaternion, omega, deviations, dt, model, turn_per_step=TURN_PER_STEP):
    """`turn_points` for points whose bodies have the rotation deviations (n, m)."""
    bodies = make_bodies(quaternion.shape[0], model)
    set_bodies(bodies, deviations, model)
    turn_points(quaternion, omega, bodies, dt, model, turn_per_step)


@njit_noalloc
def mixture_moments(quaternion, omega, weight, mean_quaternion, mean_omega, differences):
    """Mean attitude (4,), about which the mean GRP error vanishes, and mean rate (3,) of weighted
    points. `differences` (n, 6) receives the GRP of ``q_i (x) q_mean^-1`` and ``omega_i -
    omega_mean``."""
    n = quaternion.shape[0]
    heaviest = 0
    for i in range(n):
        if weight[i] > weight[heaviest]:
            heaviest = i
    copy_into(mean_quaternion, quaternion[heaviest])
    for repeat in range(_RECENTERINGS + 1):
        m = mean_quaternion
        p1, p2, p3 = 0.0, 0.0, 0.0
        for i in range(n):
            q = quaternion[i]
            d1, d2, d3, d4 = multiply_components(q[0], q[1], q[2], q[3], -m[0], -m[1], -m[2], m[3])
            x, y, z = grp_from_quaternion_components(d1, d2, d3, d4)
            differences[i, 0], differences[i, 1], differences[i, 2] = x, y, z
            p1 += weight[i] * x
            p2 += weight[i] * y
            p3 += weight[i] * z
        if repeat == _RECENTERINGS:
            break
        d1, d2, d3, d4 = quaternion_from_grp_components(p1, p2, p3)
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


@njit_noalloc
def weighted_deviations(differences, weight, sigma):
    """Root of the second moment of each component of the differences (n, 6), into `sigma` (6,)."""
    for c in range(sigma.shape[0]):
        total = 0.0
        for i in range(weight.shape[0]):
            total += weight[i] * differences[i, c] * differences[i, c]
        sigma[c] = np.sqrt(total)
