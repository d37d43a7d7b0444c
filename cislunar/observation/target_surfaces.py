"""Shapes, materials and inertia of the targets, in the layout of the compiled kernels."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.inertia import inertia_matrix
from cislunar.compiled import njit
from cislunar.errors import ConfigurationError
from cislunar.photometry.bodies import Body, plain_body
from cislunar.photometry.law_mixture import COOK_TORRANCE
from cislunar.photometry.materials import TABULATED, Material, PhotometryModel
from cislunar.photometry.reflection.tables import (
    NO_TABLE,
    ReflectanceTable,
    load_reflectance_table,
)
from cislunar.photometry.shadows.table import Shadows, joined_shadows
from cislunar.photometry.shapes import Facets
from cislunar.runtime.arguments import Array, array_of, count_of, require_kind


class TargetSurfaces(NamedTuple):
    """Shapes, materials and inertia of the targets, in the layout of the compiled kernels.

    They are either the true ones or those that estimator and scheduler assume.

    Attributes
    ----------
    areas, normals : ndarray, shapes (facet,) and (facet, 3)
        Facet areas, m^2, and outward unit normals, body frame, of all targets one after the other.
    first, first_material : ndarray of int, shape (target + 1,)
        Target j owns the facets ``first[j] : first[j + 1]``, and likewise the materials.
    material : ndarray, shape (row, 5)
        Materials of all targets one after the other, see
        `cislunar.photometry.materials.Material.as_array`.
    irradiance_4pi, fresnel_sqrt : bool
        Law of irradiance and form of the Fresnel term, see `PhotometryModel`.
    inertia : ndarray, shape (target, 3, 3)
        Inertia matrices, body frame, in any unit: only ratios matter to torque-free motion.
    rows : ndarray of int, shape (facet,)
        Row of each facet among its target's materials.
    shadows : Shadows
        Shadows of all targets in one table.
    lengths : ndarray, shape (target, 3)
        Axis scales.
    composite, law : ndarray of bool and of int, shape (target,)
        See `cislunar.photometry.bodies.Body`.
    table : ReflectanceTable
        Table of the targets with a tabulated law.
    """

    areas: Array
    normals: Array
    first: NDArray[np.int64]
    material: Array
    irradiance_4pi: bool
    fresnel_sqrt: bool
    inertia: Array
    first_material: NDArray[np.int64]
    rows: NDArray[np.int64]
    shadows: Shadows
    lengths: Array
    composite: NDArray[np.bool_]
    law: NDArray[np.int64]
    table: ReflectanceTable = NO_TABLE


@njit(cache=True, error_model="numpy", inline="always")
def body_of(surfaces, j):
    """The `Body` of target j; its arrays are views."""
    facets = slice(surfaces.first[j], surfaces.first[j + 1])
    shared = surfaces.shadows
    return Body(
        surfaces.areas[facets],
        surfaces.normals[facets],
        surfaces.rows[facets],
        surfaces.material[surfaces.first_material[j] : surfaces.first_material[j + 1]],
        Shadows(
            shared.steps,
            shared.column[facets],
            shared.lookup,
            shared.masks,
            shared.shares,
            shared.settled,
        ),
        surfaces.lengths[j],
        surfaces.composite[j],
        surfaces.law[j],
        surfaces.table,
        False,
        COOK_TORRANCE,
    )


def target_surfaces(
    facets: Facets | Body | Sequence[Facets | Body],
    material: Material | Sequence[Material],
    n_targets: int,
    model: PhotometryModel | None = None,
    *,
    inertia: ArrayLike = 1.0,
) -> TargetSurfaces:
    """Lay out shapes, materials and inertia for the compiled kernels.

    Parameters
    ----------
    facets : Facets, Body or sequence of them
        One shape for all targets, or one for each; a `Body` has its own materials.
    material : Material or sequence of Material
        One surface for all targets, or one for each.
    n_targets : int
        Number of targets.
    model : PhotometryModel, optional
        Laws of irradiance and reflection. If omitted, light spreads as 1/r^2. The law as printed in
        the paper, `cislunar.photometry.materials.PRINTED`, makes targets 2.75 mag fainter.
    inertia : array_like, shape (), (3,), (3, 3) or (target, 3, 3)
        One for all targets (see `cislunar.attitude.inertia.inertia_matrix`), or a matrix for each;
        spherical if omitted.

    Returns
    -------
    TargetSurfaces

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, there is neither one for all targets nor one for each, an
        inertia is not physical, a body mixes reflection laws, or the bodies cannot be joined; see
        `joined_surfaces`.
    InputFileError
        If the table of the reflection law cannot be used.
    """
    n_targets = count_of("n_targets", n_targets)
    model = PhotometryModel() if model is None else model
    require_kind("model", model, PhotometryModel, "give a PhotometryModel of cislunar.photometry")
    remedy = "give Facets, such as icosahedron(), or a Body"
    shapes = _of_each("facets", facets, Facets | Body, n_targets, remedy)
    remedy = "give a Material of cislunar.photometry"
    surfaces = _of_each("material", material, Material, n_targets, remedy)
    given = array_of("inertia", inertia)
    inertias = list(given) if given.ndim == 3 else [given] * n_targets
    for key, entries in (("facets", shapes), ("material", surfaces), ("inertia", inertias)):
        if len(entries) != n_targets:
            raise ConfigurationError(
                f"{key}: {len(entries)} entries given for {n_targets} targets; give one for all, "
                "or one for each"
            )
    bodies = [
        shape if isinstance(shape, Body) else plain_body(shape, surface)
        for shape, surface in zip(shapes, surfaces, strict=True)
    ]
    for j, body in enumerate(bodies):
        if body.mixed:
            raise ConfigurationError(
                f"facets: the body of target {j} mixes reflection laws; give one with a single law"
            )
    law = np.array([model.law or body.law for body in bodies])
    tables = [load_reflectance_table(model.reflection)] if model.law == TABULATED else []
    return TargetSurfaces(
        np.concatenate([body.areas for body in bodies]),
        np.ascontiguousarray(np.concatenate([body.normals for body in bodies])),
        _starts([body.areas.size for body in bodies]),
        np.concatenate([body.materials for body in bodies]),
        model.irradiance_4pi,
        model.fresnel_sqrt,
        np.array([inertia_matrix(each) for each in inertias]),
        _starts([len(body.materials) for body in bodies]),
        np.concatenate([body.rows for body in bodies]),
        joined_shadows([body.shadows for body in bodies]),
        np.array([body.lengths for body in bodies]),
        np.array([body.composite for body in bodies]) | (law > 0),
        law,
        _common_table(tables or [body.table for body in bodies]),
    )


def _of_each(name: str, given: Any, kind: Any, n_targets: int, remedy: str) -> list[Any]:
    """The value of each target, given one for all or one for each."""
    if isinstance(given, kind):
        return [given] * n_targets
    require_kind(name, given, Iterable, remedy)
    found = list(given)
    for each in found:
        require_kind(name, each, kind, remedy)
    return found


def surfaces_of(surfaces: TargetSurfaces, targets: NDArray[np.int64]) -> TargetSurfaces:
    """Surfaces of some of the targets.

    Parameters
    ----------
    surfaces : TargetSurfaces
    targets : ndarray of int, shape (n,)
        Their indices, in the order of the result.
    """
    facets, first = _rows_of(surfaces.first, targets)
    materials, first_material = _rows_of(surfaces.first_material, targets)
    return surfaces._replace(
        areas=surfaces.areas[facets],
        normals=surfaces.normals[facets],
        first=first,
        material=surfaces.material[materials],
        inertia=surfaces.inertia[targets],
        first_material=first_material,
        rows=surfaces.rows[facets],
        shadows=surfaces.shadows._replace(column=surfaces.shadows.column[facets]),
        lengths=surfaces.lengths[targets],
        composite=surfaces.composite[targets],
        law=surfaces.law[targets],
    )


def joined_surfaces(parts: Sequence[TargetSurfaces]) -> TargetSurfaces:
    """Surfaces of the targets of several parts, one part after the other.

    Parameters
    ----------
    parts : sequence of TargetSurfaces

    Raises
    ------
    ConfigurationError
        If the parts have different readings of the reflection model, different tables of the
        reflection law, or shadow tables of different steps.
    """
    for key in ("irradiance_4pi", "fresnel_sqrt"):
        if len({bool(getattr(part, key)) for part in parts}) > 1:
            raise ConfigurationError(f"surfaces: {key} must be the same for all targets")
    joined = {
        key: np.concatenate([getattr(part, key) for part in parts])
        for key in ("areas", "normals", "material", "inertia", "rows", "lengths", "composite",
            "law")
    }  # fmt: skip
    return parts[0]._replace(
        **joined,
        first=_starts(np.concatenate([np.diff(part.first) for part in parts])),
        first_material=_starts(np.concatenate([np.diff(part.first_material) for part in parts])),
        shadows=joined_shadows([part.shadows for part in parts]),
        table=_common_table([part.table for part in parts]),
    )


def _common_table(tables: Sequence[ReflectanceTable]) -> ReflectanceTable:
    """The only table of a reflection law among those of bodies with and without one."""
    found = {id(each.values): each for each in tables if each.values.size}
    first, *others = found.values() or [NO_TABLE]
    if not all(np.array_equal(first.values, each.values) for each in others):
        raise ConfigurationError(
            "surfaces: the table of the reflection law must be the same for all targets"
        )
    return first


def _rows_of(first: NDArray[np.int64], targets: NDArray[np.int64]) -> tuple[NDArray, NDArray]:
    """Indices of the rows that some of the targets own, and the first of each target among these
    rows."""
    own = [np.arange(first[j], first[j + 1]) for j in targets]
    return np.concatenate([first[:0], *own]), _starts([each.size for each in own])


def _starts(counts: Sequence[int]) -> NDArray[np.int64]:
    """First index of each of several blocks of these lengths, and the end of the last one."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
