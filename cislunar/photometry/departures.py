"""How a body's surface may depart from what is believed of it, and derivatives by that (compiled).

A departure is a kind and an amount x, 0 for none. Lengths, areas and factors change by exp(x),
shares between 0 and 1 have their odds multiplied by it, so that no amount is impossible:

    ALBEDO        the diffuse albedo rho, which counts as the product d rho alone
    SLOPE         the root mean square slope of the microfacets
    REFLECTANCE   the odds of the normal reflectance F0
    SHARE         the odds of the specular share s / (d + s), the sum d + s being kept
    SCALE         all light thrown back
    STRETCH + c   the body's length along axis c
    FACET + i     the light thrown back by facet i

Amounts of the same kind add up, so that a derivative is the same wherever it is counted from.
"""

import numpy as np

from cislunar.compiled import allocating, borrowing
from cislunar.elementary import exponential
from cislunar.photometry.bodies import Body
from cislunar.photometry.facet_blocks import (
    BLOCK_ROWS,
    BY_ODDS,
    BY_REFLECTANCE,
    BY_SLOPE,
    BY_STRETCH,
    INVERSE_HALF2,
    LANES,
    MAGNITUDE,
    SHINE,
    TOTAL,
)
from cislunar.photometry.facet_derivatives import fresnel_by_reflectance
from cislunar.photometry.facets import FLOOR_MAGNITUDE, LN10, fresnel_reflectance
from cislunar.photometry.materials import (
    ALBEDO,
    FACET,
    REFLECTANCE,
    SCALE,
    SHARE,
    SLOPE,
    STRETCH,
)

_LARGEST = 50.0
"""Amounts beyond are taken as this: e^50 is more than any light curve leaves open."""


@borrowing
def _factor(x):
    """exp(x), finite for all x."""
    return exponential(min(max(x, -_LARGEST), _LARGEST))


@borrowing
def _stretch(factors, areas, normals):
    """Lengthen a body along its axes, in place: N goes with 1 / factors, areas as its length."""
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


@allocating
def departed_body(kinds, amounts, body):
    """A `cislunar.photometry.bodies.Body` after departures, with arrays of its own.

    `kinds` and `amounts` have an entry for each. What departs of a material does so in all of a
    body's materials alike.
    """
    areas, normals, materials = body.areas.copy(), body.normals.copy(), body.materials.copy()
    lengths = np.ones(3)
    for i in range(kinds.shape[0]):
        kind, factor = kinds[i], _factor(amounts[i])
        if kind == SCALE:
            areas *= factor
        elif kind >= FACET:
            areas[kind - FACET] *= factor
        elif kind >= STRETCH:
            lengths[kind - STRETCH] *= factor
        elif kind >= ALBEDO:
            for m in range(materials.shape[0]):
                _depart(kind, factor, materials[m])
    if lengths[0] != 1.0 or lengths[1] != 1.0 or lengths[2] != 1.0:
        _stretch(lengths, areas, normals)
    lengths *= body.lengths
    return Body(areas, normals, body.rows, materials, body.shadows, lengths, body.rough, body.phong)


@borrowing
def _depart(kind, factor, material):
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


@borrowing
def _add_odds(b, count, kinds, material, fresnel_sqrt):
    """Derivatives of the sums by the odds of a material that all facets share, into the block."""
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


@borrowing
def departure_rows(block, shares, count, kinds, sigma, body, fresnel_sqrt, out):
    """Derivatives of a block's magnitudes by departures, sigma at a time, into `out` (kind, LANES).

    `block` and `shares` are those of `body_blocks.body_magnitude_departures`, `body` is as
    departed. A dark object's derivatives are zero.
    """
    b = block.reshape((BLOCK_ROWS, LANES))
    if not body.rough:
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
            elif kind >= FACET:
                change = shares[kind - FACET, k]
            elif kind >= STRETCH:
                change = b[BY_STRETCH + kind - STRETCH, k]
            else:
                change = 0.0
            bright = b[MAGNITUDE, k] < FLOOR_MAGNITUDE
            out[i, k] = scale * change / total if bright else 0.0
