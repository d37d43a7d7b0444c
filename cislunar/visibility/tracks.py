"""Positions of satellites along periodic orbits over time.

Satellites are propagated over one period only and repeated, because errors would otherwise grow
over the horizon (Paul & Fan, section 5.1). Positions come from dense output at the exact times.
"""

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import MU
from cislunar.dynamics import CR3BP, propagate, propagate_periodic
from cislunar.errors import ConfigurationError
from cislunar.runtime import Array, array_of


def satellite_tracks(
    state: ArrayLike,
    period: ArrayLike,
    phase: ArrayLike,
    times: ArrayLike,
    *,
    propagator: str = "dopri5",
    mu: float = MU,
) -> Array:
    """Positions of satellites along periodic orbits.

    Parameters
    ----------
    state : array_like, shape (orbit, 6)
        Epoch states of the first satellites, nondimensional, rotating frame.
    period : array_like, shape (orbit,)
        Periods, nondimensional; 0 for an open trajectory, which has no phases.
    phase : array_like, shape (phase,)
        Fractions of the period ahead of the first satellite.
    times : array_like, shape (time,)
        Nondimensional times since the epoch.
    propagator : str
        "dopri5" or "dop853".
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray, shape (orbit, phase, time, 3)
        Nondimensional, rotating frame.

    Raises
    ------
    ConfigurationError
        If a period is negative or not one of each orbit, there is no orbit, the propagator is
        unknown, another array is not finite or of the wrong shape, or a state is not of 6 finite
        numbers or is evidently in km.
    ConvergenceError
        If a satellite meets the center of a primary.
    """
    times, phase = array_of("times", times, ("time",)), array_of("phase", phase, ("phase",))
    states = array_of("state", state, ("orbit", 6))
    tracks = []
    for initial, duration in zip(states, array_of("period", period, (len(states),)), strict=True):
        shifted = (times[None, :] + phase[:, None] * duration).ravel()
        if duration == 0.0:
            path = propagate(initial, shifted, forces=CR3BP(mu), method=propagator)
        else:
            path = propagate_periodic(initial, duration, shifted, mu=mu, method=propagator)
        tracks.append(path[:, :3].reshape(len(phase), len(times), 3))
    return np.stack(tracks)


def architecture_tracks(
    state: ArrayLike,
    period: ArrayLike,
    satellites: ArrayLike,
    times: ArrayLike,
    *,
    phase: ArrayLike = 0.0,
    propagator: str = "dopri5",
    mu: float = MU,
) -> Array:
    """Positions of every satellite of an architecture.

    Parameters
    ----------
    state, period, times, propagator, mu
        See `satellite_tracks`; one chosen orbit per slot.
    satellites : array_like of int, shape (slot,)
        Satellites on each orbit, at phases j/n of the period.
    phase : array_like, shape (slot,) or ()
        Fractions of the period by which the satellites of each slot are ahead of these phases.

    Returns
    -------
    ndarray, shape (satellite, time, 3)
        Nondimensional, rotating frame; slot by slot.

    Raises
    ------
    ConfigurationError, ConvergenceError
        If an argument is impossible, or a satellite meets a primary; see `satellite_tracks`.
    """
    states = array_of("state", state, ("slot", 6))
    slots = (len(states),)
    counts = array_of("satellites", satellites, slots)
    if np.any((counts < 1.0) | (counts != np.floor(counts))):
        raise ConfigurationError(
            f"satellites = {counts.tolist()} must be whole numbers, at least 1"
        )
    ahead = array_of("phase", phase)
    ahead = array_of("phase", np.broadcast_to(ahead, slots) if ahead.ndim == 0 else ahead, slots)
    each = zip(states, array_of("period", period, slots), counts.astype(int), ahead, strict=True)
    tracks = [
        satellite_tracks([s], [p], a + np.arange(n) / n, times, propagator=propagator, mu=mu)[0]
        for s, p, n, a in each
    ]
    return np.concatenate(tracks)
