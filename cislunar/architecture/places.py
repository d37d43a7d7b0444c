"""Places that satellites may take: steady orbits, and phases on them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError
from cislunar.orbits.families import OrbitSet


class Places(NamedTuple):
    """Phases of orbits, orbit by orbit.

    Attributes
    ----------
    orbit : ndarray of int64, shape (place,)
        Orbit of each place in the library the places were taken from.
    phase : ndarray, shape (place,)
        Fraction of the period by which its first satellite is ahead.
    family : ndarray of str, shape (place,)
        Family of the orbit; members of a family are consecutive and ordered along it.
    stability_index : ndarray, shape (place,)
        Stability index of the orbit, 1 = linearly stable.
    """

    orbit: NDArray[np.int64]
    phase: NDArray[np.float64]
    family: NDArray[np.str_]
    stability_index: NDArray[np.float64]


def steady_orbits(orbits: OrbitSet, max_stability_index: float) -> NDArray[np.int64]:
    """Indices of the orbits whose stability index is not above a cap.

    Parameters
    ----------
    orbits : OrbitSet
        Candidate orbits.
    max_stability_index : float
        The cap; infinite for all orbits.

    Returns
    -------
    ndarray of int64, shape (allowed,)

    Raises
    ------
    ConfigurationError
        If there are none.
    """
    allowed = np.flatnonzero(orbits.stability_index <= max_stability_index)
    if allowed.size == 0:
        raise ConfigurationError(
            f"max_stability_index = {max_stability_index} leaves no orbit: the least is "
            f"{np.min(orbits.stability_index):.4g}"
        )
    return allowed


def places_at(orbits: OrbitSet, orbit: ArrayLike, phase: ArrayLike) -> Places:
    """Phases of orbits as places.

    Parameters
    ----------
    orbits : OrbitSet
        Candidate orbits.
    orbit : array_like of int, shape (place,)
        Index of each place's orbit.
    phase : array_like, shape (place,)
        Fractions of the period.

    Returns
    -------
    Places
    """
    at = np.asarray(orbit, dtype=np.int64)
    family, index = np.asarray(orbits.family)[at], np.asarray(orbits.stability_index)[at]
    return Places(at, np.asarray(phase, dtype=float), family, index)


def free_places(orbits: OrbitSet, phases: int, max_stability_index: float = np.inf) -> Places:
    """The phases 0, 1/phases, ... of every orbit steady enough.

    Parameters
    ----------
    orbits : OrbitSet
        Candidate orbits.
    phases : int
        Number of phases of each.
    max_stability_index : float
        Orbits of a larger stability index are left out.

    Returns
    -------
    Places

    Raises
    ------
    ConfigurationError
        If `phases` is below 1, or no orbit is steady enough.
    """
    if phases < 1:
        raise ConfigurationError(f"phases = {phases} must be at least 1")
    allowed = steady_orbits(orbits, max_stability_index)
    phase = np.tile(np.arange(phases) / phases, allowed.size)
    return places_at(orbits, np.repeat(allowed, phases), phase)


def satellite_places(
    orbits: OrbitSet, orbit: ArrayLike, satellites: ArrayLike, phase: ArrayLike
) -> Places:
    """The place of every satellite of an architecture.

    Parameters
    ----------
    orbits : OrbitSet
        Candidate orbits.
    orbit, satellites : array_like of int, shape (slot,)
        Orbits, and satellites on each, at j/n of the period.
    phase : array_like, shape (slot,)
        Fractions of the period by which the satellites of each slot are ahead of that.

    Returns
    -------
    Places
        One for each satellite, slot by slot.
    """
    ahead = [p + np.arange(n) / n for n, p in zip(satellites, phase, strict=True)]
    return places_at(orbits, np.repeat(orbit, satellites), np.concatenate(ahead))
