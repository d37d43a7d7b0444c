"""The scene of a run: observers, Sun, Earth and Moon, and frames at every measurement time.

Frames
------
All states of a run are given in its propagation frame. In the CR3BP the propagation frame is the
rotating frame: origin at the Earth-Moon barycenter, x from the Earth to the Moon, z along the
angular momentum. In ephemeris dynamics it is the barycentric frame with J2000 axes, which does not
rotate. Lengths and times are nondimensional in both.

The inertial frame is fixed. In the CR3BP it coincides with the rotating frame at the epoch, and at
the nondimensional time t the rotating frame is rotated by the angle t about z. In ephemeris
dynamics it is the instantaneous rotating frame of Earth and Moon at the start of the run. Attitudes
of targets are relative to the inertial frame; right ascension and declination are measured in the
observer's body frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.attitude.inertia import rigid_bodies
from cislunar.attitude.quaternion import attitude_matrix
from cislunar.attitude.rigid_body import propagate_attitudes
from cislunar.constants import MU, TIME_UNIT_S
from cislunar.dynamics.bounds import require_nondimensional
from cislunar.dynamics.cr3bp import primary_positions
from cislunar.errors import ConfigurationError
from cislunar.observation.records import Measurements
from cislunar.runtime.arguments import UNIT_NORM, Array, array_of, indices_of, number_of

_OBSERVER_RATE_DEG_H = (0.0, 0.0, 1.0)
"""Angular velocity of the observers, body frame, deg/h (Paul & Fan, table 3)."""


class Scene(NamedTuple):
    """Observers, Sun and primaries on the grid of measurement times.

    Attributes
    ----------
    step_s, step : float
        Time between measurements, s and nondimensional.
    observer_position : ndarray, shape (observer, time, 3)
        Nondimensional, propagation frame; index 0 of `time` is the start of the run.
    sun_position : ndarray, shape (time, 3)
        Nondimensional, propagation frame.
    frame_axes, observer_axes : ndarray, shape (time, 3, 3)
        Rotations from the propagation frame to the inertial frame, and to the body frame of the
        observers.
    primaries : ndarray, shape (time, 2, 3)
        Centers of Earth and Moon, nondimensional, propagation frame.
    """

    step_s: float
    step: float
    observer_position: Array
    sun_position: Array
    frame_axes: Array
    observer_axes: Array
    primaries: Array


def require_measurements(
    measurements: Measurements, n_tracks: int, index: int, scene: Scene
) -> None:
    """Raise a `ConfigurationError` if measurements after an index of the scene are of another
    number of targets than the tracks, beyond the scene, or of an observer that it does not have."""
    n_targets, n_steps = measurements.offset.shape[0], measurements.offset.shape[1] - 1
    left = scene.sun_position.shape[0] - 1 - index
    if n_targets != n_tracks or n_steps > left:
        raise ConfigurationError(
            f"measurements: {n_steps} steps of {n_targets} targets do not fit {n_tracks} tracks in "
            f"a scene with {left} steps to come"
        )
    indices_of("measurements.observer", measurements.observer, len(scene.observer_position))


def make_scene(
    observer_position: ArrayLike,
    sun_position: ArrayLike,
    step_s: float,
    *,
    observer_rate_deg_h: ArrayLike = _OBSERVER_RATE_DEG_H,
    axes: ArrayLike | None = None,
    primaries: ArrayLike | None = None,
) -> Scene:
    """Assemble a scene from positions on the grid of measurement times.

    Parameters
    ----------
    observer_position, sun_position : array_like, shapes (observer, time, 3) and (time, 3)
        Nondimensional, propagation frame.
    step_s : float
        Time between measurements, s.
    observer_rate_deg_h : array_like, shape (3,)
        Constant angular velocity of the observers, body frame, deg/h. At the start of the run the
        body frames are aligned with the inertial frame.
    axes : array_like, shape (3, 3), optional
        Constant rotation from the propagation frame to the inertial frame. If omitted, the
        propagation frame rotates about z with the period ``2 pi TIME_UNIT_S``.
    primaries : array_like, shape (time, 2, 3), optional
        Centers of Earth and Moon, if they move in the propagation frame; those of the CR3BP if
        omitted.

    Returns
    -------
    Scene

    Raises
    ------
    ConfigurationError
        If the inputs disagree, a position is not finite or evidently in km, or `axes` are no
        rotation.
    """
    if np.shape(observer_position)[:1] == (0,):
        raise ConfigurationError("observer_position has no observers; give at least one")
    axes_of_tracks = ("observer", "time", 3)
    observers = np.ascontiguousarray(
        array_of("observer_position", observer_position, axes_of_tracks)
    )
    sun = np.ascontiguousarray(array_of("sun_position", sun_position, ("time", 3)))
    step_s = number_of("step_s", step_s, positive=True)
    if sun.shape != observers.shape[1:]:
        raise ConfigurationError(
            f"sun_position has shape {sun.shape}; give {observers.shape[1:]}, as the observers have"
        )
    require_nondimensional("observer_position", observers)
    elapsed_s = step_s * np.arange(sun.shape[0])
    if axes is None:
        angle = elapsed_s / TIME_UNIT_S
        to_inertial = np.zeros((angle.size, 3, 3))
        to_inertial[:, 0, 0] = to_inertial[:, 1, 1] = np.cos(angle)
        to_inertial[:, 1, 0] = np.sin(angle)
        to_inertial[:, 0, 1] = -np.sin(angle)
        to_inertial[:, 2, 2] = 1.0
    else:
        turn = array_of("axes", axes, (3, 3))
        if np.abs(turn @ turn.T - np.eye(3)).max() > UNIT_NORM or np.linalg.det(turn) < 0.0:
            raise ConfigurationError("axes must be a rotation matrix: orthonormal, right-handed")
        to_inertial = np.tile(turn, (elapsed_s.size, 1, 1))
    if primaries is None:
        primaries = np.tile(primary_positions(MU), (elapsed_s.size, 1, 1))
    primaries = array_of("primaries", primaries, (elapsed_s.size, 2, 3))
    rate = np.deg2rad(array_of("observer_rate_deg_h", observer_rate_deg_h, (3,))) / 3600.0
    to_body = attitude_matrix(_constant_rate_attitude([0.0, 0.0, 0.0, 1.0], rate, elapsed_s))
    return Scene(
        float(step_s),
        float(step_s / TIME_UNIT_S),
        observers,
        sun,
        to_inertial,
        np.ascontiguousarray(to_body @ to_inertial),
        np.ascontiguousarray(primaries),
    )


def _constant_rate_attitude(quaternion: ArrayLike, rate: ArrayLike, elapsed_s: ArrayLike) -> Array:
    """Attitudes (time, 4) of a torque-free body of spherical inertia after `elapsed_s` (time,),
    given the attitude at the epoch (inertial frame to body frame) and the angular velocity (body
    frame, rad/s)."""
    times = np.ascontiguousarray(elapsed_s, dtype=float)
    attitude, omega = np.empty((1, times.size, 4)), np.empty((1, times.size, 3))
    body, initial = rigid_bodies(np.eye(3)[None]), [np.array([each]) for each in (quaternion, rate)]
    propagate_attitudes(times, body, np.zeros((1, 3)), 0.0, *initial, attitude, omega)
    return attitude[0]
