"""Bodies as settings and tables specify them; nothing here needs compiled kernels.

A table of bodies is comma-separated, UTF-8, a target to a row:

===================  =========================================================================
column               contents
===================  =========================================================================
``target``           name of the target, or its number among the scenario's targets, from 0
``shape``            as the key ``task2.body.shape``; a file is relative to the working folder
``radius_m``         optional; empty keeps the size of the shape
``meters_per_unit``  optional; 1 if empty
``materials``        optional; see `cislunar.photometry.materials.group_materials`
``inertia_x``        optional, with ``inertia_y`` and ``inertia_z``: principal moments along the
                     body axes, any unit; empty keeps those of the settings
===================  =========================================================================

Other columns are ignored. Targets that are not in the table keep the body of the settings.
"""

import re
from collections.abc import Iterable, Sequence
from math import isfinite
from pathlib import Path
from typing import Annotated

from pydantic import Field, PrivateAttr

from cislunar.attitude.inertia import inertia_matrix
from cislunar.errors import CislunarError, InputFileError, placed
from cislunar.exchange.table_rows import named_rows, row_names
from cislunar.photometry.materials import Material, group_materials, material_rows
from cislunar.photometry.mesh_files import load_mesh
from cislunar.photometry.meshes import Mesh
from cislunar.photometry.shapes import facets_from_triangles, icosahedron_mesh
from cislunar.photometry.spacecraft import MODELS
from cislunar.runtime.settings_fields import Positive, Section, Text, ThreePositive, setting
from cislunar.runtime.settings_words import pattern

ICOSAHEDRON = "icosahedron"

_SMALLEST_M, _LARGEST_M = 0.01, 200.0
"""Radii of bodies, of equal area; a mesh beyond is in another unit."""


SHAPE = pattern(
    f"^({ICOSAHEDRON}|{'|'.join(MODELS)})$|[.]([oO][bB][jJ]|[sS][tT][lL])$",
    f"one of {', '.join((ICOSAHEDRON, *MODELS))}, or a file ending in .obj or .stl")  # fmt: skip
TABLE = pattern("[.][cC][sS][vV]$", "a file ending in .csv")


class BodySpec(Section):
    """Specification of the body of a target, or of all targets with a table of the exceptions."""

    # fmt: off

    omitted = ("materials", "table")

    shape: Annotated[str, Field(pattern=SHAPE)] = setting(
        "`icosahedron`, a model of docs/bodies.md, or a closed triangle mesh (`.obj`, `.stl`), "
        "whose facets may shadow each other", paper="icosahedron")
    radius_m: Positive | None = setting(
        "the shape is scaled to the surface area of a sphere of this radius; null: a model or a "
        "mesh file keeps its size", "m", 1)
    meters_per_unit: Positive = setting("length unit of the mesh file", "m", default=1)
    axis_scale: ThreePositive = setting(
        "axis scales: factors on the shape along its body axes, before it is scaled to `radius_m`; "
        "they also apply to the bodies of `table`",
        "1", default=[1, 1, 1])
    materials: Text | None = setting(
        "material of each facet group, `group=material; group=material`: `panel`, `foil`, `paint`, "
        "`material` (the key `material`) or its five numbers. null: a model has its own materials, "
        "any other shape `material`", default=None)
    table: Annotated[str, Field(pattern=TABLE)] | None = setting(
        "table of bodies with one target per row (docs/bodies.md). A target that is not in the "
        "table has the body of the other keys; so has every target for tasking", "path",
        default=None)
    inertia: ThreePositive | None = setting(
        "principal moments of inertia about the body axes, in any unit, since only their ratios "
        "matter to a free rotation; null: spherical", paper="spherical", default=None)

    # fmt: on

    _source: str = PrivateAttr("body")

    def __hash__(self) -> int:  # lists have no hash
        return hash(self.shape)

    @property
    def source(self) -> str:
        """Where it is specified, for messages."""
        return self._source

    def named(self, source: str) -> "BodySpec":
        """The same specification, from another source."""
        found = self.model_copy()
        found._source = source
        return found

    def mesh(self) -> Mesh:
        """The mesh in its own size, checked; see `cislunar.photometry.mesh_files.load_mesh`."""
        if self.shape == ICOSAHEDRON:
            vertices, triangles = icosahedron_mesh()
            return Mesh(ICOSAHEDRON, vertices, triangles, ("",) * len(triangles))
        if self.shape in MODELS:
            return MODELS[self.shape][0]()
        return load_mesh(self.shape, meters_per_unit=self.meters_per_unit)

    def surfaces(self, groups: Iterable[str], usual: Material) -> dict[str, Material]:
        """Material of each facet group; `usual` is that of a group without one."""
        if self.materials is not None:
            return group_materials(self.source, self.materials, usual)
        own = MODELS[self.shape][1] if self.shape in MODELS else None
        return dict.fromkeys(groups, usual) if own is None else own

    def check(self, usual: Material) -> None:
        """Raise InputFileError, with a message that begins with the source, if the body cannot be
        built: a faulty mesh, a facet without material, or an implausible size."""
        try:
            mesh = self.mesh()
            material_rows(mesh.source, mesh.groups, self.surfaces(mesh.groups, usual))
        except CislunarError as error:
            place = "" if str(error).startswith(self.source) else f"{self.source}: "
            raise InputFileError(f"{place}{error}") from None
        facets = facets_from_triangles(mesh.vertices, mesh.triangles)
        radius = self.radius_m or facets.equivalent_radius
        if not _SMALLEST_M <= radius <= _LARGEST_M:
            raise InputFileError(
                f"{self.source}: {self.shape} is as large as a sphere of {radius:.3g} m; "
                f"{_SMALLEST_M:g} to {_LARGEST_M:g} m can be meant: correct meters_per_unit or "
                "radius_m"
            )


