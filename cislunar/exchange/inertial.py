"""Transformation of CR3BP states to inertial axes, for exchange with other tools.

The inertial axes are those of the rotating frame at the epoch, with x towards the ephemeris Moon,
rotated into the ICRF by the ephemeris. From then on the frame rotates uniformly about z, one radian
per unit of time, as the CR3BP assumes. Therefore a ballistic path in the rotating frame is
ballistic with an Earth and a Moon on circular orbits, the transformation is exact in both
directions, and directions are those that the sensors measure.

Assumptions and limitations
---------------------------
- The Moon of these states is on a circle of radius l*. The ephemeris Moon differs from it by up to
  6 percent in distance and, within half a month, by some 6 degrees in direction. Lengths are not
  scaled accordingly.
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
"""Positions of the origins on the x axis, nondimensional, by their names in CCSDS messages."""


class Epoch(NamedTuple):
    """Epoch of the CR3BP and its axes at that time.

    Attributes
    ----------
    tdb_s : float
        TDB seconds past J2000.
    rotation : ndarray, shape (3, 3)
        Rotation from the ICRF to the rotating frame at that time.
    """

    tdb_s: float
    rotation: Array


def epoch_at(epoch_jd: float, kernel: str = DEFAULT_KERNEL) -> Epoch:
    """Epoch and axes at a Julian date, UTC. For `kernel` and the errors see
    `cislunar.ephemeris.sampling.sample_ephemeris`."""
    sampled = sample_ephemeris(epoch_jd, 0.0, kernel=kernel)
    return Epoch(float(sampled.et[0]), sampled.moon_rotation[0])


def inertial_states(
    state: ArrayLike, elapsed_s: ArrayLike, epoch: Epoch, center: str = "EARTH"
) -> Array:
    """Transform states (..., time, 6), nondimensional, rotating frame, `elapsed_s` seconds (time,)
    since the epoch, to the ICRF relative to one of `CENTERS`, km and km/s."""
    shifted = np.asarray(state, dtype=float) - _origin(center)
    return np.einsum("tij,...tj->...ti", _to_inertial(elapsed_s, epoch), shifted)


def rotating_states(
    state: ArrayLike, elapsed_s: ArrayLike, epoch: Epoch, center: str = "EARTH"
) -> Array:
    """Transform states from the ICRF, km and km/s, to the rotating frame."""
    back = np.linalg.inv(_to_inertial(elapsed_s, epoch))
    return np.einsum("tij,...tj->...ti", back, np.asarray(state, dtype=float)) + _origin(center)


def inertial_covariances(covariance: ArrayLike, elapsed_s: ArrayLike, epoch: Epoch) -> Array:
    """Transform covariances (..., time, 6, 6) like `inertial_states`; km^2, km^2/s, km^2/s^2."""
    turn = _to_inertial(elapsed_s, epoch)
    return turn @ np.asarray(covariance, dtype=float) @ np.swapaxes(turn, -1, -2)


def icrf_axes(elapsed_s: ArrayLike, epoch: Epoch) -> Array:
    """Rotations (time, 3, 3) from the rotating frame to the ICRF, `elapsed_s` seconds (time,) since
    the epoch."""
    angle = np.asarray(elapsed_s, dtype=float) / TIME_UNIT_S
    zero, one = np.zeros_like(angle), np.ones_like(angle)
    cos, sin = np.cos(angle), np.sin(angle)
    turned = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], axis=-1)
    return epoch.rotation.T @ turned.reshape(*angle.shape, 3, 3)


def rotating_covariances(covariance: ArrayLike, elapsed_s: ArrayLike, epoch: Epoch) -> Array:
    """Transform covariances from the ICRF, km^2, km^2/s, km^2/s^2, to the rotating frame."""
    back = np.linalg.inv(_to_inertial(elapsed_s, epoch))
    return back @ np.asarray(covariance, dtype=float) @ np.swapaxes(back, -1, -2)


def _origin(center: str) -> Array:
    if center not in CENTERS:
        raise ConfigurationError(f"center {center!r} is unknown: use one of {list(CENTERS)}")
    return np.array([CENTERS[center], 0.0, 0.0, 0.0, 0.0, 0.0])


def _to_inertial(elapsed_s: ArrayLike, epoch: Epoch) -> Array:
    """Matrices (time, 6, 6) from the rotating frame, nondimensional, to the ICRF, km and km/s."""
    axes = icrf_axes(elapsed_s, epoch)
    rate = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    out = np.zeros((*axes.shape[:-2], 6, 6))
    out[..., :3, :3] = LENGTH_UNIT_KM * axes
    out[..., 3:, 3:] = LENGTH_UNIT_KM / TIME_UNIT_S * axes
    out[..., 3:, :3] = out[..., 3:, 3:] @ rate
    return out
