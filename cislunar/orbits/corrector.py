"""Differential correction of periodic orbits.

By the mirror theorem, an orbit that crosses the xz-plane perpendicularly twice is periodic, with a
period of twice the time of flight between the crossings. A crossing is ``u = (x, z, vy, tau)`` with
the state ``(x, 0, z, 0, vy, 0)`` and the half period tau. The half orbit is closed when
``F(u) = (y, vx, vz)(tau) = 0``. Because the time of flight is an unknown, no event detection is
needed, and orbits of several revolutions are corrected like any other.

Orbits that are symmetric about the x axis cross it perpendicularly twice; in their crossings vz
replaces z, and F is ``(y, vx, z)(tau)``. An orbit without symmetry starts where it crosses a plane
of constant x and is closed when it returns to its initial state; see `Section`.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import MU
from cislunar.dynamics import CR3BP, equations_of_motion, propagate_stm
from cislunar.errors import ConvergenceError
from cislunar.runtime import Array

_Constraint = Callable[[Array], tuple[float, Array]]

X, Z, VY, HALF_PERIOD = range(4)
TOLERANCE = 2e-12
_STAGNATION_TOLERANCE = 1e-10
_NEGLIGIBLE_STEP = 1e-13
MAX_ITERATIONS = 25
_STEP_LIMIT = 0.2


class Section(NamedTuple):
    """Section on which orbits start, and the condition that closes them."""

    start: tuple[int, ...]
    """Components of the state that a crossing holds before its time of flight."""
    closed: tuple[int, ...]
    """Components that vanish after the time of flight, or return to their values if `whole`."""
    flat: tuple[tuple[int, ...], tuple[int, ...]]
    """Rows of `closed` and entries of a crossing that are relevant within the xy-plane."""
    whole: bool = False
    """Whether the time of flight is the whole period instead of half of it."""
    x: float = 0.0
    """x of the section if the orbit is `whole`, nondimensional."""


_PLANE = Section((0, 2, 4), (1, 3, 5), ((0, 1), (X, VY, HALF_PERIOD)))
"""Perpendicular crossings of the xz-plane."""

AXIS = Section((0, 5, 4), (1, 3, 2), ((0, 1), (X, VY, HALF_PERIOD)))
"""Perpendicular crossings of the x axis, with vz in place of z."""


def at_x(x: float) -> Section:
    """Section at constant x for orbits without symmetry: ``(y, z, vx, vy, vz, period)``."""
    return Section((1, 2, 3, 4, 5), (0, 1, 2, 3, 4, 5), ((0, 1, 3, 4), (0, 2, 3, 5)), True, x)


class HalfOrbit(NamedTuple):
    """A closed half orbit between perpendicular crossings, or a whole orbit without symmetry."""

    crossing: Array
    """(x, z, vy, tau) at the start, nondimensional."""
    end: Array
    """State at tau: the opposite perpendicular crossing, nondimensional, rotating frame."""
    stm: Array
    """State transition matrix over tau, shape (6, 6)."""
    jacobian: Array
    """Derivative of (y, vx, vz)(tau) with respect to the crossing, shape (3, 4)."""
    iterations: int
    """Number of Newton iterations."""
    section: Section = _PLANE
    """Section on which the orbit starts."""

    @property
    def state(self) -> Array:
        """State at the crossing, shape (6,)."""
        return _crossing_state(self.crossing, self.section)

    @property
    def period(self) -> float:
        """Full period, nondimensional."""
        return (1.0 if self.section.whole else 2.0) * float(self.crossing[-1])

    @property
    def planar(self) -> bool:
        """Whether the orbit lies in the plane of the primaries."""
        return _planar(self.crossing, self.section)


def _planar(crossing: Array, section: Section) -> bool:
    return crossing[Z] == 0.0 and not (section.whole and crossing[4] != 0.0)


def _crossing_state(crossing: ArrayLike, section: Section = _PLANE) -> Array:
    """State of a crossing, ``(x, 0, z, 0, vy, 0)`` in the xz-plane."""
    state = np.zeros(6)
    state[0] = section.x
    state[list(section.start)] = np.asarray(crossing, dtype=float)[:-1]
    return state


def shoot(crossing: ArrayLike, mu: float = MU, section: Section = _PLANE) -> HalfOrbit:
    """Integrate a half orbit from a crossing (4,) of a section, and its derivatives, without
    correction; raises a `ConvergenceError` if the trajectory collides with a primary."""
    u, closed = np.array(crossing, dtype=float), list(section.closed)
    end, stm = propagate_stm(_crossing_state(u, section), u[-1], forces=CR3BP(mu))
    jacobian = np.empty((len(closed), u.size))
    change = stm - np.eye(6) if section.whole else stm
    jacobian[:, :-1] = change[np.ix_(closed, section.start)]
    jacobian[:, -1] = equations_of_motion(end, mu)[closed]
    return HalfOrbit(u, end, stm, jacobian, 0, section)


def fix_coordinate(index: int, value: float) -> _Constraint:
    """Constraint u[index] = value (index 3 is the half period)."""
    gradient = np.eye(4)[index]
    return lambda u: (u[index] - value, gradient)


def hyperplane(point: Array, normal: Array) -> _Constraint:
    """Constraint (u - point) . normal = 0."""
    return lambda u: (float((u - point) @ normal), normal)


def correct(
    crossing: ArrayLike,
    constraint: _Constraint,
    mu: float = MU,
    *,
    max_iterations: int = MAX_ITERATIONS,
    section: Section = _PLANE,
) -> HalfOrbit:
    """Close a half orbit by Newton's method under one scalar constraint.

    `constraint` takes a crossing (4,) and returns a value to be driven to zero and its gradient
    (4,). A guess with z = 0 is corrected within the plane, without z and vz; this keeps the system
    regular at bifurcations out of the plane. The residual is below 2e-12 relative to the speed at
    the far crossing, or below 1e-10 if the iteration stagnates or no longer changes the crossing. A
    `ConvergenceError` is raised if the iteration diverges, stalls, or loses its half period."""
    u = np.array(crossing, dtype=float)
    rows, columns = list(range(len(section.closed))), list(range(u.size))
    if _planar(u, section):
        rows, columns = (list(each) for each in section.flat)
    rows.append(len(section.closed))
    best, best_residual = None, np.inf
    for iteration in range(max_iterations):
        half = shoot(u, mu, section)
        offset, gradient = constraint(u)
        missed = (half.end - half.state if section.whole else half.end)[list(section.closed)]
        # At a crossing close to a primary the speed, and with it roundoff, is large.
        closure = np.abs(missed).max() / max(1.0, float(np.linalg.norm(half.end[3:])))
        residual = max(closure, abs(offset))
        if residual < TOLERANCE:
            return half._replace(iterations=iteration)
        if residual >= best_residual and best_residual < _STAGNATION_TOLERANCE:
            return best
        if residual < best_residual:
            best, best_residual = half._replace(iterations=iteration), residual
        system = np.vstack([half.jacobian, gradient])[np.ix_(rows, columns)]
        right = np.append(missed, offset)[rows]
        try:
            if section.whole:  # one redundant equation: the Jacobi constant is conserved
                step = np.linalg.lstsq(system, right, rcond=None)[0]
            else:
                step = np.linalg.solve(system, right)
        except np.linalg.LinAlgError:
            raise ConvergenceError(f"singular correction at crossing {u.tolist()}") from None
        largest = np.abs(step).max()
        if not np.isfinite(largest):
            break
        if residual < _STAGNATION_TOLERANCE and largest < _NEGLIGIBLE_STEP:
            return half._replace(iterations=iteration)
        u[columns] -= step * min(1.0, _STEP_LIMIT / largest)
        if u[-1] <= 0.0:
            break
    if best_residual < _STAGNATION_TOLERANCE:
        return best
    raise ConvergenceError(
        f"no periodic orbit near crossing {np.asarray(crossing).tolist()} (state, time of flight): "
        f"residual {best_residual:.2g} within {max_iterations} Newton iterations; start closer"
    )
