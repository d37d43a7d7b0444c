"""Shadows by plain ray casting: without tables or lists of pairs, every facet is tested."""

import numpy as np
from numba import njit


@njit(cache=True)
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True)
def blocked(origin, direction, corners):
    """Whether a ray hits any triangle (Moeller & Trumbore), corners (F, 3, 3)."""
    for f in range(corners.shape[0]):
        a = corners[f, 0]
        e1, e2, t = minus(corners[f, 1], a), minus(corners[f, 2], a), minus(origin, a)
        p = cross(direction, e2)
        det = dot(e1, p)
        if det == 0.0:
            continue
        u = dot(t, p) / det
        q = cross(t, e1)
        v = dot(direction, q) / det
        if u >= 0.0 and v >= 0.0 and u + v <= 1.0 and dot(e2, q) / det > 1e-9:
            return True
    return False


@njit(cache=True)
def cast_shares(corners, normals, sun, view, points):
    """Share of each facet, (F,), from which both directions are free.

    `points` (K, 2) are coordinates along the two edges; rays start slightly above the facet.
    """
    shares = np.zeros(corners.shape[0])
    for f in range(corners.shape[0]):
        if dot(normals[f], sun) <= 0.0 or dot(normals[f], view) <= 0.0:
            continue
        a, n = corners[f, 0], normals[f]
        e1, e2 = minus(corners[f, 1], a), minus(corners[f, 2], a)
        for k in range(points.shape[0]):
            u, v = points[k, 0], points[k, 1]
            origin = (
                a[0] + u * e1[0] + v * e2[0] + 1e-7 * n[0],
                a[1] + u * e1[1] + v * e2[1] + 1e-7 * n[1],
                a[2] + u * e1[2] + v * e2[2] + 1e-7 * n[2],
            )
            if not blocked(origin, sun, corners) and not blocked(origin, view, corners):
                shares[f] += 1.0 / points.shape[0]
    return shares


def random_points(n, seed=0):
    """Random points of a triangle, uniformly distributed, (n, 2)."""
    points = np.random.default_rng(seed).random((n, 2))
    return np.where(points.sum(axis=1, keepdims=True) > 1.0, 1.0 - points, points)
