"""Non-convex bodies against ray casting, closed forms and the convex kernel."""

import numpy as np
import pytest
from numba import njit
from oracles.geometries import geometries, unit
from oracles.ray_cast import cast_shares, random_points
from oracles.reflection import TRILINEAR

from cislunar.attitude.quaternion import attitude_matrix, compose, from_rotation_vector
from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.errors import ConfigurationError
from cislunar.observation.target_surfaces import body_of, target_surfaces
from cislunar.photometry import spacecraft
from cislunar.photometry.bodies import (
    Body,
    apparent_body_magnitude,
    build_body,
    plain_body,
)
from cislunar.photometry.body_blocks import (
    body_magnitude,
    body_magnitude_derivatives,
    body_magnitude_deviations,
    body_magnitude_gradients,
)
from cislunar.photometry.facet_blocks import (
    BLOCK_ROWS,
    LANES,
    MAGNITUDE,
    QUATERNION,
    RANGE,
    SUN,
    TURN,
    VIEW,
)
from cislunar.photometry.facets import (
    FLOOR_MAGNITUDE,
    IRRADIANCE_FLOOR,
    apparent_magnitude,
    facet_irradiance,
)
from cislunar.photometry.materials import (
    ALBEDO,
    AXIS_SCALE,
    FACET,
    FOIL,
    PAINT,
    PANEL,
    PHASE_CURVATURE,
    PHONG_SHARE,
    PRINTED,
    REFLECTANCE,
    REFLECTION_LAWS,
    SCALE,
    SHARE,
    SLOPE,
    Material,
    PhotometryModel,
)
from cislunar.photometry.meshes import closed_mesh
from cislunar.photometry.parameter_deviations import deviation_rows, perturbed_body
from cislunar.photometry.shadows.blocks import lit_and_seen
from cislunar.photometry.shadows.table import (
    no_shadows,
    shadowing_pairs,
    table_corners,
    table_directions,
)
from cislunar.photometry.shapes import facets_from_triangles, icosahedron
from cislunar.photometry.sphere import returned_light

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])
MATTE = Material(diffuse_weight=1.0, specular_weight=0.0, diffuse_albedo=1.0)
MODELS = {
    "box_with_wings": spacecraft.box_with_wings(wing_turn=0.4),
    "dish_on_bus": spacecraft.dish_on_bus(segments=8),
    "upper_stage": spacecraft.upper_stage(segments=6),
}


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
    """Share of each facet lit and seen, one by one from the table."""
    n, table = body.areas.shape[0], body.shadows
    shares = np.zeros(n)
    (i0, i1, i2), light, _ = table_corners(sun[0], sun[1], sun[2], table.steps)
    (j0, j1, j2), sight, _ = table_corners(view[0], view[1], view[2], table.steps)
    for i in range(n):
        if np.dot(body.normals[i], sun) > 0.0 and np.dot(body.normals[i], view) > 0.0:
            c = table.column[i]
            shares[i] = 1.0
            if c >= 0:
                lit = table.lookup[i0, c], table.lookup[i1, c], table.lookup[i2, c]
                seen = table.lookup[j0, c], table.lookup[j1, c], table.lookup[j2, c]
                found = lit_and_seen(lit, light, seen, sight, table.masks, table.shares)
                shares[i] = found[0]
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
    assert -0.015 < np.mean(alone) < 0.0  # too faint where Sun and observer coincide
    assert np.max(np.abs(alone)) < 0.045


def test_light_from_above_leaves_the_lower_plate_in_shadow(plates):
    up = np.array([0.0, 0.0, 1.0])
    shares = table_shares(plates, up, up)
    assert np.all(shares[10:12] == 0.0)
    magnitude = apparent_body_magnitude(IDENTITY, up, up, 1.0, plates, sun_magnitude=0.0)
    assert 10.0 ** (-0.4 * magnitude) == pytest.approx(1.0 / np.pi)  # one matte square meter alone


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
        free = no_shadows(body.areas.size)
        cast = body._replace(areas=body.areas * expected, shadows=free)
        one, two = (
            body_magnitude(IDENTITY, sun, view, 1e7, each, True, True) for each in (body, cast)
        )
        magnitudes.append(abs(one - two))
    assert np.sqrt(np.mean(np.square(shared))) < 0.006
    assert np.quantile(magnitudes, 0.9) < 0.04
    assert np.median(magnitudes) < 0.01


