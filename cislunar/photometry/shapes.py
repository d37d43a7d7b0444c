"""Convex bodies of triangular facets: icosahedron, subdivided sphere, scaled bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError
from cislunar.runtime import Array
from cislunar.runtime.arguments import array_of, count_of, indices_of, number_of


@dataclass(frozen=True)
class Facets:
    """Facets of a convex body.

    Parameters
    ----------
    areas : ndarray, shape (F,)
        Facet areas, m^2.
    normals : ndarray, shape (F, 3)
        Outward unit normals, body frame.
    """

    areas: Array
    normals: Array

    @property
    def total_area(self) -> float:
        """Surface area, m^2."""
        return float(self.areas.sum())

    @property
    def equivalent_radius(self) -> float:
        """Radius of the sphere of the same surface area, m; tasking assumes such a sphere."""
        return float(np.sqrt(self.total_area / (4.0 * np.pi)))


def facets_from_triangles(vertices: ArrayLike, triangles: ArrayLike) -> Facets:
    """Areas and normals of triangles whose vertices run counter-clockwise seen from outside.

    Parameters
    ----------
    vertices : array_like, shape (n, 3)
        Vertices, m, body frame.
    triangles : array_like of int, shape (F, 3)
        Vertex indices of each facet.

    Returns
    -------
    Facets

    Raises
    ------
    ConfigurationError
        If an array has another shape, a vertex is not finite or does not exist, or a facet has no
        area.
    """
    places = array_of("vertices", vertices, ("vertex", 3))
    indices = indices_of("triangles", triangles, len(places))
    array_of("triangles", indices, ("facet", 3))
    corners = places[indices]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    if not np.all(length > 0.0):
        raise ConfigurationError(f"triangles: facet {np.argmin(length)} has no area; remove it")
    return Facets(areas=0.5 * length, normals=cross / length[:, None])


def scale_to_sphere(facets: Facets, radius_m: float) -> Facets:
    """The same shape, scaled to the surface area 4 pi R^2 of a sphere of radius `radius_m`, m.

    Raises
    ------
    ConfigurationError
        If the radius is not positive.
    """
    radius_m = number_of("shape radius_m", radius_m, positive=True)
    factor = 4.0 * np.pi * radius_m**2 / facets.total_area
    return Facets(areas=facets.areas * factor, normals=facets.normals)


def scale_axes(facets: Facets, factors: ArrayLike) -> Facets:
    """The body, scaled along its axes.

    The linear map M = diag(factors) takes the vector area A n of a facet to det(M) M^-T A n, so
    that the vertices are not needed. A convex body remains convex.

    Parameters
    ----------
    facets : Facets
        Shape.
    factors : array_like, shape (3,)
        Positive, one for each body axis.

    Returns
    -------
    Facets

    Raises
    ------
    ConfigurationError
        If the factors are not three positive numbers.
    """
    given = np.asarray(factors, dtype=float)
    if given.shape != (3,) or not np.all((given > 0.0) & np.isfinite(given)):
        raise ConfigurationError(
            f"shape axis_scale = {given.tolist()} must be three positive numbers"
        )
    if np.all(given == 1.0):
        return facets
    vectors = facets.areas[:, None] * facets.normals * (np.prod(given) / given)
    areas = np.linalg.norm(vectors, axis=1)
    return Facets(areas=areas, normals=vectors / areas[:, None])


def icosahedron_mesh() -> tuple[Array, NDArray[np.int64]]:
    """Vertices on the unit sphere, (12, 3), and outward triangles, (20, 3)."""
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    face = np.array([[0.0, s, t * golden] for s in (-1.0, 1.0) for t in (-1.0, 1.0)])
    vertices = np.concatenate([np.roll(face, shift, axis=1) for shift in range(3)])
    edge2 = 4.0
    triangles = []
    n = len(vertices)
    near = np.abs(((vertices[:, None] - vertices[None]) ** 2).sum(axis=-1) - edge2) < 1e-9
    for i in range(n):
        for j in range(i + 1, n):
            for k in range(j + 1, n):
                if near[i, j] and near[j, k] and near[i, k]:
                    outward = np.linalg.det(vertices[[i, j, k]]) > 0.0
                    triangles.append((i, j, k) if outward else (i, k, j))
    return vertices / np.sqrt(1.0 + golden**2), np.array(triangles)


def _subdivide(vertices: Array, triangles: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Split each triangle into four and move the new vertices onto the unit sphere."""
    corners = vertices[triangles]
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
    middles /= np.linalg.norm(middles, axis=-1, keepdims=True)
    a, b, c = (corners[:, i] for i in range(3))
    ab, bc, ca = (middles[:, i] for i in range(3))
    split = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    finer = np.concatenate([np.stack(triangle, axis=1) for triangle in split])
    return finer.reshape(-1, 3), np.arange(3 * len(finer)).reshape(-1, 3)


def icosphere(subdivisions: int = 0, radius_m: float = 1.0) -> Facets:
    """Icosahedron with each facet split into four `subdivisions` times, on a sphere.

    Parameters
    ----------
    subdivisions : int
        0 (the icosahedron) to 8; the body has 20 * 4^subdivisions facets.
    radius_m : float
        R of the equivalent sphere: the surface area is 4 pi R^2, m.

    Returns
    -------
    Facets
        Vertices of the icosahedron at cyclic permutations of ``(0, +-1, +-golden ratio)``, scaled.

    Raises
    ------
    ConfigurationError
        If `subdivisions` is not a whole number from 0 to 8, or the radius is not positive.
    """
    count_of("icosphere subdivisions", subdivisions, 0, 8)
    vertices, triangles = icosahedron_mesh()
    for _ in range(subdivisions):
        vertices, triangles = _subdivide(vertices, triangles)
    return scale_to_sphere(facets_from_triangles(vertices, triangles), radius_m)


def icosahedron(radius_m: float = 1.0) -> Facets:
    """Regular icosahedron with the surface area of a sphere, the targets' shape in the paper.

    Parameters
    ----------
    radius_m : float
        Radius of that sphere, m; each of the 20 facets has 0.6283 m^2 for a radius of 1 m.

    Returns
    -------
    Facets

    Raises
    ------
    ConfigurationError
        If the radius is not positive.
    """
    return icosphere(0, radius_m)
