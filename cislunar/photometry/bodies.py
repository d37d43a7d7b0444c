"""Bodies for the photometric kernels: convex ones of one material, and composite ones.

A composite body is non-convex or has several materials. Its facet sum is that of
`cislunar.photometry.facets`, with the area of each facet reduced to the part that is both lit and
seen (`cislunar.photometry.shadows`) and with a material per facet. Light that one facet throws on
another is neglected. `docs/bodies.md` has the accuracy of the lit and seen area.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import njit
from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.errors import ConfigurationError
from cislunar.photometry.body_blocks import body_magnitudes
from cislunar.photometry.facet_blocks import (
    BLOCK_ROWS,
    LANES,
    PHASE_ANGLE,
    QUATERNION,
    RANGE,
    SUN,
    TOTAL,
    VIEW,
)
from cislunar.photometry.facets import apparent_magnitude, broadcast_geometries
from cislunar.photometry.law_mixture import COOK_TORRANCE, phase_magnitude
from cislunar.photometry.materials import Material, PhotometryModel, material_of, material_rows
from cislunar.photometry.meshes import Mesh
from cislunar.photometry.reflection.tables import NO_TABLE, ReflectanceTable
from cislunar.photometry.shadows.table import STEPS, Shadows, no_shadows, shadow_table
from cislunar.photometry.shapes import Facets, facets_from_triangles
from cislunar.runtime import Array, require_kind


class Body(NamedTuple):
    """Areas, materials and shadows of a body, in the layout of the kernels.

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
        Lengths along the body axes relative to the body for which the shadows were tabulated.
    composite : bool
        Whether the body has several materials, shadows or another reflection law; otherwise the
        faster kernels of `cislunar.photometry.facet_blocks` are used.
    law : int
        Reflection law: place in `cislunar.photometry.materials.REFLECTION_LAWS`, or `TABULATED`.
        A body with another law than 0 is composite.
    table : ReflectanceTable
        Table of a tabulated law.
    mixed : bool
        Whether the reflection law deviates from Cook-Torrance by `mixture`; such a body is
        composite.
    mixture : tuple of float, length 4
        Share of the Lambert-Phong lobe, share of Lommel-Seeliger reflection, and the phase
        coefficients b1 (mag/rad) and b2 (mag/rad^2), see `cislunar.photometry.law_mixture`.
    """

    areas: Array
    normals: Array
    rows: NDArray[np.int64]
    materials: Array
    shadows: Shadows
    lengths: Array
    composite: bool = False
    law: int = 0
    table: ReflectanceTable = NO_TABLE
    mixed: bool = False
    mixture: tuple[float, float, float, float] = COOK_TORRANCE

    @property
    def facets(self) -> Facets:
        """The facets, without their shadows."""
        return Facets(self.areas, self.normals)


def plain_body(facets: Facets, material: Material) -> Body:
    """Body of one material and convex shape.

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
    """Body of a mesh: areas, materials and shadows.

    Parameters
    ----------
    mesh : Mesh
        From `cislunar.photometry.mesh_files.load_mesh` or `cislunar.photometry.spacecraft`.
    materials : Material or mapping of str to Material
        One material for all facets, or one for each facet group.
    steps : int
        Steps of the shadow table from pole to equator.
    shadows : Shadows, optional
        Shadow table of the mesh, if it has been computed already.

    Returns
    -------
    Body

    Raises
    ------
    ConfigurationError
        If a facet's group has no material, a material is given for an unknown group, or `steps` is
        not positive.
    """
    if isinstance(materials, Material):
        materials = dict.fromkeys(mesh.groups, materials)
    facets = facets_from_triangles(mesh.vertices, mesh.triangles)
    rows, table = material_rows(mesh.source, mesh.groups, materials)
    shadows = shadow_table(mesh, steps) if shadows is None else shadows
    composite = shadows.steps > 0 or len(table) > 1
    return Body(facets.areas, facets.normals, rows, table, shadows, np.ones(3), composite)


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
    quaternion, sun_direction, view_direction, range_m, model, sun_magnitude
        See `cislunar.photometry.facets.apparent_magnitude`.
    body : Body
        Shape and surface.

    Returns
    -------
    ndarray, shape (...)
        Magnitudes of the broadcast geometries; inf where nothing is both lit and seen.

    Raises
    ------
    ConfigurationError
        If an argument is impossible (see `cislunar.photometry.facets.apparent_magnitude`), or
        `model` has neither the default reflection law nor that of the body.
    """
    geometry = quaternion, sun_direction, view_direction, range_m
    model = PhotometryModel() if model is None else model
    require_kind("body", body, Body, "give a Body, such as plain_body(icosahedron(), Material())")
    if not body.composite:
        material = material_of(body.materials[0])
        return apparent_magnitude(
            *geometry, body.facets, material, model, sun_magnitude=sun_magnitude
        )
    if model.law not in (0, body.law):
        raise ConfigurationError(
            f"model.reflection = {model.reflection!r}: the body has another reflection law; use "
            "cislunar.observation.target_surfaces for other laws"
        )
    shape, rows = broadcast_geometries(*geometry)
    returned = _light_thrown_back(*rows[:3], body, model.fresnel_sqrt).reshape(shape)
    # a facet that is not known to be lit counts as dark in the kernels
    returned[
        ~np.all([np.isfinite(each).all(axis=1) for each in rows[:3]], axis=0).reshape(shape)
    ] = np.nan
    spread = np.pi * np.broadcast_to(range_m, shape) ** 2
    if model.irradiance_4pi:
        spread = spread * 4.0 * np.pi
    with np.errstate(divide="ignore"):
        return sun_magnitude - 2.5 * np.log10(returned / spread)


@njit(cache=True, error_model="numpy")
def _light_thrown_back(quaternion, sun, view, body, fresnel_sqrt):
    """Facet sums of n geometries, given as arrays of n rows."""
    result, block = np.empty(quaternion.shape[0]), np.empty((BLOCK_ROWS, LANES))
    block[RANGE] = 1.0
    for first in range(0, result.size, LANES):
        count = min(LANES, result.size - first)
        for k in range(count):
            block[QUATERNION : QUATERNION + 4, k] = quaternion[first + k]
            block[SUN : SUN + 3, k], block[VIEW : VIEW + 3, k] = sun[first + k], view[first + k]
        body_magnitudes(block, count, body, False, fresnel_sqrt)
        result[first : first + count] = block[TOTAL, :count]
        if body.mixed:
            for k in range(count):
                result[first + k] *= 10.0 ** (
                    -0.4 * phase_magnitude(block[PHASE_ANGLE, k], body.mixture)
                )
    return result