def test_shadows_matter(bodies):
    """Shadows change magnitudes, so that the comparison with rays is a test."""
    geometry = *geometries(300, 8), 1e7
    for body in bodies.values():
        free = no_shadows(body.areas.size)
        dark = apparent_body_magnitude(*geometry, body)
        bright = apparent_body_magnitude(*geometry, body._replace(shadows=free))
        both = np.isfinite(dark) & np.isfinite(bright)
        assert (dark[both] - bright[both]).min() > -1e-9
        assert (dark[both] - bright[both]).max() > 0.05


def test_sun_and_observer_are_interchangeable(bodies):
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
        rows, weights, _ = table_corners(*direction, 8)
        assert min(weights) >= 0.0
        assert sum(weights) == pytest.approx(1.0, abs=1e-14)
        on_face = direction / abs(direction).sum()
        np.testing.assert_allclose(weights @ nodes[list(rows)], on_face, atol=2e-12)


def test_convex_body_of_one_material_uses_the_convex_kernel():
    assert not shadowing_pairs(CUBE).any()
    body = build_body(CUBE, FOIL)
    assert not body.composite
    geometry = *geometries(200), 1e7
    expected = apparent_magnitude(*geometry, body.facets, FOIL)
    np.testing.assert_array_equal(apparent_body_magnitude(*geometry, body), expected)
    composite = apparent_body_magnitude(*geometry, body._replace(composite=True))
    np.testing.assert_allclose(composite, expected, atol=1e-12)


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
        both = body_magnitude(IDENTITY, sun, view, 1e7, body, True, True)
        expected = SUN_APPARENT_MAGNITUDE - 2.5 * np.log10(max(sum(parts), IRRADIANCE_FLOOR))
        assert both == pytest.approx(expected, abs=1e-11)


def test_same_material_twice_is_one_row():
    mesh = CUBE._replace(groups=("bus",) * 6 + ("cells",) * 6)
    assert not build_body(mesh, {"bus": PAINT, "cells": PAINT}).composite


def test_unlit_body_has_the_floor_magnitude(plates):
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


def filled(quaternion, sun, view):
    """A block of geometries."""
    block = np.zeros((BLOCK_ROWS, LANES))
    for row, each in ((QUATERNION, quaternion), (SUN, sun), (VIEW, view)):
        block[row : row + each.shape[1]] = each.T
    block[RANGE] = 1e7
    return block


def triangles(body, quaternion, *directions):
    """Triangles of the table that contain directions, and the facets that face them."""
    found = []
    for number, q in enumerate(quaternion):
        inside = [attitude_matrix(q) @ each[number] for each in directions]
        reached = [tuple(body.normals @ each > 0.0) for each in inside]
        steps = body.shadows.steps
        found.append((reached, [table_corners(*d / body.lengths, steps)[2] for d in inside]))
    return found


def alike(these, those):
    return np.array([a == b for a, b in zip(these, those, strict=True)])


def turned(quaternion, turn):
    return compose(from_rotation_vector(turn), quaternion)


VARIED = {
    "shadows and materials": lambda body: body,
    "axis scales": lambda body: perturbed_body(
        np.array([AXIS_SCALE, AXIS_SCALE + 2]), np.array([0.2, -0.3]), body
    ),
    **{
        name: lambda body, law=law: body._replace(law=law, table=TRILINEAR)
        for law, name in enumerate([*REFLECTION_LAWS, "tabulated"])
        if law > 0
    },
}


@pytest.mark.parametrize("varied", VARIED)
@pytest.mark.parametrize("name", ["box_with_wings", "dish_on_bus"])
def test_derivatives_by_a_turn_against_differences(bodies, name, varied):
    """Away from the edges of facets and of the table, where the derivative is one-sided."""
    body = VARIED[varied](bodies[name])
    quaternion, sun, view = geometries(LANES, 5)
    block = filled(quaternion, sun, view)
    body_magnitude_gradients(block, LANES, body, True, True)
    bright, h = block[MAGNITUDE] < FLOOR_MAGNITUDE, 1e-6
    for c in range(3):
        step = h * np.eye(3)[c]
        ends = [turned(quaternion, side * step) for side in (1.0, -1.0)]
        smooth = bright & alike(*(triangles(body, q, sun, view) for q in ends))
        values = [apparent_body_magnitude(q, sun, view, 1e7, body, PRINTED) for q in ends]
        slope = (values[0] - values[1])[smooth] / (2.0 * h)
        assert smooth.sum() > 20
        np.testing.assert_allclose(block[TURN + c][smooth], slope, rtol=2e-6, atol=2e-6)


