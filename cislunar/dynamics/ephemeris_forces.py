"""Ephemeris force models: Earth, Moon and Sun, solar radiation pressure, and the Moon's J2 and C22.

States are nondimensional (l* and t* of `cislunar.constants`), in the barycentric frame: relative to
the Earth-Moon barycenter, J2000 axes. Times count from an epoch. The optional parts of a model are
chosen by their types when a kernel is compiled, so that a step has no branches; `docs/dynamics.md`
derives every term.

Assumptions and limitations
---------------------------
- The origin is accelerated by the Sun alone. Planets are neglected (Jupiter moves a state by some
  0.6 m in a day), and so are the figure of the Earth and the Moon's beyond J2 and C22.
- Relativity is neglected; masses are those of DE421.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import implements, njit, njit_inline, njit_noalloc
from cislunar.constants import GM_UNIT_KM3_S2, LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics import forces
from cislunar.dynamics.forces import Nothing
from cislunar.dynamics.moon_figure import figure_at, figure_partials, figure_pull, moon_figure
from cislunar.dynamics.radiation import (
    RadiationOnEach,
    light,
    maybe_shaded,
    on_state,
    radiation,
    unshaded,
)
from cislunar.ephemeris.bodies import GM_EARTH, GM_MOON, GM_SUN, BodyTable, cubic, require_within
from cislunar.runtime import Array


class EphemerisForces(NamedTuple):
    """Force model of Earth, Moon and Sun as point masses, with optional parts.

    Attributes
    ----------
    epoch : float
        TDB seconds past J2000 of time zero.
    start, spacing : float
        First node of the table (TDB seconds past J2000) and spacing of the nodes, s.
    coefficients : ndarray, shape (intervals, 4, 9)
        See `cislunar.ephemeris.bodies.BodyTable`; nondimensional.
    gm_earth, gm_moon, gm_sun : float
        Gravitational parameters, nondimensional.
    radiation : Radiation, RadiationOnEach or Nothing
        See `cislunar.dynamics.radiation`.
    figure : MoonFigure or Nothing
        See `cislunar.dynamics.moon_figure`.
    """

    epoch: float
    start: float
    spacing: float
    coefficients: Array
    gm_earth: float
    gm_moon: float
    gm_sun: float
    radiation: tuple
    figure: tuple

    @property
    def table(self) -> BodyTable:
        """Table of the bodies, in km."""
        return BodyTable(self.start, self.spacing, self.coefficients * LENGTH_UNIT_KM)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time of the table, nondimensional, since the epoch."""
        length = self.spacing * len(self.coefficients)
        since = self.start - self.epoch
        return since / TIME_UNIT_S, (since + length) / TIME_UNIT_S

    @property
    def n_targets(self) -> int | None:
        """Number of targets that have a radiation pressure each; None if it is common."""
        each = isinstance(self.radiation, RadiationOnEach)
        return self.radiation.strength.size if each else None

    def of_targets(self, targets: NDArray[np.int64]) -> "EphemerisForces":
        """See `cislunar.dynamics.forces.of_targets`."""
        strength = self.radiation.strength[targets]
        return self._replace(radiation=self.radiation._replace(strength=strength))


def ephemeris_forces(
    table: BodyTable,
    epoch: float,
    *,
    area_to_mass: ArrayLike | None = None,
    reflectivity: ArrayLike = 1.3,
    figure: bool = True,
) -> EphemerisForces:
    """Build an ephemeris force model from a table of the bodies over all times of the propagation.

    `epoch` is time zero, TDB seconds past J2000. `area_to_mass` is the cross-section per mass,
    m^2/kg, and `reflectivity` the radiation pressure coefficient C_R (1 for absorption, 2 for
    specular reflection), of all states () or of each state of a bundle (N,); without the former
    there is no radiation pressure. `figure` includes J2 and C22 of the Moon."""
    require_within(table, epoch, epoch)
    return EphemerisForces(
        epoch=float(epoch),
        start=table.start,
        spacing=table.spacing,
        coefficients=table.coefficients / LENGTH_UNIT_KM,
        gm_earth=GM_EARTH / GM_UNIT_KM3_S2,
        gm_moon=GM_MOON / GM_UNIT_KM3_S2,
        gm_sun=GM_SUN / GM_UNIT_KM3_S2,
        radiation=Nothing() if area_to_mass is None else radiation(area_to_mass, reflectivity),
        figure=moon_figure(table) if figure else Nothing(),
    )


