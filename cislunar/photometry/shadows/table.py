"""Shadows that the facets of a body cast on each other, tabulated over all directions.

Whether a point of the surface is lit depends only on the direction to the Sun, and whether it is
seen only on the direction to the observer. The area that is both lit and seen depends on the two
together. Therefore each facet that another one can shadow has `SAMPLES` fixed points, and a table
over directions has a mask of the points that are free. The lit and seen share is the number of bits
that the masks of Sun and observer have in common.

The directions are the vertices of an octahedron whose faces are divided into `steps` squared
triangles, projected onto the sphere. The share is interpolated linearly between the three vertices
around each direction. It is continuous, and exact where the mask does not change.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import njit, njit_noalloc
from cislunar.errors import ConfigurationError
from cislunar.photometry.meshes import CONVEX_TOLERANCE, Mesh, mesh_size
from cislunar.photometry.shapes import facets_from_triangles
from cislunar.runtime import Array

WORDS = 4
"""64-bit words per mask."""

SAMPLES = 64 * WORDS
"""Sample points per facet."""

STEPS = 32
"""Steps of the table from pole to equator, 2.8 degrees on average."""

DARK, CLEAR = 0, 1
"""Masks without bits, and with all bits."""

_PLASTIC = 1.32471795724474602596
"""Root of x^3 = x + 1; its powers distribute points evenly over the plane (the R2 sequence)."""

_GRAZING = 1e-3
"""Directions below a facet's horizon are raised to this sine; they serve only as the far end of the
interpolation across the horizon."""

LONGEST = 2.5
"""Greatest distance between neighboring directions of the table, times `steps`, rad."""


class Shadows(NamedTuple):
    """Table of the free points of facets, for compiled kernels.

    Parameters
    ----------
    steps : int
        Steps of the table from pole to equator; 0 if no facet can shadow another.
    column : ndarray of int, shape (F,)
        Column of a facet in `lookup`; -1 for a facet that nothing can shadow.
    lookup : ndarray of int, shape ((2 steps + 1)^2, C)
        Row of `masks` for a direction and a facet.
    masks : ndarray of uint64, shape (M, WORDS)
        Free points, one bit each; row `DARK` has none and row `CLEAR` all.
    shares : ndarray, shape (M,)
        Share of free points of each mask.
    settled : ndarray of uint64, shape (16 steps^2, 2, ceil(C / 64))
        For each triangle of the table, one bit per column: whether the facet is clear at all three
        corners, and whether it is dark at all three.
    """

    steps: int
    column: NDArray[np.int64]
    lookup: NDArray[np.int32]
    masks: NDArray[np.uint64]
    shares: Array
    settled: NDArray[np.uint64]


@njit_noalloc
def table_corners(x, y, z, steps):
    """Rows of `Shadows.lookup` for the three table directions around a direction, and their
    weights. The last returned value is the triangle's row of `Shadows.settled`."""
    scale = steps * (1.0 - 1e-12) / (abs(x) + abs(y) + abs(z))  # the outermost edge stays inside
    a, b = abs(x) * scale, abs(y) * scale
    i, j = int(a), int(b)
    f, g = a - i, b - j
    octant = 4 * (x < 0.0) + 2 * (y < 0.0) + (z < 0.0)
    triangle = 2 * ((octant * steps + i) * steps + j)
    if f + g <= 1.0:
        weights = 1.0 - f - g, f, g
        first = _table_row(i, j, x, y, z, steps)
        second = _table_row(i + 1, j, x, y, z, steps)
        third = _table_row(i, j + 1, x, y, z, steps)
    else:
        triangle += 1
        weights = f + g - 1.0, 1.0 - f, 1.0 - g
        first = _table_row(i + 1, j + 1, x, y, z, steps)
        second = _table_row(i, j + 1, x, y, z, steps)
        third = _table_row(i + 1, j, x, y, z, steps)
    return (first, second, third), weights, triangle


