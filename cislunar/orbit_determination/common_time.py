"""Orbits at common times, and which of them have the same state."""

import numpy as np

from cislunar.association import gate_threshold
from cislunar.dynamics import propagate_stm
from cislunar.errors import CislunarError
from cislunar.orbit_determination.least_squares import OrbitFits
from cislunar.runtime import Array, Indices

_TOLERANCE = 1e-9
"""Of the propagation, relative to one unit of length: half a meter after a week."""

_ROUNDING = 1e-14
"""Least share in the largest eigenvalue of a correlation matrix that is not lost to rounding."""


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


def orbits_at(
    starts: tuple[Array, Array, Array], time: float, forces: tuple
) -> tuple[Array, Array, Indices]:
    """States and covariances of orbits at a time.

    Parameters
    ----------
    starts : tuple of ndarray, shapes (orbit,), (orbit, 6) and (orbit, 6, 6)
        Epochs, states and covariances, nondimensional, propagation frame.
    time : float
        Nondimensional.
    forces : NamedTuple
        CR3BP or ephemeris forces.

    Returns
    -------
    state : ndarray, shape (orbit, 6)
    covariance : ndarray, shape (orbit, 6, 6)
    kept : ndarray of int, shape (orbit,)
        Which of the given orbits these are: those that meet a body until then, or whose covariance
        is not finite, are left out.
    """
    epoch, state, covariance = starts
    moved, stm = (each[:, 0] for each in propagated(state, epoch, np.array([time]), forces))
    then = stm @ covariance @ stm.swapaxes(1, 2)
    kept = np.flatnonzero(np.isfinite(then).all(axis=(1, 2)))
    return moved[kept], then[kept], kept


def same_states(fits: OrbitFits, probability: float, *, forces: tuple) -> Indices:
    """Pairs of orbits whose states may be equal.

    The difference d of two states with independent errors satisfies d' (P_1 + P_2)^-1 d < gate at
    the last epoch of all orbits, with the gate of six degrees of freedom.

    Parameters
    ----------
    fits : OrbitFits
        Converged fits.
    probability : float
        Probability that the gate keeps two orbits of one object.
    forces : NamedTuple
        Force model.

    Returns
    -------
    ndarray of int, shape (pair, 2)
        In increasing order.

    Raises
    ------
    ConfigurationError
        If `probability` does not lie between 0 and 1.
    """
    if fits.epoch.size < 2:
        return np.empty((0, 2), dtype=np.int64)
    state, covariance, kept = orbits_at(fits[:3], float(fits.epoch.max()), forces)
    gate, found = gate_threshold(probability, 6), []
    variance = np.trace(covariance, axis1=1, axis2=2)
    for k in range(len(state) - 1):
        apart = state[k + 1 :] - state[k]
        # no eigenvalue of a covariance exceeds its trace, so that most pairs need no inverse
        least = np.sum(apart**2, axis=1) / (variance[k + 1 :] + variance[k])
        close = np.flatnonzero(~(least > 2.0 * gate))
        near = k + 1 + close
        squared = squared_distances(apart[close], covariance[near] + covariance[k])
        near = near[squared <= gate]
        found.append(np.stack([np.full(near.size, kept[k]), kept[near]], axis=1))
    return np.concatenate([np.empty((0, 2), dtype=np.int64), *found])


def squared_distances(vector: Array, covariance: Array) -> Array:
    """Squared Mahalanobis distances.

    An eigenvalue that is lost to rounding, as of orbits with an undetermined range, counts as the
    least that is not, so that the distance is not too large by it. A covariance with an entry that
    is not finite or a variance that is not positive has no distance.

    Parameters
    ----------
    vector : ndarray, shape (n, m)
    covariance : ndarray, shape (n, m, m)

    Returns
    -------
    ndarray, shape (n,)
        NaN without a distance.
    """
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    valid = np.all(variance > 0.0, axis=1) & np.all(np.isfinite(covariance), axis=(1, 2))
    usable = np.where(valid[:, None, None], covariance, np.eye(covariance.shape[1]))
    scale = np.sqrt(np.diagonal(usable, axis1=1, axis2=2))
    correlation = usable / (scale[:, :, None] * scale[:, None, :])
    share, axes = np.linalg.eigh(correlation)
    share = np.maximum(share, _ROUNDING * share[:, -1:])
    squared = np.sum(np.einsum("nij,ni->nj", axes, vector / scale) ** 2 / share, axis=1)
    return np.where(valid, squared, np.nan)
