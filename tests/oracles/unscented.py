"""The paper's weights of the central sigma point, and the compiled transform on plain arrays."""

import numpy as np

from cislunar.estimation import unscented


def central_weights(n, alpha=0.5, beta=2.0):
    """W_0 of the mean and of the covariance, with kappa = 3 - n."""
    scale = 3.0 * alpha**2
    mean = (scale - n) / scale
    return mean, mean + 1.0 - alpha**2 + beta


def sigma_points(mean, root, weights):
    """The sigma points as rows."""
    center = np.array(mean, dtype=float)
    points = np.empty((center.size, 2 * center.size + 1))
    unscented.sigma_points(center, np.array(root, dtype=float), weights.spread, points)
    return points.T


def moments(center, differences, weights):
    """Mean and covariance of a transformed sigma set, given as `difference_moments` takes it."""
    d = np.ascontiguousarray(differences)
    shift, covariance = np.empty(d.shape[1]), np.empty((d.shape[1], d.shape[1]))
    unscented.difference_moments(d, weights.outer, weights.mean_shift, shift, covariance)
    lower = np.tril(covariance)  # the upper triangle is undefined
    return center + shift, lower + np.tril(lower, -1).T
