"""Apparent magnitudes of any body for a block of geometries, with derivatives (compiled).

A `cislunar.photometry.bodies.Body` that is not composite is passed to
`cislunar.photometry.facet_blocks` and gives bit-identical results. The facets of a composite body
take their material from a table, contribute with the share of their area that is both lit and seen
(`cislunar.photometry.shadows`), and may follow another reflection law
(`cislunar.photometry.reflection`) or a
mixture of laws (`cislunar.photometry.law_mixture`).

The lit and seen share is piecewise linear in the interpolation variables of the table. Derivatives
are exactly those of the returned magnitude, one-sided at the edges of the table's triangles.
"""

import numpy as np

from cislunar.attitude.quaternion import rotate_components
from cislunar.compiled import copy_into, njit, njit_alloc, njit_inline, njit_noalloc
from cislunar.photometry.facet_blocks import (
    BLOCK_ROWS,
    BY_HALF2,
    BY_LIT,
    BY_ODDS,
    BY_PHONG_SHARE,
    BY_REFLECTANCE,
    BY_SEEN,
    BY_SLOPE,
    FREE,
    INVERSE_HALF2,
    LANES,
    LIT,
    MAGNITUDE,
    OWN,
    OWN_BY_LIT,
    OWN_BY_SEEN,
    OWN_IN_FULL,
    QUATERNION,
    RANGE,
    SEEN,
    SHINE,
    SPECULAR,
    SUN,
    TOTAL,
    TURN,
    VIEW,
    add_axis_scale,
    add_facet,
    add_facet_and_slopes,
    block_magnitude_deviations,
    block_magnitude_gradients,
    block_magnitudes,
    cosines,
    facet_glint,
    known_shape,
    magnitudes_of_totals,
    turn_into_body,
    turns_of_slopes,
)
from cislunar.photometry.facet_derivatives import (
    ZERO,
    facet_magnitude_derivatives,
    fresnel_by_reflectance,
    fresnel_slope,
)
from cislunar.photometry.facets import (
    FLOOR_MAGNITUDE,
    LN10,
    facet_magnitude,
    fresnel_reflectance,
    reflection_constants,
)
from cislunar.photometry.law_mixture import add_mixed_facet, add_phase_terms
from cislunar.photometry.materials import TABULATED
from cislunar.photometry.reflection.laws import reflectance
from cislunar.photometry.shadows.blocks import (
    add_edges,
    find_corners,
    gather,
    make_sight,
    resolve_edges,
    settle,
)

_OWN_SHINE = OWN
"""Row of the specular part of a facet; later overwritten by the whole contribution of the facet."""

# Derivatives to compute besides the sums.
_NOTHING, _TURNS, _PARTS = 0, 1, 2


@njit_noalloc
def _specular_rows(b, count, materials, fresnel_sqrt, derivatives, rows):
    """Write the factors of each material in each geometry, (material, 3, LANES), into `rows`. The
    factors are that of the specular term, its logarithmic derivative by the odds of the normal
    reflectance, and its logarithmic derivative by |L + V|^2 through the Fresnel factor."""
    for m in range(materials.shape[0]):
        f0 = materials[m, 4]
        for k in range(count):
            half2 = 1.0 / b[INVERSE_HALF2, k]
            rows[m, 0, k] = reflection_constants(materials[m], half2, fresnel_sqrt)[1]
            rows[m, 1, k], rows[m, 2, k] = 0.0, 0.0
            if derivatives == _PARTS and f0 > 0.0:
                half = np.sqrt(half2)
                fresnel = fresnel_reflectance(0.5 * half, f0, fresnel_sqrt)
                slope = fresnel_by_reflectance(0.5 * half, f0, fresnel_sqrt)
                rows[m, 1, k] = slope / fresnel * f0 * (1.0 - f0)
                # cosine |L + V| / 2, whose derivative by |L + V|^2 is 1 / (4 |L + V|)
                rows[m, 2, k] = fresnel_slope(0.5 * half, f0, fresnel_sqrt) / fresnel * 0.25 / half


