"""Rotation of one rigid body at any times, as `cislunar.attitude` propagates that of a truth."""

import numpy as np

from cislunar.attitude.inertia import inertia_matrix, rigid_bodies
from cislunar.attitude.quaternion import normalize
from cislunar.attitude.rigid_body import propagate_kernel, propagate_spherical


def propagate_rotation(quaternion, omega, times, inertia, acceleration=None):
    """Attitudes (T, 4) and angular velocities (T, 3) at times in any order from the state at time
    0, torque-free or under a torque that is constant in the body frame and causes an angular
    acceleration (3,); with one, a spherical body is integrated as well."""
    body = rigid_bodies(inertia_matrix(inertia)[None])
    start, rate, now = normalize(quaternion), np.array(omega, dtype=float), 0.0
    times = np.asarray(times, dtype=float)
    if body.spherical[0] and acceleration is None:
        turned = [propagate_spherical(start, rate * time, 1.0) for time in times]
        return np.array(turned), np.tile(rate, (times.size, 1))
    quaternions, rates = np.empty((times.size, 4)), np.empty((times.size, 3))
    forced = np.zeros(3) if acceleration is None else acceleration
    for i, time in enumerate(times):
        step = body.inertia[0], body.inverse[0], time - now, 1e-13
        propagate_kernel(start, rate, *step, start, rate, *forced)
        quaternions[i], rates[i], now = start, rate, time
    return quaternions, rates
