"""Orbits of the CR3BP refined by multiple shooting among Earth, Moon and Sun as they are.

A periodic orbit of the CR3BP, placed among the bodies by the instantaneous frame
(`cislunar.dynamics.frames`), is no path that a spacecraft flies for free. Refinement looks for one
close to it. The path is cut at times t_0 .. t_n; the unknowns are the states x_i at all of them and
the times between the first and the last, and what has to vanish is by how much each arc, propagated
under the forces, misses the next state. Newton's method with the change of least norm (Gomez,
Masdemont & Simo 1998, J. Astronaut. Sci. 46, 135, use such a parallel shooting) solves

    F_i = phi(x_i; t_i, t_(i+1)) - x_(i+1) = 0,      i = 0 .. n - 1.

With v the derivative of the state along the flow and Phi_i the transition matrix, F_i changes by
Phi_i (dx_i - v_i dt_i) - dx_(i+1) + v dt_(i+1), exactly so for forces that depend on time. With D
the Jacobian the change is -D^T (D D^T)^-1 F, and D D^T is block tridiagonal. A change is halved
until what would be left to change, by the same D, is less (Deuflhard 2004, Newton Methods for
Nonlinear Problems, section 2.1.3).

A shift of a node along its path can be one of state or of time, and close to a body, where the
state turns in minutes, the least change is one of time; with times that are fixed, orbits that
graze the Moon are not found.

Assumptions and limitations
---------------------------
- The states at the ends are as free as the others, so that a path near the orbit is found, not one
  from a given state.
- Manoeuvres are none: what navigation and station keeping add is not counted.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import cho_solve_banded, cholesky_banded

from cislunar.constants import (
    EARTH_RADIUS_KM,
    LENGTH_UNIT_KM,
    MOON_RADIUS_KM,
    SECONDS_PER_DAY,
    TIME_UNIT_S,
)
from cislunar.dynamics.adaptive.runge_kutta import DOP853, OK, integrate
from cislunar.dynamics.ephemeris import UNITS
from cislunar.dynamics.ephemeris_forces import Ephemeris
from cislunar.dynamics.propagation import propagate
from cislunar.ephemeris.bodies import COLUMNS, GM_EARTH, GM_MOON, read_table
from cislunar.errors import ConvergenceError
from cislunar.orbits.among_bodies.held import CLOCK_STEP_S, flow, reference_states

Array = NDArray[np.float64]

POSITION_KM, VELOCITY_KM_S = 1e-3, 1e-6
"""What an arc may miss the next state by: 1 m and 1 mm/s."""

ARCS_PER_PERIOD, FEWEST_ARCS = 12, 20
"""Arcs far from bodies; near them there are more."""

MOST_DOUBLINGS = 3
"""Of the number of arcs, where fewer lead nowhere."""

MAX_ITERATIONS = 30
MOST_PUSHES, CLEARANCE_KM = 4, 100.0
"""A path that leads through a body is pushed out, to about this altitude."""

_LOOKS = 10
LEAST_SHARE = 1e-3
"""Of a change of Newton's method, which is halved until less is left to change."""


class RefinedPath(NamedTuple):
    """A path in nodes that arcs under the forces connect.

    Attributes
    ----------
    time : ndarray, shape (node,)
        Since the epoch of the force model, s.
    state : ndarray, shape (node, 6)
        About the Earth-Moon barycenter, axes of J2000, nondimensional.
    position_miss_km, velocity_miss_km_s : float
        The most by which an arc misses the next node.
    """

    time: Array
    state: Array
    position_miss_km: float
    velocity_miss_km_s: float


