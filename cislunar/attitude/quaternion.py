"""Unit quaternions: products, rotation of vectors, rotation vectors.

A quaternion is ``q = [rho; q4]`` with the scalar last. Its attitude matrix ``A(q)`` transforms the
inertial components of a vector into body components. The product is ordered like the matrices,
``A(p (x) q) = A(p) A(q)``, so that an error quaternion multiplies from the left,
``q_true = dq (x) q_estimate`` (Paul & Fan, section 2.4).

The ``*_components`` functions are compiled and take and return the scalars of one quaternion, so
that kernels need no arrays. The other functions, except `from_rotation_vector`, broadcast over
arrays.
"""

import numpy as np
from numpy.typing import ArrayLike

from cislunar.compiled import njit, njit_inline
from cislunar.runtime import Array, require_unit, vectors_of

SMALL_ANGLE = 1e-4
"""Rotation angle (rad) below which sin(angle/2)/angle is taken from its series (error 1e-19)."""


@njit_inline
def multiply_components(p1, p2, p3, p4, q1, q2, q3, q4):
    """Product p (x) q of two quaternions, as four scalars:
    ``[p4 rho_q + q4 rho_p - rho_p x rho_q ; p4 q4 - rho_p . rho_q]``."""
    r1 = p4 * q1 + q4 * p1 - (p2 * q3 - p3 * q2)
    r2 = p4 * q2 + q4 * p2 - (p3 * q1 - p1 * q3)
    r3 = p4 * q3 + q4 * p3 - (p1 * q2 - p2 * q1)
    r4 = p4 * q4 - (p1 * q1 + p2 * q2 + p3 * q3)
    return r1, r2, r3, r4


@njit_inline
def rotate_components(q1, q2, q3, q4, x, y, z):
    """Body components A(q) v of an inertial vector, as three scalars:
    ``v + 2 rho x (rho x v) - 2 q4 rho x v`` for a unit quaternion."""
    tx = 2.0 * (q2 * z - q3 * y)
    ty = 2.0 * (q3 * x - q1 * z)
    tz = 2.0 * (q1 * y - q2 * x)
    bx = x - q4 * tx + (q2 * tz - q3 * ty)
    by = y - q4 * ty + (q3 * tx - q1 * tz)
    bz = z - q4 * tz + (q1 * ty - q2 * tx)
    return bx, by, bz


@njit_inline
def rotation_vector_components(x, y, z):
    """Quaternion ``[axis sin(angle/2) ; cos(angle/2)]`` of a rotation vector (rad), as scalars."""
    angle2 = x * x + y * y + z * z
    if angle2 < SMALL_ANGLE * SMALL_ANGLE:
        scale = 0.5 - angle2 / 48.0
        scalar = 1.0 - angle2 / 8.0 + angle2 * angle2 / 384.0
    else:
        angle = np.sqrt(angle2)
        scale = np.sin(0.5 * angle) / angle
        scalar = np.cos(0.5 * angle)
    return scale * x, scale * y, scale * z, scalar


@njit(cache=True)
def from_rotation_vector(vector):
    """Quaternion of a rotation vector (compiled).

    Parameters
    ----------
    vector : ndarray, shape (3,)
        Rotation axis times angle, rad; the frames before and after the rotation give the same
        components.

    Returns
    -------
    ndarray, shape (4,)
        ``[axis sin(angle/2) ; cos(angle/2)]``.
    """
    r = np.empty(4)
    r[0], r[1], r[2], r[3] = rotation_vector_components(vector[0], vector[1], vector[2])
    return r


def normalize(q: ArrayLike) -> Array:
    """Quaternions, shape (..., 4) and nonzero, scaled to unit length; signs are kept."""
    q = np.asarray(q, dtype=float)
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def compose(p: ArrayLike, q: ArrayLike) -> Array:
    """Products p (x) q over arrays, with ``A(p (x) q) = A(p) A(q)``.

    Parameters
    ----------
    p, q : array_like, shapes (..., 4), broadcast against each other
        Quaternions, scalar last.

    Returns
    -------
    ndarray, shape (..., 4)
    """
    p, q = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
    columns = multiply_components.py_func(*np.moveaxis(p, -1, 0), *np.moveaxis(q, -1, 0))
    return np.stack(columns, axis=-1)


def inverse(q: ArrayLike) -> Array:
    """Inverses ``[-rho; q4]`` of unit quaternions over arrays, shape (..., 4)."""
    return np.asarray(q, dtype=float) * np.array([-1.0, -1.0, -1.0, 1.0])


def to_body(q: ArrayLike, vector: ArrayLike) -> Array:
    """Body components A(q) v (..., 3) of inertial vectors, for unit quaternions (..., 4)."""
    q, vector = np.asarray(q, dtype=float), np.asarray(vector, dtype=float)
    columns = rotate_components.py_func(*np.moveaxis(q, -1, 0), *np.moveaxis(vector, -1, 0))
    return np.stack(columns, axis=-1)


def to_inertial(q: ArrayLike, vector: ArrayLike) -> Array:
    """Inertial components A(q)^T v of body vectors over arrays.

    Parameters
    ----------
    q : array_like, shape (..., 4)
        Unit quaternions, inertial to body.
    vector : array_like, shape (..., 3), broadcast against `q`
        Vectors, body frame.

    Returns
    -------
    ndarray, shape (..., 3)
        Vectors, inertial frame.
    """
    return to_body(inverse(q), vector)


def attitude_matrix(q: ArrayLike) -> Array:
    """Attitude matrices ``A(q) = (q4^2 - |rho|^2) I + 2 rho rho^T - 2 q4 [rho x]``.

    Parameters
    ----------
    q : array_like, shape (..., 4)
        Unit quaternions, inertial to body.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rotation matrices from inertial to body components.

    Raises
    ------
    ConfigurationError
        If a quaternion has not four components or is not of unit norm.
    """
    q = vectors_of("q", q, 4)
    require_unit("q", q)
    # Row i of to_body(q, e_i) is column i of A, hence the transpose.
    return np.swapaxes(to_body(q[..., None, :], np.eye(3)), -1, -2)
