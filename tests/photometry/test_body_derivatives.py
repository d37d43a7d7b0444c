"""Derivatives of the magnitudes of composite bodies against differences."""

import numpy as np
import pytest
from body_models import LAWS
from oracles.geometries import geometries, unit
from oracles.reflection import TRILINEAR

from cislunar.attitude.quaternion import attitude_matrix, compose, from_rotation_vector
from cislunar.photometry.bodies import apparent_body_magnitude
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
from cislunar.photometry.facets import FLOOR_MAGNITUDE
from cislunar.photometry.materials import (
    ALBEDO,
    AXIS_SCALE,
    FACET,
    PRINTED,
    REFLECTANCE,
    REFLECTION_LAWS,
    SCALE,
    SHARE,
    SLOPE,
)
from cislunar.photometry.parameter_deviations import deviation_rows, perturbed_body
from cislunar.photometry.shadows.table import table_corners


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
