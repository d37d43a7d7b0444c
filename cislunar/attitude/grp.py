"""Generalized Rodrigues parameters (GRP) of attitude errors (Paul & Fan, section 2.4).

The GRP vector is ``p = f rho / (a + q4)`` with the paper's a = 0.5 and f = 2 (a + 1) = 3, for which
a small p equals the rotation vector in radians.

The ``*_components`` functions are compiled and handle one attitude; `to_quaternion` and
`from_quaternion` handle arrays.
"""

import numpy as np
from numpy.typing import ArrayLike

from cislunar.compiled import njit_alloc, njit_inline
from cislunar.runtime import Array

GRP_A: float = 0.5
"""Parameter a (table 3)."""

GRP_F: float = 3.0
"""Scale f = 2 (a + 1)."""


@njit_inline
def quaternion_from_grp_components(p1, p2, p3):
    """Quaternion of a GRP vector, as four scalars."""
    a, f = GRP_A, GRP_F
    norm2 = p1 * p1 + p2 * p2 + p3 * p3
    scalar = (-a * norm2 + f * np.sqrt(f * f + (1.0 - a * a) * norm2)) / (f * f + norm2)
    scale = (a + scalar) / f
    return scale * p1, scale * p2, scale * p3, scalar


@njit_inline
def grp_from_quaternion_components(q1, q2, q3, q4):
    """GRP vector of a quaternion, as three scalars."""
    # q and -q are one attitude; q4 >= 0 is the shorter rotation, away from the singularity
    scale = GRP_F / (GRP_A + q4) if q4 >= 0.0 else -GRP_F / (GRP_A - q4)
    return scale * q1, scale * q2, scale * q3


@njit_alloc
def pull_back_to_grp(p, g):
    """Gradient with respect to the GRP vector, shape (3,), from that with respect to small
    rotations.

    With ``dq(p + dp) = dq(e) (x) dq(p)``, where e is a small rotation vector (rad, in the frame
    after ``dq(p)``), the result is ``(de/dp)^T g``. It completes the chain rule of a light curve
    with respect to the GRP vector of an initial attitude error."""
    a, f = GRP_A, GRP_F
    r1, r2, r3, r4 = quaternion_from_grp_components(p[0], p[1], p[2])
    # e = 2 (q4 drho - dq4 rho + drho x rho), rho = k p, k = (a + q4) / f
    k = (a + r4) / f
    along = r1 * g[0] + r2 * g[1] + r3 * g[2]
    u1 = 2.0 * (r4 * g[0] + r2 * g[2] - r3 * g[1])
    u2 = 2.0 * (r4 * g[1] + r3 * g[0] - r1 * g[2])
    u3 = 2.0 * (r4 * g[2] + r1 * g[1] - r2 * g[0])
    squared = r1 * r1 + r2 * r2 + r3 * r3
    # dq4/dp = -k rho / (q4 + |rho|^2 / (a + q4)) from |q| = 1
    scalar = -k / (r4 + squared / (a + r4)) * 2.0 * along * (r4 / (a + r4) - 1.0)
    out = np.empty(3)
    out[0], out[1], out[2] = k * u1 + scalar * r1, k * u2 + scalar * r2, k * u3 + scalar * r3
    return out


def to_quaternion(p: ArrayLike) -> Array:
    """Unit quaternions of GRP vectors over arrays (Paul & Fan, eqs. 32-34).

    Parameters
    ----------
    p : array_like, shape (..., 3)
        GRP vectors.

    Returns
    -------
    ndarray, shape (..., 4)
        Unit quaternions, scalar last.
    """
    p = np.moveaxis(np.asarray(p, dtype=float), -1, 0)
    return np.stack(quaternion_from_grp_components.py_func(*p), axis=-1)


def from_quaternion(q: ArrayLike) -> Array:
    """GRP vectors of unit quaternions over arrays (Paul & Fan, eq. 39).

    Parameters
    ----------
    q : array_like, shape (..., 4)
        Unit quaternions, scalar last; q and -q give the same vector.

    Returns
    -------
    ndarray, shape (..., 3)
        GRP vectors.
    """
    q = np.asarray(q, dtype=float)
    q = np.where(q[..., 3:] < 0.0, -q, q)
    return GRP_F * q[..., :3] / (GRP_A + q[..., 3:])
