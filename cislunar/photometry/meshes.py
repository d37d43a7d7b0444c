"""Meshes of triangles with facet groups, and their validation.

A mesh is closed, and its vertices run counter-clockwise seen from outside. It may consist of
several closed parts, which may intersect but share no edge. Messages count facets from 1.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from cislunar.errors import InputFileError
from cislunar.runtime import Array, Indices

_MERGE_TOLERANCE = 1e-6
"""Vertices nearer than this share of the mesh's size are merged (STL repeats them, in float32)."""

CONVEX_TOLERANCE = 1e-5
"""Share of the mesh's size by which a vertex of a convex mesh may lie above a facet's plane."""

_THINNEST = 1e-6
"""Least height of a facet, as a share of its longest edge."""


class Mesh(NamedTuple):
    """A closed surface of triangles, convex or not.

    Parameters
    ----------
    source : str
        Origin of the mesh, for messages.
    vertices : ndarray, shape (n, 3)
        Vertices, m, body frame.
    triangles : ndarray of int, shape (F, 3)
        Vertex indices of each facet, counter-clockwise seen from outside.
    groups : tuple of str, length F
        Group of each facet, which determines its material; empty if none was given.
    """

    source: str
    vertices: Array
    triangles: Indices
    groups: tuple[str, ...]


def mesh_size(vertices: Array) -> float:
    """Diagonal of the bounding box, in the unit of the vertices, shape (n, 3)."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def closed_mesh(
    source: str | Path, vertices: Array, triangles: Indices, groups: tuple[str, ...]
) -> Mesh:
    """A mesh of vertices (n, 3), m, body frame, of which coincident ones are merged. Raises an
    `InputFileError` that names the facet if the mesh has fewer than four facets or a degenerate
    one, is open, or a part of it is inside out."""
    if len(triangles) < 4:
        raise InputFileError(f"{source}: {len(triangles)} facets cannot close a body; it takes 4")
    vertices, triangles = _merge_vertices(vertices, triangles)
    _check_facets(source, vertices, triangles)
    _check_closed(source, triangles)
    _check_outward(source, vertices, triangles)
    return Mesh(str(source), vertices, triangles, groups)


def _merge_vertices(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Drop unused vertices and merge coincident ones."""
    used, triangles = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used], triangles.reshape(-1, 3)
    if not np.all(np.isfinite(vertices)):
        return vertices, triangles  # the facet check names the facet
    nearest = _MERGE_TOLERANCE * mesh_size(vertices)
    pairs = cKDTree(vertices).query_pairs(nearest, output_type="ndarray")
    n = len(vertices)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    _, first = np.unique(label, return_index=True)
    return vertices[first], label.astype(np.int64)[triangles]


def _check_facets(source: str | Path, vertices: Array, triangles: Indices) -> None:
    """Refuse facets with coordinates that are not finite, or without area."""
    corners = vertices[triangles]
    broken = np.nonzero(~np.isfinite(corners).all(axis=(1, 2)))[0]
    if broken.size:
        raise InputFileError(f"{source}: facet {broken[0] + 1} has a coordinate that is not finite")
    edges = np.roll(corners, -1, axis=1) - corners
    longest2 = (edges**2).sum(axis=-1).max(axis=1)
    doubled_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    thin = np.nonzero(doubled_area <= _THINNEST * longest2)[0]
    if thin.size:
        raise InputFileError(
            f"{source}: facet {thin[0] + 1} is degenerate (no area); remove it from the mesh"
        )


def _check_closed(source: str | Path, triangles: Indices) -> None:
    """Refuse a mesh with an edge that does not occur once in each direction."""
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    n = int(triangles.max()) + 1
    forward, backward = starts * n + ends, ends * n + starts
    _, inverse, counts = np.unique(forward, return_inverse=True, return_counts=True)
    twice = np.nonzero(counts[inverse] > 1)[0]
    if twice.size:
        other = np.nonzero(forward == forward[twice[0]])[0][1]
        raise InputFileError(
            f"{source}: facets {twice[0] // 3 + 1} and {other // 3 + 1} run along their common "
            "edge in the same direction; orient all facets outward and remove double ones"
        )
    alone = np.nonzero(~np.isin(backward, forward))[0]
    if alone.size:
        raise InputFileError(
            f"{source}: facet {alone[0] // 3 + 1} has an edge without neighbor; close the mesh"
        )


def _check_outward(source: str | Path, vertices: Array, triangles: Indices) -> None:
    """Refuse a part with negative signed volume, whose facets face inward."""
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    n = len(vertices)
    graph = coo_array((np.ones(len(starts)), (starts, ends)), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    part = label[triangles[:, 0]]
    # Relative to the middle of a part, so that a small part far from the origin loses no digits.
    count = np.bincount(label)
    middle = np.stack([np.bincount(label, column) / count for column in vertices.T], axis=1)
    corners = vertices[triangles] - middle[part][:, None]
    inward = np.nonzero(np.bincount(part, np.linalg.det(corners))[part] < 0.0)[0]
    if inward.size:
        others = "all others" if inward.size == len(triangles) else "the others of its part"
        raise InputFileError(
            f"{source}: facet {inward[0] + 1} and {others} face inward; reverse the order of their "
            "vertices"
        )
