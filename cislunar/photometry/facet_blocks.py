"""Apparent magnitudes of one convex object for a block of geometries (compiled).

The model and its arguments are those of `cislunar.photometry.facets`. A block, shape
(BLOCK_ROWS, LANES), has one geometry per column and one quantity per row. Every loop runs along a
row, so that one facet is evaluated in all geometries at once, and a facet that is dark in all of
them costs its cosines only. Each geometry is summed separately in the order of the facets;
therefore the result depends neither on the other columns nor on the vector width of the machine.

A caller fills the rows `QUATERNION` (four), `SUN`, `VIEW` (three each) and `RANGE` of as many
columns as it needs. Afterwards `SUN` and `VIEW` are in the body frame and `TOTAL` has the facet
sum.
"""

import numpy as np

from cislunar.attitude.quaternion import rotate_components
from cislunar.compiled import njit, njit_inline, njit_noalloc
from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.elementary import exponential
from cislunar.photometry.facets import FLOOR_MAGNITUDE, IRRADIANCE_FLOOR, LN10, reflection_constants

LANES = 32
"""Geometries per block."""

# First rows of a block: inputs, results, and intermediate quantities.
QUATERNION, SUN, VIEW, RANGE = 0, 4, 7, 10
MAGNITUDE, TURN = 11, 12
TOTAL, INVERSE_HALF2, SPECULAR, LIT, SEEN, BY_LIT, BY_SEEN = 15, 16, 17, 18, 19, 20, 23
# Only for `block_magnitude_deviations`: the specular part of the sum, the sum's derivatives by the
# logarithms of the slope and of the lengths along three axes, and one facet's contributions.
SHINE, BY_SLOPE, BY_AXIS_SCALE, OWN, OWN_BY_LIT, OWN_BY_SEEN = 26, 27, 28, 31, 32, 33
_PARTS_END = 34
# Only for `cislunar.photometry.body_blocks`: derivatives of the sum by |L + V|^2 and by the odds of
# the normal reflectance and of the specular share; the lit and seen share of a facet, and its
# contribution if all of it were lit and seen.
BY_HALF2, BY_REFLECTANCE, BY_ODDS, FREE, OWN_IN_FULL = 34, 35, 36, 37, 38
# Only for `cislunar.photometry.law_mixture`: derivatives of the sum by the shares of the
# Lambert-Phong lobe and of Lommel-Seeliger reflection, and the phase angle, rad.
BY_PHONG_SHARE, BY_LOMMEL_SEELIGER_SHARE, PHASE_ANGLE = 39, 40, 41
BLOCK_ROWS = 42


@njit(cache=True, error_model="numpy", inline="always")
def known_shape(block):
    """The block with a constant shape, from which the compiler infers that rows do not overlap."""
    return block.reshape((BLOCK_ROWS, LANES))


@njit_inline
def turn_into_body(b, count, material, fresnel_sqrt):
    """Transform directions into the body frame and compute the factors that all facets share."""
    for k in range(count):
        q1, q2, q3, q4 = b[QUATERNION, k], b[QUATERNION + 1, k], b[QUATERNION + 2, k], b[3, k]
        lx, ly, lz = b[SUN, k], b[SUN + 1, k], b[SUN + 2, k]
        vx, vy, vz = b[VIEW, k], b[VIEW + 1, k], b[VIEW + 2, k]
        half2 = (lx + vx) ** 2 + (ly + vy) ** 2 + (lz + vz) ** 2
        b[INVERSE_HALF2, k] = 1.0 / half2
        b[SPECULAR, k] = reflection_constants(material, half2, fresnel_sqrt)[1]
        b[SUN, k], b[SUN + 1, k], b[SUN + 2, k] = rotate_components(q1, q2, q3, q4, lx, ly, lz)
        b[VIEW, k], b[VIEW + 1, k], b[VIEW + 2, k] = rotate_components(q1, q2, q3, q4, vx, vy, vz)


@njit_inline
def cosines(b, count, nx, ny, nz):
    """N.L and N.V of a facet; returns the number of geometries in which it is both lit and seen."""
    bright = 0
    for k in range(count):
        lit = nx * b[SUN, k] + ny * b[SUN + 1, k] + nz * b[SUN + 2, k]
        seen = nx * b[VIEW, k] + ny * b[VIEW + 1, k] + nz * b[VIEW + 2, k]
        b[LIT, k], b[SEEN, k] = lit, seen
        bright += (lit > 0.0) & (seen > 0.0)
    return bright


@njit_inline
def facet_glint(lit, seen, inverse_half2, specular, steepness, far):
    """Glint of a facet without attenuation, attenuation without its bound of 1, sec^2(phi), N.L +
    N.V, and the lesser of N.L and N.V; see `cislunar.photometry.facets.facet_sums`."""
    lower = lit if lit < seen else seen
    both = lit + seen
    cosine2 = both * both * inverse_half2
    shines = (lower > 0.0) & (1.0 - cosine2 < far * cosine2)  # else the glint underflows
    secant2 = 1.0 / (cosine2 if shines else 1.0)
    beckmann = exponential((1.0 - secant2) * steepness) * secant2 * secant2
    attenuation = 4.0 * both * lower * inverse_half2
    return (specular if shines else 0.0) * beckmann, attenuation, secant2, both, lower


