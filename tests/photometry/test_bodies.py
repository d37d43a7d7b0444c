"""Bodies of several materials: magnitudes, reflection laws, models of spacecraft."""

import numpy as np
import pytest
from body_models import CUBE, LAWS, MATTE, MODELS, PLATES
from oracles.geometries import IDENTITY, geometries, unit

from cislunar.attitude.quaternion import attitude_matrix
from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.errors import ConfigurationError
from cislunar.observation.target_surfaces import body_of, target_surfaces
from cislunar.photometry import spacecraft
from cislunar.photometry.bodies import Body, apparent_body_magnitude, build_body, plain_body
from cislunar.photometry.body_blocks import body_magnitude
from cislunar.photometry.facets import IRRADIANCE_FLOOR, apparent_magnitude, facet_irradiance
from cislunar.photometry.materials import (
    FOIL,
    PAINT,
    PANEL,
    PHASE_SLOPE,
    Material,
    PhotometryModel,
)
from cislunar.photometry.parameter_deviations import perturbed_body
from cislunar.photometry.shadows.table import shadowing_pairs
from cislunar.photometry.shapes import facets_from_triangles, icosahedron
from cislunar.photometry.sphere import returned_light


def test_convex_body_of_one_material_uses_the_convex_kernel():
    assert not shadowing_pairs(CUBE).any()
    body = build_body(CUBE, FOIL)
    assert not body.composite
    geometry = *geometries(200), 1e7
    expected = apparent_magnitude(*geometry, body.facets, FOIL)
    np.testing.assert_array_equal(apparent_body_magnitude(*geometry, body), expected)
    composite = apparent_body_magnitude(*geometry, body._replace(composite=True))
    np.testing.assert_allclose(composite, expected, atol=1e-12)


def test_a_direction_that_is_not_known_has_no_magnitude():
    body = build_body(CUBE, FOIL)._replace(composite=True)
    for known in (0, 1, 2):
        given = [np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)), *np.tile([0.0, 0.0, 1.0], (2, 2, 1))]
        given[known][1] = np.nan
        one, two = apparent_body_magnitude(*given, 1e7, body)
        assert np.isfinite(one) and np.isnan(two)


def test_laws_that_a_body_does_not_have_are_refused():
    law = PhotometryModel(reflection="lambert-phong")
    geometry = [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], 1e7
    composite = build_body(CUBE, FOIL)._replace(composite=True)
    for body in (composite, build_body(CUBE, FOIL)):
        with pytest.raises(ConfigurationError, match=r"model\.reflection = 'lambert-phong'"):
            apparent_body_magnitude(*geometry, body, law)
    assert np.isfinite(apparent_body_magnitude(*geometry, composite._replace(law=1), law))
    mixed = perturbed_body(np.array([PHASE_SLOPE]), np.ones(1), build_body(CUBE, FOIL))
    with pytest.raises(ConfigurationError, match="target 0 mixes reflection laws"):
        target_surfaces(mixed, FOIL, 1)


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
        (lambda: spacecraft.box_with_wings(size=(1.0, 1.0)), "size has shape"),
        (lambda: spacecraft.box_with_wings(wing=3.0), "wing has shape"),
        (lambda: spacecraft.box_with_wings(wing_turn=np.nan), "wing_turn = nan"),
        (lambda: spacecraft.box_with_wings(divisions=1.5), "divisions = 1.5"),
        (lambda: facets_from_triangles(np.eye(3), [[0, 1, 3]]), "triangles: 3 must be"),
        (lambda: facets_from_triangles(np.eye(3), [[0, 1, 1]]), "triangles: facet 0 has no area"),
        (lambda: facets_from_triangles(np.eye(3), [0, 1, 2]), "triangles has shape"),
        (lambda: spacecraft.dish_on_bus(diameter=np.nan), "must be positive"),
        (lambda: spacecraft.upper_stage(length=3.0), "longer than the stage"),
        (lambda: spacecraft.upper_stage(segments=2), "3 segments"),
        (lambda: build_body(PLATES, MATTE, steps=0), "steps = 0"),
    ],
)
def test_impossible_models(make, message):
    with pytest.raises(ConfigurationError, match=message):
        make()