def refined_path(
    forces: Ephemeris,
    state: ArrayLike,
    period: float,
    days: float,
    *,
    ahead: float = 0.0,
) -> RefinedPath:
    """Refine an orbit of the CR3BP into a path under real forces.

    Parameters
    ----------
    forces : Ephemeris
        Force model that covers the span; its time zero is the epoch.
    state, period, ahead
        As of `reference_states`, at the epoch.
    days : float
        Length of the path.

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
    even = ARCS_PER_PERIOD / (period * TIME_UNIT_S) if period > 0.0 else 1.0 / SECONDS_PER_DAY
    even = max(even, FEWEST_ARCS / length)
    passed = _due_arcs(forces, clock, path, even)
    for doubled in range(MOST_DOUBLINGS + 1):
        arcs = int(np.ceil(passed[-1] * 2.0**doubled))
        times = np.interp(np.linspace(0.0, passed[-1], arcs + 1), passed, clock)
        guess = reference_states(forces.table, forces.epoch, state, period, times, ahead=ahead)
        try:
            return _outside(forces, _shoot(forces, times, guess))
        except ConvergenceError as error:
            why = error
    raise ConvergenceError(f"no continuous path with {arcs} arcs: {why}")


class _Clearance(NamedTuple):
    """A node whose conic about a body has to have a periapsis distance (nondimensional)."""

    node: int
    body: str
    distance: float


def _outside(forces: Ephemeris, path: RefinedPath) -> RefinedPath:
    """A path that leads through no body: where it does, the next node's periapsis is raised.

    An arc near a body is a radian about it, and is looked at ten times.
    """
    for _ in range(MOST_PUSHES):
        found = _dip(forces, path)
        if found is None:
            return path
        body, time, depth = found
        node = int(np.argmin(np.abs(path.time - time)))
        nodes = np.column_stack([path.state, path.time / TIME_UNIT_S])
        least = _periapsis(forces, body, nodes[node])
        held = _Clearance(node, body, least + (depth + CLEARANCE_KM) / LENGTH_UNIT_KM)
        path = _shoot(forces, path.time, path.state, held)
    raise ConvergenceError(f"the path leads through the {body.capitalize()}")


def _dip(forces: Ephemeris, path: RefinedPath) -> tuple[str, float, float] | None:
    """Body, time and depth below its surface, km, where a path dips most."""
    parts = np.arange(_LOOKS * (len(path.time) - 1) + 1) / _LOOKS
    time = np.interp(parts, np.arange(len(path.time)), path.time)
    place = path_states(forces, path, time)[:, :3] * LENGTH_UNIT_KM
    bodies = read_table(forces.table, forces.epoch + time)[0]
    for body, radius in (("earth", EARTH_RADIUS_KM), ("moon", MOON_RADIUS_KM)):
        away = np.linalg.norm(place - bodies[:, COLUMNS[body]], axis=1)
        k = int(np.argmin(away))
        if away[k] < radius:
            return body, float(time[k]), float(radius - away[k])
    return None


def _due_arcs(forces: Ephemeris, clock: Array, path: Array, even: float) -> Array:
    """Number of arcs due by each time: `even` a second, and one a radian about either body."""
    position = read_table(forces.table, forces.epoch + clock)[0]
    rate = np.full(clock.size, even)
    for body, gm in (("earth", GM_EARTH), ("moon", GM_MOON)):
        away = np.linalg.norm(path[:, :3] * LENGTH_UNIT_KM - position[:, COLUMNS[body]], axis=1)
        rate += np.sqrt(gm / away**3)
    return cumulative_trapezoid(rate, clock, initial=0.0)


class _Arcs(NamedTuple):
    """Of each arc: by how much it misses, and that by the node it leaves and by that it meets."""

    miss: Array
    by_begin: Array
    by_end: Array


def _shoot(
    forces: Ephemeris, times: Array, guess: Array, held: _Clearance | None = None
) -> RefinedPath:
    """Newton's method of least changes until arcs meet the nodes or nothing improves."""
    nodes = np.column_stack([guess, times / TIME_UNIT_S])
    arcs = _arcs(forces, nodes)
    for _ in range(MAX_ITERATIONS):
        position, velocity = (
            float(unit * np.max(np.linalg.norm(part, axis=1)))
            for unit, part in ((UNITS[0], arcs.miss[:, :3]), (UNITS[3], arcs.miss[:, 3:]))
        )
        gap_km = abs(_gap(forces, held, nodes)[0]) * LENGTH_UNIT_KM
        # a thousandth of what is asked, so that the propagation of others misses it neither
        if position < 1e-3 * POSITION_KM and velocity < 1e-3 * VELOCITY_KM_S and gap_km < 1.0:
            return RefinedPath(nodes[:, 6] * TIME_UNIT_S, nodes[:, :6], position, velocity)
        better = _damped_change(forces, nodes, arcs, held)
        if better is None:
            break
        nodes, arcs = better
    passes = f", it passes the {held.body.capitalize()} {gap_km:.3g} km too low" if held else ""
    raise ConvergenceError(
        f"arcs miss their nodes by {position:.3g} km and {1e3 * velocity:.3g} m/s{passes}"
    )


def _damped_change(
    forces: Ephemeris, nodes: Array, arcs: _Arcs, held: _Clearance | None
) -> tuple[Array, _Arcs] | None:
    """Nodes after the largest share of the least change that leads closer, and their arcs."""
    gap, slope = _gap(forces, held, nodes)
    solve = _least_change(arcs, held and held.node, slope)
    change, share = solve(arcs.miss, gap), 1.0
    size = np.linalg.norm(change)
    while share > LEAST_SHARE:
        tried = nodes + share * change
        if np.all(np.diff(tried[:, 6]) > 0.0):
            try:
                found = _arcs(forces, tried)
                left = solve(found.miss, _gap(forces, held, tried)[0])
                if np.linalg.norm(left) < (1.0 - 0.25 * share) * size:
                    return tried, found
            except ConvergenceError:  # into the centre of a body
                pass
        share *= 0.5
    return None


