"""Rates of the propagation frame and of the observers, for clock errors."""

import numpy as np
from scipy.spatial.transform import Rotation

from cislunar.observation.scene import Scene
from cislunar.runtime import Array


def frame_rotation(scene: Scene) -> Array:
    """Angular velocity of the propagation frame relative to the inertial frame.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    ndarray, shape (3,)
        Nondimensional, along the axes of the propagation frame.
    """
    turn = scene.frame_axes[0].T @ scene.frame_axes[min(1, scene.frame_axes.shape[0] - 1)]
    return Rotation.from_matrix(turn).as_rotvec() / scene.step


def observer_velocities(scene: Scene) -> Array:
    """Velocities of the observers by finite differences of their positions.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    ndarray, shape (observer, time, 3)
        Nondimensional, propagation frame.
    """
    position = scene.observer_position
    if position.shape[1] < 3:
        return np.gradient(position, scene.step, axis=1) if position.shape[1] > 1 else 0 * position
    return np.gradient(position, scene.step, axis=1, edge_order=2)
