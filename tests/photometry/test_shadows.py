"""Lit and seen shares of the facets of non-convex bodies against ray casting and closed forms."""

import numpy as np
import pytest
from body_models import HEIGHT, MATTE, MODELS, PLATES
from numba import njit
from oracles.geometries import IDENTITY, geometries, unit
from oracles.ray_cast import cast_shares, random_points

from cislunar.photometry import spacecraft
from cislunar.photometry.bodies import apparent_body_magnitude, build_body
from cislunar.photometry.body_blocks import body_magnitude
from cislunar.photometry.facets import FLOOR_MAGNITUDE
from cislunar.photometry.materials import AXIS_SCALE, FOIL
from cislunar.photometry.parameter_deviations import perturbed_body
from cislunar.photometry.shadows.blocks import lit_and_seen
from cislunar.photometry.shadows.table import no_shadows, table_corners, table_directions


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


def test_unlit_body_has_the_floor_magnitude(plates):
    up = np.array([0.0, 0.0, 1.0])
    assert body_magnitude(IDENTITY, up, -up, 1e7, plates, True, True) == FLOOR_MAGNITUDE
    assert apparent_body_magnitude(IDENTITY, up, -up, 1e7, plates) == np.inf


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
