"""Right ascension and declination in the body frame of a spinning observer.

An observer turns at a constant rate about the z axis of the rotating frame, starting with its
body axes along the inertial ones (Paul & Fan, table 3: 1 deg/h). The rotating frame itself has
turned by theta = t / t* since the epoch, at which both coincide. Both turns are about z, so

    RA_body = atan2(y, x)_rotating + theta - phi_body,    DEC = asin(z).

`wrap_angle` and `body_angles` are compiled kernels.
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import TIME_UNIT_S

Array = NDArray[np.float64]

OBSERVER_SPIN_DEG_PER_HOUR: float = 1.0
"""Angular velocity of the observers about z (Paul & Fan, table 3)."""

TWO_PI = 2.0 * np.pi


@njit(cache=True)
def wrap_angle(angle):
    """Angle brought into [-pi, pi) by whole turns (compiled).

    Parameters
    ----------
    angle : float
        rad.

    Returns
    -------
    float
        rad.
    """
    return angle - TWO_PI * np.floor((angle + np.pi) / TWO_PI)


@njit(cache=True)
def body_angles(x, y, z, frame_angle, spin_angle):
    """Right ascension and declination of a line of sight (compiled).

    Parameters
    ----------
    x, y, z : float
        From observer to target, any unit, rotating frame.
    frame_angle : float
        theta, turn of the rotating frame since the epoch, rad.
    spin_angle : float
        phi, turn of the observer's body since the epoch, rad.

    Returns
    -------
    right_ascension : float
        rad, in [-pi, pi), body frame.
    declination : float
        rad, in [-pi/2, pi/2], body frame.
    """
    declination = np.arctan2(z, np.sqrt(x * x + y * y))
    return wrap_angle(np.arctan2(y, x) + frame_angle - spin_angle), declination


def frame_angle(elapsed_s: ArrayLike) -> Array:
    """Turn of the rotating frame since the epoch, theta = t / t*.

    Parameters
    ----------
    elapsed_s : array_like
        Time since the epoch, s.

    Returns
    -------
    ndarray
        rad, unwrapped.
    """
    return np.asarray(elapsed_s, dtype=float) / TIME_UNIT_S


def spin_angle(
    elapsed_s: ArrayLike, rate_deg_per_hour: float = OBSERVER_SPIN_DEG_PER_HOUR
) -> Array:
    """Turn of an observer's body about z since the epoch.

    Parameters
    ----------
    elapsed_s : array_like
        Time since the epoch, s.
    rate_deg_per_hour : float
        Spin rate.

    Returns
    -------
    ndarray
        rad, unwrapped.
    """
    return np.deg2rad(rate_deg_per_hour / 3600.0) * np.asarray(elapsed_s, dtype=float)


def line_of_sight_angles(
    line_of_sight: ArrayLike,
    elapsed_s: ArrayLike,
    rate_deg_per_hour: float = OBSERVER_SPIN_DEG_PER_HOUR,
) -> tuple[Array, Array]:
    """Right ascension and declination over arrays.

    Parameters
    ----------
    line_of_sight : array_like, shape (..., 3)
        From observer to target, any unit, rotating frame.
    elapsed_s : array_like, shape (...)
        Time since the epoch, s.
    rate_deg_per_hour : float
        Spin rate of the observers about z.

    Returns
    -------
    right_ascension, declination : ndarray, shape (...)
        rad, body frame of the observer; right ascension in [-pi, pi).
    """
    x, y, z = np.moveaxis(np.asarray(line_of_sight, dtype=float), -1, 0)
    turned = frame_angle(elapsed_s) - spin_angle(elapsed_s, rate_deg_per_hour)
    right_ascension = wrap_angle.py_func(np.arctan2(y, x) + turned)
    return right_ascension, np.arctan2(z, np.hypot(x, y))