@njit_inline
def add_facet(b, count, area, diffuse, steepness, far, shaded):
    """Add the light reflected by a facet to the totals; if `shaded`, only its share `FREE`."""
    for k in range(count):
        lit, seen = b[LIT, k], b[SEEN, k]
        glint, attenuation, _, _, lower = facet_glint(
            lit, seen, b[INVERSE_HALF2, k], b[SPECULAR, k], steepness, far
        )
        reflectance = diffuse * lit * seen + glint * (attenuation if attenuation < 1.0 else 1.0)
        reflectance *= area * b[FREE, k] if shaded else area
        b[TOTAL, k] += reflectance if lower > 0.0 else 0.0


@njit_inline
def add_facet_and_slopes(b, count, whole, nx, ny, nz, diffuse, steepness, far, with_parts, shaded):
    """Add the light reflected by a facet of area `whole`, and its derivatives by the directions.
    With parts, the specular part, the derivative by the slope and the facet's own contribution are
    added as well. If `shaded`, only the share `FREE` counts and `OWN_IN_FULL` has the contribution
    of the whole facet. The parts of a shaded facet are left to `body_blocks`, because the compiler
    does not vectorize both in one loop."""
    for k in range(count):
        area = whole * b[FREE, k] if shaded else whole
        lit, seen, inverse_half2 = b[LIT, k], b[SEEN, k], b[INVERSE_HALF2, k]
        glint, attenuation, secant2, both, lower = facet_glint(
            lit, seen, inverse_half2, b[SPECULAR, k], steepness, far
        )
        slope = (secant2 * steepness - 2.0) * secant2 * glint * 2.0 * both * inverse_half2
        edge = 4.0 * inverse_half2 * glint if attenuation < 1.0 else 0.0
        attenuation = attenuation if attenuation < 1.0 else 1.0
        slope *= attenuation
        by_lit = diffuse * seen + slope + edge * (lower + (both if lit < seen else 0.0))
        by_seen = diffuse * lit + slope + edge * (lower + (0.0 if lit < seen else both))
        reflectance = diffuse * lit * seen + glint * attenuation
        # selections rather than products with zero: the values are NaN with the Sun straight behind
        b[TOTAL, k] += area * reflectance if lower > 0.0 else 0.0
        by_lit = area * by_lit if lower > 0.0 else 0.0
        by_seen = area * by_seen if lower > 0.0 else 0.0
        b[BY_LIT, k] += by_lit * nx
        b[BY_LIT + 1, k] += by_lit * ny
        b[BY_LIT + 2, k] += by_lit * nz
        b[BY_SEEN, k] += by_seen * nx
        b[BY_SEEN + 1, k] += by_seen * ny
        b[BY_SEEN + 2, k] += by_seen * nz
        if shaded:
            b[OWN_IN_FULL, k] = whole * reflectance if lower > 0.0 else 0.0
        if shaded or with_parts:
            b[OWN_BY_LIT, k] = by_lit
            b[OWN_BY_SEEN, k] = by_seen
        if with_parts:
            shine = area * (glint * attenuation) if lower > 0.0 else 0.0
            b[SHINE, k] += shine
            b[BY_SLOPE, k] -= 2.0 * (1.0 + (1.0 - secant2) * steepness) * shine
            b[OWN, k] = area * reflectance if lower > 0.0 else 0.0


@njit_inline
def add_axis_scale(b, count, nx, ny, nz):
    """Add the change of a facet's contribution as the body grows along its axes. With s the
    logarithm of the length along axis c, the area changes by ``A (1 - n_c^2)`` and the normal by
    ``n_c (n_c N - e_c)``."""
    for k in range(count):
        lx, ly, lz = b[SUN, k], b[SUN + 1, k], b[SUN + 2, k]
        vx, vy, vz = b[VIEW, k], b[VIEW + 1, k], b[VIEW + 2, k]
        lit, seen = b[LIT, k], b[SEEN, k]
        own, by_lit, by_seen = b[OWN, k], b[OWN_BY_LIT, k], b[OWN_BY_SEEN, k]
        tilt = by_lit * lit + by_seen * seen - own
        b[BY_AXIS_SCALE, k] += own + nx * (nx * tilt - by_lit * lx - by_seen * vx)
        b[BY_AXIS_SCALE + 1, k] += own + ny * (ny * tilt - by_lit * ly - by_seen * vy)
        b[BY_AXIS_SCALE + 2, k] += own + nz * (nz * tilt - by_lit * lz - by_seen * vz)


@njit_inline
def _sum_facets(b, count, areas, normals, material, with_slopes):
    """Sums over the facets, into the rows of the totals and of their derivatives."""
    diffuse, _, steepness, far = reflection_constants(material, 1.0, True)
    for row in range(BY_LIT, SHINE):
        b[row, :count] = 0.0
    b[TOTAL, :count] = 0.0
    for i in range(areas.shape[0]):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        if cosines(b, count, nx, ny, nz) == 0:
            continue
        if with_slopes:
            add_facet_and_slopes(
                b, count, areas[i], nx, ny, nz, diffuse, steepness, far, False, False
            )
        else:
            add_facet(b, count, areas[i], diffuse, steepness, far, False)


