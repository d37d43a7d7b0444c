"""Light that a material returns, and the diffuse sphere that returns as much.

A facet sends the light it reflects into the half space above it. With microfacets drawn from
Beckmann's distribution of slopes the integral over all views is a mean over smooth functions, so
that a glint however narrow is not missed.
"""

import numpy as np

from cislunar.photometry.facets import fresnel_reflectance
from cislunar.photometry.materials import Material, PhotometryModel

_NODES = 64
"""Of each integral, with an error below 1e-3 of the light returned for slopes up to 1."""


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
        Reading of the Fresnel term; with the root if omitted. Its law of irradiance does not
        enter: light is counted where it is sent, per steradian.

    Returns
    -------
    float
        Directional-hemispherical reflectance; above 1 where the specular weight is too large to
        conserve energy.
    """
    model = PhotometryModel() if model is None else model
    middle = (np.arange(_NODES) + 0.5) / _NODES
    # slopes of the microfacets: exp(-tan^2 / delta^2) is uniform, and so is the azimuth
    tilt = np.arctan(material.rms_slope * np.sqrt(-np.log(middle)))[:, None]
    azimuth = 2.0 * np.pi * middle
    light = np.sin(incidence), np.cos(incidence)
    half = np.cos(tilt)
    cosine = light[0] * np.sin(tilt) * np.cos(azimuth) + light[1] * half  # L.H = V.H
    seen = 2.0 * cosine * half - light[1]  # N.V
    facing = (cosine > 0.0) & (seen > 0.0)
    cosine = np.where(facing, cosine, 1.0)
    attenuation = np.minimum(1.0, 2.0 * half * np.minimum(seen, light[1]) / cosine)
    fresnel = fresnel_reflectance(cosine, material.normal_reflectance, model.fresnel_sqrt)
    glint = np.where(facing, attenuation * fresnel * cosine / (half * light[1]), 0.0)
    diffuse = material.diffuse_weight * material.diffuse_albedo
    return float(diffuse + 4.0 * material.specular_weight * glint.mean())


def equal_sphere_coefficient(material: Material, model: PhotometryModel | None = None) -> float:
    """C_d of the diffuse sphere as bright as a sphere of the material, over all views.

    Turned at random, a convex body sends out as much light as a sphere of its area and material:
    the sphere of tasking with this C_d is as bright on the average over all directions.

    Parameters
    ----------
    material : Material
        Surface.
    model : PhotometryModel, optional
        Reading of the equations; under ``4pi`` the sphere is as much darker as the facets are.

    Returns
    -------
    float
        C_d of `cislunar.photometry.sphere`; 0 for a material that returns nothing.
    """
    model = PhotometryModel() if model is None else model
    # over a sphere the squared cosine of the incidence is uniform
    squares = (np.arange(_NODES) + 0.5) / _NODES
    shares = [returned_light(material, angle, model) for angle in np.arccos(np.sqrt(squares))]
    spread = 4.0 * np.pi if model.irradiance_4pi else 1.0
    return float(np.mean(shares)) / spread
