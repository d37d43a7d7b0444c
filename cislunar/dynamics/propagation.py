"""Propagation of states and state transition matrices under any force model.

States are in the propagation frame of the force model: the rotating frame for the CR3BP; the
barycentric frame, J2000 axes, for ephemeris dynamics (`cislunar.dynamics.ephemeris_forces`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import MU
from cislunar.dynamics.adaptive import lanes, runge_kutta
from cislunar.dynamics.bounds import require_nondimensional, state_vector
from cislunar.dynamics.cr3bp import CR3BP, EARTH_MOON, primary_positions
from cislunar.dynamics.forces import require_span, require_targets
from cislunar.errors import ConfigurationError, ConvergenceError
from cislunar.quantities import nondimensional
from cislunar.runtime.arguments import Array, array_of, number_of, require_choice

_NOWHERE = np.empty(0)
METHODS = {"dopri5": runge_kutta.DOPRI5, "dop853": runge_kutta.DOP853}
_DEFAULT_TOLERANCE = {"dopri5": 1e-10, "dop853": 1e-13}


def _method_and_tolerances(
    method: str, rtol: float | None, atol: float | None
) -> tuple[int, float, float]:
    require_choice("method", method, METHODS)
    rtol = _DEFAULT_TOLERANCE[method] if rtol is None else number_of("rtol", rtol)
    atol = _DEFAULT_TOLERANCE[method] if atol is None else number_of("atol", atol)
    # Below about 100 machine epsilons the error estimate is roundoff and steps collapse.
    if not rtol >= 2.3e-14 or not atol > 0.0:
        raise ConfigurationError(f"rtol = {rtol} must be at least 2.3e-14, atol = {atol} positive")
    return METHODS[method], rtol, atol


def _integrate(method, forces, start, y0, times, rtol, atol, centers=_NOWHERE) -> tuple:
    """Solution and least distances; a failure of the compiled integrator raises an exception."""
    require_targets(forces, None)
    require_span(forces, start, start + times[-1])
    out, closest = np.empty((times.size, y0.size)), np.empty(centers.size)
    status, reached = runge_kutta.integrate(
        method, forces, float(start), y0, times, rtol, atol, out, centers, closest
    )
    _require_arrival(status, y0[:6], reached, times[-1])
    return out, closest


def _require_arrival(status: int, state: Array, reached: float, end: float) -> None:
    """Raise a `ConvergenceError` for a status of the compiled integrators other than OK."""
    if status == runge_kutta.OK:
        return
    reason = (
        "the step size underflowed (the trajectory collides with the center of a body)"
        if status == runge_kutta.STEP_UNDERFLOW
        else f"more than {runge_kutta.MAX_STEPS} steps were needed"
    )
    raise ConvergenceError(
        f"propagation from {state.tolist()} stopped at t = {reached:.12g} of {end:.12g}: "
        f"{reason}; shorten the propagation or move the initial state"
    )


def _wrapped(times: ArrayLike, period: ArrayLike) -> Array:
    """Times wrapped to within half a period of the epoch; unchanged where the period is 0."""
    times, period = np.broadcast_arrays(np.asarray(times, float), np.asarray(period, float))
    turns = np.divide(times, period, out=np.zeros(times.shape), where=period > 0.0)
    return times - period * np.round(turns)


def propagate(
    state: ArrayLike,
    times: ArrayLike,
    *,
    forces: tuple = EARTH_MOON,
    start: float = 0.0,
    method: str = "dopri5",
    rtol: float | None = None,
    atol: float | None = None,
) -> Array:
    """Propagate one state and return it at given times.

    The step size adapts to the tolerances alone; the continuous extension of the method (4th order
    for Dormand-Prince 5(4), 7th for DOP853) gives the states at the output times.

    Parameters
    ----------
    state : array_like, shape (6,)
        State at `start`, nondimensional, propagation frame. Position and velocity may be quantities
        of `astropy.units`, as well as `times` and `start`.
    times : array_like, shape (m,)
        Nondimensional times since `start`, in any order; negative times are reached backwards.
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.
    start : float
        Time of `state`, nondimensional, since the epoch.
    method : {"dopri5", "dop853"}
        Dormand-Prince 5(4) (Paul & Fan, table 1) or DOP853.
    rtol, atol : float, optional
        Tolerances; by default 1e-10 for dopri5 and 1e-13 for dop853.

    Returns
    -------
    ndarray, shape (m, 6)
        Nondimensional, propagation frame.

    Raises
    ------
    ConfigurationError
        If an argument is impossible, the force model does not cover the times, or a CR3BP state is
        evidently in km.
    ConvergenceError
        If the step size underflows, as on a collision with a primary, or too many steps are needed.
    """
    code, rtol, atol = _method_and_tolerances(method, rtol, atol)
    y0 = state_vector(state)
    if isinstance(forces, CR3BP):
        require_nondimensional("state", y0)
    times = array_of("times", nondimensional("times", times, "time"), (None,))
    start = number_of("start", nondimensional("start", start, "time"))
    out = np.empty((times.size, 6))
    for forward in (True, False):
        chosen = np.flatnonzero(times >= 0.0 if forward else times < 0.0)
        if chosen.size:
            order = chosen[np.argsort(times[chosen] if forward else -times[chosen], kind="stable")]
            out[order] = _integrate(code, forces, start, y0, times[order], rtol, atol)[0]
    return out


def _state_rows(state: ArrayLike, forces: tuple, on_failure: str = "raise") -> Array:
    """States (n, 6); if failures raise errors, of finite numbers that are not evidently in km.
    Raises a `ConfigurationError` otherwise."""
    require_choice("on_failure", on_failure, ("raise", "nan"))
    given = nondimensional("states", state, "state")
    states = np.ascontiguousarray(array_of("states", given, finite=False))
    checked = on_failure == "raise"
    if states.ndim != 2 or states.shape[1] != 6 or (checked and not np.all(np.isfinite(states))):
        raise ConfigurationError(
            f"states must be rows of 6 finite numbers, got an array of shape {states.shape}"
        )
    if isinstance(forces, CR3BP) and checked:
        require_nondimensional("state", states)
    return states


def _integrate_many(y0, times, forces, start, method, rtol, atol, on_failure) -> Array:
    """Solutions (n, m, components) from initial values (n, components) by the integrator in lanes;
    times, start and on_failure as in `propagate_many`."""
    times = array_of("times", nondimensional("times", times, "time"), finite=False)
    start = array_of("start", nondimensional("start", start, "time"))
    if times.ndim not in (1, 2) or (times.ndim == 2 and len(times) != len(y0)):
        raise ConfigurationError(
            f"times of shape {times.shape} do not belong to {len(y0)} states: give one row for "
            "all or a row for each"
        )
    if not np.all(np.isfinite(times)):
        raise ConfigurationError("times must be finite numbers")
    times = np.broadcast_to(times, (len(y0), times.shape[-1]))
    if start.shape not in ((), (len(y0),)):
        raise ConfigurationError(f"start has shape {start.shape}; give one, or one of each state")
    starts = np.broadcast_to(start, len(y0))
    out = np.empty((*times.shape, y0.shape[1]))
    if out.size == 0:
        return out
    require_targets(forces, None)
    spans = starts, starts + times.min(axis=1), starts + times.max(axis=1)
    require_span(forces, np.min(spans), np.max(spans))
    # Up to two jobs per row: backward from 0, and forward from 0.
    n, m = times.shape
    order, back = np.argsort(times, axis=1, kind="stable"), np.sum(times < 0.0, axis=1)
    column = np.arange(m)
    column = np.where(column < back[:, None], back[:, None] - 1 - column, column)
    order = np.take_along_axis(order, column, axis=1)
    which, forward = np.nonzero(np.stack([back > 0, back < m], axis=1))
    direction = 2.0 * forward - 1.0
    jobs = lanes.Jobs(
        state=y0[which],
        start=starts[which],
        direction=direction,
        first=np.append(which * m + forward * back[which], n * m),
        times=np.abs(np.take_along_axis(times, order, axis=1)).ravel(),
        place=(m * np.arange(n)[:, None] + order).ravel(),
    )
    status, stopped = np.empty(which.size, dtype=int), np.zeros(which.size)
    kind = lanes.OfStates() if y0.shape[1] == 6 else lanes.OfMatrices()
    rows = out.reshape(-1, y0.shape[1])
    lanes.integrate_many(kind, method, forces, jobs, rtol, atol, rows, status, stopped)
    failed = np.flatnonzero(status != runge_kutta.OK)
    if on_failure == "nan":
        out[which[failed]] = np.nan
        return out
    for k in failed:
        end = direction[k] * jobs.times[jobs.first[k + 1] - 1]
        _require_arrival(status[k], jobs.state[k, :6], stopped[k], end)
    return out


def propagate_many(
    state: ArrayLike,
    times: ArrayLike,
    *,
    forces: tuple = EARTH_MOON,
    start: ArrayLike = 0.0,
    method: str = "dopri5",
    rtol: float | None = None,
    atol: float | None = None,
    on_failure: str = "raise",
) -> Array:
    """Propagate many states, each with its own steps; bit-identical to `propagate` for each state,
    and a few times faster (`cislunar.dynamics.adaptive.lanes`).

    Parameters
    ----------
    state : array_like, shape (n, 6)
        States at `start`, nondimensional, propagation frame.
    times : array_like, shape (m,) or (n, m)
        Nondimensional times since `start`, in any order, for all states or for each state.
    forces : NamedTuple
        Force model, common to all states, see `cislunar.dynamics.forces`.
    start : array_like, shape () or (n,)
        Time of the states, nondimensional, since the epoch.
    method, rtol, atol
        See `propagate`; so are the errors raised.
    on_failure : {"raise", "nan"}
        For a state whose propagation does not converge: raise the error of `propagate` for the
        first such state, or return NaN at all its times, also for a state that is not finite.

    Returns
    -------
    ndarray, shape (n, m, 6)
        Nondimensional, propagation frame.
    """
    given = forces, start, *_method_and_tolerances(method, rtol, atol), on_failure
    return _integrate_many(_state_rows(state, forces, on_failure), times, *given)


def propagate_periodic(
    state: ArrayLike,
    period: float,
    times: ArrayLike,
    *,
    mu: float = MU,
    method: str = "dopri5",
    rtol: float | None = None,
    atol: float | None = None,
) -> Array:
    """State of a periodic orbit of the CR3BP at any times.

    Times are wrapped to half a period on either side of the epoch, so that the error of an unstable
    orbit grows over at most half a period, however distant the times.

    Parameters
    ----------
    state : array_like, shape (6,)
        State at time 0 on the orbit, nondimensional, rotating frame.
    period : float
        Period, nondimensional.
    times : array_like, shape (m,)
        Nondimensional times.
    mu : float
        Mass ratio.
    method, rtol, atol
        See `propagate`.

    Returns
    -------
    ndarray, shape (m, 6)
        Nondimensional, rotating frame.

    Raises
    ------
    ConfigurationError, ConvergenceError
        If the period is not positive, and see `propagate`.
    """
    period = number_of("period", nondimensional("period", period, "time"), positive=True)
    wrapped = _wrapped(array_of("times", nondimensional("times", times, "time")), period)
    return propagate(state, wrapped, forces=CR3BP(mu), method=method, rtol=rtol, atol=atol)


def propagate_stm(
    state: ArrayLike,
    duration: float | ArrayLike,
    *,
    forces: tuple = EARTH_MOON,
    start: ArrayLike = 0.0,
    rtol: float = 1e-13,
    atol: float = 1e-13,
    on_failure: str = "raise",
) -> tuple[Array, Array]:
    """Propagate states and their state transition matrices with DOP853; errors as in `propagate`,
    except that a single state in km is not detected. For many states see `propagate_many`.

    Parameters
    ----------
    state : array_like, shape (6,) or (n, 6)
        States at `start`, nondimensional, propagation frame.
    duration : float or array_like, shape (m,) or (n, m)
        Nondimensional, either sign; several durations of one state must have one sign and increase
        in magnitude.
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.
    start : float or array_like, shape (n,)
        Time of the states, nondimensional, since the epoch.
    rtol, atol : float
        Tolerances, applied to all 42 entries.
    on_failure : {"raise", "nan"}
        For several states, see `propagate_many`; an error is always raised for a single one.

    Returns
    -------
    state_f : ndarray, shape (6,), (m, 6), (n, 6) or (n, m, 6)
        Final states, nondimensional, propagation frame.
    stm : ndarray, shape (..., 6, 6)
        Derivative of each final state with respect to the initial one.
    """
    code, rtol, atol = _method_and_tolerances("dop853", rtol, atol)
    durations = array_of("duration", nondimensional("duration", duration, "time"), finite=False)
    if np.ndim(state) == 2:
        states = _state_rows(state, forces, on_failure)
        y0 = np.hstack([states, np.tile(np.eye(6).ravel(), (len(states), 1))])
        given = np.atleast_1d(durations), forces, start, code, rtol, atol, on_failure
        end = _integrate_many(y0, *given)
        shape = (len(states), *durations.shape[-1:])
    else:
        y0 = np.concatenate([state_vector(state), np.eye(6).ravel()])
        steps = np.diff(np.append(0.0, durations))
        one_way = np.isfinite(steps).all() and (np.all(steps >= 0.0) or np.all(steps <= 0.0))
        if durations.ndim > 1 or durations.size == 0 or not one_way:
            rule = "give finite numbers of one sign that increase in magnitude"
            raise ConfigurationError(f"duration of one state: {rule}")
        start = number_of("start", nondimensional("start", start, "time"))
        end, _ = _integrate(code, forces, start, y0, durations.ravel(), rtol, atol)
        shape = durations.shape
    return end[..., :6].reshape(*shape, 6), end[..., 6:].reshape(*shape, 6, 6)


def advance_orbits(state: ArrayLike, period: ArrayLike, time: float, mu: float = MU) -> Array:
    """Propagate states of the CR3BP by a time, around a closed orbit or along an open trajectory.

    Parameters
    ----------
    state : array_like, shape (orbit, 6)
        Nondimensional, rotating frame.
    period : array_like, shape (orbit,)
        Period, nondimensional, by multiples of which the time is reduced; 0 for an open trajectory.
    time : float
        Nondimensional; the states are unchanged for 0.
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray, shape (orbit, 6)
        Nondimensional, rotating frame.

    Raises
    ------
    ConfigurationError, ConvergenceError
        If a period is negative or not one of each state, and see `propagate_many`.
    """
    states, periods = _state_rows(state, EARTH_MOON).copy(), array_of("period", period)
    if np.any(array_of("period", periods, (len(states),)) < 0.0):
        raise ConfigurationError("period must not be negative; it is 0 for an open trajectory")
    if number_of("time", time) == 0.0:
        return states
    times = _wrapped(time, periods)[:, None]
    return propagate_many(states, times, forces=CR3BP(mu), method="dop853")[:, 0]


def closest_approaches(state: ArrayLike, duration: float, *, mu: float = MU) -> tuple[float, float]:
    """Least distances to the Earth and to the Moon along a trajectory in the CR3BP.

    Minima within a step are found on the continuous extension of DOP853.

    Parameters
    ----------
    state : array_like, shape (6,)
        Nondimensional, rotating frame.
    duration : float
        Nondimensional, positive.
    mu : float
        Mass ratio.

    Returns
    -------
    perigee, perilune : float
        Distances from the centers, nondimensional.

    Raises
    ------
    ConfigurationError, ConvergenceError
        If the duration is not positive, and see `propagate`.
    """
    duration = number_of("duration", nondimensional("duration", duration, "time"), positive=True)
    centers = np.array(primary_positions(mu))[:, 0]
    y0 = state_vector(state)
    require_nondimensional("state", y0)
    given = CR3BP(mu), 0.0, y0, np.array([duration]), 1e-12, 1e-12, centers
    return tuple(_integrate(METHODS["dop853"], *given)[1].tolist())
