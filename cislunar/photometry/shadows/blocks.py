"""Lit and seen shares of facets for a block of geometries, with derivatives (compiled).

For blocks see `cislunar.photometry.facet_blocks`. In most geometries most facets are entirely free
or entirely dark at the table directions around; two words of bits say so for 64 facets. The
remaining cases, at the edges of shadows, are computed one by one.
"""

from typing import NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from cislunar.compiled import njit_alloc, njit_inline, njit_noalloc
from cislunar.photometry.facet_blocks import (
    BY_AXIS_SCALE,
    BY_LIT,
    BY_SEEN,
    FREE,
    LANES,
    LIT,
    OWN_IN_FULL,
    SEEN,
    SUN,
    VIEW,
)
from cislunar.photometry.shadows.table import CLEAR, DARK, SAMPLES, WORDS, table_corners


@intrinsic
def _count_bits(typing_context, word):
    """Number of bits set in an unsigned 64-bit word."""

    def generate(context, builder, signature, arguments):
        return builder.ctpop(arguments[0])

    return types.uint64(types.uint64), generate


@njit_inline
def _common_bits(masks, one, other):
    """Number of sample points that two masks share."""
    count = np.uint64(0)
    for k in range(WORDS):
        count += _count_bits(masks[one, k] & masks[other, k])
    return np.int64(count)


@njit_noalloc
def lit_and_seen(sun, sun_weights, view, view_weights, masks, shares):
    """Share of a facet's area that is both lit by the Sun and seen by the observer. `sun` and
    `view` are the rows of `masks` at the three table directions around each direction, with the
    weights of `table_corners`. The arrays of `Shadows` are passed one by one, because a kernel
    counts references to arrays that it takes from a tuple. The share is followed, for each
    direction, by a pair: the shares at the second and third table direction minus that at the
    first; see `_table_slopes`."""
    (s0, s1, s2), (a0, a1, a2) = sun, sun_weights
    (v0, v1, v2), (b0, b1, b2) = view, view_weights
    sun_alike, view_alike = s0 == s1 and s0 == s2, v0 == v1 and v0 == v2
    if (sun_alike and s0 == DARK) or (view_alike and v0 == DARK):
        return 0.0, (0.0, 0.0), (0.0, 0.0)
    if sun_alike and s0 == CLEAR:
        q0, q1, q2 = shares[v0], shares[v1], shares[v2]
        if view_alike:
            return q0, (0.0, 0.0), (0.0, 0.0)
        return b0 * q0 + b1 * q1 + b2 * q2, (0.0, 0.0), (q1 - q0, q2 - q0)
    if view_alike and v0 == CLEAR:
        p0, p1, p2 = shares[s0], shares[s1], shares[s2]
        return a0 * p0 + a1 * p1 + a2 * p2, (p1 - p0, p2 - p0), (0.0, 0.0)
    n00, n01 = _common_bits(masks, s0, v0), _common_bits(masks, s0, v1)
    n02, n10 = _common_bits(masks, s0, v2), _common_bits(masks, s1, v0)
    n11, n12 = _common_bits(masks, s1, v1), _common_bits(masks, s1, v2)
    n20, n21 = _common_bits(masks, s2, v0), _common_bits(masks, s2, v1)
    n22 = _common_bits(masks, s2, v2)
    scale = 1.0 / SAMPLES
    p0 = scale * (b0 * n00 + b1 * n01 + b2 * n02)
    p1 = scale * (b0 * n10 + b1 * n11 + b2 * n12)
    p2 = scale * (b0 * n20 + b1 * n21 + b2 * n22)
    q0 = scale * (a0 * n00 + a1 * n10 + a2 * n20)
    q1 = scale * (a0 * n01 + a1 * n11 + a2 * n21)
    q2 = scale * (a0 * n02 + a1 * n12 + a2 * n22)
    return a0 * p0 + a1 * p1 + a2 * p2, (p1 - p0, p2 - p0), (q1 - q0, q2 - q0)


@njit_noalloc
def _table_slopes(x, y, z, steps, second, third):
    """Gradient of a quantity interpolated in the table by a direction, homogeneous of degree 0.
    `second` and `third` are its values at the second and third of `table_corners` minus that at the
    first."""
    norm = abs(x) + abs(y) + abs(z)
    scale = steps * (1.0 - 1e-12) / norm
    a, b = abs(x) * scale, abs(y) * scale
    if (a - int(a)) + (b - int(b)) > 1.0:
        second, third = -second, -third  # the first corner is the far one
    scale /= norm
    common = scale * (second * abs(x) + third * abs(y))
    sx, sy, sz = np.sign(x), np.sign(y), np.sign(z)
    gx = (scale * second * norm - common) * sx
    gy = (scale * third * norm - common) * sy
    return gx, gy, -common * sz


