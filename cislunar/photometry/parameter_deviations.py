"""Body-parameter deviations of a surface, and derivatives by them (compiled).

A body-parameter deviation is a kind and an amount x, with 0 for no deviation. Lengths, areas and
factors are multiplied by exp(x), and so are the odds of shares between 0 and 1; therefore every
amount is possible. Amounts of the reflection law are added::

    ALBEDO                   diffuse albedo rho, which enters only through the product d rho
    SLOPE                    root mean square slope of the microfacets
    REFLECTANCE              odds of the normal reflectance F0
    SHARE                    odds of the specular share s / (d + s), at constant d + s
    SCALE                    all reflected light
    PHONG_SHARE,
    LOMMEL_SEELIGER_SHARE,
    PHASE_SLOPE,
    PHASE_CURVATURE          deviations from Cook-Torrance, `cislunar.photometry.law_mixture`
    AXIS_SCALE + c           length of the body along axis c
    FACET + i                light reflected by facet i

Amounts of the same kind add up, so that a derivative does not depend on the reference.
"""

import numpy as np

from cislunar.compiled import njit_alloc, njit_noalloc
from cislunar.elementary import exponential
from cislunar.photometry.bodies import Body
from cislunar.photometry.facet_blocks import (
    BLOCK_ROWS,
    BY_AXIS_SCALE,
    BY_LOMMEL_SEELIGER_SHARE,
    BY_ODDS,
    BY_PHONG_SHARE,
    BY_REFLECTANCE,
    BY_SLOPE,
    INVERSE_HALF2,
    LANES,
    MAGNITUDE,
    PHASE_ANGLE,
    SHINE,
    TOTAL,
)
from cislunar.photometry.facet_derivatives import fresnel_by_reflectance
from cislunar.photometry.facets import FLOOR_MAGNITUDE, LN10, fresnel_reflectance
from cislunar.photometry.law_mixture import phase_terms
from cislunar.photometry.materials import (
    ALBEDO,
    AXIS_SCALE,
    FACET,
    LOMMEL_SEELIGER_SHARE,
    PHASE_CURVATURE,
    PHASE_SLOPE,
    PHONG_SHARE,
    REFLECTANCE,
    SCALE,
    SHARE,
    SLOPE,
)

_LARGEST = 50.0
"""Largest amount, to which others are clipped; e^50 exceeds the range of any light curve."""


@njit_noalloc
def _factor(x):
    """exp(x), finite for all x."""
    return exponential(min(max(x, -_LARGEST), _LARGEST))


@njit_noalloc
def _axis_scale(factors, areas, normals):
    """Scale a body along its axes, in place: N is divided by the factors, areas scale with both."""
    product = factors[0] * factors[1] * factors[2]
    for i in range(areas.shape[0]):
        length = 0.0
        for c in range(3):
            normals[i, c] /= factors[c]
            length += normals[i, c] * normals[i, c]
        length = np.sqrt(length)
        areas[i] *= product * length
        for c in range(3):
            normals[i, c] /= length


@njit_alloc
def perturbed_body(kinds, amounts, body):
    """A `cislunar.photometry.bodies.Body` with body-parameter deviations, in arrays of its own.
    `kinds` and `amounts` have one entry per deviation. A deviation of a material applies to all
    materials of the body."""
    areas, normals, materials = body.areas.copy(), body.normals.copy(), body.materials.copy()
    lengths = np.ones(3)
    phong_share, lommel_seeliger, slope, curvature = body.mixture
    for i in range(kinds.shape[0]):
        kind, factor = kinds[i], _factor(amounts[i])
        if kind == SCALE:
            areas *= factor
        elif kind >= FACET:
            areas[kind - FACET] *= factor
        elif kind >= AXIS_SCALE:
            lengths[kind - AXIS_SCALE] *= factor
        elif kind == PHONG_SHARE:
            phong_share += amounts[i]
        elif kind == LOMMEL_SEELIGER_SHARE:
            lommel_seeliger += amounts[i]
        elif kind == PHASE_SLOPE:
            slope += amounts[i]
        elif kind == PHASE_CURVATURE:
            curvature += amounts[i]
        elif kind >= ALBEDO:
            for m in range(materials.shape[0]):
                _perturb(kind, factor, materials[m])
    if lengths[0] != 1.0 or lengths[1] != 1.0 or lengths[2] != 1.0:
        _axis_scale(lengths, areas, normals)
    lengths *= body.lengths
    mixture = phong_share, lommel_seeliger, slope, curvature
    return _changed(kinds, body, areas, normals, materials, lengths, mixture)


