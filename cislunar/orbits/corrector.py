"""Differential correction of periodic orbits.

By the mirror theorem an orbit that crosses the xz-plane perpendicularly twice is periodic: its
period is twice the time of flight between the crossings. A crossing is written
``u = (x, z, vy, tau)`` with state ``(x, 0, z, 0, vy, 0)`` and half period tau, and the half orbit
is closed when ``F(u) = (y, vx, vz)(tau) = 0``. The time of flight being an unknown, no event is
detected, and an orbit that goes round many times is corrected like any other.

Orbits symmetric about the x axis cross it perpendicularly twice; in their crossings vz stands in
place of z, and F is ``(y, vx, z)(tau)``. An orbit without symmetry starts where it crosses a plane
of constant x and is closed when it comes back to its state: see `Section`.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import MU
from cislunar.dynamics.cr3bp import CR3BP, equations_of_motion, jacobi_constant
from cislunar.dynamics.propagation import propagate_stm
from cislunar.errors import ConvergenceError

Array = NDArray[np.float64]
Constraint = Callable[[Array], tuple[float, Array]]

X, Z, VY, HALF_PERIOD = range(4)
TOLERANCE = 2e-12
STAGNATION_TOLERANCE = 1e-10
NEGLIGIBLE_STEP = 1e-13
MAX_ITERATIONS = 25
STEP_LIMIT = 0.2


class Section(NamedTuple):
    """Where orbits start and how they are closed."""

    start: tuple[int, ...]
    """Components of the state that a crossing holds before its time of flight."""
    closed: tuple[int, ...]
    """Components that vanish after the time of flight, or come back if the orbit is `whole`."""
    flat: tuple[tuple[int, ...], tuple[int, ...]]
    """Rows of `closed` and entries of a crossing that count within the plane."""
    whole: bool = False
    """Whether the time of flight is the period, not half of it."""
    x: float = 0.0
    """Of the plane that an orbit starts on, if it is whole."""


PLANE = Section((0, 2, 4), (1, 3, 5), ((0, 1), (X, VY, HALF_PERIOD)))
"""Perpendicular crossings of the xz-plane."""

AXIS = Section((0, 5, 4), (1, 3, 2), ((0, 1), (X, VY, HALF_PERIOD)))
"""Perpendicular crossings of the x axis, with vz in place of z."""


def at_x(x: float) -> Section:
    """Crossings ``(y, z, vx, vy, vz, period)`` of the plane at x, by orbits without symmetry."""
    return Section((1, 2, 3, 4, 5), (0, 1, 2, 3, 4, 5), ((0, 1, 3, 4), (0, 2, 3, 5)), True, x)


class HalfOrbit(NamedTuple):
    """A closed half orbit, from one perpendicular crossing to the next (or a whole one)."""

    crossing: Array
    """(x, z, vy, tau) at the start, nondimensional."""
    end: Array
    """State at tau: the opposite perpendicular crossing."""
    stm: Array
    """State transition matrix over tau, shape (6, 6)."""
    jacobian: Array
    """Derivative of (y, vx, vz)(tau) with respect to the crossing, shape (3, 4)."""
    iterations: int
    """Newton iterations spent."""
    section: Section = PLANE
    """Where it starts and ends."""

    @property
    def state(self) -> Array:
        """State at the crossing, shape (6,)."""
        return crossing_state(self.crossing, self.section)

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


def crossing_state(crossing: ArrayLike, section: Section = PLANE) -> Array:
    """State of a crossing, ``(x, 0, z, 0, vy, 0)`` in the xz-plane."""
    state = np.zeros(6)
    state[0] = section.x
    state[list(section.start)] = np.asarray(crossing, dtype=float)[:-1]
    return state


def shoot(crossing: ArrayLike, mu: float = MU, section: Section = PLANE) -> HalfOrbit:
    """Integrate a half orbit and its derivatives, without correcting it.

    Parameters
    ----------
    crossing : array_like, shape (4,)
        (x, z, vy, tau), nondimensional.
    mu : float
        Mass ratio.
    section : Section
        Where it starts, and how it is closed.

    Returns
    -------
    HalfOrbit

    Raises
    ------
    ConvergenceError
        If the trajectory collides with a primary.
    """
    u, closed = np.array(crossing, dtype=float), list(section.closed)
    end, stm = propagate_stm(crossing_state(u, section), u[-1], forces=CR3BP(mu))
    jacobian = np.empty((len(closed), u.size))
    change = stm - np.eye(6) if section.whole else stm
    jacobian[:, :-1] = change[np.ix_(closed, section.start)]
    jacobian[:, -1] = equations_of_motion(end, mu)[closed]
    return HalfOrbit(u, end, stm, jacobian, 0, section)


def fix_coordinate(index: int, value: float) -> Constraint:
    """Constraint u[index] = value (index 3: half the period)."""
    gradient = np.eye(4)[index]
    return lambda u: (u[index] - value, gradient)


def hyperplane(point: Array, normal: Array) -> Constraint:
    """Constraint (u - point) . normal = 0."""
    return lambda u: (float((u - point) @ normal), normal)


def fix_jacobi(value: float, mu: float = MU) -> Constraint:
    """Constraint JC(u) = value."""

    def constraint(u: Array) -> tuple[float, Array]:
        state = crossing_state(u)
        # grad JC = 2 grad U - 2 v; at rest, the equations of motion return grad U itself.
        force = equations_of_motion([u[X], 0.0, u[Z], 0.0, 0.0, 0.0], mu)
        gradient = np.array([2.0 * force[3], 2.0 * force[5], -2.0 * u[VY], 0.0])
        return float(jacobi_constant(state, mu)) - value, gradient

    return constraint


def correct(
    crossing: ArrayLike,
    constraint: Constraint,
    mu: float = MU,
    *,
    max_iterations: int = MAX_ITERATIONS,
    section: Section = PLANE,
) -> HalfOrbit:
    """Close a half orbit by Newton's method under one scalar constraint.

    A guess with z = 0 is corrected within the plane, where z and vz drop out: this keeps the
    system regular at the bifurcations out of the plane.

    Parameters
    ----------
    crossing : array_like, shape (4,)
        Guess (x, z, vy, tau), nondimensional.
    constraint : callable
        Takes a crossing, returns a value to be driven to zero and its gradient, shape (4,).
    mu : float
        Mass ratio.
    max_iterations : int
        Bound on the Newton iterations.
    section : Section
        Where the orbit starts, and how it is closed.

    Returns
    -------
    HalfOrbit
        With residual below 2e-12 relative to the speed at the far crossing, or below 1e-10 and
        stagnated or no longer moving the crossing.

    Raises
    ------
    ConvergenceError
        If the iteration diverges, stalls, or loses its half period.
    """
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
        if residual >= best_residual and best_residual < STAGNATION_TOLERANCE:
            return best
        if residual < best_residual:
            best, best_residual = half._replace(iterations=iteration), residual
        system = np.vstack([half.jacobian, gradient])[np.ix_(rows, columns)]
        right = np.append(missed, offset)[rows]
        try:
            if section.whole:  # one equation more than unknowns: the Jacobi constant closes itself
                step = np.linalg.lstsq(system, right, rcond=None)[0]
            else:
                step = np.linalg.solve(system, right)
        except np.linalg.LinAlgError:
            raise ConvergenceError(f"singular correction at crossing {u.tolist()}") from None
        largest = np.abs(step).max()
        if not np.isfinite(largest):
            break
        if residual < STAGNATION_TOLERANCE and largest < NEGLIGIBLE_STEP:
            return half._replace(iterations=iteration)
        u[columns] -= step * min(1.0, STEP_LIMIT / largest)
        if u[-1] <= 0.0:
            break
    if best_residual < STAGNATION_TOLERANCE:
        return best
    raise ConvergenceError(
        f"no periodic orbit near crossing {np.asarray(crossing).tolist()} (state, time of flight): "
        f"residual {best_residual:.2g} within {max_iterations} Newton iterations; start closer"
    )
