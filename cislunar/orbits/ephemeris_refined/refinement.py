"""Refinement of CR3BP orbits by multiple shooting with Earth, Moon and Sun from the ephemeris.

The unknowns are the states x_i at the nodes t_0 .. t_n and the times of the interior nodes; the
residuals are the mismatches of each arc, propagated under the forces, with the next state. Newton's
method with the least-norm change -D^T (D D^T)^-1 F, where D is the Jacobian, solves

    F_i = phi(x_i; t_i, t_(i+1)) - x_(i+1) = 0,      i = 0 .. n - 1.

`docs/dynamics.md` derives D, and explains the step control and why the times are unknowns.

Assumptions and limitations
---------------------------
- The states at the ends are free like the others. The result is a path near the orbit, not one from
  a given state.
- There are no maneuvers; navigation errors and station keeping are not included.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import cho_solve_banded, cholesky_banded

from cislunar.compiled import njit
from cislunar.constants import (
    EARTH_RADIUS_KM,
    LENGTH_UNIT_KM,
    MOON_RADIUS_KM,
    SECONDS_PER_DAY,
    TIME_UNIT_S,
)
from cislunar.dynamics.adaptive.runge_kutta import DOP853, OK, integrate
from cislunar.dynamics.ephemeris import UNITS
from cislunar.dynamics.ephemeris_forces import EphemerisForces
from cislunar.dynamics.propagation import propagate
from cislunar.ephemeris.bodies import BODY_COLUMNS, GM_EARTH, GM_MOON, read_table
from cislunar.errors import ConvergenceError
from cislunar.orbits.ephemeris_refined.reference_tracking import (
    CLOCK_STEP_S,
    flow,
    reference_states,
)
from cislunar.runtime import Array

_POSITION_KM, _VELOCITY_KM_S = 1e-6, 1e-9
"""Largest mismatch of an arc: 1 mm and 1 μm/s, so that it is within 1 m and 1 mm/s for another
propagator as well."""

_ARCS_PER_PERIOD, _FEWEST_ARCS = 12, 20
"""Arcs far from bodies; there are more close to bodies."""

_MOST_DOUBLINGS = 3
"""Largest number of doublings of the number of arcs if the iteration fails."""

MAX_ITERATIONS = 30
_MOST_PUSHES, _CLEARANCE_KM = 4, 100.0
"""A path that intersects a body is moved out to about this altitude, in at most this many
attempts."""

_MAX_GRID_EVALUATIONS = 10
_LEAST_SHARE = 1e-3
"""Smallest fraction of a Newton change in the line search."""


class RefinedPath(NamedTuple):
    """A path given by nodes that ballistic arcs connect.

    Attributes
    ----------
    time : ndarray, shape (node,)
        Time since the epoch of the force model, s.
    state : ndarray, shape (node, 6)
        Barycentric frame, J2000 axes, nondimensional.
    position_miss_km, velocity_miss_km_s : float
        Largest mismatch of an arc with the next node.
    """

    time: Array
    state: Array
    position_miss_km: float
    velocity_miss_km_s: float


def refined_path(
    forces: EphemerisForces, state: ArrayLike, period: float, days: float, *, ahead: float = 0.0
) -> RefinedPath:
    """Refine a CR3BP orbit into a ballistic path of the ephemeris dynamics.

    Parameters
    ----------
    forces : EphemerisForces
        Force model that covers the span; its time zero is the epoch.
    state, period, ahead
        CR3BP orbit at the epoch, nondimensional, rotating frame; see `reference_states`.
    days : float
        Length of the path, days.

    Returns
    -------
    RefinedPath

    Raises
    ------
    ConvergenceError
        If no number of arcs leads to a continuous path.
    ConfigurationError
        If the force model does not cover the span.
    """
    length = days * SECONDS_PER_DAY
    clock = np.linspace(0.0, length, int(np.ceil(length / CLOCK_STEP_S)) + 1)
    path = reference_states(forces.table, forces.epoch, state, period, clock, ahead=ahead)
    even = _ARCS_PER_PERIOD / (period * TIME_UNIT_S) if period > 0.0 else 1.0 / SECONDS_PER_DAY
    even = max(even, _FEWEST_ARCS / length)
    arc_count = _due_arcs(forces, clock, path, even)
    for doubled in range(_MOST_DOUBLINGS + 1):
        arcs = int(np.ceil(arc_count[-1] * 2.0**doubled))
        times = np.interp(np.linspace(0.0, arc_count[-1], arcs + 1), arc_count, clock)
        guess = reference_states(forces.table, forces.epoch, state, period, times, ahead=ahead)
        try:
            return _outside(forces, _shoot(forces, times, guess))
        except ConvergenceError as error:
            failure = error
    raise ConvergenceError(f"no continuous path with {arcs} arcs: {failure}")


class _Clearance(NamedTuple):
    """A node with a prescribed periapsis distance from a body, nondimensional."""

    node: int
    body: str
    distance: float


def _outside(forces: EphemerisForces, path: RefinedPath) -> RefinedPath:
    """Move a path out of the bodies by raising the periapsis of the node next to the intersection.
    An arc near a body covers about one radian and is sampled ten times."""
    for _ in range(_MOST_PUSHES):
        found = _dip(forces, path)
        if found is None:
            return path
        body, time, depth = found
        node = int(np.argmin(np.abs(path.time - time)))
        nodes = np.column_stack([path.state, path.time / TIME_UNIT_S])
        least = _periapsis(forces, body, nodes[node])
        constraint = _Clearance(node, body, least + (depth + _CLEARANCE_KM) / LENGTH_UNIT_KM)
        path = _shoot(forces, path.time, path.state, constraint)
    raise ConvergenceError(
        f"the path intersects the {body.capitalize()} by {depth:.0f} km at {time / 3600.0:.1f} h"
    )


def _dip(forces: EphemerisForces, path: RefinedPath) -> tuple[str, float, float] | None:
    """Body, time and depth below its surface, km, where a path is deepest inside a body."""
    parts = np.arange(_MAX_GRID_EVALUATIONS * (len(path.time) - 1) + 1) / _MAX_GRID_EVALUATIONS
    time = np.interp(parts, np.arange(len(path.time)), path.time)
    position = path_states(forces, path, time)[:, :3] * LENGTH_UNIT_KM
    bodies = read_table(forces.table, forces.epoch + time)[0]
    for body, radius in (("earth", EARTH_RADIUS_KM), ("moon", MOON_RADIUS_KM)):
        distance = np.linalg.norm(position - bodies[:, BODY_COLUMNS[body]], axis=1)
        k = int(np.argmin(distance))
        if distance[k] < radius:
            return body, float(time[k]), float(radius - distance[k])
    return None


def _due_arcs(forces: EphemerisForces, clock: Array, path: Array, even: float) -> Array:
    """Cumulative number of arcs: `even` per second, plus one per radian about either body."""
    position = read_table(forces.table, forces.epoch + clock)[0]
    rate = np.full(clock.size, even)
    for body, gm in (("earth", GM_EARTH), ("moon", GM_MOON)):
        distance = np.linalg.norm(
            path[:, :3] * LENGTH_UNIT_KM - position[:, BODY_COLUMNS[body]], axis=1
        )
        rate += np.sqrt(gm / distance**3)
    return cumulative_trapezoid(rate, clock, initial=0.0)


class _Arcs(NamedTuple):
    """Mismatch of each arc, and its derivatives by the nodes at its beginning and end."""

    miss: Array
    by_begin: Array
    by_end: Array


def _shoot(
    forces: EphemerisForces, times: Array, guess: Array, constraint: _Clearance | None = None
) -> RefinedPath:
    """Least-norm Newton iterations until the arcs match the nodes or no longer improve."""
    nodes = np.column_stack([guess, times / TIME_UNIT_S])
    arcs = _arcs(forces, nodes)
    for _ in range(MAX_ITERATIONS):
        position, velocity = (
            float(unit * np.max(np.linalg.norm(part, axis=1)))
            for unit, part in ((UNITS[0], arcs.miss[:, :3]), (UNITS[3], arcs.miss[:, 3:]))
        )
        gap_km = abs(_gap(forces, constraint, nodes)[0]) * LENGTH_UNIT_KM
        if position < _POSITION_KM and velocity < _VELOCITY_KM_S and gap_km < 1.0:
            return RefinedPath(nodes[:, 6] * TIME_UNIT_S, nodes[:, :6], position, velocity)
        better = _damped_change(forces, nodes, arcs, constraint)
        if better is None:
            break
        nodes, arcs = better
    passes = (
        f", it passes the {constraint.body.capitalize()} {gap_km:.3g} km too low"
        if constraint
        else ""
    )
    raise ConvergenceError(
        f"arcs miss their nodes by {position:.3g} km and {1e3 * velocity:.3g} m/s{passes}"
    )


def _damped_change(
    forces: EphemerisForces, nodes: Array, arcs: _Arcs, constraint: _Clearance | None
) -> tuple[Array, _Arcs] | None:
    """Nodes after the largest fraction of the least-norm change that converges, and their arcs."""
    gap, slope = _gap(forces, constraint, nodes)
    solve = _least_change(arcs, constraint and constraint.node, slope)
    change, share = solve(arcs.miss, gap), 1.0
    size = np.linalg.norm(change)
    while share > _LEAST_SHARE:
        tried = nodes + share * change
        if np.all(np.diff(tried[:, 6]) > 0.0):
            try:
                found = _arcs(forces, tried)
                left = solve(found.miss, _gap(forces, constraint, tried)[0])
                if np.linalg.norm(left) < (1.0 - 0.25 * share) * size:
                    return tried, found
            except ConvergenceError:  # collision with the center of a body
                pass
        share *= 0.5
    return None


def _gap(
    forces: EphemerisForces, constraint: _Clearance | None, nodes: Array
) -> tuple[float, Array]:
    """Excess of a constrained node's periapsis over the prescribed one, and its derivative (7,)."""
    if constraint is None:
        return 0.0, np.zeros(7)
    node, steps = nodes[constraint.node], 1e-7 * np.eye(7)
    slope = [
        (
            _periapsis(forces, constraint.body, node + e)
            - _periapsis(forces, constraint.body, node - e)
        )
        / 2e-7
        for e in steps
    ]
    return _periapsis(forces, constraint.body, node) - constraint.distance, np.array(slope)


