"""Random attitudes and directions of Sun and observer."""

import numpy as np

from cislunar.attitude.quaternion import normalize

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def geometries(n, seed=0):
    """Quaternions (n, 4), and unit vectors (n, 3) to the Sun and to the observer."""
    rng = np.random.default_rng(seed)
    return normalize(rng.normal(size=(n, 4))), *unit(rng.normal(size=(2, n, 3)))
