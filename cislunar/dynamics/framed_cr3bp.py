"""The CR3BP of an observer of the real sky: states in inertial axes, moved in the rotating frame.

An estimator that believes in the CR3BP has to place its rotating frame among the bodies as they
are. A state is taken into the instantaneous frame when a step begins, moved by the CR3BP for the
time that passes in the units of that frame, and taken back by the frame at the step's end
(`cislunar.dynamics.frames`). Both maps are linear, so that they carry every sigma point exactly.
The frames are tabulated at the ends of the steps.

Assumptions and limitations
---------------------------
- A step has to begin and end at tabulated times.
- A low lunar orbit keeps the Moon's centre and its altitude (`lunar_frame`), any other one both
  bodies (`pulsating_frame`): whichever of the two the CR3BP is closer to the truth in.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_trapezoid

from cislunar.compiled import allocating, borrowing, implements
from cislunar.constants import MU, TIME_UNIT_S
from cislunar.dynamics import forces
from cislunar.dynamics.bundle import take_cloud_step, take_step
from cislunar.dynamics.cr3bp import CR3BP
from cislunar.dynamics.ephemeris import UNITS
from cislunar.dynamics.frames import Frame, lunar_frame, pulsating_frame, to_inertial
from cislunar.ephemeris.bodies import GM_MOON, BodyTable

Array = NDArray[np.float64]

LOW_LUNAR_KM = 20_000.0
"""Apolune below which an orbit counts as one of the Moon's own: a third of its Hill radius."""


class FramedCR3BP(NamedTuple):
    """The CR3BP in inertial axes for many targets, a frame for each.

    Attributes
    ----------
    mu : float
        Mass ratio.
    step : float
        Between tabulated times, nondimensional; the first is time zero.
    kind : ndarray of int, shape (target,)
        Which of the frames a target has.
    outward, inward : ndarray, shape (frame, time, 6, 6)
        Derivative of the inertial state by the rotating one, both nondimensional, and its inverse.
    origin : ndarray, shape (frame, time, 6)
        Inertial state of the frame's barycenter at rest, nondimensional.
    clock : ndarray, shape (frame, time)
        Time that has passed in the units of the frame.
    """

    mu: float
    step: float
    kind: NDArray[np.int64]
    outward: Array
    inward: Array
    origin: Array
    clock: Array


class _OneFrame(NamedTuple):
    """The same for one target: arrays without the axis of frames."""

    mu: float
    step: float
    outward: Array
    inward: Array
    origin: Array
    clock: Array


def framed_cr3bp(
    table: BodyTable,
    epoch: float,
    step_s: float,
    n_steps: int,
    low_lunar: ArrayLike,
    *,
    mu: float = MU,
) -> FramedCR3BP:
    """Tabulate the frames of targets that move by the CR3BP.

    Parameters
    ----------
    table : BodyTable
        Places of the bodies.
    epoch : float
        TDB seconds past J2000 of time zero.
    step_s : float
        Length of a step, s.
    n_steps : int
        Number of steps.
    low_lunar : array_like of bool, shape (target,)
        Which targets are in low lunar orbits, see `is_low_lunar`.
    mu : float
        Mass ratio.

    Returns
    -------
    FramedCR3BP

    Raises
    ------
    ConfigurationError
        If the table does not cover the steps.
    """
    times = epoch + step_s * np.arange(n_steps + 1)
    frames = [make(table, times, mu=mu) for make in (pulsating_frame, lunar_frame)]
    outward = np.array([frame.matrix() / UNITS[:, None] for frame in frames])
    return FramedCR3BP(
        float(mu),
        float(step_s / TIME_UNIT_S),
        np.asarray(low_lunar).astype(np.int64),
        outward,
        np.linalg.inv(outward),
        np.array([frame.origin / UNITS for frame in frames]),
        np.array([cumulative_trapezoid(step_s / each.time, initial=0.0) for each in frames]),
    )