@njit_inline
def _add_parts(b, count, whole, steepness, far):
    """Add the specular part of a facet and its derivatives by slope and |L + V|^2."""
    for k in range(count):
        inverse_half2 = b[INVERSE_HALF2, k]
        glint, attenuation, secant2, _, lower = facet_glint(
            b[LIT, k], b[SEEN, k], inverse_half2, b[SPECULAR, k], steepness, far
        )
        excess = (1.0 - secant2) * steepness
        shine = whole * b[FREE, k] * glint * (attenuation if attenuation < 1.0 else 1.0)
        shine = shine if lower > 0.0 else 0.0
        power = (1.0 if attenuation < 1.0 else 2.0) + excess - steepness
        b[_OWN_SHINE, k] = shine
        b[SHINE, k] += shine
        b[BY_SLOPE, k] -= 2.0 * (1.0 + excess) * shine if lower > 0.0 else 0.0
        b[BY_HALF2, k] += shine * power * inverse_half2 if lower > 0.0 else 0.0


@njit_inline
def _add_odds(b, count, rows, specular_share, one_law):
    """Add a facet's derivatives by the odds of its material and through its Fresnel factor; the
    latter only for `one_law`, since a mixture has added them."""
    for k in range(count):
        shine, own = b[_OWN_SHINE, k], b[OWN_IN_FULL, k] * b[FREE, k]
        b[OWN, k] = own
        if one_law:
            b[BY_REFLECTANCE, k] += shine * rows[1, k]
            b[BY_HALF2, k] += shine * rows[2, k]
        b[BY_ODDS, k] += shine * (1.0 - specular_share) - (own - shine) * specular_share


@njit_noalloc
def _add_by_law(b, count, whole, nx, ny, nz, material, law, table):
    """Add a shadowed facet of another reflection law; see `facet_blocks.add_facet_and_slopes`."""
    for k in range(count):
        lit, seen = b[LIT, k], b[SEEN, k]
        if not (lit > 0.0 and seen > 0.0):
            for row in (OWN_BY_LIT, OWN_BY_SEEN, _OWN_SHINE, OWN_IN_FULL):
                b[row, k] = 0.0
            continue
        area, both = whole * b[FREE, k], lit * seen
        diffuse, lobe, d_lit, d_seen, d_half2, d_slope, d_odds = reflectance(
            law, lit, seen, b[INVERSE_HALF2, k], material, table
        )
        b[OWN_IN_FULL, k] = whole * both * (diffuse + lobe)
        shine = area * lobe * both
        b[_OWN_SHINE, k] = shine
        by_lit = area * seen * (diffuse + lobe + lit * d_lit)
        by_seen = area * lit * (diffuse + lobe + seen * d_seen)
        b[OWN_BY_LIT, k], b[OWN_BY_SEEN, k] = by_lit, by_seen
        b[TOTAL, k] += area * both * (diffuse + lobe)
        b[SHINE, k] += shine
        b[BY_SLOPE, k] += area * both * d_slope
        b[BY_REFLECTANCE, k] += area * both * d_odds
        b[BY_HALF2, k] += area * both * d_half2
        b[BY_LIT, k], b[BY_SEEN, k] = b[BY_LIT, k] + by_lit * nx, b[BY_SEEN, k] + by_seen * nx
        b[BY_LIT + 1, k] += by_lit * ny
        b[BY_LIT + 2, k] += by_lit * nz
        b[BY_SEEN + 1, k] += by_seen * ny
        b[BY_SEEN + 2, k] += by_seen * nz


@njit_alloc
def _sum_body(block, shares, scaled, count, body, fresnel_sqrt, derivatives):
    """Sums over the facets of a composite body; see `body_magnitude_deviations`."""
    work = np.empty((body.materials.shape[0], 3, LANES)), make_sight()
    _sum_facets(block, shares, scaled, count, body, fresnel_sqrt, derivatives, *work)


