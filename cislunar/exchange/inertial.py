"""States of the three-body problem in inertial axes, as other tools want them.

The rotating frame of the circular problem is none other tools know. Its inertial axes are here
those of the Moon at the epoch, turned by the ephemeris into the ICRF; from then on the frame turns
uniformly, one radian per unit of time, about z, as the circular problem says. So a path that is
ballistic in the rotating frame is ballistic among an Earth and a Moon on circles, the map is exact
both ways, and directions are those the sensors measure.

Assumptions and limitations
---------------------------
- The Moon of these states is on a circle of l*; the true one leaves it by up to 6 per cent of the
  distance and, in half a month, some 6 degrees in direction. Lengths are not scaled by it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.ephemeris.kernel import DEFAULT_KERNEL
from cislunar.ephemeris.sampling import sample_ephemeris
from cislunar.errors import ConfigurationError

Array = NDArray[np.float64]

CENTERS = {"EARTH": -MU, "MOON": 1.0 - MU, "EARTH BARYCENTER": 0.0}
"""Place of the origins on the x axis, nondimensional, by their names in CCSDS messages."""


class Epoch(NamedTuple):
    """When the axes of the circular problem are which.

    Attributes
    ----------
    tdb_s : float
        TDB seconds past J2000.
    rotation : ndarray, shape (3, 3)
        From the ICRF to the rotating frame at that time.
    """

    tdb_s: float
    rotation: Array


def epoch_at(epoch_jd: float, kernel: str = DEFAULT_KERNEL) -> Epoch:
    """The frame at a date.

    Parameters
    ----------
    epoch_jd : float
        Julian date, UTC.
    kernel : str
        As for `cislunar.ephemeris.sampling.sample_ephemeris`.

    Returns
    -------
    Epoch

    Raises
    ------
    ConfigurationError, InputFileError
        As of `cislunar.ephemeris.sampling.sample_ephemeris`.
    """
    sampled = sample_ephemeris(epoch_jd, 0.0, kernel=kernel)
    return Epoch(float(sampled.et[0]), sampled.moon_rotation[0])


def inertial_states(
    state: ArrayLike, elapsed_s: ArrayLike, epoch: Epoch, center: str = "EARTH"
) -> Array:
    """States in the ICRF.

    Parameters
    ----------
    state : array_like, shape (..., time, 6)
        Nondimensional, rotating frame.
    elapsed_s : array_like, shape (time,)
        Times since the epoch, s.
    epoch : Epoch
    center : str
        Origin, one of `CENTERS`.

    Returns
    -------
    ndarray, shape (..., time, 6)
        km and km/s.

    Raises
    ------
    ConfigurationError
        If there is no such centre.
    """
    shifted = np.asarray(state, dtype=float) - _origin(center)
    return np.einsum("tij,...tj->...ti", _to_inertial(elapsed_s, epoch), shifted)


def rotating_states(
    state: ArrayLike, elapsed_s: ArrayLike, epoch: Epoch, center: str = "EARTH"
) -> Array:
    """The inverse of `inertial_states`: from km and km/s, ICRF, to the rotating frame."""
    back = np.linalg.inv(_to_inertial(elapsed_s, epoch))
    return np.einsum("tij,...tj->...ti", back, np.asarray(state, dtype=float)) + _origin(center)


def inertial_covariances(covariance: ArrayLike, elapsed_s: ArrayLike, epoch: Epoch) -> Array:
    """Covariances, shape (..., time, 6, 6), carried like `inertial_states`; km^2 ... km^2/s^2."""
    turn = _to_inertial(elapsed_s, epoch)
    return turn @ np.asarray(covariance, dtype=float) @ np.swapaxes(turn, -1, -2)


def _origin(center: str) -> Array:
    if center not in CENTERS:
        raise ConfigurationError(f"center {center!r} is unknown: use one of {list(CENTERS)}")
    return np.array([CENTERS[center], 0.0, 0.0, 0.0, 0.0, 0.0])


def _to_inertial(elapsed_s: ArrayLike, epoch: Epoch) -> Array:
    """Matrices (time, 6, 6) from the rotating frame to the ICRF, with the units."""
    angle = np.asarray(elapsed_s, dtype=float) / TIME_UNIT_S
    zero, one = np.zeros_like(angle), np.ones_like(angle)
    cos, sin = np.cos(angle), np.sin(angle)
    turned = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], axis=-1)
    axes = epoch.rotation.T @ turned.reshape(*angle.shape, 3, 3)
    rate = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    out = np.zeros((*angle.shape, 6, 6))
    out[..., :3, :3] = LENGTH_UNIT_KM * axes
    out[..., 3:, 3:] = LENGTH_UNIT_KM / TIME_UNIT_S * axes
    out[..., 3:, :3] = out[..., 3:, 3:] @ rate
    return out