@njit_inline
def _sum_parts(b, shares, scaled, count, areas, normals, material):
    """As `_sum_facets`, with the further sums of `block_magnitude_deviations`."""
    diffuse, _, steepness, far = reflection_constants(material, 1.0, True)
    for row in range(BY_LIT, _PARTS_END):
        b[row, :count] = 0.0
    b[TOTAL, :count] = 0.0
    shares[:, :count] = 0.0
    for i in range(areas.shape[0]):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        if cosines(b, count, nx, ny, nz) == 0:
            continue
        add_facet_and_slopes(b, count, areas[i], nx, ny, nz, diffuse, steepness, far, True, False)
        if scaled:
            add_axis_scale(b, count, nx, ny, nz)
        if i < shares.shape[0]:
            for k in range(count):
                shares[i, k] = b[OWN, k]


@njit_inline
def magnitudes_of_totals(b, count, irradiance_4pi):
    """Apparent magnitudes of the sums over the facets (Paul & Fan, eq. 6)."""
    for k in range(count):
        spread = np.pi * b[RANGE, k] * b[RANGE, k]
        if irradiance_4pi:
            spread *= 4.0 * np.pi
        flux = b[TOTAL, k] / spread
        if flux <= IRRADIANCE_FLOOR:
            b[MAGNITUDE, k] = FLOOR_MAGNITUDE
        else:
            b[MAGNITUDE, k] = SUN_APPARENT_MAGNITUDE - 2.5 * np.log10(flux)


@njit_inline
def turns_of_slopes(b, count):
    """Derivatives of the magnitudes by a small rotation, into the rows from `TURN` on."""
    for k in range(count):
        lx, ly, lz = b[SUN, k], b[SUN + 1, k], b[SUN + 2, k]
        vx, vy, vz = b[VIEW, k], b[VIEW + 1, k], b[VIEW + 2, k]
        ax, ay, az = b[BY_LIT, k], b[BY_LIT + 1, k], b[BY_LIT + 2, k]
        bx, by, bz = b[BY_SEEN, k], b[BY_SEEN + 1, k], b[BY_SEEN + 2, k]
        bright = b[MAGNITUDE, k] < FLOOR_MAGNITUDE
        scale = -2.5 / (LN10 * (b[TOTAL, k] if bright else 1.0))
        scale = scale if bright else 0.0
        b[TURN, k] = scale * (ay * lz - az * ly + by * vz - bz * vy)
        b[TURN + 1, k] = scale * (az * lx - ax * lz + bz * vx - bx * vz)
        b[TURN + 2, k] = scale * (ax * ly - ay * lx + bx * vy - by * vx)


@njit_noalloc
def block_magnitudes(block, count, areas, normals, material, irradiance_4pi, fresnel_sqrt):
    """Apparent magnitudes of a block's first `count` geometries, into its row `MAGNITUDE`. For the
    other arguments, and the magnitude of a dark object, see
    `cislunar.photometry.facets.facet_magnitude`."""
    b = known_shape(block)
    turn_into_body(b, count, material, fresnel_sqrt)
    _sum_facets(b, count, areas, normals, material, False)
    magnitudes_of_totals(b, count, irradiance_4pi)


@njit_noalloc
def block_magnitude_gradients(block, count, areas, normals, material, irradiance_4pi, fresnel_sqrt):
    """As `block_magnitudes`, with the derivatives by a small rotation of the body. The derivatives,
    mag/rad, are written into the three rows from `TURN` on. With ``q(e) = dq(e) (x) q``, where e is
    a rotation vector in the body frame, the facet sum depends on e only through N.L and N.V, whose
    derivatives are ``N x L`` and ``N x V``; L.V, and hence the Fresnel factor, is constant. The
    derivative is zero for a dark object. It is one-sided where a facet becomes lit or seen, or
    where the attenuation changes branch."""
    b = known_shape(block)
    turn_into_body(b, count, material, fresnel_sqrt)
    _sum_facets(b, count, areas, normals, material, True)
    magnitudes_of_totals(b, count, irradiance_4pi)
    turns_of_slopes(b, count)


@njit_noalloc
def block_magnitude_deviations(
    block, shares, scaled, count, areas, normals, material, irradiance_4pi, fresnel_sqrt
):
    """As `block_magnitude_gradients`, with the sums that derivatives by material and shape need.
    They are the specular part of `TOTAL` (`SHINE`), the derivative by the logarithm of the slope
    (`BY_SLOPE`) and, if `scaled`, those by the logarithms of the lengths along the body axes
    (`BY_AXIS_SCALE`). `shares`, shape (F or 0, LANES), receives the contribution of each facet."""
    b = known_shape(block)
    turn_into_body(b, count, material, fresnel_sqrt)
    _sum_parts(b, shares, scaled, count, areas, normals, material)
    magnitudes_of_totals(b, count, irradiance_4pi)
    turns_of_slopes(b, count)