@njit_noalloc
def _sum_facets(block, shares, scaled, count, body, fresnel_sqrt, derivatives, specular, sight):
    """`_sum_body` with given scratch."""
    b = known_shape(block)
    areas, normals, rows, column = body.areas, body.normals, body.rows, body.shadows.column
    materials, shadows, lengths, law = body.materials, body.shadows, body.lengths, body.law
    turn_into_body(b, count, materials[0], fresnel_sqrt)
    if law == 0:
        _specular_rows(b, count, materials, fresnel_sqrt, derivatives, specular)
    else:
        specular[:, 1:] = 0.0  # `_add_by_law` adds these derivatives
    find_corners(b, count, lengths, shadows.steps, sight)
    settled = shadows.settled
    b[TOTAL, :count] = 0.0
    if derivatives != _NOTHING:
        b[BY_LIT : BY_REFLECTANCE + 2, :count] = 0.0
        shares[:, :count] = 0.0
        b[BY_PHONG_SHARE:BLOCK_ROWS, :count] = 0.0
    last, left, word, shaded = -1, 0, -1, True
    diffuse, steepness, far, specular_share = 0.0, 0.0, 0.0, 0.0
    for i in range(areas.shape[0]):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        if cosines(b, count, nx, ny, nz) == 0:
            continue
        left = 0
        if column[i] >= 0:
            shaded = True
            if column[i] // 64 != word:
                word = column[i] // 64
                gather(count, word, sight, settled)
            left = settle(b, count, np.uint64(1) << np.uint64(column[i] % 64), sight)
            if left < 0:
                continue
            if left > 0:
                slopes = derivatives != _NOTHING
                resolve_edges(b, left, column[i], shadows, lengths, sight, slopes)
        elif shaded:
            shaded = False
            b[FREE, :count] = 1.0
        if rows[i] != last:
            last = rows[i]
            diffuse, _, steepness, far = reflection_constants(materials[last], 1.0, True)
            if law == 0:
                copy_into(b[SPECULAR, :count], specular[last, 0, :count])
            weights = materials[last, 0] + materials[last, 1]
            specular_share = materials[last, 1] / weights if weights > 0.0 else 0.0
            if law == TABULATED:
                specular_share = 1.0  # so that the derivative by the shares is zero
        if law != 0:
            _add_by_law(b, count, areas[i], nx, ny, nz, materials[last], law, body.table)
        elif body.mixed:
            normal, sums = (nx, ny, nz), (diffuse, steepness, far)
            add_mixed_facet(
                b, count, areas[i], normal, sums, materials[last], specular[last], body.mixture,
                derivatives != _NOTHING,
            )  # fmt: skip
        elif derivatives == _NOTHING:
            add_facet(b, count, areas[i], diffuse, steepness, far, True)
        else:
            add_facet_and_slopes(
                b, count, areas[i], nx, ny, nz, diffuse, steepness, far, False, True
            )
        if derivatives == _NOTHING:
            continue
        if derivatives == _PARTS:
            if law == 0 and not body.mixed:
                _add_parts(b, count, areas[i], steepness, far)
            _add_odds(b, count, specular[last], specular_share, not body.mixed)
            if scaled:
                add_axis_scale(b, count, nx, ny, nz)
            if i < shares.shape[0]:
                for k in range(count):
                    shares[i, k] = b[OWN, k]
        add_edges(b, left, sight, derivatives == _PARTS and scaled)


@njit(cache=True, error_model="numpy", inline="always")
def _sums(block, shares, scaled, count, body, fresnel_sqrt, derivatives):
    """Call `_sum_body` with fixed argument types, so that it is compiled only once."""
    given = body, fresnel_sqrt, np.int64(derivatives)
    _sum_body(block, shares, np.bool_(scaled), np.int64(count), *given)


@njit_noalloc
def body_magnitudes(block, count, body, irradiance_4pi, fresnel_sqrt):
    """Apparent magnitudes of a block's first `count` geometries, into its row `MAGNITUDE`. This is
    `cislunar.photometry.facet_blocks.block_magnitudes` for any `Body`."""
    if not body.composite:
        block_magnitudes(
            block, count, body.areas, body.normals, body.materials[0], irradiance_4pi, fresnel_sqrt
        )
        return
    _sums(block, block[:0], False, count, body, fresnel_sqrt, _NOTHING)
    b = known_shape(block)
    magnitudes_of_totals(b, count, irradiance_4pi)
    if body.mixed:
        add_phase_terms(b, count, body.mixture)


@njit_noalloc
def body_magnitude_gradients(block, count, body, irradiance_4pi, fresnel_sqrt):
    """Magnitudes and their derivatives by a small rotation of the body, mag/rad, in the body frame.
    This is `cislunar.photometry.facet_blocks.block_magnitude_gradients` for any `Body`."""
    if not body.composite:
        block_magnitude_gradients(
            block, count, body.areas, body.normals, body.materials[0], irradiance_4pi, fresnel_sqrt
        )
        return
    _sums(block, block[:0], False, count, body, fresnel_sqrt, _TURNS)
    b = known_shape(block)
    magnitudes_of_totals(b, count, irradiance_4pi)
    turns_of_slopes(b, count)
    if body.mixed:
        add_phase_terms(b, count, body.mixture)