@njit_noalloc
def _table_row(i, j, x, y, z, steps):
    """Row of the vertex i, j >= 0 steps from the pole, in the octant of (x, y, z)."""
    if z < 0.0:  # the lower half is folded outward
        i, j = steps - j, steps - i
    if x < 0.0:
        i = -i
    if y < 0.0:
        j = -j
    return (i + steps) * (2 * steps + 1) + j + steps


def table_directions(steps: int) -> Array:
    """Unit vectors of the rows of a table, shape ((2 steps + 1)^2, 3). Directions on the rim of the
    unfolded octahedron occur twice."""
    axis = np.arange(-steps, steps + 1) / max(steps, 1)
    x, y = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
    z = 1.0 - abs(x) - abs(y)
    below = z < -1e-12
    folded = (1.0 - abs(y)) * np.sign(x), (1.0 - abs(x)) * np.sign(y)
    x, y = np.where(below, folded[0], x), np.where(below, folded[1], y)
    vectors = np.stack([x, y, z], axis=1)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _sample_points(n_facets: int) -> Array:
    """Evenly distributed points on F facets, different for each facet: coordinates along the two
    edges from a facet's first vertex, shape (F, SAMPLES, 2)."""
    step = np.array([1.0 / _PLASTIC, 1.0 / _PLASTIC**2])
    start = np.arange(n_facets)[:, None, None] * np.array([np.sqrt(2.0), np.sqrt(3.0)])
    points = (start + np.arange(1, SAMPLES + 1)[:, None] * step) % 1.0
    return np.where(points.sum(axis=-1, keepdims=True) > 1.0, 1.0 - points, points)


def shadowing_pairs(mesh: Mesh) -> NDArray[np.bool_]:
    """Which facet j can shadow which facet i of a closed mesh, entry [i, j] of (F, F). A ray that
    leaves a closed body passes through the back of a facet. Facet j can therefore shadow i only if
    j rises above the plane of i and i reaches below that of j. No two facets of a convex body can.
    """
    normals = facets_from_triangles(mesh.vertices, mesh.triangles).normals
    corners = mesh.vertices[mesh.triangles]
    offsets = np.einsum("fi,fi->f", normals, corners[:, 0])
    heights = np.einsum("fi,jci->fjc", normals, corners) - offsets[:, None, None]
    tolerance = CONVEX_TOLERANCE * mesh_size(mesh.vertices)
    rises, dips = heights.max(axis=-1) > tolerance, heights.min(axis=-1) < -tolerance
    return rises & dips.T


def no_shadows(n_facets: int) -> Shadows:
    """Table of one row, without columns, for F facets that do not shadow each other."""
    masks = np.array([[0] * WORDS, [~np.uint64(0)] * WORDS], dtype=np.uint64)
    column = np.full(n_facets, -1, dtype=np.int64)
    shares, settled = np.array([0.0, 1.0]), np.zeros((0, 2, 0), np.uint64)
    return Shadows(0, column, np.zeros((1, 0), np.int32), masks, shares, settled)


