"""Visibility of static targets in plain float64 NumPy: the meaning of the compiled kernel."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.observation.exclusion import ExclusionAngles, directions_to_bodies, outside_exclusion
from cislunar.photometry.sphere import phase_angle, sphere_magnitude


def visible(
    observer: ArrayLike,
    target: ArrayLike,
    sun_position: ArrayLike,
    *,
    angles: ExclusionAngles,
    limiting_magnitude: float,
    radius_m: float,
    diffuse_reflection_coefficient: float,
    mu: float = MU,
) -> NDArray[np.bool_]:
    """Which targets one track observes at each time (Paul & Fan, section 3).

    A target is observable when its sphere magnitude is below the limit and the line of sight
    keeps clear of the Sun, Moon and Earth.

    Parameters
    ----------
    observer : array_like, shape (time, 3)
        Track of one satellite, nondimensional, rotating frame.
    target : array_like, shape (target, 3)
        Static targets, nondimensional, rotating frame.
    sun_position : array_like, shape (time, 3)
        Sun, nondimensional, rotating frame.
    angles : ExclusionAngles
        Exclusion angles.
    limiting_magnitude : float
        Visibility threshold, mag.
    radius_m : float
        Radius of the targets, m.
    diffuse_reflection_coefficient : float
        C_d, dimensionless.
    mu : float
        Mass ratio.

    Returns
    -------
    ndarray of bool, shape (time, target)
    """
    observer = np.asarray(observer, dtype=float)[:, None, :]
    sun = np.asarray(sun_position, dtype=float)[:, None, :]
    target = np.asarray(target, dtype=float)[None, :, :]
    line = target - observer
    magnitude = sphere_magnitude(
        np.linalg.norm(line, axis=-1) * LENGTH_UNIT_KM * 1e3,
        phase_angle(line, target - sun),
        radius_m=radius_m,
        diffuse_reflection_coefficient=diffuse_reflection_coefficient,
    )
    toward_bodies = directions_to_bodies(observer, sun, mu)
    return (magnitude < limiting_magnitude) & outside_exclusion(line, toward_bodies, angles)
