"""The circular restricted three-body problem (Paul & Fan, section 2.1).

All quantities are nondimensional and in the rotating barycentric frame: x points from the Earth (at
``[-mu, 0, 0]``) to the Moon (at ``[1 - mu, 0, 0]``), z along the angular momentum of the primaries.
A state is ``(x, y, z, vx, vy, vz)``.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from cislunar.compiled import implements, njit_inline
from cislunar.constants import MU
from cislunar.dynamics import forces
from cislunar.errors import ConfigurationError
from cislunar.runtime import Array, array_of, number_of, vectors_of


class CR3BP(NamedTuple):
    """Force model of two primaries on circular orbits, in their rotating frame; `mu` is their mass
    ratio."""

    mu: float = MU


EARTH_MOON = CR3BP()
"""The Earth-Moon system of the paper."""


@register_jitable(inline="always")
def primary_positions(mu):
    """Positions of the Earth and of the Moon, nondimensional, rotating frame (compiled)."""
    return (-mu, 0.0, 0.0), (1.0 - mu, 0.0, 0.0)


class Hessian(NamedTuple):
    """Second derivatives of the pseudo-potential U at a point."""

    xx: float
    yy: float
    zz: float
    xy: float
    xz: float
    yz: float


@implements(forces.at, CR3BP)
def _at(forces, t):
    return forces


@implements(forces.acceleration, CR3BP)
@njit_inline
def _acceleration(field, x, y, z, vx, vy, vz):
    """Equations 1-3 of Paul & Fan."""
    mu = field.mu
    x_earth = x + mu
    x_moon = x_earth - 1.0
    yz2 = y * y + z * z
    d2 = x_earth * x_earth + yz2
    r2 = x_moon * x_moon + yz2
    earth = (1.0 - mu) / (d2 * np.sqrt(d2))
    moon = mu / (r2 * np.sqrt(r2))
    pull = earth + moon
    ax = 2.0 * vy + x - earth * x_earth - moon * x_moon
    ay = -2.0 * vx + y - pull * y
    az = -pull * z
    return ax, ay, az


@implements(forces.is_calm, CR3BP)
@njit_inline
def _is_calm(field, x, y, z, dt):
    x_earth = x + field.mu
    x_moon = x_earth - 1.0
    yz2 = y * y + z * z
    d2 = x_earth * x_earth + yz2
    r2 = x_moon * x_moon + yz2
    rate2 = max((1.0 - field.mu) / (d2 * np.sqrt(d2)), field.mu / (r2 * np.sqrt(r2)))
    return rate2 * dt * dt < forces.CALM_STEP**2


@implements(forces.partials, CR3BP)
@njit_inline
def _hessian(field, x, y, z, vx, vy, vz):
    """Second derivatives of the pseudo-potential."""
    mu = field.mu
    x_earth = x + mu
    x_moon = x_earth - 1.0
    yz2 = y * y + z * z
    d2 = x_earth * x_earth + yz2
    r2 = x_moon * x_moon + yz2
    earth3 = (1.0 - mu) / (d2 * np.sqrt(d2))
    moon3 = mu / (r2 * np.sqrt(r2))
    earth5 = 3.0 * earth3 / d2
    moon5 = 3.0 * moon3 / r2
    pull = earth3 + moon3
    both5 = earth5 + moon5
    mixed = earth5 * x_earth + moon5 * x_moon
    uxx = 1.0 - pull + earth5 * x_earth * x_earth + moon5 * x_moon * x_moon
    uyy = 1.0 - pull + both5 * y * y
    uzz = -pull + both5 * z * z
    return Hessian(uxx, uyy, uzz, mixed * y, mixed * z, both5 * y * z)


@implements(forces.acceleration_change, Hessian)
@njit_inline
def _acceleration_change(u, dx, dy, dz, dvx, dvy, dvz):
    """Rows of [U_rr, 2J] with J = [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]."""
    return (
        u.xx * dx + u.xy * dy + u.xz * dz + 2.0 * dvy,
        u.xy * dx + u.yy * dy + u.yz * dz - 2.0 * dvx,
        u.xz * dx + u.yz * dy + u.zz * dz,
    )


def primary_distances(position: ArrayLike, mu: float = MU) -> tuple[Array, Array]:
    """Distances to the Earth and to the Moon (Paul & Fan, eq. 4).

    Parameters
    ----------
    position : array_like, shape (..., 3) or (..., 6)
        Positions (or states), nondimensional, rotating frame.
    mu : float
        Mass ratio.

    Returns
    -------
    d, r : ndarray, shape (...)
        Distance to the Earth and to the Moon, nondimensional.

    Raises
    ------
    ConfigurationError
        If the last axis of `position` has another length, or a value is not a number.
    """
    p = vectors_of("position", position, 3, 6)
    off_axis2 = p[..., 1] ** 2 + p[..., 2] ** 2
    d = np.sqrt((p[..., 0] + mu) ** 2 + off_axis2)
    r = np.sqrt((p[..., 0] - 1.0 + mu) ** 2 + off_axis2)
    return d, r


def equations_of_motion(state: ArrayLike, mu: float = MU) -> Array:
    """Time derivative ``(vx, vy, vz, ax, ay, az)`` of states (Paul & Fan, eqs. 1-3).

    Parameters
    ----------
    state : array_like, shape (..., 6)
        Nondimensional, rotating frame.
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray, shape (..., 6)
        Nondimensional, rotating frame.

    Raises
    ------
    ConfigurationError
        If the last axis of `state` has another length, or a value is not a number.
    """
    s = vectors_of("state", state, 6)
    d, r = primary_distances(s, mu)
    earth = (1.0 - mu) / d**3
    moon = mu / r**3
    derivative = np.empty_like(s)
    derivative[..., :3] = s[..., 3:]
    derivative[..., 3] = (
        2.0 * s[..., 4] + s[..., 0] - earth * (s[..., 0] + mu) - moon * (s[..., 0] - 1.0 + mu)
    )
    derivative[..., 4] = -2.0 * s[..., 3] + s[..., 1] - (earth + moon) * s[..., 1]
    derivative[..., 5] = -(earth + moon) * s[..., 2]
    return derivative


def pseudo_potential(position: ArrayLike, mu: float = MU) -> Array:
    """Pseudo-potential U = (x^2 + y^2)/2 + (1 - mu)/d + mu/r (Paul & Fan, eq. 5).

    Parameters
    ----------
    position : array_like, shape (..., 3) or (..., 6)
        Nondimensional, rotating frame.
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray, shape (...)
        Nondimensional.

    Raises
    ------
    ConfigurationError
        If the last axis of `position` has another length, or a value is not a number.
    """
    p = vectors_of("position", position, 3, 6)
    d, r = primary_distances(p, mu)
    return 0.5 * (p[..., 0] ** 2 + p[..., 1] ** 2) + (1.0 - mu) / d + mu / r


def jacobi_constant(state: ArrayLike, mu: float = MU) -> Array:
    """Jacobi constant JC = 2U - v^2 (Paul & Fan, section 2.1).

    Parameters
    ----------
    state : array_like, shape (..., 6)
        Nondimensional, rotating frame.
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray, shape (...)
        Nondimensional.

    Raises
    ------
    ConfigurationError
        If the last axis of `state` has another length, or a value is not a number.
    """
    s = vectors_of("state", state, 6)
    return 2.0 * pseudo_potential(s, mu) - np.sum(s[..., 3:] ** 2, axis=-1)


def variational_matrix(state: ArrayLike, mu: float = MU) -> Array:
    """Jacobian A of the equations of motion; the STM obeys dPhi/dt = A Phi.

    Parameters
    ----------
    state : array_like, shape (6,)
        Nondimensional, rotating frame.
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray, shape (6, 6)
        ``[[0, I], [U_rr, 2 J]]`` with ``J = [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]``.

    Raises
    ------
    ConfigurationError
        If the state is not of 6 numbers.
    """
    second = _hessian(CR3BP(mu), *array_of("state", state, (6,), finite=False))
    matrix = np.zeros((6, 6))
    matrix[:3, 3:] = np.eye(3)
    matrix[3:] = np.transpose([_acceleration_change(second, *change) for change in np.eye(6)])
    return matrix


def libration_points(mu: float = MU) -> Array:
    """The five libration points, where the gradient of U vanishes.

    Parameters
    ----------
    mu : float
        Mass ratio, ``0 < mu <= 0.5``.

    Returns
    -------
    ndarray, shape (5, 3)
        L1 (between the primaries), L2 (beyond the Moon), L3 (beyond the Earth), L4 (leading)
        and L5 (trailing); nondimensional, rotating frame.

    Raises
    ------
    ConfigurationError
        If the mass ratio lies outside of (0, 0.5].
    """
    if not 0.0 < number_of("mu", mu) <= 0.5:
        raise ConfigurationError(f"mass ratio mu = {mu} must lie in (0, 0.5]")

    def axial_force(x: float) -> float:
        return equations_of_motion([x, 0.0, 0.0, 0.0, 0.0, 0.0], mu)[3]

    edge = 1e-9
    collinear = [
        brentq(axial_force, -mu + edge, 1.0 - mu - edge, xtol=1e-15, rtol=1e-15),
        brentq(axial_force, 1.0 - mu + edge, 2.0, xtol=1e-15, rtol=1e-15),
        brentq(axial_force, -2.0, -mu - edge, xtol=1e-15, rtol=1e-15),
    ]
    points = np.zeros((5, 3))
    points[:3, 0] = collinear
    points[3:, 0] = 0.5 - mu
    points[3:, 1] = [np.sqrt(3.0) / 2.0, -np.sqrt(3.0) / 2.0]
    return points


def zero_velocity_function(position: ArrayLike, jacobi: ArrayLike, mu: float = MU) -> Array:
    """Squared speed 2U - JC that a particle of Jacobi constant JC would have at a position.

    The zero-velocity surface is its zero set; negative values mark the forbidden region
    (Paul & Fan, section 2.1).

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Nondimensional, rotating frame.
    jacobi : array_like, broadcastable to (...)
        Jacobi constant.
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray, shape (...)
        Nondimensional squared speed.

    Raises
    ------
    ConfigurationError
        If the last axis of `position` has another length, or a value is not a number.
    """
    return 2.0 * pseudo_potential(position, mu) - array_of("jacobi", jacobi, finite=False)