def _periapsis(forces: EphemerisForces, body: str, node: Array) -> float:
    """Periapsis distance of a node's osculating conic about a body, nondimensional."""
    position, velocity, _ = read_table(forces.table, forces.epoch + node[6] * TIME_UNIT_S)
    relative = node[:3] - position[BODY_COLUMNS[body]] / UNITS[:3]
    relative_velocity = node[3:6] - velocity[BODY_COLUMNS[body]] / UNITS[3:]
    gm = forces.gm_earth if body == "earth" else forces.gm_moon
    momentum = np.cross(relative, relative_velocity)
    eccentricity = np.cross(relative_velocity, momentum) / gm - relative / np.linalg.norm(relative)
    return float(momentum @ momentum / (gm * (1.0 + np.linalg.norm(eccentricity))))


@njit(cache=True)
def _fly(forces, nodes, ends, matrices):
    """End and state transition matrix of every arc; returns the number of arcs that succeeded.
    Newton's method tolerates errors of the matrices, which near a body lose digits to the rounding
    of the time; therefore they have a looser tolerance."""
    length, nowhere = np.empty(1), np.empty(0)
    end, both, start = np.empty((1, 6)), np.empty((1, 42)), np.zeros(42)
    for i in range(len(ends)):
        length[0] = nodes[i + 1, 6] - nodes[i, 6]
        start[:] = 0.0
        start[:6] = nodes[i, :6]
        start[6::7] = 1.0
        for y0, out, tolerance in ((start[:6], end, 1e-13), (start, both, 1e-9)):
            status, _ = integrate(
                DOP853, forces, nodes[i, 6], y0, length, tolerance, tolerance, out, nowhere, nowhere
            )
            if status != OK:
                return i
        ends[i] = end[0]
        for a in range(6):
            matrices[i, a] = both[0, 6 + 6 * a : 12 + 6 * a]
    return len(ends)


