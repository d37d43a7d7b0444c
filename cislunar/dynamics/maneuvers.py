"""Propagation of states that maneuver, on a grid of times.

An impulse changes the velocity of a state at a time between or on the grid. A burn with constant
thrust acceleration and axes is represented by equal impulses at the midpoints of its parts. The
midpoint rule is exact for the displacement at the end of the burn in a uniform field, and its error
decreases with the square of the part's length otherwise.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.forces import of_targets
from cislunar.errors import ConfigurationError
from cislunar.runtime import Array, array_of, indices_of, number_of

VELOCITY_UNIT_M_S = 1e3 * LENGTH_UNIT_KM / TIME_UNIT_S
"""Nondimensional unit of velocity, m/s."""

_NEAR = 1e-6
"""Part of a step within which an impulse is taken to be at a time of the grid, so that rounding
cannot decide on which side it is."""

PART_S = 10.0
"""Length of the parts of a burn, s."""


class Impulses(NamedTuple):
    """Changes of velocity of some states.

    Attributes
    ----------
    index : ndarray of int, shape (impulse,)
        State that changes.
    time : ndarray, shape (impulse,)
        Nondimensional, since the epoch; not decreasing.
    velocity : ndarray, shape (impulse, 3)
        Change of velocity, nondimensional, propagation frame.
    """

    index: NDArray[np.int64]
    time: Array
    velocity: Array


def burn_times(start_s: float, duration_s: float) -> Array:
    """Times of the impulses that represent a burn, each with an equal part of its change of
    velocity.

    Parameters
    ----------
    start_s, duration_s : float
        Begin and duration of the burn, s; a duration of 0 is one impulse at its begin.

    Returns
    -------
    ndarray, shape (impulse,)
        Midpoints of parts of at most 10 s, s.

    Raises
    ------
    ConfigurationError
        If a time is not finite, or the duration is negative.
    """
    number_of("start_s", start_s)
    if number_of("duration_s", duration_s) < 0.0:
        raise ConfigurationError(f"duration_s = {duration_s} must not be negative")
    count = max(1, int(np.ceil(duration_s / PART_S)))
    return start_s + duration_s * (np.arange(count) + 0.5) / count


def local_axes(
    state: ArrayLike, body: ArrayLike, body_velocity: ArrayLike, turning: ArrayLike
) -> Array:
    """Radial, transverse and normal axes of a state about a body.

    Parameters
    ----------
    state : array_like, shape (6,)
        Nondimensional, propagation frame.
    body, body_velocity : array_like, shape (3,)
        Position and velocity of the body's center, nondimensional, propagation frame.
    turning : array_like, shape (3,)
        Angular velocity of the propagation frame relative to the inertial frame, nondimensional,
        along its own axes.

    Returns
    -------
    ndarray, shape (3, 3)
        Rotation from the propagation frame to the local axes: radial from the body, normal along
        the angular momentum of the inertial motion about the body, transverse completing the
        right-handed system (RTN of the CCSDS navigation standards).
    """
    given = np.asarray(state, dtype=float)
    away = given[:3] - np.asarray(body, dtype=float)
    velocity = given[3:] - np.asarray(body_velocity, dtype=float) + np.cross(turning, away)
    radial, normal = away / np.linalg.norm(away), np.cross(away, velocity)
    normal /= np.linalg.norm(normal)
    return np.array([radial, np.cross(normal, radial), normal])


def propagate_with_impulses(
    state: ArrayLike,
    dt: float,
    n_steps: int,
    impulses: Impulses,
    *,
    forces: tuple = EARTH_MOON,
    start: float = 0.0,
    resolve: Callable[[int, float, Array], Array] | None = None,
) -> Array:
    """Propagate many states over a common grid of times, with impulses.

    Parameters
    ----------
    state : array_like, shape (N, 6)
        States at the first time, before an impulse at this time, nondimensional, propagation frame.
    dt : float
        Step, nondimensional, positive.
    n_steps : int
        Number of steps.
    impulses : Impulses
        In the order of time for each state. Those before the first time, or at or after the last
        time, have no effect. An impulse within a millionth of a step of a time is at that time.
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.
    start : float
        First time, nondimensional, since the epoch.
    resolve : callable, optional
        Returns the change of velocity (3,), nondimensional, propagation frame, of an impulse from
        its number, its time and the state (6,) before it, instead of ``impulses.velocity``. It is
        called once for each impulse that has an effect.

    Returns
    -------
    ndarray, shape (N, n_steps + 1, 6)
        States at all times including the first, nondimensional, propagation frame. The state at a
        time includes the impulses before it, but not those at this very time. States without
        impulses are those of `propagate_bundle`, bit for bit.

    Raises
    ------
    ConfigurationError
        If the step is not positive, the force model does not cover the times, an impulse is of a
        state that does not exist, or times and changes of velocity are not finite, not as many as
        the impulses, or not in the order of time.
    """
    dt = number_of("dt", dt, positive=True)
    out = propagate_bundle(state, dt, n_steps, forces=forces, start=start)
    index = indices_of("impulses.index", impulses.index, len(out))
    time = array_of("impulses.time", impulses.time, (index.size,))
    velocity = array_of("impulses.velocity", impulses.velocity, (index.size, 3))
    step = np.floor((time - start) / dt + _NEAR).astype(np.int64)
    within = (step >= 0) & (step < n_steps)
    for j in np.unique(index[within]):
        alone = of_targets(forces, np.array([j]))
        own = within & (index == j)
        if np.any(np.diff(time[own]) < 0.0):
            raise ConfigurationError(f"impulses.time: sort the impulses of state {j} by time")
        for k in np.unique(step[own]):
            here, now = out[j, k].copy(), start + k * dt
            for i in np.flatnonzero(own & (step == k)):
                here = _moved(here, time[i] - now, alone, now)
                at = float(time[i])
                here[3:] += velocity[i] if resolve is None else resolve(i, at, here)
                now = max(now, time[i])
            out[j, k + 1] = _moved(here, start + (k + 1) * dt - now, alone, now)
            later = n_steps - k - 1
            out[j, k + 1 :] = propagate_bundle(
                out[None, j, k + 1], dt, later, forces=alone, start=start + (k + 1) * dt
            )[0]
    return out


def _moved(state: Array, span: float, forces: tuple, start: float) -> Array:
    """A state after a time span shorter than a step."""
    if span <= 0.0:
        return state
    return propagate_bundle(state[None], span, 1, forces=forces, start=start)[0, 1]
