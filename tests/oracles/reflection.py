"""Brightness of convex bodies by reflection laws written out facet by facet."""

import numpy as np

from cislunar.attitude.quaternion import attitude_matrix
from cislunar.estimation.light_curves.row_blocks import RANGE, SUN, VIEW

SUN_MAGNITUDE = -26.74


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
