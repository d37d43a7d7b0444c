"""Compiled passes over the observations of one target, for a bank of maneuver times; see
`cislunar.estimation.maneuvers.bank`."""

import numpy as np

from cislunar.compiled import copy_into, njit
from cislunar.dynamics.forces import of_state
from cislunar.estimation.linearization import (
    SIZE,
    angles_by_state,
    carry_covariance,
    follow,
    make_scratch,
    multiply,
    transition,
)

STRIDE_S = 240.0
"""Longest integration step without observations, s."""


@njit(cache=True, error_model="numpy")
def filter_orbit(j, model, first, state, covariance, rows, means, spreads, evidence):
    """Filter the orbit of target j without a maneuver, from its state (6,) and covariance (6, 6) at
    time `first`.

    `model` are scene, force model and process noise (6, 6) of a step; `rows` time, observer, values
    (row, 2) and variances (row, 2) of right ascension and declination, after `first` and in the
    order of time. Outputs at every time from `first` on: mean (time, 6) and covariance (time, 6, 6)
    after the observations, and twice the negative logarithm of the density of the observations so
    far (time,), without a constant for each.
    """
    scene, forces, process = model
    time, observer, value, variance = rows
    work, measured, row = make_scratch(), np.empty(3), 0
    forced = of_state(forces, j)
    for i in range(means.shape[0]):
        k = first + i
        if i > 0:
            transition(forced, k - 1, 1, scene, state, state, work)
            copy_into(state, work.mean)
            carry_covariance(work.phi, covariance, work.square)
            covariance += process
            evidence[i] = evidence[i - 1]
        while row < time.size and time[row] == k:
            measured[1], measured[2] = value[row]
            root = follow(state, covariance, measured, variance[row], observer[row], k, scene, work)
            e0 = work.angles[0] / root[0]
            e1 = (work.angles[1] - root[1] * e0) / root[2]
            evidence[i] += e0 * e0 + e1 * e1 + 2.0 * np.log(root[0] * root[2])
            row += 1
        copy_into(means[i], state)
        copy_into(spreads[i], covariance)


@njit(cache=True, error_model="numpy")
def normal_equations(j, model, first, last, start, rows, normal, gradient, end, path):
    """Squared residuals of the observations after time `first`, in variances, of the orbit of
    target j that starts at `start` (6,) then.

    `model` and `rows` are as in `filter_orbit`. Outputs: normal matrix (6, 6) and gradient (6,) by
    the start, and state (6,) and transition matrix (6, 6) at time `last`.
    """
    scene, forces, _ = model
    time, observer, value, variance = rows
    work, measured, product = make_scratch(), np.empty(3), np.empty((SIZE, SIZE))
    forced = of_state(forces, j)
    state, derivative = start.copy(), np.empty((2, SIZE))
    normal[:, :], gradient[:], path[:, :] = 0.0, 0.0, np.eye(SIZE)
    row, total, k = int(np.searchsorted(time, first + 1)), 0.0, first
    stride = max(1, int(STRIDE_S / scene.step_s))
    while k < last:
        reach = min(k + stride, last)
        if row < time.size:
            reach = min(reach, time[row])
        transition(forced, k, reach - k, scene, state, state, work)
        k = reach
        copy_into(state, work.mean)
        multiply(work.phi, path, product)
        copy_into(path, product)
        while row < time.size and time[row] == k:
            measured[1], measured[2] = value[row]
            angles_by_state(state, measured, observer[row], k, scene, work)
            for a in range(2):
                weight, residual = 1.0 / variance[row, a], work.angles[a]
                total += weight * residual * residual
                for c in range(SIZE):
                    derivative[a, c] = 0.0
                    for d in range(3):
                        derivative[a, c] += work.rows[1 + a, 3 + d] * path[d, c]
                for c in range(SIZE):
                    gradient[c] += weight * derivative[a, c] * residual
                    for d in range(SIZE):
                        normal[c, d] += weight * derivative[a, c] * derivative[a, d]
            row += 1
    copy_into(end, state)
    return total
