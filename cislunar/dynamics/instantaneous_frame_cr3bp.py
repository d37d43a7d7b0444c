"""The instantaneous-frame CR3BP: barycentric states propagated by the CR3BP in its rotating frame.

An estimator that assumes the CR3BP has to relate its rotating frame to the actual positions of
Earth and Moon. At the beginning of a step a state is transformed into the instantaneous rotating
frame. It is propagated by the CR3BP for the elapsed time in the units of that frame, and
transformed back with the frame at the end of the step (`cislunar.dynamics.frames`). Both
transformations are linear, so that they are exact for every sigma point. The frames are tabulated
at the ends of steps.

Assumptions and limitations
---------------------------
- A step has to begin and end at tabulated times.
- Low lunar orbits use `lunar_frame`, which preserves the Moon's center and the altitude; all others
  use `pulsating_frame`, which preserves both primaries. In each case the CR3BP is closer to the
  truth in the chosen frame.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_trapezoid

from cislunar.compiled import implements, njit_alloc, njit_noalloc
from cislunar.constants import MU, TIME_UNIT_S
from cislunar.dynamics import forces
from cislunar.dynamics.bundle import take_cloud_step, take_step
from cislunar.dynamics.cr3bp import CR3BP
from cislunar.dynamics.ephemeris import UNITS
from cislunar.dynamics.frames import lunar_frame, pulsating_frame, to_inertial
from cislunar.ephemeris.bodies import GM_MOON, BodyTable
from cislunar.runtime import Array, vectors_of

LOW_LUNAR_KM = 20_000.0
"""Apolune radius below which an orbit is a low lunar orbit, km: a third of the Moon's Hill
radius."""


class _InstantaneousFrameCR3BP(NamedTuple):
    """The CR3BP in the barycentric frame, J2000 axes, for many targets with one frame each;
    nondimensional.

    `step`: interval between tabulated times, the first of which is time zero. `kind` (target,):
    index of the frame of each target. `outward`, `inward` (frame, time, 6, 6): derivative of the
    barycentric state by the rotating one, and its inverse. `origin` (frame, time, 6): the frame's
    barycenter, barycentric. `clock` (frame, time): elapsed time in the units of the frame."""

    mu: float
    step: float
    kind: NDArray[np.int64]
    outward: Array
    inward: Array
    origin: Array
    clock: Array

    @property
    def n_targets(self) -> int:
        """Number of targets, each of which has a frame."""
        return self.kind.size

    def of_targets(self, targets: NDArray[np.int64]) -> "_InstantaneousFrameCR3BP":
        """See `cislunar.dynamics.forces.of_targets`."""
        return self._replace(kind=self.kind[targets])


class _OneFrame(NamedTuple):
    """`_InstantaneousFrameCR3BP` of one target: arrays without the axis of frames."""

    mu: float
    step: float
    outward: Array
    inward: Array
    origin: Array
    clock: Array


def instantaneous_frame_cr3bp(
    table: BodyTable, epoch: float, step_s: float, n_steps: int, low_lunar: ArrayLike
) -> _InstantaneousFrameCR3BP:
    """Tabulate the frames of targets that are propagated by the instantaneous-frame CR3BP for
    `n_steps` steps of `step_s` seconds from `epoch` (TDB seconds past J2000); `low_lunar` (target,)
    is from `is_low_lunar`."""
    times = epoch + step_s * np.arange(n_steps + 1)
    frames = [pulsating_frame(table, times), lunar_frame(table, times)]
    outward = np.array([frame.matrix() / UNITS[:, None] for frame in frames])
    return _InstantaneousFrameCR3BP(
        MU,
        float(step_s / TIME_UNIT_S),
        np.asarray(low_lunar).astype(np.int64),
        outward,
        np.linalg.inv(outward),
        np.array([frame.origin / UNITS for frame in frames]),
        np.array([cumulative_trapezoid(step_s / each.time, initial=0.0) for each in frames]),
    )


def is_low_lunar(state: ArrayLike) -> NDArray[np.bool_]:
    """Whether states lie on ellipses about the Moon with an apolune below 20,000 km.

    Parameters
    ----------
    state : array_like, shape (..., 6)
        CR3BP states, nondimensional, rotating frame.

    Returns
    -------
    ndarray of bool, shape (...)

    Raises
    ------
    ConfigurationError
        If the last axis of `state` has another length, or a value is not a number.
    """
    s = vectors_of("state", state, 6)
    r = (s[..., :3] - [1.0 - MU, 0.0, 0.0]) * UNITS[0]
    # inertial velocity relative to the Moon
    v = (s[..., 3:] + np.cross([0.0, 0.0, 1.0], s[..., :3] - [1.0 - MU, 0.0, 0.0])) * UNITS[3]
    distance = np.linalg.norm(r, axis=-1)
    energy = 0.5 * np.sum(v * v, axis=-1) - GM_MOON / distance
    momentum2 = np.sum(np.cross(r, v) ** 2, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        eccentricity = np.sqrt(np.maximum(0.0, 1.0 + 2.0 * energy * momentum2 / GM_MOON**2))
        apolune = -GM_MOON / (2.0 * energy) * (1.0 + eccentricity)
    return (energy < 0.0) & (apolune < LOW_LUNAR_KM)


def inertial_states(
    state: ArrayLike, table: BodyTable, time: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Transform CR3BP states to the barycentric frame, each with the suitable instantaneous frame.

    Parameters
    ----------
    state : array_like, shape (target, 6)
        Nondimensional, rotating frame.
    table : BodyTable
        Positions of the bodies.
    time : float
        TDB seconds past J2000.

    Returns
    -------
    state : ndarray, shape (target, 6)
        Barycentric frame, J2000 axes, nondimensional.
    low_lunar : ndarray of bool, shape (target,)
        Which targets are in low lunar orbits.

    Raises
    ------
    ConfigurationError
        If the time lies outside of the table.
    """
    low = is_low_lunar(state)
    pulsating, lunar = (
        to_inertial(state, make(table, time)) / UNITS for make in (pulsating_frame, lunar_frame)
    )
    return np.where(low[:, None], lunar, pulsating), low


