"""Orbits at given times, and which of them have the same state.

The radiation pressure on an object is its assumed one times a factor with the standard deviation s.
A displacement d of one standard deviation of the factor grows with time,

    d(t) = Phi(t, t_0) d(t_0) + x(t; 1 + s) - x(t; 1),   P(t) = Phi P(t_0) Phi' + d d',          (1)

with the transition matrix Phi and the path x of an orbit with a given factor. The factor is taken
to be independent of the state at the epoch, at which d is zero.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cislunar.association import gate_threshold
from cislunar.dynamics import Radiation, propagate_stm
from cislunar.orbit_determination.least_squares import OrbitFits
from cislunar.runtime import Array, Indices

_TOLERANCE = 1e-12
"""Of the propagation, in units of length. Detections of a week determine one component of a state
on an unstable orbit to some centimeters, or 1e-10."""

_TOGETHER, _HELD = 16, 64
"""Orbits with times of their own that are integrated together, and whose transition matrices are
held at once."""

_ROUNDING = 1e-14
"""Least share in the largest eigenvalue of a correlation matrix that is not lost to rounding."""


def propagated(state: Array, epoch: Array, time: Array, forces: tuple) -> tuple[Array, Array]:
    """Orbits and their transition matrices at given times.

    Parameters
    ----------
    state : ndarray, shape (n, 6)
        Nondimensional, propagation frame.
    epoch : ndarray, shape (n,)
        Times of the states, nondimensional, since the epoch of the force model.
    time : ndarray, shape (m,) or (n, m)
        For all orbits, or for each.
    forces : NamedTuple
        CR3BP or ephemeris forces.

    Returns
    -------
    states : ndarray, shape (n, m, 6)
    transition : ndarray, shape (n, m, 6, 6)
        NaN for an orbit that cannot be propagated.
    """
    given = {"forces": forces, "rtol": _TOLERANCE, "atol": _TOLERANCE, "on_failure": "nan"}
    return propagate_stm(state, time - epoch[:, None], start=epoch, **given)


def propagated_each(
    state: Array,
    epoch: Array,
    times: Sequence[Array],
    forces: tuple,
    radiation_sigma: float = 0.0,
) -> Iterator[tuple[Array, Array, Array]]:
    """Orbits, each at its own times; several are integrated together.

    Parameters
    ----------
    state, epoch, forces
        See `propagated`.
    times : sequence of ndarray, shape (m,)
        At least one time of each orbit.
    radiation_sigma : float
        Standard deviation of the factor of the radiation pressure on an object; 0: it is known.

    Yields
    ------
    states, transition, displacement : ndarray
        Of each orbit, shapes (m, 6), (m, 6, 6) and (m, 6, 0 or 1), see `propagated` and
        `by_radiation`.
    """
    size = np.array([each.size for each in times], dtype=np.int64)
    for first in range(0, size.size, _HELD):
        order = first + np.argsort(size[first : first + _HELD], kind="stable")
        found = {}
        for begin in range(0, order.size, _TOGETHER):
            own = order[begin : begin + _TOGETHER]
            longest = int(size[own[-1]])
            time = [np.pad(times[k], (0, longest - size[k]), "edge") for k in own.tolist()]
            given = state[own], epoch[own], np.stack(time)
            path, transition = propagated(*given, forces)
            shift = by_radiation(*given, path, forces, radiation_sigma)
            for k, *each in zip(own.tolist(), path, transition, shift, strict=True):
                found[k] = tuple(part[: size[k]] for part in each)
        yield from (found[k] for k in sorted(found))


def by_radiation(
    state: Array, epoch: Array, time: Array, path: Array, forces: tuple, sigma: float
) -> Array:
    """Displacements of orbits by one standard deviation of the factor of their radiation pressure.

    Parameters
    ----------
    state, epoch : ndarray, shapes (n, 6) and (n,)
        As for `propagated`.
    time, path : ndarray, shapes (m,) or (n, m), and (n, m, 6)
        Times, and the states there with `forces`.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    sigma : float
        Standard deviation of the factor.

    Returns
    -------
    ndarray, shape (n, m, 6, 0) or (n, m, 6, 1)
        There is no displacement without a radiation pressure, or if its factor is known. It is zero
        for an orbit that cannot be propagated with the changed factor.
    """
    if not (sigma > 0.0 and isinstance(getattr(forces, "radiation", None), Radiation)):
        return np.empty((*path.shape, 0))
    strength = forces.radiation.strength * (1.0 + sigma)
    changed = forces._replace(radiation=forces.radiation._replace(strength=strength))
    shift = propagated(state, epoch, time, changed)[0] - path
    good = np.all(np.isfinite(shift), axis=(1, 2))
    return np.where(good[:, None, None], shift, 0.0)[..., None]


class OrbitStates(NamedTuple):
    """Orbits with the uncertainty of their radiation pressure.

    Attributes
    ----------
    epoch : ndarray, shape (orbit,)
        Nondimensional.
    state : ndarray, shape (orbit, 6)
        Nondimensional, propagation frame.
    known_radiation : ndarray, shape (orbit, 6, 6)
        Covariances of the states if the radiation pressure is as assumed.
    shift : ndarray, shape (orbit, 6)
        d of equation (1).
    """

    epoch: Array
    state: Array
    known_radiation: Array
    shift: Array

    @classmethod
    def of(cls, fits: OrbitFits) -> "OrbitStates":
        """The states of fits at their epochs."""
        return cls(*fits[:3], np.zeros_like(fits.state))

    def take(self, which: Indices) -> "OrbitStates":
        """Some of the orbits."""
        return OrbitStates(*(each[which] for each in self))

    @property
    def covariance(self) -> Array:
        """Covariances (orbit, 6, 6) of the states, equation (1)."""
        return self.known_radiation + self.shift[:, :, None] * self.shift[:, None]


def orbits_at(
    starts: OrbitStates, time: float, forces: tuple, radiation_sigma: float = 0.0
) -> tuple[OrbitStates, Indices]:
    """States and covariances of orbits at a time.

    Parameters
    ----------
    starts : OrbitStates
    time : float
        Nondimensional.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    radiation_sigma : float
        Standard deviation of the factor of the radiation pressure on an object; 0: it is known.

    Returns
    -------
    OrbitStates
    kept : ndarray of int, shape (orbit,)
        Which of the given orbits these are: those that meet a body until then, or whose covariance
        is not finite, are left out.
    """
    epoch, state, covariance, shift = starts
    at = np.array([time])
    path, transition = propagated(state, epoch, at, forces)
    more = by_radiation(state, epoch, at, path, forces, radiation_sigma).sum(axis=3)[:, 0]
    moved, stm = path[:, 0], transition[:, 0]
    then = stm @ covariance @ stm.swapaxes(1, 2)
    shift = np.einsum("nij,nj->ni", stm, shift) + more
    kept = np.flatnonzero(np.isfinite(then).all(axis=(1, 2)))
    return OrbitStates(np.full(kept.size, time), moved[kept], then[kept], shift[kept]), kept


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
    moved, kept = orbits_at(OrbitStates.of(fits), float(fits.epoch.max()), forces)
    state, covariance = moved.state, moved.covariance
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
