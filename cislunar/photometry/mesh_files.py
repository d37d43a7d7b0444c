"""Shapes of objects from mesh files: Wavefront OBJ, STL in text or binary.

The facet model knows no shadows of one facet on another, so a mesh must be a closed convex body
of triangles whose vertices run counter-clockwise seen from outside. Everything else is refused
with the file and the facet at fault; facets are counted from 1 in the file's order.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from cislunar.errors import ConfigurationError, InputFileError
from cislunar.photometry.shapes import Facets, facets_from_triangles, scale_to_sphere

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MERGE_TOLERANCE = 1e-6
"""Vertices nearer than this share of the mesh's size are one (STL repeats them, in float32)."""

CONVEX_TOLERANCE = 1e-5
"""Share of the mesh's size by which a vertex may stand above a facet's plane."""

THINNEST = 1e-6
"""Least height of a facet, as a share of its longest edge."""


def load_shape(
    path: str | Path, *, metres_per_unit: float = 1.0, radius_m: float | None = None
) -> Facets:
    """Facets of a convex body from a mesh file.

    Parameters
    ----------
    path : str or Path
        ``.obj`` or ``.stl`` (text or binary). The file's axes become the body frame. Normals
        stored in the file are ignored: the order of the vertices decides.
    metres_per_unit : float
        Length of the file's unit, m.
    radius_m : float, optional
        If given, the shape is scaled to the surface area 4 pi R^2 instead, m.

    Returns
    -------
    Facets
        One facet per triangle, in the file's order.

    Raises
    ------
    InputFileError
        If the file cannot be read, or the mesh is open, not of triangles, inside out, not convex,
        or has a degenerate facet; the message names the file and the facet.
    ConfigurationError
        If `metres_per_unit` or `radius_m` is not positive.
    """
    if not metres_per_unit > 0.0:
        raise ConfigurationError(f"shape metres_per_unit = {metres_per_unit} must be positive")
    path = Path(path)
    readers = {".obj": _read_obj, ".stl": _read_stl}
    if path.suffix.lower() not in readers:
        raise InputFileError(f"{path}: a shape file must end in .obj or .stl")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputFileError(f"{path}: cannot read the shape file ({error.strerror})") from error
    vertices, triangles = readers[path.suffix.lower()](path, content)
    if len(triangles) < 4:
        raise InputFileError(f"{path}: {len(triangles)} facets cannot close a body; it takes 4")
    vertices, triangles = _merge_vertices(vertices, triangles)
    _check_facets(path, vertices, triangles)
    _check_closed(path, triangles)
    _check_convex(path, vertices, triangles)
    facets = facets_from_triangles(vertices * metres_per_unit, triangles)
    return facets if radius_m is None else scale_to_sphere(facets, radius_m)


def _read_obj(path: Path, content: bytes) -> tuple[Array, Indices]:
    """Vertices (n, 3) and triangles (F, 3) of an OBJ file; only ``v`` and ``f`` lines count."""
    vertices: list[list[float]] = []
    triangles: list[list[int]] = []
    for number, line in enumerate(content.decode("utf-8", errors="replace").splitlines(), 1):
        words = line.split("#")[0].split()
        if not words or words[0] not in ("v", "f"):
            continue
        try:
            if words[0] == "v":
                vertices.append([float(word) for word in words[1:4]])
                continue
            corners = [int(word.split("/")[0]) for word in words[1:]]
        except ValueError as error:
            raise InputFileError(f"{path}, line {number}: cannot read {line.strip()!r}") from error
        facet = len(triangles) + 1
        if len(corners) != 3:
            raise InputFileError(
                f"{path}, line {number}: facet {facet} has {len(corners)} vertices, not 3; "
                "triangulate the mesh"
            )
        # OBJ counts from 1, and backwards from the latest vertex with negative numbers
        indices = [c - 1 if c > 0 else len(vertices) + c for c in corners]
        if 0 in corners or min(indices) < 0:
            raise InputFileError(f"{path}, line {number}: facet {facet} names no known vertex")
        triangles.append(indices)
    if any(len(vertex) != 3 for vertex in vertices):
        raise InputFileError(f"{path}: a vertex has fewer than 3 coordinates")
    array = np.array(triangles, dtype=np.int64).reshape(-1, 3)
    beyond = np.nonzero(array.max(axis=1, initial=-1) >= len(vertices))[0]
    if beyond.size:
        raise InputFileError(
            f"{path}: facet {beyond[0] + 1} names vertex {array[beyond[0]].max() + 1} of "
            f"{len(vertices)}"
        )
    return np.array(vertices, dtype=float).reshape(-1, 3), array