def load_body_table(path: str | Path) -> dict[str, BodySpec]:
    """Read a table of bodies.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict of str to BodySpec
        By the targets' names or numbers.

    Raises
    ------
    InputFileError
        If the table is faulty; the message names the file and the row as an editor numbers it.
    """
    _, rows = named_rows(path, "target", "target", ("shape",))
    names = row_names(rows, "target", "target")
    return {name: _body_of_row(*each) for name, each in zip(names, rows, strict=True)}


def _number(place: str, column: str, text: str) -> float | None:
    """A positive number of a row; None if the field is empty."""
    try:
        value = float(text) if text else None
    except ValueError:
        value = 0.0
    if value is not None and not (value > 0.0 and isfinite(value)):
        raise InputFileError(f"{place}: {column} = {text!r} must be a number above 0")
    return value


def _inertia_of_row(place: str, row: dict[str, str]) -> tuple[float, float, float] | None:
    """Principal moments of a row; None if the row has none."""
    columns = ("inertia_x", "inertia_y", "inertia_z")
    x, y, z = (_number(place, column, row.get(column, "")) for column in columns)
    if x is None or y is None or z is None:
        if (x, y, z) != (None, None, None):
            raise InputFileError(f"{place}: give all of {', '.join(columns)}, or none")
        return None
    with placed(place, raised=InputFileError):
        inertia_matrix([x, y, z])
    return x, y, z


def _body_of_row(place: str, row: dict[str, str]) -> BodySpec:
    shape = row["shape"]
    if not re.search(SHAPE, shape):
        raise InputFileError(
            f"{place}: shape {shape!r} is none of {', '.join((ICOSAHEDRON, *MODELS))}, nor a file "
            "ending in .obj or .stl"
        )
    radius_m, meters_per_unit = (
        _number(place, column, row.get(column, "")) for column in ("radius_m", "meters_per_unit")
    )
    if shape == ICOSAHEDRON and radius_m is None:
        raise InputFileError(f"{place}: an icosahedron has no size of its own; give radius_m")
    return BodySpec(
        shape,
        radius_m,
        meters_per_unit or 1.0,
        materials=row.get("materials") or None,
        inertia=_inertia_of_row(place, row),
    ).named(place)


def bodies_of_targets(usual: BodySpec, names: Sequence[Sequence[str]]) -> list[BodySpec]:
    """The body of each target.

    Parameters
    ----------
    usual : BodySpec
        Body of a target that is not in its table, axis scales of all targets, and inertia of a
        target without one in the table.
    names : sequence of sequence of str
        Possible names of each target.

    Raises
    ------
    InputFileError
        If the table of bodies cannot be used; see `load_body_table`.
    """
    known = {} if usual.table is None else load_body_table(usual.table)
    scaled = {"axis_scale": usual.axis_scale}
    known = {
        name: body.model_copy(update=scaled | {"inertia": body.inertia or usual.inertia})
        for name, body in known.items()
    }
    return [next((known[name] for name in each if name in known), usual) for each in names]
