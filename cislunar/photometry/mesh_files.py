"""Meshes from files: Wavefront OBJ, and STL in text or binary form.

Meshes are closed, and vertices run counter-clockwise seen from outside. Other input is refused with
the file and the facet; facets are counted from 1 in the order of the file.
"""

from pathlib import Path

import numpy as np

from cislunar.errors import ConfigurationError, InputFileError
from cislunar.photometry.meshes import Mesh, closed_mesh
from cislunar.runtime import Array, Indices


def load_mesh(path: str | Path, *, meters_per_unit: float = 1.0) -> Mesh:
    """A closed mesh, convex or not, from a file.

    Parameters
    ----------
    path : str or Path
        ``.obj`` or ``.stl`` (text or binary). The file's axes become the body frame. Normals in the
        file are ignored; the order of the vertices determines them. The facet groups are the names
        after ``usemtl`` in an OBJ file; STL has none.
    meters_per_unit : float
        Length of the file's unit, m.

    Returns
    -------
    Mesh
        One facet per triangle, in the file's order.

    Raises
    ------
    ConfigurationError
        If the length of the unit is not positive.
    InputFileError
        If the file cannot be read, or the mesh is open, not of triangles, inside out, or has a
        degenerate facet.
    """
    if not meters_per_unit > 0.0:
        raise ConfigurationError(f"shape meters_per_unit = {meters_per_unit} must be positive")
    path = Path(path)
    readers = {".obj": _read_obj, ".stl": _read_stl}
    if path.suffix.lower() not in readers:
        raise InputFileError(f"{path}: a shape file must end in .obj or .stl")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputFileError(f"{path}: cannot read the shape file ({error.strerror})") from error
    mesh = closed_mesh(path, *readers[path.suffix.lower()](path, content))
    return mesh._replace(vertices=mesh.vertices * meters_per_unit)


def _read_obj(path: Path, content: bytes) -> tuple[Array, Indices, tuple[str, ...]]:
    """Vertices (n, 3), triangles (F, 3) and groups of an OBJ file, from its lines ``v``, ``f`` and
    ``usemtl``; other lines are ignored."""
    vertices: list[list[float]] = []
    triangles: list[list[int]] = []
    group, groups = "", []
    for number, line in enumerate(content.decode("utf-8", errors="replace").splitlines(), 1):
        words = line.split("#")[0].split()
        if words[:1] == ["usemtl"]:
            group = " ".join(words[1:])
        if not words or words[0] not in ("v", "f"):
            continue
        try:
            if words[0] == "v":
                point = [float(word) for word in words[1:4]]
            else:
                corners = [int(word.split("/")[0]) for word in words[1:]]
        except ValueError as error:
            raise InputFileError(
                f"{path}, line {number}: cannot read {line.strip()!r}; correct the line"
            ) from error
        if words[0] == "v":
            if len(point) != 3:
                raise InputFileError(
                    f"{path}, line {number}: a vertex has {len(point)} coordinates; give three"
                )
            vertices.append(point)
            continue
        facet = len(triangles) + 1
        if len(corners) != 3:
            raise InputFileError(
                f"{path}, line {number}: facet {facet} has {len(corners)} vertices, not 3; "
                "triangulate the mesh"
            )
        # OBJ counts from 1; negative numbers count backwards from the latest vertex
        indices = [c - 1 if c > 0 else len(vertices) + c for c in corners]
        if 0 in corners or min(indices) < 0:
            raise InputFileError(
                f"{path}, line {number}: facet {facet} names no known vertex; list it first"
            )
        triangles.append(indices)
        groups.append(group)
    array = np.array(triangles, dtype=np.int64).reshape(-1, 3)
    beyond = np.nonzero(array.max(axis=1, initial=-1) >= len(vertices))[0]
    if beyond.size:
        raise InputFileError(
            f"{path}: facet {beyond[0] + 1} names vertex {array[beyond[0]].max() + 1} of "
            f"{len(vertices)}; export the mesh again"
        )
    return np.array(vertices, dtype=float).reshape(-1, 3), array, tuple(groups)


def _read_stl(path: Path, content: bytes) -> tuple[Array, Indices, tuple[str, ...]]:
    """Vertices (3F, 3), not yet merged, triangles (F, 3) and empty groups of an STL file."""
    # Some binary files begin with "solid" too, so that only the length identifies them.
    count = int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    if count >= 0 and len(content) == 84 + 50 * count:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(content, record, count, offset=84)["corners"].astype(float)
    elif content.lstrip()[:5].lower() == b"solid":
        corners = _read_stl_text(path, content.decode("utf-8", errors="replace"))
    else:
        raise InputFileError(
            f"{path}: neither a text STL file nor a whole binary one ({len(content)} bytes; "
            f"{count} facets announced)"
        )
    count = corners.size // 9
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), ("",) * count


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
                raise InputFileError(
                    f"{path}, line {number}: cannot read {line.strip()!r}; correct the line"
                )
        elif words[:1] == ["endfacet"]:
            if len(loop) != 3:
                raise InputFileError(
                    f"{path}, line {number}: facet {len(corners) + 1} has {len(loop)} vertices, "
                    "not 3; triangulate the mesh"
                )
            corners.append(loop)
            loop = []
    if loop:
        raise InputFileError(
            f"{path}: the file ends within facet {len(corners) + 1}; get the complete file"
        )
    return np.array(corners, dtype=float).reshape(-1, 3, 3)
