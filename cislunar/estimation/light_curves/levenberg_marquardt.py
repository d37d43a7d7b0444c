"""Damped Gauss-Newton steps on the cost of a light curve, compiled. With the gradient g and the
Gauss-Newton Hessian H a step solves ``(H + lambda diag H) s = -g`` (Levenberg 1944, Marquardt
1963). If the cost decreases the step is kept and lambda is lowered; otherwise lambda is raised."""

import numpy as np

from cislunar.compiled import copy_into, njit_alloc, njit_noalloc
from cislunar.estimation.light_curves.light_curve import derivatives_with
from cislunar.estimation.light_curves.row_blocks import make_cost_work
from cislunar.estimation.triangular import cholesky, solve_lower, solve_transposed

INITIAL_DAMPING = 1e-2
WARM_DAMPING = 1e-5
"""Initial damping for a live mode with body parameters: data determine some combinations of the
parameters a hundred times worse than each alone, and a damped step hardly changes those."""
_DAMPING_AFTER_SUCCESS = 0.2
_DAMPING_AFTER_FAILURE = 6.0
_LARGEST_FAILURES = 5
_SMALLEST_DECREASE = 0.02
"""Decrease of the cost (half a chi squared) below which a minimum counts as found."""


@njit_noalloc
def squared_distance(u, other, root):
    """Squared Mahalanobis distance ``|L^T (u - other)|^2``, with L L^T the information at
    `other`."""
    total = 0.0
    for i in range(u.shape[0]):
        along = 0.0
        for k in range(i, u.shape[0]):
            along += root[k, i] * (u[k] - other[k])
        total += along * along
    return total


@njit_noalloc
def is_known(u, known, roots, merge_distance):
    """Whether a point is closer than the merging distance to one of the known minima."""
    for j in range(known.shape[0]):
        if squared_distance(u, known[j], roots[j]) < merge_distance:
            return True
    return False


@njit_alloc
def refine(
    u, data, anchor, model, damping, max_iterations, information, known, known_roots, merge_distance
):
    """Lower the cost from a start `u` (n,), which receives the best point found. Returns the cost
    there, or inf once a step leads to a squared distance below `merge_distance` from a minimum of
    `known` (m, n), given with the Cholesky factors of its information. `information` (n, n)
    receives that of the best point."""
    size = u.shape[0]
    gradient, trial_gradient = np.empty(size), np.empty(size)
    trial_information, damped = np.empty((size, size)), np.empty((size, size))
    step, trial = np.empty(size), np.empty(size)
    work = make_cost_work(size)
    best = derivatives_with(work, u, data, anchor, model, np.inf, gradient, information)
    for _ in range(max_iterations):
        decrease = 0.0
        for _ in range(_LARGEST_FAILURES):
            copy_into(damped, information)
            for i in range(size):
                damped[i, i] *= 1.0 + damping
                step[i] = -gradient[i]
            if cholesky(damped):
                solve_lower(damped, step)
                solve_transposed(damped, step)
                for i in range(size):
                    trial[i] = u[i] + step[i]
                if is_known(trial, known, known_roots, merge_distance):
                    return np.inf
                given = data, anchor, model, best, trial_gradient, trial_information
                value = derivatives_with(work, trial, *given)
                if value < best:
                    decrease = best - value
                    best = value
                    break
            damping *= _DAMPING_AFTER_FAILURE
        if decrease == 0.0:
            break
        copy_into(u, trial)
        copy_into(gradient, trial_gradient)
        copy_into(information, trial_information)
        damping *= _DAMPING_AFTER_SUCCESS
        if decrease < _SMALLEST_DECREASE:
            break
    return best
