"""Priors with heavier tails than the normal distribution (compiled).

A deviation x, in prior standard deviations, that follows Student's t distribution with nu > 2
degrees of freedom, scaled to a standard deviation of 1, has the negative log density

    (nu + 1) / 2 ln(1 + x^2 / (nu - 2)) + constant

instead of x^2 / 2. A deviation of several standard deviations then costs little, so that data
decide on it (O'Hagan 1979).
"""

import numpy as np

from cislunar.compiled import njit_noalloc


@njit_noalloc
def tail_cost(u, first, freedom):
    """Cost of the parameters from `first` on under Student's t distribution less that under the
    normal one; 0 with `freedom` 0."""
    total = 0.0
    if freedom > 0.0:
        for i in range(first, u.shape[0]):
            square = u[i] * u[i]
            total += 0.5 * (freedom + 1.0) * np.log(1.0 + square / (freedom - 2.0)) - 0.5 * square
    return total


@njit_noalloc
def add_tail_derivatives(u, first, freedom, gradient, information):
    """Add the gradient of `tail_cost`, and in place of its second derivative the curvature of the
    parabola that touches the cost at u and lies above it (iteratively reweighted least squares),
    with which the information remains positive definite."""
    if freedom > 0.0:
        for i in range(first, u.shape[0]):
            change = (freedom + 1.0) / (freedom - 2.0 + u[i] * u[i]) - 1.0
            gradient[i] += change * u[i]
            information[i, i] += change
