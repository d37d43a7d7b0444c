"""Damped Gauss-Newton steps on the cost of a light curve, compiled.

With g the gradient and H = Lambda + sum a a^T / R the Gauss-Newton Hessian, a step solves
``(H + lambda diag H) s = -g`` (Levenberg 1944, Marquardt 1963). It is kept if the cost falls, and
lambda is lowered; otherwise lambda is raised and the step tried again.
"""

import numpy as np

from cislunar.compiled import allocating, borrowing, put
from cislunar.estimation.light_curves.cost_work import make_cost_work
from cislunar.estimation.light_curves.light_curve import derivatives_with
from cislunar.estimation.triangular import cholesky, solve_lower, solve_transposed

INITIAL_DAMPING = 1e-2
WARM_DAMPING = 1e-5
"""From a live mode of more unknowns than the rotation's: data tell some combinations of them a
hundred times worse than each alone, and along those a damped step hardly moves."""
DAMPING_AFTER_SUCCESS = 0.2
DAMPING_AFTER_FAILURE = 6.0
LARGEST_FAILURES = 5
SMALLEST_DECREASE = 0.02
"""Decrease of the cost (half a chi squared) at which a minimum counts as found."""


@borrowing
def squared_distance(u, other, root):
    """Squared Mahalanobis distance ``|L^T (u - other)|^2``, L L^T the information at `other`."""
    total = 0.0
    for i in range(u.shape[0]):
        along = 0.0
        for k in range(i, u.shape[0]):
            along += root[k, i] * (u[k] - other[k])
        total += along * along
    return total


@allocating
def refine(
    u, data, anchor, model, damping, max_iterations, information, known, known_roots, merge_distance
):
    """Lower the cost from a start `u` (n,), which receives the best point found.

    Returns the cost there, or inf once within `merge_distance`, squared, of a minimum `known`
    (m, n) already, given with the Cholesky factors of its information. `information` (n, n)
    receives that of the best point.
    """
    unknowns = u.shape[0]
    gradient, trial_gradient = np.empty(unknowns), np.empty(unknowns)
    trial_information, damped = np.empty((unknowns, unknowns)), np.empty((unknowns, unknowns))
    step, trial = np.empty(unknowns), np.empty(unknowns)
    work = make_cost_work(unknowns)
    best = derivatives_with(work, u, data, anchor, model, gradient, information)
    for _ in range(max_iterations):
        decrease = 0.0
        for _ in range(LARGEST_FAILURES):
            put(damped, information)
            for i in range(unknowns):
                damped[i, i] *= 1.0 + damping
                step[i] = -gradient[i]
            if cholesky(damped):
                solve_lower(damped, step)
                solve_transposed(damped, step)
                for i in range(unknowns):
                    trial[i] = u[i] + step[i]
                given = data, anchor, model, trial_gradient, trial_information
                value = derivatives_with(work, trial, *given)
                if value < best:
                    decrease = best - value
                    best = value
                    break
            damping *= DAMPING_AFTER_FAILURE
        if decrease == 0.0:
            break
        put(u, trial)
        put(gradient, trial_gradient)
        put(information, trial_information)
        for j in range(known.shape[0]):
            if squared_distance(u, known[j], known_roots[j]) < merge_distance:
                return np.inf
        damping *= DAMPING_AFTER_SUCCESS
        if decrease < SMALLEST_DECREASE:
            break
    return best
