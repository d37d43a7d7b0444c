"""Attitudes of many bodies at common times (compiled)."""

import numpy as np

from cislunar.attitude.rigid_body import propagate_kernel, propagate_spherical
from cislunar.compiled import njit


@njit(cache=True, error_model="numpy")
def propagate_attitudes(elapsed_s, bodies, forced, tolerance, attitude, rate, quaternion, omega):
    """Attitudes (body, time, 4) and angular velocities (body, time, 3) of many bodies (compiled).

    `bodies` is a `RigidBodies`, `forced` (body, 3) their angular accelerations, rad/s^2. A
    torque-free spherical body is propagated in closed form from `attitude` (body, 4) and `rate`
    (body, 3) at the epoch. Any other body is integrated from its state at the first time (or at the
    epoch, if the first time is zero), and `attitude` and `rate` are overwritten by its state at the
    last time."""
    for j in range(attitude.shape[0]):
        if bodies.spherical[j] and not np.any(forced[j]):
            for i in range(elapsed_s.size):
                quaternion[j, i] = propagate_spherical(attitude[j], rate[j], elapsed_s[i])
                omega[j, i] = rate[j]
            continue
        now = elapsed_s[0]
        for i in range(elapsed_s.size):
            if i > 0 or now == 0.0:  # consecutive intervals share an end
                propagate_kernel(
                    attitude[j],
                    rate[j],
                    bodies.inertia[j],
                    bodies.inverse[j],
                    elapsed_s[i] - now,
                    tolerance,
                    attitude[j],
                    rate[j],
                    forced[j, 0],
                    forced[j, 1],
                    forced[j, 2],
                )
            now = elapsed_s[i]
            quaternion[j, i] = attitude[j]
            omega[j, i] = rate[j]
