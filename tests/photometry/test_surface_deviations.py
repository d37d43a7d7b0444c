"""Body-parameter deviations of a surface, and their derivatives against differences."""

import numpy as np
import pytest

from cislunar.attitude.quaternion import normalize
from cislunar.photometry.bodies import plain_body
from cislunar.photometry.body_blocks import body_magnitude, body_magnitude_deviations
from cislunar.photometry.facet_blocks import (
    BLOCK_ROWS,
    LANES,
    MAGNITUDE,
    QUATERNION,
    RANGE,
    SUN,
    TURN,
    VIEW,
    block_magnitude_deviations,
    block_magnitude_gradients,
)
from cislunar.photometry.facets import FLOOR_MAGNITUDE
from cislunar.photometry.materials import (
    ALBEDO,
    AXIS_SCALE,
    FACET,
    NOTHING,
    REFLECTANCE,
    SCALE,
    SHARE,
    SLOPE,
    Material,
)
from cislunar.photometry.parameter_deviations import deviation_rows, perturbed_body
from cislunar.photometry.shapes import icosahedron, scale_axes

FACETS = icosahedron()
MATERIAL = Material(0.6, 0.3, 0.4, 0.3, 0.3)
ROW = MATERIAL.as_array()
KINDS = np.array([ALBEDO, SLOPE, REFLECTANCE, SHARE, SCALE, *range(AXIS_SCALE, FACET), FACET + 3])
AMOUNTS = np.array([0.2, -0.3, 0.4, -0.5, 0.1, 0.15, -0.1, 0.05, 0.3])


def _perturbed(kinds, amounts):
    given = np.array(kinds), np.array(amounts, dtype=float)
    return perturbed_body(*given, plain_body(FACETS, MATERIAL))


def test_deviations_have_their_defined_effects():
    material = _perturbed(KINDS[:4], AMOUNTS[:4]).materials[0]
    weights, odds = material[0] + material[1], ROW[4] / (1.0 - ROW[4])
    assert material[2] == pytest.approx(ROW[2] * np.exp(0.2))
    assert material[3] == pytest.approx(ROW[3] * np.exp(-0.3))
    assert material[4] / (1.0 - material[4]) == pytest.approx(odds * np.exp(0.4))
    assert weights == pytest.approx(0.9)
    assert material[1] / material[0] == pytest.approx(0.5 * np.exp(-0.5))
    areas = _perturbed([SCALE, FACET + 2], [0.1, 0.2]).areas
    factor = np.exp(0.1 + 0.2 * (np.arange(areas.size) == 2))
    np.testing.assert_allclose(areas, FACETS.areas * factor)


def test_axis_scales_are_those_of_the_shape():
    body = _perturbed([AXIS_SCALE, AXIS_SCALE + 2], [0.1, -0.2])
    expected = scale_axes(FACETS, np.exp([0.1, 0.0, -0.2]))
    np.testing.assert_allclose(body.areas, expected.areas, rtol=1e-12)
    np.testing.assert_allclose(body.normals, expected.normals, atol=1e-12)


def _block(seed=0):
    rng = np.random.default_rng(seed)
    block = np.zeros((BLOCK_ROWS, LANES))
    for row, size in ((QUATERNION, 4), (SUN, 3), (VIEW, 3)):
        block[row : row + size] = normalize(rng.standard_normal((LANES, size))).T
    block[RANGE] = 8e7
    return block


def _magnitudes(block, body, fresnel_sqrt):
    return np.array([
        body_magnitude(b[:4], b[SUN:VIEW], b[VIEW:RANGE], b[RANGE], body, True, fresnel_sqrt)
        for b in block.T.copy()
    ])  # fmt: skip


@pytest.mark.parametrize("fresnel_sqrt", [True, False])
def test_derivatives_against_differences(fresnel_sqrt):
    given = _block()
    body = _perturbed(KINDS, AMOUNTS)
    kinds, sigma = np.append(KINDS, NOTHING), np.linspace(0.5, 1.5, KINDS.size + 1)
    block, shares = given.copy(), np.empty((FACETS.areas.size, LANES))
    body_magnitude_deviations(block, shares, True, LANES, body, True, fresnel_sqrt)
    rows = np.empty((kinds.size, LANES))
    deviation_rows(block, shares, LANES, kinds, sigma, body, fresnel_sqrt, rows)
    magnitude = _magnitudes(given, body, fresnel_sqrt)
    np.testing.assert_allclose(block[MAGNITUDE], magnitude, atol=1e-11)
    bright = magnitude < FLOOR_MAGNITUDE
    assert 15 < bright.sum() < LANES
    assert not rows[:, ~bright].any() and not rows[-1].any()
    h = 1e-6
    for i in range(KINDS.size):
        ends = [
            _magnitudes(given, _perturbed(KINDS, AMOUNTS + side * (np.arange(KINDS.size) == i)),
                        fresnel_sqrt)
            for side in (h, -h)
        ]  # fmt: skip
        slope = sigma[i] * (ends[0] - ends[1]) / (2.0 * h)
        assert np.abs(slope[bright]).max() > 0.01
        np.testing.assert_allclose(rows[i, bright], slope[bright], atol=2e-8, rtol=2e-7)


def test_magnitudes_and_gradients_do_not_need_shares_of_facets():
    plain, parts = _block(1), _block(1)
    surface = FACETS.areas, FACETS.normals, ROW
    block_magnitude_gradients(plain, LANES, *surface, True, True)
    block_magnitude_deviations(parts, np.empty((0, LANES)), False, LANES, *surface, True, True)
    np.testing.assert_array_equal(parts[MAGNITUDE : TURN + 3], plain[MAGNITUDE : TURN + 3])