class Field(NamedTuple):
    """Positions of Earth, Moon and Sun, acceleration of the origin, and optional parts."""

    earth: tuple
    moon: tuple
    sun: tuple
    origin: tuple
    gm_earth: float
    gm_moon: float
    gm_sun: float
    radiation: tuple
    figure: tuple


class Gradient(NamedTuple):
    """Symmetric second derivatives, and direction and change of the radiation in a penumbra."""

    xx: float
    yy: float
    zz: float
    xy: float
    xz: float
    yz: float
    push: tuple
    change: tuple


@njit_inline
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit_inline
def _squared(a):
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]


@njit_inline
def _inverse_cube(a):
    r2 = _squared(a)
    return 1.0 / (r2 * np.sqrt(r2))


@njit_noalloc
def _interval(u, count):
    """Interval of a table and the fraction of it; the fraction is NaN beyond the table."""
    k = min(max(int(u), 0), count - 1)
    w = u - k
    return k, (w if -1e-5 < w < 1.00001 else np.nan)


@njit_inline
def _bodies_at(forces, t):
    """Positions of Earth, Moon and Sun, acceleration of the origin, and figure of the Moon."""
    c = forces.coefficients
    u = (t * TIME_UNIT_S + (forces.epoch - forces.start)) / forces.spacing
    k, w = _interval(u, c.shape[0])
    earth = cubic(c, k, 0, w), cubic(c, k, 1, w), cubic(c, k, 2, w)
    moon = cubic(c, k, 3, w), cubic(c, k, 4, w), cubic(c, k, 5, w)
    sun = cubic(c, k, 6, w), cubic(c, k, 7, w), cubic(c, k, 8, w)
    from_earth, from_moon = _minus(sun, earth), _minus(sun, moon)
    share = forces.gm_sun / (forces.gm_earth + forces.gm_moon)
    on_earth = share * forces.gm_earth * _inverse_cube(from_earth)
    on_moon = share * forces.gm_moon * _inverse_cube(from_moon)
    origin = (
        on_earth * from_earth[0] + on_moon * from_moon[0],
        on_earth * from_earth[1] + on_moon * from_moon[1],
        on_earth * from_earth[2] + on_moon * from_moon[2],
    )
    return earth, moon, sun, origin, figure_at(forces.figure, k, w)


@implements(forces.at, EphemerisForces)
def _at(forces, t):
    earth, moon, sun, origin, figure = _bodies_at(forces, t)
    return Field(
        earth,
        moon,
        sun,
        origin,
        forces.gm_earth,
        forces.gm_moon,
        forces.gm_sun,
        forces.radiation,
        figure,
    )


@implements(forces.of_state, EphemerisForces)
def _forces_of_state(forces, i):
    return EphemerisForces(
        forces.epoch,
        forces.start,
        forces.spacing,
        forces.coefficients,
        forces.gm_earth,
        forces.gm_moon,
        forces.gm_sun,
        on_state(forces.radiation, i),
        forces.figure,
    )


@njit(cache=True, inline="always")
def _lit_by(field, radiation):
    """The same field with another radiation."""
    return Field(
        field.earth,
        field.moon,
        field.sun,
        field.origin,
        field.gm_earth,
        field.gm_moon,
        field.gm_sun,
        radiation,
        field.figure,
    )


@implements(forces.of_state, Field)
def _field_of_state(field, i):
    return _lit_by(field, on_state(field.radiation, i))


@implements(forces.plain, Field)
def _without_shadow(field):
    return _lit_by(field, unshaded(field.radiation))


