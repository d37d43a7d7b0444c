"""Transformation of CR3BP states to inertial axes, for exchange with other tools.

At the epoch, the ephemeris gives the axes of the rotating frame in the ICRF, with x towards the
ephemeris Moon. After the epoch the frame rotates uniformly about z, one radian per unit of time, as
the CR3BP assumes. A ballistic path in the rotating frame is therefore ballistic with an Earth and a
Moon on circular orbits, the transformation has an exact inverse, and directions are those that the
sensors measure.

Assumptions and limitations
---------------------------
- The Moon of these states is on a circle of radius l*. The ephemeris Moon differs from it by up to
  7 percent in distance and, within half a month, by 4 to 15 degrees in direction, depending on the
  epoch. Lengths are not scaled accordingly.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.dynamics.frames import BARYCENTER
from cislunar.ephemeris.kernel import DEFAULT_KERNEL
from cislunar.ephemeris.sampling import sample_ephemeris
from cislunar.errors import placed
from cislunar.exchange.key_values import CENTERS
from cislunar.exchange.oem import Segment, state_at
from cislunar.exchange.table_rows import check_state
from cislunar.runtime.arguments import Array, require_choice

_PLACES = {"earth": -MU, "moon": 1.0 - MU, BARYCENTER: 0.0}
"""Positions of the origins on the x axis, nondimensional."""

_MESSAGE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
"""Components of states in messages (CCSDS 502.0-B, section 4.2.4)."""


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
    """Epoch and axes at a Julian date, UTC; see `cislunar.ephemeris.sampling.sample_ephemeris` for
    the kernel and the errors raised."""
    sampled = sample_ephemeris(epoch_jd, 0.0, kernel=kernel)
    return Epoch(float(sampled.et[0]), sampled.moon_rotation[0])


def inertial_states(
    state: ArrayLike, elapsed_s: ArrayLike, epoch: Epoch, center: str = "EARTH"
) -> Array:
    """Transform states from the rotating frame to the ICRF.

    Parameters
    ----------
    state : array_like, shape (..., time, 6)
        Nondimensional, rotating frame.
    elapsed_s : array_like, shape (time,)
        Times since the epoch, s.
    epoch : Epoch
    center : str
        Origin of the result, one of `cislunar.exchange.CENTERS`.

    Returns
    -------
    ndarray, shape (..., time, 6)
        km and km/s, ICRF.

    Raises
    ------
    ConfigurationError
        If the center is unknown.
    """
    shifted = np.asarray(state, dtype=float) - origin_of(center)
    return np.einsum("tij,...tj->...ti", _to_inertial(elapsed_s, epoch), shifted)


def rotating_states(
    state: ArrayLike, elapsed_s: ArrayLike, epoch: Epoch, center: str = "EARTH"
) -> Array:
    """Transform states from the ICRF to the rotating frame: the inverse of `inertial_states`.

    Parameters
    ----------
    state : array_like, shape (..., time, 6)
        km and km/s, ICRF, relative to `center`.
    elapsed_s, epoch, center
        See `inertial_states`, also for the errors raised.

    Returns
    -------
    ndarray, shape (..., time, 6)
        Nondimensional, rotating frame.
    """
    back = np.linalg.inv(_to_inertial(elapsed_s, epoch))
    return np.einsum("tij,...tj->...ti", back, np.asarray(state, dtype=float)) + origin_of(center)


def rotating_state_at(place: str, segments: Sequence[Segment], epoch: Epoch) -> Array:
    """State (6,) of an object at an epoch, nondimensional, rotating frame, from its segments.

    Raises
    ------
    ConfigurationError, InputFileError
        If the segments do not cover the epoch, or the state or the center is impossible; the
        message begins with `place`.
    """
    with placed(place):
        state, center = state_at(segments, epoch.tdb_s)
        found = rotating_states(state[None], [0.0], epoch, center)[0]
    check_state(f"{place}, object {segments[0].name!r}", _MESSAGE, found, "km")
    return found


def inertial_covariances(covariance: ArrayLike, elapsed_s: ArrayLike, epoch: Epoch) -> Array:
    """Transform covariances from the rotating frame to the ICRF.

    Parameters
    ----------
    covariance : array_like, shape (..., time, 6, 6)
        Of position and velocity, nondimensional, rotating frame.
    elapsed_s, epoch
        See `inertial_states`.

    Returns
    -------
    ndarray, shape (..., time, 6, 6)
        km^2, km^2/s and km^2/s^2, ICRF.
    """
    return _turned(covariance, _to_inertial(elapsed_s, epoch))


def icrf_axes(elapsed_s: ArrayLike, epoch: Epoch) -> Array:
    """Rotations from the rotating frame to the ICRF.

    Parameters
    ----------
    elapsed_s : array_like, shape (time,)
        Times since the epoch, s.
    epoch : Epoch

    Returns
    -------
    ndarray, shape (time, 3, 3)
    """
    angle = np.asarray(elapsed_s, dtype=float) / TIME_UNIT_S
    zero, one = np.zeros_like(angle), np.ones_like(angle)
    cos, sin = np.cos(angle), np.sin(angle)
    turned = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], axis=-1)
    return epoch.rotation.T @ turned.reshape(*angle.shape, 3, 3)


def rotating_covariances(covariance: ArrayLike, elapsed_s: ArrayLike, epoch: Epoch) -> Array:
    """Transform covariances from the ICRF to the rotating frame: the inverse of
    `inertial_covariances`, with the same shapes and units."""
    return _turned(covariance, np.linalg.inv(_to_inertial(elapsed_s, epoch)))


def _turned(covariance: ArrayLike, turn: Array) -> Array:
    return turn @ np.asarray(covariance, dtype=float) @ np.swapaxes(turn, -1, -2)


def origin_of(center: str) -> Array:
    """State (6,) of an origin, nondimensional, rotating frame; refuses an unknown one."""
    require_choice("center", center, CENTERS)
    return np.array([_PLACES[CENTERS[center]], 0.0, 0.0, 0.0, 0.0, 0.0])


def _to_inertial(elapsed_s: ArrayLike, epoch: Epoch) -> Array:
    """Matrices (time, 6, 6) from the rotating frame, nondimensional, to the ICRF, km and km/s."""
    axes = icrf_axes(elapsed_s, epoch)
    rate = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    out = np.zeros((*axes.shape[:-2], 6, 6))
    out[..., :3, :3] = LENGTH_UNIT_KM * axes
    out[..., 3:, 3:] = LENGTH_UNIT_KM / TIME_UNIT_S * axes
    out[..., 3:, :3] = out[..., 3:, 3:] @ rate
    return out