def shadow_table(mesh: Mesh, steps: int = STEPS) -> Shadows:
    """Tabulate the shadows that the facets of a body cast on each other.

    Parameters
    ----------
    mesh : Mesh
        Closed, facing outward.
    steps : int
        Steps of the table from pole to equator.

    Returns
    -------
    Shadows
        Without columns, and of one row, if no facet can shadow another.

    Raises
    ------
    ConfigurationError
        If `steps` is not positive.
    """
    if not steps > 0:
        raise ConfigurationError(f"shadow table steps = {steps} must be positive")
    pairs = shadowing_pairs(mesh)
    shadowed = np.nonzero(pairs.any(axis=1))[0]
    if not shadowed.size:
        return no_shadows(len(pairs))
    column = np.full(len(pairs), -1, dtype=np.int64)
    column[shadowed] = np.arange(shadowed.size)
    normals = facets_from_triangles(mesh.vertices, mesh.triangles).normals
    corners = mesh.vertices[mesh.triangles]
    directions, points = table_directions(steps), _sample_points(len(pairs))
    lookup = np.zeros((len(directions), shadowed.size), dtype=np.int32)
    masks = [no_shadows(0).masks]
    found = 2
    for i in shadowed:
        edges = corners[i, 1:] - corners[i, 0]
        # Its rows give the coordinates along the two edges, and the height above the plane.
        frame = np.linalg.inv(np.column_stack([*edges, normals[i]]))
        occluders = np.nonzero(pairs[i])[0]
        polygons = [_part_above((corners[j] - corners[i, 0]) @ frame.T) for j in occluders]
        sizes = np.array([len(each) for each in polygons])
        padded = np.zeros((len(polygons), 4, 3))
        for row, each in zip(padded, polygons, strict=True):
            row[: len(each)] = each
        rising = directions @ normals[occluders].T
        free = _free_points(
            directions @ frame.T, rising, padded, sizes, points[i], -LONGEST / steps
        )
        bits = np.bitwise_count(free).sum(axis=1)
        partial = np.nonzero((bits > 0) & (bits < SAMPLES))[0]
        kept, inverse = np.unique(free[partial], axis=0, return_inverse=True)
        rows = np.where(bits == SAMPLES, CLEAR, DARK)
        rows[partial] = found + inverse.ravel()
        lookup[:, column[i]] = rows
        masks.append(kept)
        found += len(kept)
    table = np.concatenate(masks)
    shares = np.bitwise_count(table).sum(axis=1) / SAMPLES
    return Shadows(steps, column, lookup, table, shares, _settled(lookup, steps))


def joined_shadows(tables: Sequence[Shadows]) -> Shadows:
    """Shadow tables of several bodies as one table; equal tables are stored once.

    Parameters
    ----------
    tables : sequence of Shadows
        One for each body.

    Returns
    -------
    Shadows
        With a `column` for the facets of all bodies, one body after the other.

    Raises
    ------
    ConfigurationError
        If the tables have different steps.
    """
    # tables of some facets of the same bodies share their arrays
    distinct = {id(each.lookup): each for each in tables if each.steps > 0}
    none = no_shadows(0)
    if len({each.steps for each in distinct.values()}) > 1:
        raise ConfigurationError("shadow table steps must be the same for all bodies")
    if len(distinct) <= 1:
        (table,) = distinct.values() or [none]
        return table._replace(column=np.concatenate([each.column for each in tables]))
    starts, lookups, settled, masks, shares = {}, [], [], [none.masks], [none.shares]
    width, found = 0, len(none.shares)
    for key, each in distinct.items():
        starts[key] = width
        # each word of `settled` belongs to one body
        spare = -each.lookup.shape[1] % 64
        shifted = np.where(each.lookup > CLEAR, each.lookup + (found - 2), each.lookup)
        lookups.append(np.pad(shifted, ((0, 0), (0, spare))))
        settled.append(each.settled)
        masks.append(each.masks[2:])
        shares.append(each.shares[2:])
        width += each.lookup.shape[1] + spare
        found += len(each.masks) - 2
    column = [np.where(t.column >= 0, t.column + starts.get(id(t.lookup), 0), -1) for t in tables]
    return Shadows(
        next(iter(distinct.values())).steps,
        np.concatenate(column),
        np.ascontiguousarray(np.concatenate(lookups, axis=1), dtype=np.int32),
        np.concatenate(masks),
        np.concatenate(shares),
        np.ascontiguousarray(np.concatenate(settled, axis=2)),
    )


