"""Gravity of the Moon's figure, J2 and C22, as a quadrupole in J2000 axes.

The second degree of the potential is ``GM R^2 (r . Q r) / r^5`` with a symmetric matrix Q that
rotates with the Moon (`docs/dynamics.md`). Its six entries are tabulated in time, so that no angle
is evaluated for a state. The orientation is that of `cislunar.ephemeris.bodies.moon_axes`.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.compiled import implements, njit_inline
from cislunar.constants import GM_UNIT_KM3_S2, LENGTH_UNIT_KM
from cislunar.dynamics.forces import Nothing
from cislunar.ephemeris.bodies import GM_MOON, BodyTable, cubic, hermite, moon_axes
from cislunar.runtime import Array

# GRGM900C (Lemoine et al. 2014, Geophys. Res. Lett. 41, 3382), in principal axes, denormalized.
MOON_J2 = 9.0881248e-5 * sqrt(5.0)
MOON_C22 = 3.4674086e-5 * sqrt(5.0 / 12.0)
MOON_GRAVITY_RADIUS_KM = 1738.0

_ENTRIES = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)


class MoonFigure(NamedTuple):
    """Second degree of the Moon's gravity: cubics (intervals, 4, 6) of the entries xx, yy, zz, xy,
    xz, yz of GM R^2 Q (`_moon_quadrupole`) between the nodes of the bodies' table, nondimensional,
    J2000 axes."""

    coefficients: Array


def _moon_quadrupole(axes: ArrayLike) -> Array:
    """Matrix Q of the Moon's second degree, (..., 3, 3), symmetric and trace-free: -J2 / 2 (3 Z Z'
    - 1) + 3 C22 (X X' - Y Y'), with the Moon's axes X, Y, Z in the rows of `axes`; the potential is
    GM R^2 (r . Q r) / r^5."""
    x, y, z = np.moveaxis(np.asarray(axes, dtype=float), -2, 0)

    def square(axis: Array) -> Array:
        return axis[..., :, None] * axis[..., None, :]

    zonal = -0.5 * MOON_J2 * (3.0 * square(z) - np.eye(3))
    return zonal + 3.0 * MOON_C22 * (square(x) - square(y))


def moon_figure(table: BodyTable) -> MoonFigure:
    """The Moon's figure at the nodes of a table of the bodies."""

    def entries(time: Array) -> Array:
        return _moon_quadrupole(moon_axes(time))[:, *_ENTRIES]

    nodes = table.start + table.spacing * np.arange(len(table.coefficients) + 1)
    slope = (entries(nodes + 30.0) - entries(nodes - 30.0)) / 60.0
    scale = GM_MOON / GM_UNIT_KM3_S2 * (MOON_GRAVITY_RADIUS_KM / LENGTH_UNIT_KM) ** 2
    return MoonFigure(scale * hermite(entries(nodes), slope * table.spacing))


class _Quadrupole(NamedTuple):
    """Entries of GM R^2 Q at a time."""

    xx: float
    yy: float
    zz: float
    xy: float
    xz: float
    yz: float


def figure_at(figure, k, w):
    """The figure at the fraction w of interval k of its table."""
    raise NotImplementedError


def figure_pull(figure, x, y, z, r2):
    """Acceleration due to the figure at a position relative to the Moon's center."""
    raise NotImplementedError


def figure_partials(figure, x, y, z, r2):
    """Derivatives xx, yy, zz, xy, xz, yz of `figure_pull`."""
    raise NotImplementedError


@implements(figure_at, Nothing)
def _no_figure_at(figure, k, w):
    return figure


@implements(figure_at, MoonFigure)
@njit_inline
def _moon_figure_at(figure, k, w):
    c = figure.coefficients
    return _Quadrupole(
        cubic(c, k, 0, w),
        cubic(c, k, 1, w),
        cubic(c, k, 2, w),
        cubic(c, k, 3, w),
        cubic(c, k, 4, w),
        cubic(c, k, 5, w),
    )


@implements(figure_pull, Nothing)
def _no_pull(figure, x, y, z, r2):
    return 0.0, 0.0, 0.0


@implements(figure_pull, _Quadrupole)
@njit_inline
def _quadrupole_pull(figure, x, y, z, r2):
    qx = figure.xx * x + figure.xy * y + figure.xz * z
    qy = figure.xy * x + figure.yy * y + figure.yz * z
    qz = figure.xz * x + figure.yz * y + figure.zz * z
    by_r5 = 1.0 / (r2 * r2 * np.sqrt(r2))
    radial = 5.0 * (x * qx + y * qy + z * qz) / r2
    return (
        by_r5 * (2.0 * qx - radial * x),
        by_r5 * (2.0 * qy - radial * y),
        by_r5 * (2.0 * qz - radial * z),
    )


@implements(figure_partials, Nothing)
def _no_partials(figure, x, y, z, r2):
    return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@implements(figure_partials, _Quadrupole)
@njit_inline
def _quadrupole_partials(figure, x, y, z, r2):
    qx = figure.xx * x + figure.xy * y + figure.xz * z
    qy = figure.xy * x + figure.yy * y + figure.yz * z
    qz = figure.xz * x + figure.yz * y + figure.zz * z
    by_r5 = 1.0 / (r2 * r2 * np.sqrt(r2))
    by_r7 = 10.0 * by_r5 / r2
    product = x * qx + y * qy + z * qz
    level = -0.5 * by_r7 * product
    both = 3.5 * by_r7 * product / r2
    return (
        2.0 * by_r5 * figure.xx - 2.0 * by_r7 * qx * x + level + both * x * x,
        2.0 * by_r5 * figure.yy - 2.0 * by_r7 * qy * y + level + both * y * y,
        2.0 * by_r5 * figure.zz - 2.0 * by_r7 * qz * z + level + both * z * z,
        2.0 * by_r5 * figure.xy - by_r7 * (qx * y + qy * x) + both * x * y,
        2.0 * by_r5 * figure.xz - by_r7 * (qx * z + qz * x) + both * x * z,
        2.0 * by_r5 * figure.yz - by_r7 * (qy * z + qz * y) + both * y * z,
    )
