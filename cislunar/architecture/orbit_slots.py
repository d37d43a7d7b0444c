"""Orbit slots: sufficiently stable orbits, and phases on them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError
from cislunar.orbits.families import OrbitSet
from cislunar.runtime.arguments import array_of, count_of, indices_of


class OrbitSlots(NamedTuple):
    """Phases of orbits, orbit by orbit.

    Attributes
    ----------
    orbit : ndarray of int64, shape (slot,)
        Orbit of each slot in the library of candidates.
    phase : ndarray, shape (slot,)
        Fraction of the period by which its first satellite is ahead.
    family : ndarray of str, shape (slot,)
        Family of the orbit; members of a family are consecutive and ordered along it.
    stability_index : ndarray, shape (slot,)
        Stability index of the orbit, 1 = linearly stable.
    """

    orbit: NDArray[np.int64]
    phase: NDArray[np.float64]
    family: NDArray[np.str_]
    stability_index: NDArray[np.float64]


def steady_orbits(orbits: OrbitSet, max_stability_index: float) -> NDArray[np.int64]:
    """Indices of the orbits whose stability index is at most `max_stability_index`.

    Raises
    ------
    ConfigurationError
        If there is none.
    """
    allowed = np.flatnonzero(orbits.stability_index <= max_stability_index)
    if allowed.size == 0:
        raise ConfigurationError(
            f"max_stability_index = {max_stability_index} leaves no orbit: the least is "
            f"{np.min(orbits.stability_index):.4g}"
        )
    return allowed


def orbit_slots_at(orbits: OrbitSet, orbit: ArrayLike, phase: ArrayLike) -> OrbitSlots:
    """Orbit slots from indices of orbits and fractions of the period, both of shape (slot,); raises
    a `ConfigurationError` for an orbit that does not exist or a phase that is missing."""
    at = indices_of("orbit", orbit, len(orbits.family))
    ahead = array_of("phase", phase, at.shape)
    family, index = np.asarray(orbits.family)[at], np.asarray(orbits.stability_index)[at]
    return OrbitSlots(at, ahead, family, index)


def free_orbit_slots(
    orbits: OrbitSet, phases: int, max_stability_index: float = np.inf
) -> OrbitSlots:
    """The phases 0, 1/phases, ... of every orbit with a stability index of at most a limit.

    Parameters
    ----------
    orbits : OrbitSet
        Candidate orbits.
    phases : int
        Number of phases of each orbit.
    max_stability_index : float
        Orbits with a larger stability index are excluded.

    Returns
    -------
    OrbitSlots

    Raises
    ------
    ConfigurationError
        If `phases` is less than 1, or no orbit has a stability index within the limit.
    """
    phases = count_of("phases", phases)
    allowed = steady_orbits(orbits, max_stability_index)
    phase = np.tile(np.arange(phases) / phases, allowed.size)
    return orbit_slots_at(orbits, np.repeat(allowed, phases), phase)


def satellite_orbit_slots(
    orbits: OrbitSet, orbit: ArrayLike, satellites: ArrayLike, phase: ArrayLike
) -> OrbitSlots:
    """Orbit slot of every satellite of an architecture, slot by slot.

    Parameters
    ----------
    orbits : OrbitSet
        Candidate orbits.
    orbit, satellites : array_like of int, shape (slot,)
        Orbits, and satellites on each, at j/n of the period.
    phase : array_like, shape (slot,)
        Fractions of the period by which the satellites of each slot are ahead of these phases.

    Returns
    -------
    OrbitSlots
    """
    ahead = [p + np.arange(n) / n for n, p in zip(satellites, phase, strict=True)]
    return orbit_slots_at(orbits, np.repeat(orbit, satellites), np.concatenate(ahead))
