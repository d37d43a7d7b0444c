"""Visibility of static targets in plain float64 NumPy: the meaning of the compiled kernel."""

import numpy as np

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.observation.exclusion import directions_to_bodies, outside_exclusion
from cislunar.photometry.sphere import phase_angle, sphere_magnitude


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