@njit(cache=True, error_model="numpy")
def _settled(lookup, steps):
    """`Shadows.settled` of a lookup table."""
    count = lookup.shape[1]
    result = np.zeros((16 * steps * steps, 2, (count + 63) // 64), np.uint64)
    for x in (-1.0, 1.0):
        for y in (-1.0, 1.0):
            for z in (-1.0, 1.0):
                for i in range(steps):
                    for j in range(steps - i):
                        for third in (1.0 / 3.0, 2.0 / 3.0):
                            a, b = i + third, j + third
                            rest = steps - a - b
                            if rest < 0.0:
                                continue
                            corners, _, triangle = table_corners(x * a, y * b, z * rest, steps)
                            for c in range(count):
                                mask = lookup[corners[0], c]
                                alike = mask == lookup[corners[1], c]
                                if alike and mask == lookup[corners[2], c] and mask <= CLEAR:
                                    kind = 0 if mask == CLEAR else 1
                                    bit = np.uint64(1) << np.uint64(c % 64)
                                    result[triangle, kind, c // 64] |= bit
    return result


def _part_above(triangle: Array) -> Array:
    """Corners of the part of a triangle, (3, 3), with positive last coordinate: 3 or 4."""
    kept = []
    for here, there in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        if here[2] > 0.0:
            kept.append(here)
        if (here[2] > 0.0) != (there[2] > 0.0):
            kept.append(here + (there - here) * here[2] / (here[2] - there[2]))
    return np.array(kept)


@njit(cache=True, error_model="numpy")
def _free_points(directions, rising, polygons, sizes, points, lowest):
    """Masks (rows, WORDS) of the points of a facet that no occluder hides. `directions` (rows, 3),
    `polygons` (J, 4, 3) with `sizes` corners and `points` (SAMPLES, 2) are in the coordinates of
    the facet. `rising` (rows, J) is the cosine between a direction and an occluder's normal; only
    the back of an occluder counts. Directions with a third coordinate below `lowest` are skipped.
    """
    result = np.zeros((directions.shape[0], WORDS), np.uint64)
    shadow = np.empty((4, 2))
    first, second = points[:, 0].copy(), points[:, 1].copy()
    free, inside = np.empty(SAMPLES, np.bool_), np.empty(SAMPLES, np.bool_)
    for row in range(directions.shape[0]):
        rise = directions[row, 2]
        if rise < lowest:
            continue  # not used in any interpolation
        rise = max(rise, _GRAZING)
        slope_u, slope_v = directions[row, 0] / rise, directions[row, 1] / rise
        left = SAMPLES
        free[:] = True
        for j in range(polygons.shape[0]):
            if rising[row, j] <= 0.0 or left == 0:
                continue
            n = sizes[j]
            low_u, low_v, high_u, high_v = np.inf, np.inf, -np.inf, -np.inf
            for k in range(n):
                u = polygons[j, k, 0] - slope_u * polygons[j, k, 2]
                v = polygons[j, k, 1] - slope_v * polygons[j, k, 2]
                shadow[k, 0], shadow[k, 1] = u, v
                low_u, high_u = min(low_u, u), max(high_u, u)
                low_v, high_v = min(low_v, v), max(high_v, v)
            if high_u <= 0.0 or high_v <= 0.0 or low_u >= 1.0 or low_v >= 1.0:
                continue
            area = 0.0
            for k in range(n):
                m = (k + 1) % n
                area += shadow[k, 0] * shadow[m, 1] - shadow[m, 0] * shadow[k, 1]
            # without branches, for vector instructions
            for s in range(SAMPLES):
                u, v = first[s], second[s]
                inside[s] = (low_u <= u) & (u <= high_u) & (low_v <= v) & (v <= high_v)
            for k in range(n):
                m = k + 1 if k + 1 < n else 0
                at_u, at_v = shadow[k, 0], shadow[k, 1]
                du, dv = shadow[m, 0] - at_u, shadow[m, 1] - at_v
                for s in range(SAMPLES):
                    inside[s] &= area * (du * (second[s] - at_v) - dv * (first[s] - at_u)) >= 0.0
            left = 0
            for s in range(SAMPLES):
                free[s] &= not inside[s]
                left += free[s]
        for s in range(SAMPLES):
            if free[s]:
                result[row, s // 64] |= np.uint64(1) << np.uint64(s % 64)
    return result