@implements(forces.is_special, Field)
@njit_inline
def _maybe_in_shadow(field, x, y, z):
    at = (x, y, z)
    return maybe_shaded(
        field.radiation, _minus(at, field.earth), _minus(at, field.moon), _minus(at, field.sun)
    )


@implements(forces.is_calm, Field)
@njit_inline
def _is_calm(field, x, y, z, dt):
    # shadows are ignored: no step of either order ends at their edges
    at = (x, y, z)
    earth = field.gm_earth * _inverse_cube(_minus(at, field.earth))
    moon = field.gm_moon * _inverse_cube(_minus(at, field.moon))
    return max(earth, moon) * dt * dt < forces.CALM_STEP**2


@implements(forces.acceleration, Field)
@njit_inline
def _acceleration(field, x, y, z, vx, vy, vz):
    at = (x, y, z)
    from_earth, from_moon = _minus(at, field.earth), _minus(at, field.moon)
    from_sun = _minus(at, field.sun)
    mx, my, mz = from_moon
    m2 = _squared(from_moon)
    earth = field.gm_earth * _inverse_cube(from_earth)
    moon = field.gm_moon / (m2 * np.sqrt(m2))
    # Radiation acts like a reduction of the Sun's gravity.
    strength = light(field.radiation, from_earth, from_moon, from_sun)[0]
    sun = (field.gm_sun - strength) * _inverse_cube(from_sun)
    fx, fy, fz = figure_pull(field.figure, mx, my, mz, m2)
    return (
        fx - earth * from_earth[0] - moon * mx - sun * from_sun[0] - field.origin[0],
        fy - earth * from_earth[1] - moon * my - sun * from_sun[1] - field.origin[1],
        fz - earth * from_earth[2] - moon * mz - sun * from_sun[2] - field.origin[2],
    )


@implements(forces.partials, Field)
@njit_inline
def _partials(field, x, y, z, vx, vy, vz):
    at = (x, y, z)
    from_earth, from_moon = _minus(at, field.earth), _minus(at, field.moon)
    from_sun = _minus(at, field.sun)
    ex, ey, ez = from_earth
    mx, my, mz = from_moon
    sx, sy, sz = from_sun
    m2 = _squared(from_moon)
    strength, lx, ly, lz = light(field.radiation, from_earth, from_moon, from_sun)
    sun_cube = _inverse_cube(from_sun)
    e = field.gm_earth * _inverse_cube(from_earth)
    m = field.gm_moon / (m2 * np.sqrt(m2))
    s = (field.gm_sun - strength) * sun_cube
    pull = e + m + s
    e5, m5, s5 = 3.0 * e / _squared(from_earth), 3.0 * m / m2, 3.0 * s / _squared(from_sun)
    fxx, fyy, fzz, fxy, fxz, fyz = figure_partials(field.figure, mx, my, mz, m2)
    return Gradient(
        fxx - pull + e5 * ex * ex + m5 * mx * mx + s5 * sx * sx,
        fyy - pull + e5 * ey * ey + m5 * my * my + s5 * sy * sy,
        fzz - pull + e5 * ez * ez + m5 * mz * mz + s5 * sz * sz,
        fxy + e5 * ex * ey + m5 * mx * my + s5 * sx * sy,
        fxz + e5 * ex * ez + m5 * mx * mz + s5 * sx * sz,
        fyz + e5 * ey * ez + m5 * my * mz + s5 * sy * sz,
        (sun_cube * sx, sun_cube * sy, sun_cube * sz),
        (lx, ly, lz),
    )


@implements(forces.acceleration_change, Gradient)
@njit_inline
def _acceleration_change(g, dx, dy, dz, dvx, dvy, dvz):
    change = g.change[0] * dx + g.change[1] * dy + g.change[2] * dz
    return (
        g.xx * dx + g.xy * dy + g.xz * dz + g.push[0] * change,
        g.xy * dx + g.yy * dy + g.yz * dz + g.push[1] * change,
        g.xz * dx + g.yz * dy + g.zz * dz + g.push[2] * change,
    )
