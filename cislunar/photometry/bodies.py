"""Bodies as the kernels see them: convex ones of one material, and all others.

Facets may shadow each other and differ in material. The facet sum is that of
`cislunar.photometry.facets`, with the area of each facet reduced to what is both lit and seen
(`cislunar.photometry.shadows`) and the material taken from the facet's row of a table. Light that a
facet throws on another is left out. `cislunar.photometry.body_blocks` has the kernels.

The lit and seen area is approximate: points stand for the area, and the table is interpolated.
Against rays to a thousand points of each facet, in 100 random pairs of directions, its error as a
share of the area that faces both is 0.11 % (box with wings), 0.23 % (dish on a bus) and 0.03 %
(upper stage) rms and 1.3 % at most. The error in magnitude is 0.002, 0.010 and 0.0005 rms, below
0.003, 0.018 and 0.001 in 95 of 100 pairs, and 0.05 at most; little is left to see where it is
large. Of a single square under another one it is 0.7 % of its area rms and 2.7 % at most; where
Sun and observer are nearer to each other than the spacing of the table, it is 1 % too dark.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.photometry.body_blocks import body_magnitudes
from cislunar.photometry.facet_blocks import (
    BLOCK_ROWS,
    LANES,
    QUATERNION,
    RANGE,
    SUN,
    TOTAL,
    VIEW,
)
from cislunar.photometry.facets import apparent_magnitude, broadcast_geometries
from cislunar.photometry.materials import Material, PhotometryModel, material_rows
from cislunar.photometry.meshes import Mesh
from cislunar.photometry.shadows.table import STEPS, Shadows, no_shadows, shadow_table
from cislunar.photometry.shapes import Facets, facets_from_triangles

Array = NDArray[np.float64]


class Body(NamedTuple):
    """A body as the kernels see it.

    Parameters
    ----------
    areas : ndarray, shape (F,)
        Facet areas, m^2.
    normals : ndarray, shape (F, 3)
        Outward unit normals, body frame.
    rows : ndarray of int, shape (F,)
        Row of each facet in `materials`.
    materials : ndarray, shape (M, 5)
        ``[d, s, rho, delta_rms, F0]``, see `cislunar.photometry.materials.Material`.
    shadows : Shadows
        Shadows of the facets on each other.
    lengths : ndarray, shape (3,)
        Of the body along its axes over those of the one the shadows were tabulated for.
    rough : bool
        Whether it has several materials, shadows or another law of reflection: false leaves it to
        the kernels of `cislunar.photometry.facet_blocks`.
    phong : bool
        Whether it reflects by Lambert's law and Phong's, see `cislunar.photometry.body_blocks`.
    """

    areas: Array
    normals: Array
    rows: NDArray[np.int64]
    materials: Array
    shadows: Shadows
    lengths: Array
    rough: bool = False
    phong: bool = False

    @property
    def facets(self) -> Facets:
        """The shape without its shadows."""
        return Facets(self.areas, self.normals)


def plain_body(facets: Facets, material: Material) -> Body:
    """A convex body of one material.

    Parameters
    ----------
    facets : Facets
        Shape.
    material : Material
        Surface.

    Returns
    -------
    Body
    """
    areas = np.ascontiguousarray(facets.areas, dtype=float)
    normals = np.ascontiguousarray(facets.normals, dtype=float)
    rows = np.zeros(areas.size, dtype=np.int64)
    shadows = no_shadows(areas.size)
    return Body(areas, normals, rows, material.as_array()[None], shadows, np.ones(3))


def build_body(
    mesh: Mesh,
    materials: Material | Mapping[str, Material],
    *,
    steps: int = STEPS,
    shadows: Shadows | None = None,
) -> Body:
    """Areas, materials and shadows of a mesh.

    Parameters
    ----------
    mesh : Mesh
        From `cislunar.photometry.mesh_files.load_mesh` or `cislunar.photometry.spacecraft`.
    materials : Material or mapping of str to Material
        One material for all facets, or one for each facet group.
    steps : int
        Steps of the shadow table from pole to equator.
    shadows : Shadows, optional
        The mesh's table, where it is there already.

    Returns
    -------
    Body

    Raises
    ------
    ConfigurationError
        If a facet's group has no material, a material is given for an unknown group, or `steps`
        is not positive.
    """
    if isinstance(materials, Material):
        materials = dict.fromkeys(mesh.groups, materials)
    facets = facets_from_triangles(mesh.vertices, mesh.triangles)
    rows, table = material_rows(mesh.source, mesh.groups, materials)
    shadows = shadow_table(mesh, steps) if shadows is None else shadows
    rough = shadows.steps > 0 or len(table) > 1
    return Body(facets.areas, facets.normals, rows, table, shadows, np.ones(3), rough)


def apparent_body_magnitude(
    quaternion: ArrayLike,
    sun_direction: ArrayLike,
    view_direction: ArrayLike,
    range_m: ArrayLike,
    body: Body,
    model: PhotometryModel | None = None,
    *,
    sun_magnitude: float = SUN_APPARENT_MAGNITUDE,
) -> Array:
    """Apparent magnitudes of a body over arrays.

    Parameters
    ----------
    quaternion : array_like, shape (..., 4)
        Attitudes, inertial to body, scalar last.
    sun_direction, view_direction : array_like, shape (..., 3)
        Unit vectors from the object to the Sun and to the observer, inertial frame.
    range_m : array_like, shape (...)
        Distances from the object to the observer, m.
    body : Body
        Shape and surface. A plain one is left to
        `cislunar.photometry.facets.apparent_magnitude`.
    model : PhotometryModel, optional
        Reading of the equations; 1/r^2 and Fresnel with the root if omitted.
    sun_magnitude : float
        Magnitude of the Sun in the sensor's band.

    Returns
    -------
    ndarray, shape (...)
        Magnitudes of the broadcast geometries; inf where nothing is both lit and seen.
    """
    geometry = quaternion, sun_direction, view_direction, range_m
    model = PhotometryModel() if model is None else model
    if not body.rough:
        material = Material(*map(float, body.materials[0]))
        return apparent_magnitude(
            *geometry, body.facets, material, model, sun_magnitude=sun_magnitude
        )
    shape, rows = broadcast_geometries(*geometry)
    returned = _light_thrown_back(*rows[:3], body, model.fresnel_sqrt).reshape(shape)
    spread = np.pi * np.broadcast_to(range_m, shape) ** 2
    if model.irradiance_4pi:
        spread = spread * 4.0 * np.pi
    with np.errstate(divide="ignore"):
        return sun_magnitude - 2.5 * np.log10(returned / spread)


@njit(cache=True, error_model="numpy")
def _light_thrown_back(quaternion, sun, view, body, fresnel_sqrt):
    """Sums over the facets of n geometries, arrays of n rows."""
    result, block = np.empty(quaternion.shape[0]), np.empty((BLOCK_ROWS, LANES))
    block[RANGE] = 1.0
    for first in range(0, result.size, LANES):
        count = min(LANES, result.size - first)
        for k in range(count):
            block[QUATERNION : QUATERNION + 4, k] = quaternion[first + k]
            block[SUN : SUN + 3, k], block[VIEW : VIEW + 3, k] = sun[first + k], view[first + k]
        body_magnitudes(block, count, body, False, fresnel_sqrt)
        result[first : first + count] = block[TOTAL, :count]
    return result