@njit_noalloc
def body_magnitude_deviations(block, shares, scaled, count, body, irradiance_4pi, fresnel_sqrt):
    """As `body_magnitude_gradients`, with the sums that derivatives by material and shape need.
    This is `cislunar.photometry.facet_blocks.block_magnitude_deviations` for any `Body`. For a
    composite body the derivatives by odds (`BY_REFLECTANCE`, `BY_ODDS`) are summed as well."""
    if not body.composite:
        block_magnitude_deviations(
            block, shares, scaled, count, body.areas, body.normals, body.materials[0],
            irradiance_4pi, fresnel_sqrt,
        )  # fmt: skip
        return
    _sums(block, shares, scaled, count, body, fresnel_sqrt, _PARTS)
    b = known_shape(block)
    magnitudes_of_totals(b, count, irradiance_4pi)
    turns_of_slopes(b, count)
    if body.mixed:
        add_phase_terms(b, count, body.mixture)


@njit_alloc
def one_geometry(quaternion, sun_direction, view_direction, range_m):
    """A block whose first column is the given geometry."""
    block = np.empty((BLOCK_ROWS, LANES))
    for c in range(4):
        block[QUATERNION + c, 0] = quaternion[c]
    for c in range(3):
        block[SUN + c, 0], block[VIEW + c, 0] = sun_direction[c], view_direction[c]
    block[RANGE, 0] = range_m
    return block


@njit_noalloc
def body_magnitude(
    quaternion, sun_direction, view_direction, range_m, body, irradiance_4pi, fresnel_sqrt
):
    """Apparent magnitude in one geometry; see `cislunar.photometry.facets.facet_magnitude`."""
    geometry = quaternion, sun_direction, view_direction, range_m
    if not body.composite:
        return facet_magnitude(
            *geometry, body.areas, body.normals, body.materials[0], irradiance_4pi, fresnel_sqrt
        )
    return _magnitude(geometry, body, irradiance_4pi, fresnel_sqrt)


@njit_alloc
def _magnitude(geometry, body, irradiance_4pi, fresnel_sqrt):
    """`body_magnitude` of a composite body."""
    block = one_geometry(*geometry)
    body_magnitudes(block, np.int64(1), body, irradiance_4pi, fresnel_sqrt)
    return block[MAGNITUDE, 0]


@njit_noalloc
def body_magnitude_derivatives(
    quaternion, sun_direction, view_direction, range_m, body, irradiance_4pi, fresnel_sqrt
):
    """Magnitude with its derivatives by attitude, directions and range. This is
    `cislunar.photometry.facet_derivatives.facet_magnitude_derivatives` for any `Body`."""
    geometry = quaternion, sun_direction, view_direction, range_m
    if not body.composite:
        return facet_magnitude_derivatives(
            *geometry, body.areas, body.normals, body.materials[0], irradiance_4pi, fresnel_sqrt
        )
    return _magnitude_derivatives(geometry, body, irradiance_4pi, fresnel_sqrt)


@njit_alloc
def _magnitude_derivatives(geometry, body, irradiance_4pi, fresnel_sqrt):
    """`body_magnitude_derivatives` of a composite body."""
    quaternion, sun_direction, view_direction, _ = geometry
    b = one_geometry(*geometry)
    body_magnitude_deviations(
        b, np.empty((0, LANES)), np.bool_(False), np.int64(1), body, irradiance_4pi, fresnel_sqrt
    )
    if not b[MAGNITUDE, 0] < FLOOR_MAGNITUDE:
        return FLOOR_MAGNITUDE, ZERO, ZERO, ZERO, 0.0
    scale = -2.5 / (LN10 * b[TOTAL, 0])
    q1, q2, q3, q4 = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    ax, ay, az = rotate_components(
        -q1, -q2, -q3, q4, b[BY_LIT, 0], b[BY_LIT + 1, 0], b[BY_LIT + 2, 0]
    )
    bx, by, bz = rotate_components(
        -q1, -q2, -q3, q4, b[BY_SEEN, 0], b[BY_SEEN + 1, 0], b[BY_SEEN + 2, 0]
    )
    common = 2.0 * b[BY_HALF2, 0]
    hx = common * (sun_direction[0] + view_direction[0])
    hy = common * (sun_direction[1] + view_direction[1])
    hz = common * (sun_direction[2] + view_direction[2])
    turn = b[TURN, 0], b[TURN + 1, 0], b[TURN + 2, 0]
    by_sun = scale * (ax + hx), scale * (ay + hy), scale * (az + hz)
    by_view = scale * (bx + hx), scale * (by + hy), scale * (bz + hz)
    return b[MAGNITUDE, 0], turn, by_sun, by_view, 5.0 / LN10
