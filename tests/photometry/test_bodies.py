"""Bodies that shadow themselves: against ray casting, closed forms and the convex kernel."""

import numpy as np
import pytest
from numba import njit
from oracles.ray_cast import cast_shares, random_points

from cislunar.attitude.quaternion import normalize
from cislunar.errors import ConfigurationError
from cislunar.observation.scene import target_surfaces
from cislunar.photometry import spacecraft
from cislunar.photometry.bodies import (
    Body,
    apparent_body_magnitude,
    body_irradiance,
    body_magnitude,
    build_body,
    convex_facets,
    is_plain,
)
from cislunar.photometry.facets import FLOOR_MAGNITUDE, apparent_magnitude, facet_irradiance
from cislunar.photometry.materials import FOIL, PAINT, PANEL, Material
from cislunar.photometry.meshes import closed_mesh
from cislunar.photometry.shadows import (
    shadowing_pairs,
    share_lit_and_seen,
    table_corners,
    table_directions,
)
from cislunar.photometry.shapes import facets_from_triangles

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])
MATTE = Material(diffuse_weight=1.0, specular_weight=0.0, diffuse_albedo=1.0)
MODELS = {
    "box_with_wings": spacecraft.box_with_wings(wing_turn=0.4),
    "dish_on_bus": spacecraft.dish_on_bus(segments=8),
    "upper_stage": spacecraft.upper_stage(segments=6),
}


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def box(size, center, group):
    """Vertices, triangles and groups of one box, faces in the order -x, +x, -y, +y, -z, +z."""
    vertices = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]
    return 0.5 * vertices * size + center, np.array(triangles), (group,) * 12


def boxes(*parts):
    vertices, triangles, groups = zip(*(box(*part) for part in parts), strict=True)
    shifted = [each + 8 * k for k, each in enumerate(triangles)]
    return closed_mesh("boxes", np.concatenate(vertices), np.concatenate(shifted), sum(groups, ()))


CUBE = boxes(((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), "bus"))
HEIGHT = 0.7
PLATES = boxes(
    ((1.0, 1.0, 1e-4), (0.0, 0.0, -5e-5), "low"),
    ((1.0, 1.0, 1e-4), (0.0, 0.0, HEIGHT + 5e-5), "high"),
)


@njit
def table_shares(body, sun, view):
    """Share of each facet lit and seen, as the kernel sums it."""
    n = body.areas.shape[0]
    shares = np.zeros(n)
    light = table_corners(sun[0], sun[1], sun[2], body.shadows.steps)
    sight = table_corners(view[0], view[1], view[2], body.shadows.steps)
    for i in range(n):
        if np.dot(body.normals[i], sun) > 0.0 and np.dot(body.normals[i], view) > 0.0:
            column = body.shadows.column[i]
            shares[i] = 1.0
            if column >= 0:
                table = body.shadows
                shares[i] = share_lit_and_seen(
                    column, light, sight, table.lookup, table.masks, table.shares
                )
    return shares


@pytest.fixture(scope="module")
def bodies():
    """The three models as bodies."""
    return {name: build_body(mesh, spacecraft.SURFACES[name]) for name, mesh in MODELS.items()}


@pytest.fixture(scope="module")
def plates():
    return build_body(PLATES, MATTE)


def free_of_plate(*shifts):
    """Area of the unit square outside of copies of it moved by the shifts."""
    grid = (np.arange(400) + 0.5) / 400
    x, y = np.meshgrid(grid, grid)
    hidden = [(x > a) & (x < 1 + a) & (y > b) & (y < 1 + b) for a, b in shifts]
    return 1.0 - np.mean(np.logical_or.reduce(hidden))


def test_plate_above_plate(plates):
    """The shadow of a plate is the plate, moved by its height times the slope of the light."""
    errors, alone = [], []
    rng = np.random.default_rng(0)
    for _ in range(100):
        sun, view = rng.normal(size=(2, 3)) * [1.0, 1.0, 0.5] + [0.0, 0.0, 1.0]
        sun, view = unit(np.abs([sun, view]) * np.sign([sun, view]) ** [1, 1, 2])
        shares = table_shares(plates, sun, view)
        np.testing.assert_array_equal(shares[22:24], 1.0)  # nothing is above the upper plate
        a, b = (-HEIGHT * d[:2] / d[2] for d in (sun, view))
        errors.append(shares[10:12].mean() - free_of_plate(a, b))
        exact = 1.0 - np.prod(np.maximum(1.0 - abs(a), 0.0))
        alone.append(table_shares(plates, sun, sun)[10:12].mean() - exact)
    assert np.sqrt(np.mean(np.square(errors))) < 0.009
    assert abs(np.mean(errors)) < 0.002
    assert np.max(np.abs(errors)) < 0.03
    assert -0.015 < np.mean(alone) < 0.0  # too dark where Sun and observer coincide
    assert np.max(np.abs(alone)) < 0.045


