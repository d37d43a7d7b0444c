"""Reflection laws in the form of their sources, and tables of laws in closed form."""

import numpy as np

from cislunar.attitude.quaternion import attitude_matrix
from cislunar.estimation.light_curves.row_blocks import RANGE, SUN, VIEW
from cislunar.photometry.reflection.tables import ReflectanceTable

SUN_MAGNITUDE = -26.74


def trilinear(lit, seen, azimuth):
    """A reciprocal law that is linear in each of three cosines, so that its table is exact."""
    return 0.5 + 0.3 * lit * seen + 0.1 * (1.0 - lit) * (1.0 - seen) * azimuth


def _table(law, degrees, azimuth_degrees):
    cosines = np.cos(np.deg2rad(degrees)), np.cos(np.deg2rad(azimuth_degrees))
    axes = cosines[0], cosines[0], cosines[1]
    return ReflectanceTable(*axes, law(*np.meshgrid(*axes, indexing="ij")))


TRILINEAR = _table(trilinear, np.linspace(0.0, 90.0, 7), np.linspace(0.0, 180.0, 5))


def microfacet_ggx(light, view, normal, roughness, normal_reflectance):
    """BRDF of the GGX law: Walter et al. (2007, eqs. 20, 33), Heitz (2014, eqs. 72, 99) and
    Schlick (1994), with tangents of angles as there."""
    half = (light + view) / np.linalg.norm(light + view)

    def tangent2(direction):
        return 1.0 / (direction @ normal) ** 2 - 1.0

    def smith(direction):
        return 0.5 * (np.sqrt(1.0 + roughness**2 * tangent2(direction)) - 1.0)

    slopes = roughness**2 / (np.pi * (half @ normal) ** 4 * (roughness**2 + tangent2(half)) ** 2)
    shadowing = 1.0 / (1.0 + smith(light) + smith(view))
    fresnel = normal_reflectance + (1.0 - normal_reflectance) * (1.0 - half @ light) ** 5
    return slopes * shadowing * fresnel / (4.0 * (light @ normal) * (view @ normal))


def example_law(incidence, emission, azimuth):
    """BRDF of ``config/examples/brdf.csv``, sr^-1: a diffuse part with an opposition effect,
    0.9 + 0.5 e^(-g/0.4) at the phase angle g, and a lobe of Ward (1992, eq. 5a) with reflectance
    0.1 and slope 0.25, whose (N.L)(N.V) is at least 0.05. Angles in rad; the observer is on the
    side of the Sun at azimuth 0."""
    lit, seen = np.cos(incidence), np.cos(emission)
    phase = lit * seen + np.sin(incidence) * np.sin(emission) * np.cos(azimuth)
    opposition = 0.5 * np.exp(-np.arccos(np.clip(phase, -1.0, 1.0)) / 0.4)
    diffuse = 0.25 / np.pi * (0.9 + opposition)
    cosine2 = (lit + seen) ** 2 / np.maximum(2.0 + 2.0 * phase, 1e-12)
    slope2 = 1.0 / np.clip(cosine2, 1e-12, 1.0) - 1.0
    lobe = 0.1 * np.exp(-slope2 / 0.25**2) / (4.0 * np.pi * 0.25**2)
    return diffuse + lobe / np.sqrt(np.maximum(lit * seen, 0.05))


def lambert_phong_magnitude(attitudes, data, facets, material):
    """Magnitudes of the rows of a light curve, inf for a dark object."""
    diffuse, specular, albedo, slope, reflectance = material.as_array()
    found = np.empty(len(data))
    for k, (q, row) in enumerate(zip(attitudes, data, strict=True)):
        turn = attitude_matrix(q)
        sun, view = turn @ row[SUN], turn @ row[VIEW]
        lit, seen = (np.maximum(facets.normals @ each, 0.0) for each in (sun, view))
        mirrored = 2.0 * (facets.normals @ sun)[:, None] * facets.normals - sun
        cosine = np.maximum(mirrored @ view, 0.0)
        lobe = specular * reflectance / slope**2 * cosine ** (0.5 / slope**2)
        total = np.sum(facets.areas * lit * seen * (diffuse * albedo + lobe))
        with np.errstate(divide="ignore"):
            found[k] = SUN_MAGNITUDE - 2.5 * np.log10(total / (np.pi * row[RANGE] ** 2))
    return found