@implements(forces.of_state, _InstantaneousFrameCR3BP)
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


@njit_noalloc
def _map(matrix, shift_in, shift_out, state, out):
    """shift_out + matrix (state - shift_in) of a bundle (6, N), into `out`."""
    for c in range(6):
        for i in range(state.shape[1]):
            out[c, i] = shift_out[c]
        for d in range(6):
            factor, shift = matrix[c, d], shift_in[d]
            for i in range(state.shape[1]):
                out[c, i] += factor * (state[d, i] - shift)


@njit_alloc
def _enter(model, t, state, dt, out):
    """Transform states into their frame, `out`; returns final table index and step length."""
    k, last = int(np.floor(t / model.step + 0.5)), int(np.floor((t + dt) / model.step + 0.5))
    _map(model.inward[k], model.origin[k], np.zeros(6), state, out)
    return last, model.clock[last] - model.clock[k]


@njit_alloc
def _leave(model, last, state, out):
    """Transform states out of their frame."""
    _map(model.outward[last], np.zeros(6), model.origin[last], state, out)


@implements(take_step, _OneFrame)
def _step(model, t, state, dt, slopes, work):
    last, duration = _enter(model, t, state, dt, work)
    take_step(CR3BP(model.mu), 0.0, work, duration, slopes, state)
    _leave(model, last, work, state)


@implements(take_step, _InstantaneousFrameCR3BP)
def _step_of_each(model, t, state, dt, slopes, work):
    _step_each(model, t, state, dt, slopes.shape[0])


@njit_alloc
def _step_each(model, t, state, dt, stages):
    """One step of a bundle with the states of all targets, each in its own frame."""
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