def test_light_from_straight_above_leaves_the_lower_plate_dark(plates):
    up = np.array([0.0, 0.0, 1.0])
    shares = table_shares(plates, up, up)
    assert np.all(shares[10:12] == 0.0)
    flux = body_irradiance(IDENTITY, up, up, 1.0, plates, False, True)
    assert flux == pytest.approx(1.0 / np.pi, rel=1e-14)  # one matte square metre alone


@pytest.mark.parametrize("name", MODELS)
def test_models_against_rays(bodies, name):
    """Errors of the lit and seen share of the surface, and of the magnitude."""
    body, mesh = bodies[name], MODELS[name]
    corners = mesh.vertices[mesh.triangles]
    points = random_points(1000)
    directions = unit(np.random.default_rng(8).normal(size=(40, 2, 3)))
    shared, magnitudes = [], []
    for sun, view in directions:
        expected = cast_shares(corners, body.normals, sun, view, points)
        facing = body.areas * ((body.normals @ sun > 0.0) & (body.normals @ view > 0.0))
        made = table_shares(body, sun, view)
        shared.append((made - expected) @ facing / max(facing.sum(), 1e-9))
        # Without a shadow table, areas reduced by the rays are what the kernel should sum.
        free = body.shadows._replace(steps=0, column=np.full_like(body.shadows.column, -1))
        cast = body._replace(areas=body.areas * expected, shadows=free)
        one, two = (
            body_magnitude(IDENTITY, sun, view, 1e7, each, True, True) for each in (body, cast)
        )
        magnitudes.append(abs(one - two))
    assert np.sqrt(np.mean(np.square(shared))) < 0.006
    assert np.quantile(magnitudes, 0.9) < 0.04
    assert np.median(magnitudes) < 0.01


def test_shadows_matter(bodies):
    """Rays that agree with a kernel without shadows would test nothing."""
    rng = np.random.default_rng(8)
    geometry = normalize(rng.normal(size=(300, 4))), *unit(rng.normal(size=(2, 300, 3))), 1e7
    for body in bodies.values():
        free = body.shadows._replace(steps=0, column=np.full_like(body.shadows.column, -1))
        dark = apparent_body_magnitude(*geometry, body)
        bright = apparent_body_magnitude(*geometry, body._replace(shadows=free))
        both = np.isfinite(dark) & np.isfinite(bright)
        assert (dark[both] - bright[both]).min() > -1e-9
        assert (dark[both] - bright[both]).max() > 0.05


def test_sun_and_observer_change_places(bodies):
    sun, view = unit(np.random.default_rng(2).normal(size=(2, 50, 3)))
    for body in bodies.values():
        one = apparent_body_magnitude(IDENTITY, sun, view, 1e7, body)
        np.testing.assert_allclose(
            one, apparent_body_magnitude(IDENTITY, view, sun, 1e7, body), rtol=1e-12
        )


def test_table_interpolates_linearly_on_the_octahedron():
    """Directions are weighted means of their three neighbors there, over the whole sphere."""
    nodes = table_directions(8)
    nodes /= abs(nodes).sum(axis=1, keepdims=True)
    directions = unit(np.random.default_rng(1).normal(size=(2000, 3)))
    edges = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [1, 1, 0], [-1, 0, 1]])
    for direction in [*directions, *unit(edges.astype(float)), *unit(nodes)]:
        rows, weights = table_corners(*direction, 8)
        assert min(weights) >= 0.0
        assert sum(weights) == pytest.approx(1.0, abs=1e-14)
        on_face = direction / abs(direction).sum()
        np.testing.assert_allclose(weights @ nodes[list(rows)], on_face, atol=2e-12)


def test_convex_body_of_one_material_is_left_to_the_convex_kernel():
    assert not shadowing_pairs(CUBE).any()
    body = build_body(CUBE, FOIL)
    assert is_plain(body)
    facets, material = convex_facets(body)
    assert material == FOIL
    rng = np.random.default_rng(0)
    quaternions = normalize(rng.normal(size=(200, 4)))
    sun, view = unit(rng.normal(size=(2, 200, 3)))
    np.testing.assert_array_equal(
        apparent_body_magnitude(quaternions, sun, view, 1e7, body),
        apparent_magnitude(quaternions, sun, view, 1e7, facets, material),
    )
    for q, s, v in zip(quaternions, sun, view, strict=True):
        plain = facet_irradiance(
            q, s, v, 1e7, body.areas, body.normals, body.materials[0], True, True
        )
        assert body_irradiance(q, s, v, 1e7, body, True, True) == plain


