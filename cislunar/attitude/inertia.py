"""Inertia of rigid bodies: validation, and the layout of the compiled kernels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError
from cislunar.runtime import Array

# Kinds of body-parameter deviation, see `cislunar.attitude.parameter_deviations`.
INERTIA, TORQUE = 0, 2


def inertia_matrix(inertia: ArrayLike) -> Array:
    """Inertia as a validated (3, 3) matrix.

    Parameters
    ----------
    inertia : array_like, shape (), (3,) or (3, 3)
        Moment of a spherical body, principal moments, or matrix in the body frame; kg m^2.

    Returns
    -------
    ndarray, shape (3, 3)
        Symmetric positive definite matrix.

    Raises
    ------
    ConfigurationError
        If the inertia is not physical: not symmetric, not positive definite, or one principal
        moment larger than the sum of the other two.
    """
    given = np.asarray(inertia, dtype=float)
    if given.shape not in ((), (3,), (3, 3)) or not np.all(np.isfinite(given)):
        raise ConfigurationError(
            f"inertia {given.tolist()} must be one moment, three moments or a 3 x 3 matrix, kg m^2"
        )
    matrix = given if given.ndim == 2 else np.eye(3) * given
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-9 * np.abs(matrix).max()):
        raise ConfigurationError(f"inertia {matrix.tolist()} must be symmetric")
    moments = np.linalg.eigvalsh(matrix)
    if moments[0] <= 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
        raise ConfigurationError(
            f"principal moments of inertia {moments.tolist()} must be positive, and none may "
            "exceed the sum of the other two"
        )
    return np.ascontiguousarray(0.5 * (matrix + matrix.T))


class RigidBodies(NamedTuple):
    """Inertia of many bodies, in the layout of the compiled kernels.

    Attributes
    ----------
    inertia, inverse : ndarray, shape (body, 3, 3)
        Inertia matrices and their inverses, body frame, any unit.
    spherical : ndarray of bool, shape (body,)
        Whether the principal moments agree to 1e-12, so that the torque-free angular velocity is
        constant.
    """

    inertia: Array
    inverse: Array
    spherical: NDArray[np.bool_]


def rigid_bodies(inertia: ArrayLike) -> RigidBodies:
    """Arrange the inertia of many bodies for the kernels.

    Parameters
    ----------
    inertia : array_like, shape (body, 3, 3)
        Body frame, any unit; each matrix is validated by `inertia_matrix`.

    Raises
    ------
    ConfigurationError
        If the inertia of a body is not physical; see `inertia_matrix`.
    """
    # most often all bodies are equal, and validating one takes longer than propagating it
    given, kind = np.unique(np.asarray(inertia, dtype=float), axis=0, return_inverse=True)
    matrices = np.array([inertia_matrix(matrix) for matrix in given])
    mean = np.trace(matrices, axis1=1, axis2=2)[:, None, None] / 3.0
    spherical = np.all(np.abs(matrices - mean * np.eye(3)) <= 1e-12 * mean, axis=(1, 2))
    kind = kind.ravel()
    return RigidBodies(matrices[kind], np.linalg.inv(matrices)[kind], spherical[kind])
