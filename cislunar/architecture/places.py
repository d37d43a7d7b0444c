"""Places that satellites may take: steady orbits, and phases on them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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


def places_of(orbits: OrbitSet, allowed: NDArray[np.int64], phase: NDArray[np.float64]) -> Places:
    """The same phases (phase,) on each of the allowed orbits.

    Parameters
    ----------
    orbits : OrbitSet
        Candidate orbits.
    allowed : ndarray of int64, shape (allowed,)
        Indices of those with places.
    phase : ndarray, shape (phase,)
        Fractions of the period.

    Returns
    -------
    Places
    """
    orbit = np.repeat(allowed, len(phase))
    family, index = np.asarray(orbits.family)[orbit], np.asarray(orbits.stability_index)[orbit]
    return Places(orbit, np.tile(phase, len(allowed)), family, index)
