"""Apparent magnitude of a diffuse sphere (Paul & Fan, section 2.3).

The sphere's magnitude depends only on range and solar phase angle; the architecture optimization
and the tasking step use it. `equal_sphere_coefficient` gives the sphere that returns as much light
as a given material.

A facet reflects light into the half space above it. With microfacets sampled from Beckmann's
distribution of slopes, the integral over all view directions is a mean over smooth functions, so
that even a narrow glint is resolved.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.errors import ConfigurationError
from cislunar.photometry.facets import fresnel_reflectance
from cislunar.photometry.materials import TABULATED, Material, PhotometryModel
from cislunar.photometry.reflection.laws import directional_hemispherical_reflectance
from cislunar.photometry.reflection.tables import NO_TABLE, load_reflectance_table
from cislunar.runtime import Array
from cislunar.runtime.arguments import number_of

_NODES = 64
"""Nodes of each integral; the error is below 1e-3 of the returned light for slopes up to 1."""

_VIEW_NODES = 160
"""Gauss-Legendre nodes per axis of the integral over views of a law other than the paper's; the
error is below 1e-5 of the returned light for slopes from 0.1."""


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
        Distance from observer to target, m; positive.
    phase_angle : array_like, shape (...)
        Solar phase angle, rad.
    radius_m : float
        Radius of the sphere, m; positive.
    diffuse_reflection_coefficient : float
        C_d, dimensionless, not negative; not given in the paper.

    Returns
    -------
    ndarray, shape (...)
        Magnitude; ``inf`` for an unlit sphere.

    Raises
    ------
    ConfigurationError
        If the radius or a distance is not positive, a phase angle is not from 0 to pi, or the
        coefficient is negative. NaN is not refused.
    """
    number_of("radius_m", radius_m, positive=True)
    phase, distance = (np.asarray(each, dtype=float) for each in (phase_angle, range_m))
    if np.any((phase < 0.0) | (phase > np.pi)):
        raise ConfigurationError("phase_angle: give angles from 0 to pi, rad")
    if np.any(distance <= 0.0):
        raise ConfigurationError("range_m: give positive distances, m")
    if not diffuse_reflection_coefficient >= 0.0:
        raise ConfigurationError(
            f"diffuse_reflection_coefficient = {diffuse_reflection_coefficient} is negative"
        )
    ratio = (
        2.0
        * diffuse_reflection_coefficient
        * radius_m**2
        / (3.0 * np.pi * distance**2)
        * phase_function(phase)
    )
    with np.errstate(divide="ignore"):
        return SUN_APPARENT_MAGNITUDE - 2.5 * np.log10(np.maximum(ratio, 0.0))


def faintness_per_squared_range(
    limiting_magnitude: float, *, radius_m: float = 1.0, diffuse_reflection_coefficient: float = 1.0
) -> float:
    """K such that a sphere is brighter than the limit exactly when Phi(alpha) > K r^2.

    This is eq. 18 of Paul & Fan solved for the phase function; it avoids the logarithm.

    Parameters
    ----------
    limiting_magnitude : float
        Limiting magnitude, mag.
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
        If the radius or the coefficient is not positive.
    """
    number_of("radius_m", radius_m, positive=True)
    name = "diffuse_reflection_coefficient"
    number_of(name, diffuse_reflection_coefficient, positive=True)
    threshold = 10.0 ** ((SUN_APPARENT_MAGNITUDE - limiting_magnitude) / 2.5)
    return threshold * 3.0 * np.pi / (2.0 * diffuse_reflection_coefficient * radius_m**2)


def returned_light(
    material: Material, incidence: float, model: PhotometryModel | None = None
) -> float:
    """Share of the incident light a facet returns (Paul & Fan, eqs. 8-17, over all views).

    Parameters
    ----------
    material : Material
        Surface.
    incidence : float
        Angle between the normal and the Sun, rad, in [0, pi / 2).
    model : PhotometryModel, optional
        Form of the Fresnel term; with the root if omitted. The law of irradiance has no effect,
        because the light is counted per steradian at the facet.

    Returns
    -------
    float
        Directional-hemispherical reflectance; above 1 if the specular weight is too large to
        conserve energy.

    Raises
    ------
    ConfigurationError
        If the incidence is outside of [0, pi / 2).
    InputFileError
        If the table of the reflection law cannot be used.
    """
    if not 0.0 <= incidence < 0.5 * np.pi:
        raise ConfigurationError(f"incidence = {incidence} rad must be at least 0 and below pi / 2")
    model = PhotometryModel() if model is None else model
    if model.law > 0:
        table = load_reflectance_table(model.reflection) if model.law == TABULATED else NO_TABLE
        given = model.law, incidence, material.as_array(), table
        return float(directional_hemispherical_reflectance(*given, *_view_nodes()))
    middle = (np.arange(_NODES) + 0.5) / _NODES
    # for the slopes of microfacets exp(-tan^2 / delta^2) is uniform, and so is the azimuth
    tilt = np.arctan(material.rms_slope * np.sqrt(-np.log(middle)))[:, None]
    azimuth = 2.0 * np.pi * middle
    light = np.sin(incidence), np.cos(incidence)
    half = np.cos(tilt)
    cosine = light[0] * np.sin(tilt) * np.cos(azimuth) + light[1] * half  # L.H = V.H
    seen = 2.0 * cosine * half - light[1]  # N.V
    facing = (cosine > 0.0) & (seen > 0.0)
    cosine = np.where(facing, cosine, 1.0)
    attenuation = np.minimum(1.0, 2.0 * half * np.minimum(seen, light[1]) / cosine)
    # as a Python function, since arrays need no kernel
    fresnel = getattr(fresnel_reflectance, "py_func", fresnel_reflectance)(
        cosine, material.normal_reflectance, model.fresnel_sqrt
    )
    glint = np.where(facing, attenuation * fresnel * cosine / (half * light[1]), 0.0)
    diffuse = material.diffuse_weight * material.diffuse_albedo
    return float(diffuse + 4.0 * material.specular_weight * glint.mean())


@cache
def _view_nodes() -> tuple[Array, Array]:
    """Nodes and weights of the integral over views, on (0, 1)."""
    nodes, weights = np.polynomial.legendre.leggauss(_VIEW_NODES)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def equal_sphere_coefficient(material: Material, model: PhotometryModel | None = None) -> float:
    """C_d of the diffuse sphere as bright as a sphere of the material, averaged over all views.

    In random orientation a convex body reflects as much light as a sphere of its area and material.
    The sphere that tasking assumes, with this C_d, is therefore as bright on average over all
    directions.

    Parameters
    ----------
    material : Material
        Surface.
    model : PhotometryModel, optional
        Law of irradiance; under ``4pi`` the sphere is darker by the same factor as the
        facets.

    Returns
    -------
    float
        C_d, dimensionless; 0 for a material that returns no light.

    Raises
    ------
    InputFileError
        If the table of the reflection law cannot be used.
    """
    model = PhotometryModel() if model is None else model
    # over a sphere the squared cosine of the incidence is uniform
    squares = (np.arange(_NODES) + 0.5) / _NODES
    shares = [returned_light(material, angle, model) for angle in np.arccos(np.sqrt(squares))]
    spread = 4.0 * np.pi if model.irradiance_4pi else 1.0
    return float(np.mean(shares)) / spread