def _gap(forces: Ephemeris, held: _Clearance | None, nodes: Array) -> tuple[float, Array]:
    """By how much the periapsis of a held node is too far out, and the derivative by it (7,)."""
    if held is None:
        return 0.0, np.zeros(7)
    node, steps = nodes[held.node], 1e-7 * np.eye(7)
    slope = [
        (_periapsis(forces, held.body, node + e) - _periapsis(forces, held.body, node - e)) / 2e-7
        for e in steps
    ]
    return _periapsis(forces, held.body, node) - held.distance, np.array(slope)


def _periapsis(forces: Ephemeris, body: str, node: Array) -> float:
    """Least distance from a body of a node's conic about it, nondimensional."""
    position, velocity, _ = read_table(forces.table, forces.epoch + node[6] * TIME_UNIT_S)
    place = node[:3] - position[COLUMNS[body]] / UNITS[:3]
    motion = node[3:6] - velocity[COLUMNS[body]] / UNITS[3:]
    gm = forces.gm_earth if body == "earth" else forces.gm_moon
    turning = np.cross(place, motion)
    shape = np.cross(motion, turning) / gm - place / np.linalg.norm(place)
    return float(turning @ turning / (gm * (1.0 + np.linalg.norm(shape))))


@njit(cache=True)
def _fly(forces, nodes, ends, matrices):
    """End and transition matrix of every arc; how many arcs could be flown.

    Newton's method bears an error in the matrices, and near a body rounding of the time takes
    digits of them.
    """
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


def _arcs(forces: Ephemeris, nodes: Array) -> _Arcs:
    """Arcs between nodes (node, 7) of state and time; `by_begin`, `by_end` have shape (n, 6, 7)."""
    n = len(nodes) - 1
    met, matrix = np.empty((n, 6)), np.empty((n, 6, 6))
    done = _fly(forces, np.ascontiguousarray(nodes), met, matrix)
    if done < n:
        raise ConvergenceError(
            f"an arc from {nodes[done, :6].tolist()} runs into the centre of a body"
        )
    by_begin, by_end = np.zeros((2, n, 6, 7))
    by_begin[..., :6], by_end[..., :6] = matrix, -np.eye(6)
    leave = flow(forces, nodes[:-1, 6], nodes[:-1, :6])
    by_begin[..., 6] = -np.einsum("iab,ib->ia", matrix, leave)
    by_end[..., 6] = flow(forces, nodes[1:, 6], met)
    by_begin[0, :, 6] = by_end[-1, :, 6] = 0.0  # the path begins and ends when it is asked to
    return _Arcs(met - nodes[1:, :6], by_begin, by_end)


def _least_change(arcs: _Arcs, held: int | None, slope: Array) -> Callable[[Array, float], Array]:
    """F, of shape (n, 6), and the gap of a held node to the least change (node, 7) that ends both.

    Without such a node -D^T (D D^T)^-1 F. With one the change besides goes along the part of the
    gap's derivative that D does not see.
    """
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
        raise ConvergenceError("arcs are too long: their ends hang on their beginnings") from None

    def close(miss: Array) -> Array:
        multiplier = cho_solve_banded((factor, False), -miss.ravel()).reshape(n, 6)
        change = np.zeros((n + 1, 7))
        change[:-1] = np.einsum("iba,ib->ia", by_begin, multiplier)
        change[1:] += np.einsum("iba,ib->ia", by_end, multiplier)
        return change

    if held is None:
        return lambda miss, _: close(miss)
    free, seen = np.zeros((n + 1, 7)), np.zeros((n, 6))
    free[held] = slope
    if held < n:
        seen[held] = by_begin[held] @ slope
    if held > 0:
        seen[held - 1] = by_end[held - 1] @ slope
    free += close(seen)

    def close_both(miss: Array, gap: float) -> Array:
        change = close(miss)
        return change - free * (gap + slope @ change[held]) / (slope @ free[held])

    return close_both


def path_states(forces: Ephemeris, path: RefinedPath, time: ArrayLike) -> Array:
    """States along a path.

    Parameters
    ----------
    forces : Ephemeris
        Those that the path was refined under.
    path : RefinedPath
    time : array_like, shape (m,)
        Since the epoch of the force model, s, within the path.

    Returns
    -------
    ndarray, shape (m, 6)
        About the Earth-Moon barycenter, axes of J2000, nondimensional.
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