def test_materials_of_groups_add_up():
    mesh = CUBE._replace(groups=("bus",) * 6 + ("cells",) * 6)
    body = build_body(mesh, {"bus": FOIL, "cells": PANEL})
    assert len(body.materials) == 2
    facets = facets_from_triangles(mesh.vertices, mesh.triangles)
    for sun, view in unit(np.random.default_rng(4).normal(size=(50, 2, 3))):
        parts = [
            facet_irradiance(
                IDENTITY, sun, view, 1e7, facets.areas[part], facets.normals[part],
                material.as_array(), True, True,
            )
            for part, material in ((slice(6), FOIL), (slice(6, 12), PANEL))
        ]  # fmt: skip
        both = body_irradiance(IDENTITY, sun, view, 1e7, body, True, True)
        assert both == pytest.approx(sum(parts), rel=1e-13)


def test_same_material_twice_is_one_row():
    mesh = CUBE._replace(groups=("bus",) * 6 + ("cells",) * 6)
    assert is_plain(build_body(mesh, {"bus": PAINT, "cells": PAINT}))


def test_dark_body_is_at_the_floor(plates):
    up = np.array([0.0, 0.0, 1.0])
    assert body_magnitude(IDENTITY, up, -up, 1e7, plates, True, True) == FLOOR_MAGNITUDE
    assert apparent_body_magnitude(IDENTITY, up, -up, 1e7, plates) == np.inf


@pytest.mark.parametrize(
    ("groups", "materials", "message"),
    [
        (("bus",) * 11 + ("wing",), {"bus": FOIL}, "boxes: facet 12, of group 'wing', has no mat"),
        (("bus",) * 11 + ("",), {"bus": FOIL}, "boxes: facet 12, of no group, has no material"),
        (("bus",) * 12, {"bus": FOIL, "dish": FOIL}, "no facet belongs to group 'dish'"),
        (("bus",) * 12, {}, "facet 1, of group 'bus', has no material"),
    ],
)
def test_unusable_materials(groups, materials, message):
    with pytest.raises(ConfigurationError, match=message) as error:
        build_body(CUBE._replace(groups=groups), materials)
    assert "\n" not in str(error.value)


def test_estimators_refuse_what_has_no_derivatives(plates):
    with pytest.raises(ConfigurationError, match="no derivatives"):
        convex_facets(plates)
    for given in (plates, [plates, plates]):
        with pytest.raises(ConfigurationError, match="no derivatives"):
            target_surfaces(given, Material(), 2)
    assert isinstance(plates, Body)


def test_models_have_the_dimensions_they_are_made_from():
    wings = spacecraft.box_with_wings()
    np.testing.assert_allclose(np.ptp(wings.vertices, axis=0), [2.7, 14.67, 1.1])
    facets = facets_from_triangles(wings.vertices, wings.triangles)
    cells = np.array(wings.groups) == "cells"
    assert facets.areas[cells].sum() == pytest.approx(10.0)
    np.testing.assert_allclose(facets.normals[cells], [[1.0, 0.0, 0.0]] * cells.sum())
    turned = spacecraft.box_with_wings(wing_turn=np.pi / 2)
    normals = facets_from_triangles(turned.vertices, turned.triangles).normals[cells]
    np.testing.assert_allclose(normals, [[0.0, 0.0, -1.0]] * cells.sum(), atol=1e-12)
    np.testing.assert_allclose(np.ptp(spacecraft.dish_on_bus().vertices, axis=0)[:2], 4.2)
    stage = spacecraft.upper_stage()
    np.testing.assert_allclose(np.ptp(stage.vertices, axis=0), [3.05, 3.05, 12.68])
    for name, mesh in MODELS.items():
        assert set(mesh.groups) == set(spacecraft.SURFACES[name])
        facets = facets_from_triangles(mesh.vertices, mesh.triangles)
        np.testing.assert_allclose(facets.areas @ facets.normals, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: spacecraft.box_with_wings(span=11.0), "run into a box"),
        (lambda: spacecraft.box_with_wings(thickness=0.0), "must be positive"),
        (lambda: spacecraft.dish_on_bus(diameter=np.nan), "must be positive"),
        (lambda: spacecraft.upper_stage(length=3.0), "longer than the stage"),
        (lambda: spacecraft.upper_stage(segments=2), "3 segments"),
        (lambda: build_body(PLATES, MATTE, steps=0), "steps = 0"),
    ],
)
def test_impossible_models(make, message):
    with pytest.raises(ConfigurationError, match=message):
        make()
