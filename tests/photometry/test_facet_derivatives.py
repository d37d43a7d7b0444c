"""Derivatives of the magnitudes of facets against differences."""

import numpy as np
import pytest
from oracles.geometries import geometries

from cislunar.attitude.quaternion import compose, from_rotation_vector
from cislunar.photometry.facet_derivatives import facet_magnitude_derivatives, fresnel_slope
from cislunar.photometry.facets import FLOOR_MAGNITUDE, facet_magnitude, fresnel_reflectance
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron


@pytest.mark.parametrize("fresnel_sqrt", [True, False])
def test_derivatives_by_turn_direction_and_range_agree_with_central_differences(fresnel_sqrt):
    facets = icosahedron()
    material = Material(0.4, 0.6, 0.3, 0.25, 0.45).as_array()
    shape = (facets.areas, facets.normals, material, True, fresnel_sqrt)
    checked = 0
    for q, sun, view in zip(*geometries(300, seed=8), strict=True):
        magnitude, turn, by_sun, by_view, by_log_range = facet_magnitude_derivatives(
            q, sun, view, 1e6, *shape
        )
        assert magnitude == pytest.approx(facet_magnitude(q, sun, view, 1e6, *shape), rel=1e-14)
        if magnitude == FLOOR_MAGNITUDE:
            assert not np.any([*turn, *by_sun, *by_view, by_log_range])
            continue
        h = 1e-6
        for axis, found in zip(np.eye(3), turn, strict=True):
            ends = [
                facet_magnitude(compose(from_rotation_vector(step), q), sun, view, 1e6, *shape)
                for step in (h * axis, -h * axis)
            ]
            scale = 1.0 + np.abs(turn).max()
            assert found == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=3e-8 * scale)
        for vector, found in ((sun, by_sun), (view, by_view)):
            # across the direction, where the vector stays a unit vector
            for axis in np.cross(vector, np.eye(3)):
                ends = []
                for step in (h * axis, -h * axis):
                    moved = (sun + step, view) if vector is sun else (sun, view + step)
                    ends.append(facet_magnitude(q, *moved, 1e6, *shape))
                scale = 1.0 + np.abs(found).max()
                assert axis @ found == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=3e-8 * scale)
        ranges = [facet_magnitude(q, sun, view, 1e6 * f, *shape) for f in (1.001, 0.999)]
        assert by_log_range == pytest.approx((ranges[0] - ranges[1]) / 0.002, rel=1e-6)
        checked += 1
    assert checked > 250


@pytest.mark.parametrize("fresnel_sqrt", [True, False])
@pytest.mark.parametrize("cosine", [0.1, 0.5, 0.9])
def test_slope_of_the_fresnel_reflectance(cosine, fresnel_sqrt):
    ends = [fresnel_reflectance(cosine + h, 0.5, fresnel_sqrt) for h in (1e-6, -1e-6)]
    slope = fresnel_slope(cosine, 0.5, fresnel_sqrt)
    assert slope == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-6)