def is_low_lunar(state: ArrayLike, *, mu: float = MU) -> NDArray[np.bool_]:
    """Whether states lie on ellipses about the Moon with an apolune below `LOW_LUNAR_KM`.

    Parameters
    ----------
    state : array_like, shape (..., 6)
        Of the CR3BP, nondimensional, rotating frame.
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray of bool, shape (...)
    """
    s = np.asarray(state, dtype=float)
    r = (s[..., :3] - [1.0 - mu, 0.0, 0.0]) * UNITS[0]
    # the inertial velocity about the Moon
    v = (s[..., 3:] + np.cross([0.0, 0.0, 1.0], s[..., :3] - [1.0 - mu, 0.0, 0.0])) * UNITS[3]
    distance = np.linalg.norm(r, axis=-1)
    energy = 0.5 * np.sum(v * v, axis=-1) - GM_MOON / distance
    momentum2 = np.sum(np.cross(r, v) ** 2, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        eccentricity = np.sqrt(np.maximum(0.0, 1.0 + 2.0 * energy * momentum2 / GM_MOON**2))
        apolune = -GM_MOON / (2.0 * energy) * (1.0 + eccentricity)
    return (energy < 0.0) & (apolune < LOW_LUNAR_KM)


def inertial_states(
    state: ArrayLike, table: BodyTable, time: float, *, mu: float = MU
) -> tuple[Array, NDArray[np.bool_]]:
    """States of the CR3BP where they belong among the bodies, each by the frame that suits it.

    Parameters
    ----------
    state : array_like, shape (target, 6)
        Nondimensional, rotating frame.
    table : BodyTable
        Places of the bodies.
    time : float
        TDB seconds past J2000.
    mu : float
        Mass ratio.

    Returns
    -------
    state : ndarray, shape (target, 6)
        About the Earth-Moon barycenter, axes of J2000, nondimensional.
    low_lunar : ndarray of bool, shape (target,)
        Which of them are in low lunar orbits.

    Raises
    ------
    ConfigurationError
        If the time lies outside of the table.
    """
    low = is_low_lunar(state, mu=mu)
    both = [_placed(state, make(table, time, mu=mu)) for make in (pulsating_frame, lunar_frame)]
    return np.where(low[:, None], both[1], both[0]), low


def _placed(state: ArrayLike, frame: Frame) -> Array:
    return to_inertial(state, frame) / UNITS


@implements(forces.of_state, FramedCR3BP)
def _of_target(model, j):
    kind = model.kind[j]
    return _OneFrame(
        model.mu,
        model.step,
        model.outward[kind],
        model.inward[kind],
        model.origin[kind],
        model.clock[kind],
    )


@borrowing
def _map(matrix, shift_in, shift_out, state, out):
    """shift_out + matrix (state - shift_in) of a bundle (6, N), into `out`."""
    for c in range(6):
        for i in range(state.shape[1]):
            out[c, i] = shift_out[c]
        for d in range(6):
            factor, shift = matrix[c, d], shift_in[d]
            for i in range(state.shape[1]):
                out[c, i] += factor * (state[d, i] - shift)


@allocating
def _enter(model, t, state, dt, out):
    """States in their frame, into `out`; where the tables end the step, and its length there."""
    k, last = int(np.floor(t / model.step + 0.5)), int(np.floor((t + dt) / model.step + 0.5))
    _map(model.inward[k], model.origin[k], np.zeros(6), state, out)
    return last, model.clock[last] - model.clock[k]


@allocating
def _leave(model, last, state, out):
    """States out of their frame."""
    _map(model.outward[last], np.zeros(6), model.origin[last], state, out)


@implements(take_step, _OneFrame)
def _step(model, t, state, dt, slopes, work):
    last, duration = _enter(model, t, state, dt, work)
    take_step(CR3BP(model.mu), 0.0, work, duration, slopes, state)
    _leave(model, last, work, state)


@implements(take_step, FramedCR3BP)
def _step_of_each(model, t, state, dt, slopes, work):
    _step_each(model, t, state, dt, slopes.shape[0])


@allocating
def _step_each(model, t, state, dt, stages):
    """A step of a bundle of the states of all targets, each in its own frame."""
    one, own_work = np.empty((6, 1)), np.empty((6, 1))
    own_slopes = np.empty((stages, 6, 1))
    for i in range(state.shape[1]):
        one[:, 0] = state[:, i]
        take_step(forces.of_state(model, i), t, one, dt, own_slopes, own_work)
        state[:, i] = one[:, 0]


@implements(take_cloud_step, _OneFrame)
def _cloud_step(model, t, state, dt, slopes, work):
    last, duration = _enter(model, t, state, dt, work)
    take_cloud_step(CR3BP(model.mu), 0.0, work, duration, slopes, state)
    _leave(model, last, work, state)
