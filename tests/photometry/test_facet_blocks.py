"""Magnitudes and gradients in blocks against one geometry at a time, and against themselves."""

import numpy as np
import pytest
from numba import njit
from oracles.geometries import geometries
from scipy.special import erf, ndtr

from cislunar.attitude.quaternion import compose, from_rotation_vector
from cislunar.elementary import LOWEST_EXPONENT, exponential, normal_cdf, sine_and_cosine
from cislunar.photometry.facet_blocks import (
    BLOCK_ROWS,
    LANES,
    MAGNITUDE,
    TURN,
    block_magnitude_gradients,
    block_magnitudes,
)
from cislunar.photometry.facets import FLOOR_MAGNITUDE, facet_magnitude
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron

FACETS = icosahedron()
SURFACE = FACETS.areas, FACETS.normals, Material(0.4, 0.6, 0.3, 0.25, 0.45).as_array()
RANGE_M = 1e6


def in_blocks(kernel, quaternion, sun, view, fresnel_sqrt=True, lanes=LANES):
    """Magnitudes (n,) and gradients (n, 3) of n geometries, computed in blocks."""
    results = []
    for first in range(0, len(sun), lanes):
        rows = np.full((BLOCK_ROWS, LANES), np.nan)
        given = [each[first : first + lanes] for each in (quaternion, sun, view)]
        count = len(given[0])
        rows[:11, :count] = np.hstack([*given, np.full((count, 1), RANGE_M)]).T
        kernel(rows, count, *SURFACE, True, fresnel_sqrt)
        results.append(rows[[MAGNITUDE, TURN, TURN + 1, TURN + 2], :count].T)
    found = np.concatenate(results)
    return found[:, 0], found[:, 1:]


@pytest.mark.parametrize("fresnel_sqrt", [True, False])
def test_magnitudes_are_those_of_one_geometry_at_a_time(fresnel_sqrt):
    given = geometries(300, seed=7)
    one = [
        facet_magnitude(q, sun, view, RANGE_M, *SURFACE, True, fresnel_sqrt)
        for q, sun, view in zip(*given, strict=True)
    ]
    assert one.count(FLOOR_MAGNITUDE) < 50
    for kernel in (block_magnitudes, block_magnitude_gradients):
        found, _ = in_blocks(kernel, *given, fresnel_sqrt)
        np.testing.assert_allclose(found, one, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("fresnel_sqrt", [True, False])
def test_gradient_agrees_with_central_differences(fresnel_sqrt):
    given = geometries(300, seed=7)
    magnitude, gradient = in_blocks(block_magnitude_gradients, *given, fresnel_sqrt)
    checked = 0
    for k, (q, sun, view) in enumerate(zip(*given, strict=True)):
        if magnitude[k] == FLOOR_MAGNITUDE:
            assert not gradient[k].any()
            continue
        h = 1e-6
        ends = [
            [
                facet_magnitude(
                    compose(from_rotation_vector(sign * step), q), sun, view, RANGE_M,
                    *SURFACE, True, fresnel_sqrt,
                )
                for sign in (1.0, -1.0)
            ]
            for step in np.eye(3) * h
        ]  # fmt: skip
        scale = 1.0 + np.abs(gradient[k]).max()
        np.testing.assert_allclose(
            gradient[k], -np.diff(ends)[:, 0] / (2 * h), atol=3e-8 * scale, rtol=0.0
        )
        checked += 1
    assert checked > 250


@pytest.mark.parametrize("lanes", [1, 3, 8, 21])
def test_neighbors_and_lanes_change_no_bit(lanes):
    """The width of registers therefore has no effect either."""
    given = geometries(64, seed=3)
    usual, other = (
        in_blocks(block_magnitude_gradients, *given, lanes=each) for each in (LANES, lanes)
    )
    np.testing.assert_array_equal(usual[0], other[0])
    np.testing.assert_array_equal(usual[1], other[1])


def test_an_unlit_geometry_does_not_change_its_neighbors():
    """With the Sun directly behind the object |L + V| vanishes."""
    quaternion, sun, view = geometries(LANES, seed=5)
    bright, slopes = in_blocks(block_magnitude_gradients, quaternion, sun, view)
    view[4] = -sun[4]
    magnitude, gradient = in_blocks(block_magnitude_gradients, quaternion, sun, view)
    assert (
        magnitude[4] == FLOOR_MAGNITUDE == in_blocks(block_magnitudes, quaternion, sun, view)[0][4]
    )
    assert not gradient[4].any()
    others = np.arange(LANES) != 4
    np.testing.assert_array_equal(magnitude[others], bright[others])
    np.testing.assert_array_equal(gradient[others], slopes[others])


@njit
def _elementary(x, exponentials, sines, cosines):
    for k in range(x.size):
        exponentials[k] = exponential(x[k])
        sines[k], cosines[k] = sine_and_cosine(x[k])


def test_the_normal_distribution_against_scipy():
    """In both tails relative to it, and without a deviation."""
    x = np.linspace(-37.0, 37.0, 2001)
    found = np.array([normal_cdf.py_func(each, 0.7) for each in 0.7 * x])
    np.testing.assert_allclose(found, ndtr(x), rtol=1e-12, atol=0.0)
    by_erf = 0.5 * (1.0 + erf(x / np.sqrt(2.0)))
    np.testing.assert_allclose(found, by_erf, rtol=0.0, atol=1e-14)
    assert [normal_cdf(each, 0.0) for each in (-np.inf, -0.1, 0.0, 0.1)] == [0.0, 0.0, 0.5, 1.0]
    assert np.isnan([normal_cdf(0.1, np.nan), normal_cdf(np.nan, 0.1)]).all()
    assert normal_cdf(-30.0, 1.0) == pytest.approx(ndtr(-30.0), rel=1e-13, abs=0.0)


def test_elementary_functions_against_extended_precision():
    rng = np.random.default_rng(0)
    x = np.r_[rng.uniform(LOWEST_EXPONENT, 700.0, 4000), rng.uniform(-2.0, 2.0, 4000), 0.0]
    found = np.empty((3, x.size))
    _elementary(x, *found)
    wide = x.astype(np.longdouble)
    assert np.abs(found[0] / np.exp(wide) - 1.0).max() < 4e-16
    assert found[0, -1] == found[2, -1] == 1.0 and found[1, -1] == 0.0
    angles = np.r_[x, rng.uniform(-4e6, 4e6, 4000), np.arange(-8, 9) * np.pi / 4.0]
    found = np.empty((3, angles.size))
    _elementary(angles, *found)
    wide = angles.astype(np.longdouble)
    assert np.abs(found[1] - np.sin(wide)).max() < 2e-16
    assert np.abs(found[2] - np.cos(wide)).max() < 2e-16
    below = np.array([2.0 * LOWEST_EXPONENT, -np.inf])
    found = np.empty((3, 2))
    _elementary(below, *found)
    np.testing.assert_allclose(found[0], 3.3e-308, rtol=0.01)