def _read_stl(path: Path, content: bytes) -> tuple[Array, Indices]:
    """Vertices (3F, 3), not yet merged, and triangles (F, 3) of an STL file."""
    # Some binary files begin with "solid" too; their length tells.
    count = int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    if len(content) == 84 + 50 * count:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(content, record, count, offset=84)["corners"].astype(float)
    elif content.lstrip()[:5].lower() == b"solid":
        corners = _read_stl_text(path, content.decode("utf-8", errors="replace"))
    else:
        raise InputFileError(
            f"{path}: neither a text STL file nor a whole binary one ({len(content)} bytes; "
            f"{count} facets announced)"
        )
    return corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3)


def _read_stl_text(path: Path, text: str) -> Array:
    """Corners (F, 3, 3) of a text STL file."""
    corners: list[list[list[float]]] = []
    loop: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.lower().split()
        if words[:1] == ["vertex"]:
            try:
                loop.append([float(word) for word in words[1:]])
            except ValueError:
                loop.append([])
            if len(loop[-1]) != 3:
                raise InputFileError(f"{path}, line {number}: cannot read {line.strip()!r}")
        elif words[:1] == ["endfacet"]:
            if len(loop) != 3:
                raise InputFileError(
                    f"{path}, line {number}: facet {len(corners) + 1} has {len(loop)} vertices, "
                    "not 3; triangulate the mesh"
                )
            corners.append(loop)
            loop = []
    if loop:
        raise InputFileError(f"{path}: the file ends within facet {len(corners) + 1}")
    return np.array(corners, dtype=float).reshape(-1, 3, 3)


def _size(vertices: Array) -> float:
    """Diagonal of the bounding box."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def _merge_vertices(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Drop unused vertices and make one of those that coincide."""
    used, triangles = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used], triangles.reshape(-1, 3)
    if not np.all(np.isfinite(vertices)):
        return vertices, triangles  # the facet check names the culprit
    pairs = cKDTree(vertices).query_pairs(MERGE_TOLERANCE * _size(vertices), output_type="ndarray")
    n = len(vertices)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    _, first = np.unique(label, return_index=True)
    return vertices[first], label.astype(np.int64)[triangles]


def _check_facets(path: Path, vertices: Array, triangles: Indices) -> None:
    """Refuse facets without finite coordinates or without an area."""
    corners = vertices[triangles]
    broken = np.nonzero(~np.isfinite(corners).all(axis=(1, 2)))[0]
    if broken.size:
        raise InputFileError(f"{path}: facet {broken[0] + 1} has a coordinate that is not finite")
    edges = np.roll(corners, -1, axis=1) - corners
    longest2 = (edges**2).sum(axis=-1).max(axis=1)
    doubled_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    thin = np.nonzero(doubled_area <= THINNEST * longest2)[0]
    if thin.size:
        raise InputFileError(
            f"{path}: facet {thin[0] + 1} is degenerate (no area); remove it from the mesh"
        )


def _check_closed(path: Path, triangles: Indices) -> None:
    """Each edge must be walked once in each direction."""
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    n = int(triangles.max()) + 1
    forward, backward = starts * n + ends, ends * n + starts
    _, inverse, counts = np.unique(forward, return_inverse=True, return_counts=True)
    twice = np.nonzero(counts[inverse] > 1)[0]
    if twice.size:
        other = np.nonzero(forward == forward[twice[0]])[0][1]
        raise InputFileError(
            f"{path}: facets {twice[0] // 3 + 1} and {other // 3 + 1} run along their common edge "
            "in the same direction; orient all facets outward and remove double ones"
        )
    alone = np.nonzero(~np.isin(backward, forward))[0]
    if alone.size:
        raise InputFileError(
            f"{path}: facet {alone[0] // 3 + 1} has an edge without neighbor; close the mesh"
        )


def _check_convex(path: Path, vertices: Array, triangles: Indices) -> None:
    """No vertex above the plane of any facet; inside out is told apart."""
    normals = facets_from_triangles(vertices, triangles).normals
    origins = vertices[triangles[:, 0]]
    # The signed volume of a closed mesh is positive exactly when its facets face outward.
    corners = vertices[triangles] - vertices.mean(axis=0)
    if np.linalg.det(corners).sum() < 0.0:
        raise InputFileError(
            f"{path}: facet 1 and all others face inward; reverse the order of their vertices"
        )
    tolerance = CONVEX_TOLERANCE * _size(vertices)
    for facet, (normal, origin) in enumerate(zip(normals, origins, strict=True), 1):
        height = float(((vertices - origin) @ normal).max())
        if height > tolerance:
            raise InputFileError(
                f"{path}: not convex, a vertex stands {height:.4g} units above the plane of facet "
                f"{facet}; facets would shadow each other, which the model leaves out"
            )
