"""Paths of fitted orbits, and their derivatives."""

import numpy as np
from numpy.typing import NDArray

from cislunar.dynamics import Radiation, propagate_stm
from cislunar.errors import CislunarError

Array = NDArray[np.float64]

_TOLERANCE = 1e-9
"""Of the propagation, relative to one unit of length."""


def propagated(state: Array, epoch: Array, time: Array, forces: tuple) -> tuple[Array, Array]:
    """Orbits and their transition matrices at common times.

    Parameters
    ----------
    state : ndarray, shape (n, 6)
        Nondimensional, propagation frame.
    epoch : ndarray, shape (n,)
        Times of the states, nondimensional, since the epoch of the force model.
    time : ndarray, shape (m,)
    forces : NamedTuple
        CR3BP or ephemeris forces.

    Returns
    -------
    states : ndarray, shape (n, m, 6)
    transition : ndarray, shape (n, m, 6, 6)
        NaN for an orbit that cannot be propagated.
    """
    given = {"forces": forces, "rtol": _TOLERANCE, "atol": _TOLERANCE}
    try:
        return propagate_stm(state, time - epoch[:, None], start=epoch, **given)
    except CislunarError:
        if len(state) == 1:
            shape = 1, time.size, 6
            return np.full(shape, np.nan), np.full((*shape, 6), np.nan)
    parts = [propagated(state[[k]], epoch[[k]], time, forces) for k in range(len(state))]
    return tuple(np.concatenate(each) for each in zip(*parts, strict=True))


def by_radiation(
    start: Array, epoch: Array, time: Array, path: Array, forces: tuple, sigma: float
) -> Array:
    """Derivatives of positions by the factor of the radiation pressure on an object.

    Parameters
    ----------
    start : ndarray, shape (1, 6)
        State at the epoch, nondimensional, propagation frame.
    epoch : ndarray, shape (1,)
    time, path : ndarray, shapes (row,) and (row, 6)
        Times, and the states there with `forces`.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    sigma : float
        Standard deviation of the factor.

    Returns
    -------
    ndarray, shape (row, 3, 0) or (row, 3, 1)
        In standard deviations of the factor. There is no derivative without a radiation pressure,
        if its factor is known, or where the path cannot be propagated.
    """
    none = np.empty((time.size, 3, 0))
    if not (sigma > 0.0 and isinstance(getattr(forces, "radiation", None), Radiation)):
        return none
    strength = forces.radiation.strength * (1.0 + sigma)
    changed = forces._replace(radiation=forces.radiation._replace(strength=strength))
    shift = (propagated(start, epoch, time, changed)[0][0] - path)[:, :3, None]
    return shift if np.all(np.isfinite(shift)) else none
