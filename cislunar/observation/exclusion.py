"""Exclusion angles: how near to the Sun, Moon and Earth a telescope may point."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import MU
from cislunar.errors import ConfigurationError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ExclusionAngles:
    """Smallest angles between the line of sight and each bright body (Paul & Fan, section 3).

    Attributes
    ----------
    sun_deg, moon_deg, earth_deg : float
        Degrees in [0, 180); measured at the observer, from the centre of the body.

    Raises
    ------
    ConfigurationError
        If an angle lies outside [0, 180).
    """

    sun_deg: float = 35.0
    moon_deg: float = 5.0
    earth_deg: float = 15.0

    def __post_init__(self) -> None:
        for body in ("sun_deg", "moon_deg", "earth_deg"):
            angle = getattr(self, body)
            if not 0.0 <= angle < 180.0:
                raise ConfigurationError(f"exclusion angle {body} = {angle} must lie in [0, 180)")

    @property
    def cosines(self) -> Array:
        """Cosines of the Sun, Moon and Earth angles, shape (3,)."""
        return np.cos(np.deg2rad([self.sun_deg, self.moon_deg, self.earth_deg]))


def directions_to_bodies(position: ArrayLike, sun_position: ArrayLike, mu: float = MU) -> Array:
    """Unit vectors from observers to the Sun, Moon and Earth.

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Observers, nondimensional, rotating frame.
    sun_position : array_like, shape (..., 3)
        Sun, nondimensional, rotating frame; broadcast against `position`.
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Second-last axis: Sun, Moon, Earth; last axis: component.
    """
    observer = np.asarray(position, dtype=float)
    sun = np.asarray(sun_position, dtype=float) - observer
    moon = np.array([1.0 - mu, 0.0, 0.0]) - observer
    earth = np.array([-mu, 0.0, 0.0]) - observer
    toward = np.stack(np.broadcast_arrays(sun, moon, earth), axis=-2)
    return toward / np.linalg.norm(toward, axis=-1, keepdims=True)


def outside_exclusion(
    observer_to_target: ArrayLike, toward_bodies: ArrayLike, angles: ExclusionAngles
) -> NDArray[np.bool_]:
    """Whether lines of sight keep clear of the Sun, Moon and Earth.

    Parameters
    ----------
    observer_to_target : array_like, shape (..., 3)
        Position differences, any unit, rotating frame.
    toward_bodies : array_like, shape (..., 3, 3)
        Unit vectors of `directions_to_bodies`, broadcast against the lines of sight.
    angles : ExclusionAngles
        The limits.

    Returns
    -------
    ndarray of bool, shape (...)
        True where all three angles exceed their limits.
    """
    line = np.asarray(observer_to_target, dtype=float)
    distance = np.linalg.norm(line, axis=-1)
    projections = np.einsum("...bc,...c->...b", np.asarray(toward_bodies, dtype=float), line)
    return np.all(projections < distance[..., None] * angles.cosines, axis=-1)
