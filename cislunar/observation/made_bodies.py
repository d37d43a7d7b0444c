"""Bodies of targets made as they are asked for, with their shadows."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from cislunar.observation.wanted_bodies import WantedBody
from cislunar.photometry.bodies import Body, build_body
from cislunar.photometry.materials import Material, PhotometryModel
from cislunar.photometry.meshes import Mesh
from cislunar.photometry.shadows.table import Shadows, shadow_table
from cislunar.photometry.shapes import scale_to_sphere, stretch
from cislunar.photometry.sphere import equal_sphere_coefficient


def made_body(wanted: WantedBody, usual: Material) -> Body:
    """A body as it is asked for.

    Parameters
    ----------
    wanted : WantedBody
        Shape, size and materials.
    usual : Material
        Of what the body says nothing of.

    Returns
    -------
    Body
        Bodies of one shape share one table of shadows, whatever their size, stretch and materials.

    Raises
    ------
    InputFileError, ConfigurationError
        As of `WantedBody.check`.
    """
    path = Path(wanted.shape)
    changed = path.stat().st_mtime_ns if path.suffix and path.is_file() else 0
    mesh, shadows = _tabulated(wanted.shape, wanted.metres_per_unit, changed)
    body = build_body(mesh, wanted.surfaces(mesh, usual), shadows=shadows)
    facets = body.facets
    if wanted.radius_m is not None:
        facets = scale_to_sphere(facets, wanted.radius_m)
    stretched = stretch(facets, wanted.stretch)
    if stretched is not facets and wanted.radius_m is not None:
        stretched = scale_to_sphere(stretched, wanted.radius_m)
    lengths = np.array(wanted.stretch, dtype=float)
    return body._replace(areas=stretched.areas, normals=stretched.normals, lengths=lengths)


@lru_cache(maxsize=256)
def _tabulated(shape: str, metres_per_unit: float, _changed: int) -> tuple[Mesh, Shadows]:
    """Mesh and shadows of a shape in its own size; `_changed` is when its file was."""
    mesh = WantedBody(shape, None, metres_per_unit).mesh()
    return mesh, shadow_table(mesh)


def equal_sphere_of(body: Body, model: PhotometryModel) -> tuple[float, float]:
    """Radius and C_d of the diffuse sphere that is as bright as a body, but for its shadows.

    Parameters
    ----------
    body : Body
        Any.
    model : PhotometryModel
        As of `cislunar.photometry.sphere.equal_sphere_coefficient`.

    Returns
    -------
    radius_m : float
        That of a sphere of the same area, m.
    coefficient : float
        Mean over the area of those of the materials.
    """
    each = [equal_sphere_coefficient(Material(*map(float, row)), model) for row in body.materials]
    mean = np.average(np.array(each)[body.rows], weights=body.areas) if len(each) > 1 else each[0]
    return body.facets.equivalent_radius, float(mean)