LAWS = np.arange(PHONG_SHARE, PHASE_CURVATURE + 1)


@pytest.mark.parametrize("law", [*range(len(REFLECTION_LAWS)), "mixed"])
def test_derivatives_by_directions_and_deviations_against_differences(bodies, law):
    if law == "mixed":
        body = perturbed_body(LAWS, np.array([0.4, 0.3, 0.1, -0.2]), bodies["dish_on_bus"])
    else:
        body = bodies["dish_on_bus"]._replace(law=law)
    quaternion, sun, view = geometries(LANES, 6)
    kinds = np.array(
        [ALBEDO, SLOPE, REFLECTANCE, SHARE, SCALE, *range(AXIS_SCALE, FACET), FACET + 40]
        + (list(LAWS) if law == "mixed" else [])
    )
    block, shares = filled(quaternion, sun, view), np.empty((body.areas.size, LANES))
    body_magnitude_deviations(block, shares, True, LANES, body, True, True)
    rows, h = np.empty((kinds.size, LANES)), 1e-6
    deviation_rows(block, shares, LANES, kinds, np.ones(kinds.size), body, True, rows)
    bright = block[MAGNITUDE] < FLOOR_MAGNITUDE
    for number, kind in enumerate(kinds):
        ends = [perturbed_body(np.array([kind]), np.array([side]), body) for side in (h, -h)]
        smooth = bright & alike(*(triangles(each, quaternion, sun, view) for each in ends))
        values = [apparent_body_magnitude(quaternion, sun, view, 1e7, e, PRINTED) for e in ends]
        slope = (values[0] - values[1])[smooth] / (2.0 * h)
        assert smooth.sum() > 20 and abs(slope).max() > 0.01
        np.testing.assert_allclose(rows[number][smooth], slope, rtol=2e-6, atol=2e-6)
    checked = 0
    for q, s, v in zip(quaternion, sun, view, strict=True):
        magnitude, _, by_sun, by_view, by_log_range = body_magnitude_derivatives(
            tuple(q), s, v, 1e7, body, True, True
        )
        assert magnitude == body_magnitude(q, s, v, 1e7, body, True, True)
        if magnitude == FLOOR_MAGNITUDE:
            continue
        assert by_log_range == pytest.approx(5.0 / np.log(10.0))
        for place, gradient in enumerate((by_sun, by_view)):
            across = np.cross((s, v)[place], [0.3, -0.5, 0.8])
            ends = [[s, v], [s, v]]
            for end, side in zip(ends, (1.0, -1.0), strict=True):
                end[place] = unit(end[place] + side * h * across)
            where = [triangles(body, q[None], *(each[None] for each in end)) for end in ends]
            if where[0] == where[1]:
                values = [body_magnitude(q, *end, 1e7, body, True, True) for end in ends]
                slope = (values[0] - values[1]) / (2.0 * h)
                assert np.dot(gradient, across) == pytest.approx(slope, rel=2e-6, abs=2e-6)
                checked += 1
    assert checked > 30


def test_scaled_axes_keep_the_shadow_table():
    """An affine map preserves which facets shadow which: no other table is needed."""
    mesh = spacecraft.box_with_wings(wing_turn=0.4)
    factors = np.array([1.3, 0.8, 1.1])
    own = build_body(mesh._replace(vertices=mesh.vertices * factors), FOIL)
    kinds = np.arange(AXIS_SCALE, AXIS_SCALE + 3)
    shared = perturbed_body(kinds, np.log(factors), build_body(mesh, FOIL))
    one, two = (apparent_body_magnitude(*geometries(200, 5), 1e7, each) for each in (own, shared))
    seen = np.isfinite(one) & np.isfinite(two)
    assert np.quantile(abs(one - two)[seen], 0.95) < 0.01


