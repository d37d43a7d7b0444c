"""Visibility of static targets in plain float64 NumPy: the meaning of the compiled kernel."""

import numpy as np

from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.photometry.sphere import phase_angle, sphere_magnitude


def directions_to_bodies(position, sun_position):
    """Unit vectors from observers (..., 3) to the Sun, Moon and Earth, shape (..., 3, 3)."""
    sun = sun_position - position
    moon = np.array([1.0 - MU, 0.0, 0.0]) - position
    earth = np.array([-MU, 0.0, 0.0]) - position
    toward = np.stack(np.broadcast_arrays(sun, moon, earth), axis=-2)
    return toward / np.linalg.norm(toward, axis=-1, keepdims=True)


def outside_exclusion(observer_to_target, toward_bodies, angles):
    """Whether lines of sight (..., 3) keep clear of the Sun, Moon and Earth."""
    distance = np.linalg.norm(observer_to_target, axis=-1)
    projections = np.einsum("...bc,...c->...b", toward_bodies, observer_to_target)
    return np.all(projections < distance[..., None] * angles.cosines, axis=-1)


def visible(observer, target, sun, settings):
    """Which targets (target, 3) one track (time, 3) observes: bool, shape (time, target).

    A target is observable when its sphere magnitude is below the limit and the line of sight
    keeps clear of the Sun, Moon and Earth (Paul & Fan, section 3). Positions nondimensional,
    rotating frame.
    """
    observer, sun = observer[:, None], sun[:, None]
    line = target[None] - observer
    magnitude = sphere_magnitude(
        np.linalg.norm(line, axis=-1) * LENGTH_UNIT_KM * 1e3,
        phase_angle(line, target[None] - sun),
        radius_m=settings.target_radius_m,
        diffuse_reflection_coefficient=settings.diffuse_reflection_coefficient,
    )
    clear = outside_exclusion(line, directions_to_bodies(observer, sun), settings.angles)
    return (magnitude < settings.limiting_magnitude) & clear