class _Sight(NamedTuple):
    """Positions of a block's directions in the shadow table; rows 0 Sun, 1 observer. For each lane:
    the table directions around the direction (2, LANES, 3), their weights, and the triangle (2,
    LANES). For the current 64 facets: bits of those that are free, and of those at the edge of a
    shadow (LANES,). For the current facet: the lanes where it is at an edge, and the derivatives of
    its free share by the directions (LANES, 6)."""

    corners: NDArray[np.int64]
    weights: NDArray[np.float64]
    triangles: NDArray[np.int64]
    clear: NDArray[np.uint64]
    mixed: NDArray[np.uint64]
    edges: NDArray[np.int64]
    slopes: NDArray[np.float64]


@njit_alloc
def make_sight():
    """Uninitialized positions of a block's directions in the shadow table, for `find_corners`."""
    return _Sight(
        np.empty((2, LANES, 3), np.int64),
        np.empty((2, LANES, 3)),
        np.empty((2, LANES), np.int64),
        np.empty(LANES, np.uint64),
        np.empty(LANES, np.uint64),
        np.empty(LANES, np.int64),
        np.empty((LANES, 6)),
    )


@njit_noalloc
def find_corners(b, count, lengths, steps, sight):
    """Write the table directions around the directions of a block, with weights and triangles."""
    if steps == 0:
        return
    corners, weights, triangles = sight.corners, sight.weights, sight.triangles
    for d in range(2):
        row = SUN if d == 0 else VIEW
        for k in range(count):
            found, shares, triangles[d, k] = table_corners(
                b[row, k] / lengths[0], b[row + 1, k] / lengths[1], b[row + 2, k] / lengths[2],
                steps,
            )  # fmt: skip
            corners[d, k, 0], corners[d, k, 1], corners[d, k, 2] = found
            weights[d, k, 0], weights[d, k, 1], weights[d, k, 2] = shares


@njit_noalloc
def gather(count, word, sight, settled):
    """Determine which of 64 facets are entirely free, and which are at an edge of shadow."""
    for k in range(count):
        sun, view = settled[sight.triangles[0, k]], settled[sight.triangles[1, k]]
        sight.clear[k] = sun[0, word] & view[0, word]
        sight.mixed[k] = ~(sight.clear[k] | sun[1, word] | view[1, word])


@njit_inline
def settle(b, count, bit, sight):
    """Set the free share of a facet where it is 0 or 1; returns the number of remaining geometries.
    The remaining geometries are listed in `sight.edges`. Returns -1 if the facet is dark in all."""
    clear, mixed = sight.clear, sight.mixed
    left, free = 0, 0
    for k in range(count):
        bright = (b[LIT, k] > 0.0) & (b[SEEN, k] > 0.0)
        whole = (clear[k] & bit) != 0
        b[FREE, k] = 1.0 if whole else 0.0
        free += bright & whole
        left += bright & ((mixed[k] & bit) != 0)
    if left > 0:
        found = 0
        for k in range(count):
            if (mixed[k] & bit) != 0 and b[LIT, k] > 0.0 and b[SEEN, k] > 0.0:
                sight.edges[found] = k
                found += 1
    return left if left + free > 0 else -1


@njit_noalloc
def resolve_edges(b, left, column, shadows, lengths, sight, with_slopes):
    """Free shares of a facet at the edges of shadows, and their derivatives."""
    lookup, masks, shares = shadows.lookup, shadows.masks, shadows.shares
    corners, weights = sight.corners, sight.weights
    for n in range(left):
        k = sight.edges[n]
        free, by_sun, by_view = lit_and_seen(
            (
                lookup[corners[0, k, 0], column],
                lookup[corners[0, k, 1], column],
                lookup[corners[0, k, 2], column],
            ),
            (weights[0, k, 0], weights[0, k, 1], weights[0, k, 2]),
            (
                lookup[corners[1, k, 0], column],
                lookup[corners[1, k, 1], column],
                lookup[corners[1, k, 2], column],
            ),
            (weights[1, k, 0], weights[1, k, 1], weights[1, k, 2]),
            masks,
            shares,
        )
        b[FREE, k] = free
        if with_slopes:
            for d in range(2):
                row, (second, third) = (SUN, by_sun) if d == 0 else (VIEW, by_view)
                gx, gy, gz = _table_slopes(
                    b[row, k] / lengths[0], b[row + 1, k] / lengths[1], b[row + 2, k] / lengths[2],
                    shadows.steps, second, third,
                )  # fmt: skip
                sight.slopes[n, 3 * d] = gx / lengths[0]
                sight.slopes[n, 3 * d + 1] = gy / lengths[1]
                sight.slopes[n, 3 * d + 2] = gz / lengths[2]


@njit_noalloc
def add_edges(b, left, sight, scaled):
    """Add the change of the sums as the edges of shadows move over a facet."""
    for n in range(left):
        k = sight.edges[n]
        own = b[OWN_IN_FULL, k]
        for c in range(3):
            by_sun, by_view = own * sight.slopes[n, c], own * sight.slopes[n, 3 + c]
            b[BY_LIT + c, k] += by_sun
            b[BY_SEEN + c, k] += by_view
            if scaled:
                b[BY_AXIS_SCALE + c, k] -= by_sun * b[SUN + c, k] + by_view * b[VIEW + c, k]
