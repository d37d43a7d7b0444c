"""Visibility of static targets in plain float64 NumPy: the definition of the compiled kernel."""

import numpy as np

from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.photometry.sphere import phase_angle, sphere_magnitude


def sun_at(times):
    """A Sun that revolves once a synodic month in the plane of the primaries, rotating frame."""
    angle = -2.0 * np.pi * times * TIME_UNIT_S / (29.53 * 86_400.0)
    return 389.0 * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)


def directions_to_bodies(position, sun_position):
    """Unit vectors from observers (..., 3) to the Sun, Moon and Earth, shape (..., 3, 3)."""
    sun = sun_position - position
    moon = np.array([1.0 - MU, 0.0, 0.0]) - position
    earth = np.array([-MU, 0.0, 0.0]) - position
    toward = np.stack(np.broadcast_arrays(sun, moon, earth), axis=-2)
    return toward / np.linalg.norm(toward, axis=-1, keepdims=True)


def outside_exclusion(observer_to_target, toward_bodies, angles):
    """Whether lines of sight (..., 3) are outside the exclusion angles of Sun, Moon and Earth."""
    distance = np.linalg.norm(observer_to_target, axis=-1)
    projections = np.einsum("...bc,...c->...b", toward_bodies, observer_to_target)
    return np.all(projections < distance[..., None] * angles.cosines, axis=-1)


def visible(observer, target, sun, settings):
    """Which targets (target, 3) one track (time, 3) observes: bool, shape (time, target).

    A target is observable when its sphere magnitude is below the limit and the line of sight
    is outside the exclusion angles of Sun, Moon and Earth (Paul & Fan, section 3). Positions are
    nondimensional, in the rotating frame.
    """
    observer, sun = observer[:, None], sun[:, None]
    line = target[None] - observer
    magnitude = sphere_magnitude(
        np.linalg.norm(line, axis=-1) * LENGTH_UNIT_KM * 1e3,
        phase_angle(line, target[None] - sun),
        radius_m=settings.target_radius_m,
        diffuse_reflection_coefficient=settings.diffuse_reflection_coefficient,
    )
    clear = outside_exclusion(line, directions_to_bodies(observer, sun), settings.exclusion_deg)
    return (magnitude < settings.limiting_magnitude) & clear