def test_lambert_phong_reflection_against_its_formula():
    """Lambert-Phong reflection facet by facet, and the reflected light."""
    material = Material(0.4, 0.2, 0.5, 0.3, 0.3)
    body = build_body(CUBE, material)._replace(composite=True, law=1)
    quaternion, sun, view = geometries(50, 5)
    exponent = 0.5 / 0.3**2
    for q, s, v in zip(quaternion, sun, view, strict=True):
        lit, seen = (np.maximum(body.normals @ (attitude_matrix(q) @ each), 0.0) for each in (s, v))
        mirrored = np.maximum(2.0 * lit * seen - s @ v, 0.0)
        brightness = 0.2 + 0.2 * 0.3 / 0.3**2 * mirrored**exponent
        total = np.sum(body.areas * lit * seen * brightness)
        magnitude = apparent_body_magnitude(q, s, v, 1.0, body, sun_magnitude=0.0)
        assert 10.0 ** (-0.4 * magnitude) == pytest.approx(total / np.pi, rel=1e-12)
    model = PhotometryModel(reflection="lambert-phong")
    light, views = (
        np.array([np.sin(0.6), 0.0, np.cos(0.6)]),
        unit(np.random.default_rng(0).normal(size=(200_000, 3))),
    )
    seen = np.maximum(views[:, 2], 0.0)
    mirrored = np.maximum(2.0 * np.cos(0.6) * seen - views @ light, 0.0)
    sent = (0.2 + 0.2 * 0.3 / 0.3**2 * mirrored**exponent) * seen / np.pi
    assert returned_light(material, 0.6, model) == pytest.approx(
        4.0 * np.pi * sent.mean(), rel=0.02
    )


def test_mixed_reflection_against_its_formula():
    """At its ends the law is that of Cook-Torrance or Lambert-Phong, between them the formula."""
    material = Material(0.4, 0.2, 0.5, 0.3, 0.3)
    body = build_body(CUBE, material)
    quaternion, sun, view = geometries(50, 5)
    given = quaternion, sun, view, 1.0

    def magnitude(body):
        return apparent_body_magnitude(*given, body, sun_magnitude=0.0)

    def mixed(*amounts):
        return magnitude(perturbed_body(LAWS, np.array(amounts), body))

    plain, phong = magnitude(body), magnitude(body._replace(composite=True, law=1))
    np.testing.assert_allclose(mixed(0.0, 0.0, 0.0, 0.0), plain, rtol=1e-12)
    np.testing.assert_allclose(mixed(1.0, 0.0, 0.0, 0.0), phong, rtol=1e-12)
    angle = np.arccos(np.sum(sun * view, axis=1))
    terms = 0.1 * (angle - 1.2) - 0.2 * ((angle - 1.2) ** 2 - 0.3)
    np.testing.assert_allclose(mixed(0.0, 0.0, 0.1, -0.2), plain + terms, rtol=1e-12)
    turns = [attitude_matrix(q) for q in quaternion]
    lit, seen = (
        np.maximum(np.einsum("nij,nj->ni", turns, each) @ body.normals.T, 0.0)
        for each in (sun, view)
    )
    both = np.where(lit + seen > 0.0, lit + seen, 1.0)
    lommel = np.sum(body.areas * 0.2 * lit * seen * (1.4 / both - 1.0), axis=1)
    expected = 0.6 * 10 ** (-0.4 * plain) + 0.4 * 10 ** (-0.4 * phong) + 0.3 * lommel / np.pi
    found = 10.0 ** (-0.4 * mixed(0.4, 0.3, 0.0, 0.0))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_targets_with_different_bodies(bodies):
    """Each target is as bright as its body alone, and equal bodies share one table."""
    dish, stage = bodies["dish_on_bus"], bodies["upper_stage"]
    shapes = [dish, icosahedron(2.0), stage, dish._replace(areas=2.0 * dish.areas)]
    surfaces = target_surfaces(shapes, PAINT, 4)
    widths = [-(-each.shadows.lookup.shape[1] // 64) * 64 for each in (dish, stage)]
    assert surfaces.shadows.lookup.shape[1] == sum(widths)
    np.testing.assert_array_equal(surfaces.composite, [True, False, True, True])
    for j, shape in enumerate(shapes):
        alone = shape if isinstance(shape, Body) else plain_body(shape, PAINT)
        for q, s, v in zip(*geometries(20, j), strict=True):
            together = body_magnitude(q, s, v, 1e7, body_of(surfaces, j), False, True)
            assert together == body_magnitude(q, s, v, 1e7, alone, False, True)


def test_models_have_the_given_dimensions():
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
        (lambda: spacecraft.box_with_wings(span=11.0), "intersect a box"),
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