@njit_alloc
def _changed(kinds, body, areas, normals, materials, lengths, mixture):
    """The body with other arrays and another mixture of laws, and with derivatives by the
    deviations of the law if they are among the kinds."""
    mixed = body.mixed or np.any((kinds >= PHONG_SHARE) & (kinds <= PHASE_CURVATURE))
    return Body(
        areas, normals, body.rows, materials, body.shadows, lengths, body.composite or mixed,
        body.law, body.table, mixed, mixture,
    )  # fmt: skip


@njit_alloc
def with_law(kinds, body):
    """The body, with derivatives by the deviations of the reflection law if they are among the
    kinds; its arrays are shared."""
    own = body.areas, body.normals, body.materials, body.lengths, body.mixture
    return _changed(kinds, body, *own)


@njit_noalloc
def _perturb(kind, factor, material):
    """Change one material (5,), in place."""
    if kind == ALBEDO:
        material[2] *= factor
    elif kind == SLOPE:
        material[3] *= factor
    elif kind == REFLECTANCE:
        odds = factor * material[4] / (1.0 - material[4])
        material[4] = odds / (1.0 + odds)
    elif kind == SHARE and material[1] > 0.0:
        both = material[0] + material[1]
        shine = factor * material[1]
        share = shine / (material[0] + shine)
        material[0], material[1] = both * (1.0 - share), both * share


@njit_noalloc
def _add_odds(b, count, kinds, material, fresnel_sqrt):
    """Write derivatives of the sums by the odds of a material that all facets share."""
    weights = material[0] + material[1]
    share = material[1] / weights if weights > 0.0 else 0.0
    f0 = material[4]
    for kind in kinds:
        for k in range(count):
            total, shine = b[TOTAL, k], b[SHINE, k]
            if kind == SHARE:
                b[BY_ODDS, k] = shine * (1.0 - share) - (total - shine) * share
            elif kind == REFLECTANCE:
                cosine = 0.5 / np.sqrt(b[INVERSE_HALF2, k])
                fresnel = fresnel_reflectance(cosine, f0, fresnel_sqrt)
                slope = fresnel_by_reflectance(cosine, f0, fresnel_sqrt) * f0 * (1.0 - f0)
                b[BY_REFLECTANCE, k] = shine * slope / fresnel


@njit_noalloc
def deviation_rows(block, shares, count, kinds, sigma, body, fresnel_sqrt, out):
    """Derivatives of magnitudes by deviations in units of `sigma`, into `out` (kind, LANES). For
    `block` and `shares` see `body_blocks.body_magnitude_deviations`; `body` includes the
    deviations. The derivatives of a dark object are zero."""
    b = block.reshape((BLOCK_ROWS, LANES))
    if not body.composite:
        _add_odds(b, count, kinds, body.materials[0], fresnel_sqrt)
    for i in range(kinds.shape[0]):
        kind, scale = kinds[i], -2.5 / LN10 * sigma[i]
        for k in range(count):
            total, shine = b[TOTAL, k], b[SHINE, k]
            if kind == ALBEDO:
                change = total - shine
            elif kind == SLOPE:
                change = b[BY_SLOPE, k]
            elif kind == REFLECTANCE:
                change = b[BY_REFLECTANCE, k]
            elif kind == SHARE:
                change = b[BY_ODDS, k]
            elif kind == SCALE:
                change = total
            elif kind == PHONG_SHARE:
                change = b[BY_PHONG_SHARE, k]
            elif kind == LOMMEL_SEELIGER_SHARE:
                change = b[BY_LOMMEL_SEELIGER_SHARE, k]
            elif kind == PHASE_SLOPE:  # of the magnitude itself
                change = -LN10 / 2.5 * total * phase_terms(b[PHASE_ANGLE, k])[0]
            elif kind == PHASE_CURVATURE:
                change = -LN10 / 2.5 * total * phase_terms(b[PHASE_ANGLE, k])[1]
            elif kind >= FACET:
                change = shares[kind - FACET, k]
            elif kind >= AXIS_SCALE:
                change = b[BY_AXIS_SCALE + kind - AXIS_SCALE, k]
            else:
                change = 0.0
            bright = b[MAGNITUDE, k] < FLOOR_MAGNITUDE
            out[i, k] = scale * change / total if bright else 0.0
