"""Groups of similarly observed targets, for the relaxation of J.

By Jensen's inequality a concave sum over targets is at most the sum over groups at their mean
observations; the loss is small if the targets of a group are similar.
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import njit

_FEATURES = 64  # orbits whose observations are compared
_ITERATIONS = 12


def group_targets(
    observations: NDArray[np.unsignedinteger], weight: NDArray[np.float64], n_groups: int
) -> NDArray[np.int64]:
    """Group targets that every good architecture would observe similarly (k-means). The loss of
    Jensen's inequality on a group grows with the variance of its targets' observations y relative
    to the mean. Two targets are therefore similar if a typical architecture gives them the same y,
    and every orbit the same part of it. ``observations`` (orbit, target) are those of one
    satellite; ``weight`` (orbit,) adds up to the number of orbits in a typical architecture. Groups
    are 0 .. groups - 1, none empty."""
    n_targets = observations.shape[1]
    if n_groups >= n_targets:
        return np.arange(n_targets)
    chosen = np.argsort(-weight, kind="stable")[:_FEATURES]
    seen = weight[chosen, None] * observations[chosen]
    typical = seen.sum(axis=0) + np.e  # below e the envelope is straight and nothing is lost
    parts = seen / typical / np.sqrt(np.maximum(weight[chosen, None], 1e-300))
    features = np.ascontiguousarray(np.vstack([parts, np.log(typical)]).T)
    # any seeding gives a valid bound; a fixed one makes it reproducible
    label = _k_means(features, _spread_seeds(features, n_groups, np.random.default_rng(0)))
    return np.unique(label, return_inverse=True)[1]


def _spread_seeds(features: NDArray, n_groups: int, rng: np.random.Generator) -> NDArray:
    """Random seeds with probability proportional to the squared distance from the previous ones."""
    centers = np.empty((n_groups, features.shape[1]))
    centers[0] = features[rng.integers(len(features))]
    distance = ((features - centers[0]) ** 2).sum(axis=1)
    for k in range(1, n_groups):
        cumulative = np.cumsum(distance)
        pick = np.searchsorted(cumulative, rng.random() * cumulative[-1], side="right")
        centers[k] = features[min(pick, len(features) - 1)]
        distance = np.minimum(distance, ((features - centers[k]) ** 2).sum(axis=1))
    return centers


@njit(cache=True)
def _k_means(features, centers):
    n, width = features.shape
    label = np.zeros(n, np.int64)
    for _ in range(_ITERATIONS):
        for t in range(n):
            nearest = np.inf
            for k in range(centers.shape[0]):
                squared = 0.0
                for f in range(width):
                    squared += (features[t, f] - centers[k, f]) ** 2
                    if squared >= nearest:
                        break
                if squared < nearest:
                    nearest = squared
                    label[t] = k
        size = np.zeros(centers.shape[0])
        total = np.zeros_like(centers)
        for t in range(n):
            size[label[t]] += 1.0
            total[label[t]] += features[t]
        for k in range(centers.shape[0]):
            if size[k] > 0.0:
                centers[k] = total[k] / size[k]
    return label


@njit(cache=True)
def group_means(observations, label, n_groups):
    """Mean observations per satellite of each group, shape (orbit, satellites, group), and its
    number of targets, from the table of counts and the group of each target."""
    n_orbits, counts, n_targets = observations.shape
    mass = np.zeros(n_groups)
    for t in range(n_targets):
        mass[label[t]] += 1.0
    mean = np.zeros((n_orbits, counts, n_groups))
    for i in range(n_orbits):
        for e in range(counts):
            row = mean[i, e]
            for t in range(n_targets):
                row[label[t]] += observations[i, e, t]
            for g in range(n_groups):
                row[g] /= mass[g] * (e + 1)
    return mean, mass