def _arcs(forces: EphemerisForces, nodes: Array) -> _Arcs:
    """Arcs between nodes (node, 7) of state and time; `by_begin`, `by_end` have shape (n, 6, 7)."""
    n = len(nodes) - 1
    met, matrix = np.empty((n, 6)), np.empty((n, 6, 6))
    done = _fly(forces, np.ascontiguousarray(nodes), met, matrix)
    if done < n:
        raise ConvergenceError(
            f"an arc from {nodes[done, :6].tolist()} collides with the center of a body"
        )
    by_begin, by_end = np.zeros((2, n, 6, 7))
    by_begin[..., :6], by_end[..., :6] = matrix, -np.eye(6)
    leave = flow(forces, nodes[:-1, 6], nodes[:-1, :6])
    by_begin[..., 6] = -np.einsum("iab,ib->ia", matrix, leave)
    by_end[..., 6] = flow(forces, nodes[1:, 6], met)
    by_begin[0, :, 6] = by_end[-1, :, 6] = 0.0  # the times of the ends are fixed
    return _Arcs(met - nodes[1:, :6], by_begin, by_end)


def _least_change(
    arcs: _Arcs, constrained: int | None, slope: Array
) -> Callable[[Array, float], Array]:
    """Function of the mismatches F (n, 6) and the gap that returns the least-norm change (node, 7).
    Without a constrained node it is -D^T (D D^T)^-1 F. Otherwise the gap is closed along the
    component of its derivative in the null space of D."""
    _, by_begin, by_end = arcs
    n = len(by_begin)
    diagonal = by_begin @ np.swapaxes(by_begin, 1, 2) + by_end @ np.swapaxes(by_end, 1, 2)
    beside = by_end[:-1] @ np.swapaxes(by_begin[1:], 1, 2)
    banded = np.zeros((12, 6 * n))
    for a in range(6):
        for b in range(6):
            if b >= a:
                banded[11 - (b - a), b::6] = diagonal[:, a, b]
            banded[11 - (6 + b - a), 6 + b :: 6] = beside[:, a, b]
    try:
        factor = cholesky_banded(banded)
    except np.linalg.LinAlgError:
        raise ConvergenceError("arcs are too long: the shooting equations are singular") from None

    def close(miss: Array) -> Array:
        multiplier = cho_solve_banded((factor, False), -miss.ravel()).reshape(n, 6)
        change = np.zeros((n + 1, 7))
        change[:-1] = np.einsum("iba,ib->ia", by_begin, multiplier)
        change[1:] += np.einsum("iba,ib->ia", by_end, multiplier)
        return change

    if constrained is None:
        return lambda miss, _: close(miss)
    free, seen = np.zeros((n + 1, 7)), np.zeros((n, 6))
    free[constrained] = slope
    if constrained < n:
        seen[constrained] = by_begin[constrained] @ slope
    if constrained > 0:
        seen[constrained - 1] = by_end[constrained - 1] @ slope
    free += close(seen)

    def close_both(miss: Array, gap: float) -> Array:
        change = close(miss)
        return change - free * (gap + slope @ change[constrained]) / (slope @ free[constrained])

    return close_both


def path_states(forces: EphemerisForces, path: RefinedPath, time: ArrayLike) -> Array:
    """States along a refined path.

    Parameters
    ----------
    forces : EphemerisForces
        Force model of the refinement.
    path : RefinedPath
        From `refined_path`.
    time : array_like, shape (m,)
        Time since the epoch of the force model, s, within the path.

    Returns
    -------
    ndarray, shape (m, 6)
        Barycentric frame, J2000 axes, nondimensional.

    Raises
    ------
    ConfigurationError
        If the force model does not cover the times.
    """
    times = np.asarray(time, dtype=float)
    arc = np.clip(np.searchsorted(path.time, times, side="right") - 1, 0, len(path.time) - 2)
    out = np.empty((times.size, 6))
    for k in np.unique(arc):
        own = arc == k
        since = (times[own] - path.time[k]) / TIME_UNIT_S
        start = path.time[k] / TIME_UNIT_S
        out[own] = propagate(path.state[k], since, forces=forces, start=start, method="dop853")
    return out
