"""Bodies of targets built from their specification, with their shadows."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from cislunar.observation.body_spec import BodySpec
from cislunar.photometry.bodies import Body, build_body
from cislunar.photometry.materials import Material, PhotometryModel, material_of
from cislunar.photometry.meshes import Mesh
from cislunar.photometry.shadows.table import Shadows, shadow_table
from cislunar.photometry.shapes import scale_axes, scale_to_sphere
from cislunar.photometry.sphere import equal_sphere_coefficient


def body_from_spec(spec: BodySpec, usual: Material) -> Body:
    """Build a body from its specification.

    Parameters
    ----------
    spec : BodySpec
        Shape, size and materials.
    usual : Material
        Material of facets for which the specification has none.

    Returns
    -------
    Body
        Bodies of one shape share one table of shadows, whatever their size, axis scale and
        materials.

    Raises
    ------
    ConfigurationError
        If a facet has no material, or a material is given for an unknown group.
    InputFileError
        If the mesh or the text of the materials cannot be used.
    """
    path = Path(spec.shape)
    changed = path.stat().st_mtime_ns if path.suffix and path.is_file() else 0
    mesh, shadows = _tabulated(spec.shape, spec.meters_per_unit, changed)
    body = build_body(mesh, spec.surfaces(mesh.groups, usual), shadows=shadows)
    facets = body.facets
    if spec.radius_m is not None:
        facets = scale_to_sphere(facets, spec.radius_m)
    scaled = scale_axes(facets, spec.axis_scale)
    if scaled is not facets and spec.radius_m is not None:
        scaled = scale_to_sphere(scaled, spec.radius_m)
    lengths = np.array(spec.axis_scale, dtype=float)
    return body._replace(areas=scaled.areas, normals=scaled.normals, lengths=lengths)


@lru_cache(maxsize=256)
def _tabulated(shape: str, meters_per_unit: float, _changed: int) -> tuple[Mesh, Shadows]:
    """Mesh and shadows of a shape in its own size; the cache depends on the time of its file,
    `_changed`."""
    mesh = BodySpec(shape, None, meters_per_unit).mesh()
    return mesh, shadow_table(mesh)


def equal_sphere_of(body: Body, model: PhotometryModel) -> tuple[float, float]:
    """Diffuse sphere that is as bright as a body, apart from its shadows.

    Parameters
    ----------
    body : Body
    model : PhotometryModel
        See `cislunar.photometry.sphere.equal_sphere_coefficient`.

    Returns
    -------
    radius_m, coefficient : float
        Radius of the sphere of the same area, m; C_d, the area-weighted mean over the materials.

    Raises
    ------
    InputFileError
        If the table of the reflection law cannot be used.
    """
    each = [equal_sphere_coefficient(material_of(row), model) for row in body.materials]
    mean = np.average(np.array(each)[body.rows], weights=body.areas) if len(each) > 1 else each[0]
    return body.facets.equivalent_radius, float(mean)
