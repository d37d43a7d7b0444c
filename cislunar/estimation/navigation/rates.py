"""Rates that a clock error needs: of the propagation frame and of the observers."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cislunar.observation.scene import Scene

Array = NDArray[np.float64]


def frame_rotation(scene: Scene) -> Array:
    """Angular velocity of the propagation frame relative to the inertial frame, shape (3,),
    nondimensional, along the axes of the propagation frame."""
    turn = scene.frame_axes[0].T @ scene.frame_axes[min(1, scene.frame_axes.shape[0] - 1)]
    return Rotation.from_matrix(turn).as_rotvec() / scene.step


def observer_velocities(scene: Scene) -> Array:
    """Velocities of the observers, shape (observer, time, 3), nondimensional, propagation frame, by
    differences of their positions."""
    position = scene.observer_position
    if position.shape[1] < 3:
        return np.gradient(position, scene.step, axis=1) if position.shape[1] > 1 else 0 * position
    return np.gradient(position, scene.step, axis=1, edge_order=2)
