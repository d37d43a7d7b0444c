"""Apparent magnitude of a diffuse sphere (Paul & Fan, section 2.3).

The sphere depends on the solar phase angle alone, which makes it the model of the architecture
optimisation and of the tasking step.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.errors import ConfigurationError

Array = NDArray[np.float64]


def phase_function(phase_angle: ArrayLike) -> Array:
    """Lambert phase function Phi = sin(alpha) + (pi - alpha) cos(alpha) (Paul & Fan, eq. 19).

    Parameters
    ----------
    phase_angle : array_like, shape (...)
        Angle at the target between the Sun and the observer, rad, in [0, pi].

    Returns
    -------
    ndarray, shape (...)
        From pi (full phase) down to 0; dimensionless.
    """
    alpha = np.asarray(phase_angle, dtype=float)
    return np.sin(alpha) + (np.pi - alpha) * np.cos(alpha)


def phase_angle(observer_to_target: ArrayLike, sun_to_target: ArrayLike) -> Array:
    """Solar phase angle at the target (Paul & Fan, eq. 20).

    Parameters
    ----------
    observer_to_target, sun_to_target : array_like, shape (..., 3)
        Position differences in one unit and one frame.

    Returns
    -------
    ndarray, shape (...)
        rad, in [0, pi].
    """
    to_target = np.asarray(observer_to_target, dtype=float)
    from_sun = np.asarray(sun_to_target, dtype=float)
    cosine = np.sum(to_target * from_sun, axis=-1) / (
        np.linalg.norm(to_target, axis=-1) * np.linalg.norm(from_sun, axis=-1)
    )
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def sphere_magnitude(
    range_m: ArrayLike,
    phase_angle: ArrayLike,
    *,
    radius_m: float = 1.0,
    diffuse_reflection_coefficient: float = 1.0,
) -> Array:
    """Apparent magnitude of a diffuse sphere (Paul & Fan, eq. 18).

    Parameters
    ----------
    range_m : array_like, shape (...)
        Distance from observer to target, m.
    phase_angle : array_like, shape (...)
        Solar phase angle, rad.
    radius_m : float
        Radius of the sphere, m.
    diffuse_reflection_coefficient : float
        C_d, dimensionless; not given in the paper.

    Returns
    -------
    ndarray, shape (...)
        Magnitude; ``inf`` for an unlit sphere.
    """
    ratio = (
        2.0
        * diffuse_reflection_coefficient
        * radius_m**2
        / (3.0 * np.pi * np.asarray(range_m, dtype=float) ** 2)
        * phase_function(phase_angle)
    )
    with np.errstate(divide="ignore"):
        return SUN_APPARENT_MAGNITUDE - 2.5 * np.log10(np.maximum(ratio, 0.0))


def faintness_per_squared_range(
    limiting_magnitude: float,
    *,
    radius_m: float = 1.0,
    diffuse_reflection_coefficient: float = 1.0,
) -> float:
    """K such that a sphere is brighter than the limit exactly when Phi(alpha) > K r^2.

    This is eq. 18 of Paul & Fan solved for the phase function; it spares the logarithm.

    Parameters
    ----------
    limiting_magnitude : float
        Visibility threshold, mag.
    radius_m : float
        Radius of the sphere, m; positive.
    diffuse_reflection_coefficient : float
        C_d, dimensionless; positive.

    Returns
    -------
    float
        K, m^-2.

    Raises
    ------
    ConfigurationError
        If the radius or C_d is not positive.
    """
    for name, value in (
        ("target_radius_m", radius_m),
        ("diffuse_reflection_coefficient", diffuse_reflection_coefficient),
    ):
        if not value > 0.0:
            raise ConfigurationError(f"{name} = {value} must be positive")
    threshold = 10.0 ** ((SUN_APPARENT_MAGNITUDE - limiting_magnitude) / 2.5)
    return threshold * 3.0 * np.pi / (2.0 * diffuse_reflection_coefficient * radius_m**2)
