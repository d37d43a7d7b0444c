"""Attitudes of many bodies at the same times (compiled)."""

import numpy as np
from numba import njit

from cislunar.attitude.rigid_body import propagate_kernel, propagate_spherical


@njit(cache=True, error_model="numpy")
def turn_bodies(elapsed_s, bodies, forced, tolerance, attitude, rate, quaternion, omega):
    """Attitudes (body, time, 4) and rates of many bodies at some times (compiled).

    `attitude` (body, 4) and `rate` (body, 3) are those at the epoch of bodies that turn in closed
    form, and those at the first of the times, or the epoch, of the others, which are carried on to
    the last. `bodies` is a `RigidBodies`, `forced` (body, 3) their angular accelerations.
    """
    for j in range(attitude.shape[0]):
        if bodies.spherical[j] and not np.any(forced[j]):
            for i in range(elapsed_s.size):
                quaternion[j, i] = propagate_spherical(attitude[j], rate[j], elapsed_s[i])
                omega[j, i] = rate[j]
            continue
        now = elapsed_s[0]
        for i in range(elapsed_s.size):
            if i > 0 or now == 0.0:  # the last state of an interval is the first of the next
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
