"""Diffuse sphere against a numerical integral over its surface, and eq. 18 of Paul & Fan."""

import numpy as np
import pytest

from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.errors import ConfigurationError
from cislunar.photometry.facets import apparent_magnitude
from cislunar.photometry.materials import FOIL, PANEL, Material, PhotometryModel, material_of
from cislunar.photometry.shapes import Facets
from cislunar.photometry.sphere import (
    equal_sphere_coefficient,
    faintness_per_squared_range,
    phase_angle,
    phase_function,
    returned_light,
    sphere_magnitude,
)


def lambert_integral(alpha, nodes=60):
    """Integral of cos(incidence) cos(emission) over the lit and seen part of a unit sphere.

    Longitude is measured from the observer in the plane of Sun and observer, where both cosines
    separate: cos(latitude) cos(longitude) and cos(latitude) cos(longitude - alpha).
    """
    node, weight = np.polynomial.legendre.leggauss(nodes)
    low, high = alpha - np.pi / 2, np.pi / 2
    longitude = 0.5 * (high - low) * node + 0.5 * (high + low)
    in_longitude = (
        0.5 * (high - low) * np.sum(weight * np.cos(longitude) * np.cos(longitude - alpha))
    )
    latitude = 0.5 * np.pi * node
    return in_longitude * 0.5 * np.pi * np.sum(weight * np.cos(latitude) ** 3)


@pytest.mark.parametrize("alpha", [0.0, 0.3, np.pi / 2, 2.5, 3.1])
def test_phase_function_is_the_integral_over_the_lit_and_seen_surface(alpha):
    # The integral is (2/3) (sin a + (pi - a) cos a): eq. 18's 2 / 3 comes from there.
    assert 2.0 / 3.0 * phase_function(alpha) == pytest.approx(lambert_integral(alpha), abs=1e-13)


def test_phase_function_at_its_ends():
    assert phase_function(0.0) == pytest.approx(np.pi)
    assert phase_function(np.pi / 2) == pytest.approx(1.0)
    assert phase_function(np.pi) == pytest.approx(0.0, abs=1e-15)


def test_phase_angle_is_zero_at_full_phase_and_pi_at_new():
    # The Sun behind the observer lights the whole disk; behind the target, none of it.
    sun, target = np.array([400.0, 0.0, 0.0]), np.zeros(3)
    observer = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    angle = phase_angle(target - observer, target - sun)
    np.testing.assert_allclose(angle, [0.0, np.pi, np.pi / 2], atol=1e-15)


def test_phase_angle_against_atan2():
    rng = np.random.default_rng(3)
    line, light = rng.normal(size=(2, 50, 3))
    expected = np.arctan2(np.linalg.norm(np.cross(line, light), axis=1), np.sum(line * light, 1))
    np.testing.assert_allclose(phase_angle(line, light), expected, atol=1e-12)


def test_magnitude_of_a_full_sphere_by_hand():
    # Full phase, C_d = 1, R = 1 m: the ratio of fluxes is 2 / (3 r^2); at r = sqrt(2/3) 1e8 m it
    # is 1e-16, so the sphere is 40 mag fainter than the Sun.
    range_m = np.sqrt(2.0 / 3.0) * 1e8
    assert sphere_magnitude(range_m, 0.0) == pytest.approx(SUN_APPARENT_MAGNITUDE + 40.0, abs=1e-12)


def test_magnitude_follows_range_radius_and_reflection():
    base = sphere_magnitude(2e8, 1.0)
    assert sphere_magnitude(2e9, 1.0) - base == pytest.approx(5.0)
    assert sphere_magnitude(2e8, 1.0, radius_m=10.0) - base == pytest.approx(-5.0)
    dimmer = sphere_magnitude(2e8, 1.0, diffuse_reflection_coefficient=0.1)
    assert dimmer - base == pytest.approx(2.5)


def test_unlit_sphere_is_fainter_by_39_magnitudes():
    # Rounding leaves Phi(pi) of the order of 1e-16, 40 mag fainter than a full sphere.
    assert sphere_magnitude(1e6, np.pi) - sphere_magnitude(1e6, 0.0) > 39.0
    with np.errstate(all="raise", divide="ignore"):
        assert sphere_magnitude(1e6, 0.0, diffuse_reflection_coefficient=0.0) == np.inf


@pytest.mark.parametrize("radius, reflection, limit", [(1.0, 1.0, 18.0), (2.5, 0.2, 20.0)])
def test_faintness_decides_as_the_magnitude_does(radius, reflection, limit):
    rng = np.random.default_rng(8)
    range_m = 10 ** rng.uniform(5.0, 9.5, 4000)
    alpha = rng.uniform(0.0, np.pi, 4000)
    setting = {"radius_m": radius, "diffuse_reflection_coefficient": reflection}
    brighter = sphere_magnitude(range_m, alpha, **setting) < limit
    assert 0.1 < brighter.mean() < 0.9
    faintness = faintness_per_squared_range(limit, **setting)
    np.testing.assert_array_equal(phase_function(alpha) > faintness * range_m**2, brighter)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_impossible_sphere_is_refused(value):
    with pytest.raises(ConfigurationError, match="radius_m = "):
        faintness_per_squared_range(18.0, radius_m=value)
    with pytest.raises(ConfigurationError, match="diffuse_reflection_coefficient"):
        faintness_per_squared_range(18.0, diffuse_reflection_coefficient=value)


@pytest.mark.parametrize("material", [Material(), Material(rms_slope=1.0), PANEL, FOIL])
@pytest.mark.parametrize("incidence_deg", [0.0, 40.0, 75.0])
def test_reflected_light_is_the_sum_over_all_views(material, incidence_deg):
    incidence, points = np.deg2rad(incidence_deg), 300
    sun = np.array([np.sin(incidence), 0.0, np.cos(incidence)])
    # midpoints equal in solid angle: the sum needs no weights
    height, angle = np.meshgrid(*2 * [(np.arange(points) + 0.5) / points], indexing="ij")
    z, flat = height.ravel(), np.sqrt(1.0 - height.ravel() ** 2)
    angle = 2.0 * np.pi * angle.ravel()
    view = np.column_stack((flat * np.cos(angle), flat * np.sin(angle), z))
    facet = Facets(areas=np.ones(1), normals=np.array([[0.0, 0.0, 1.0]]))
    model = PhotometryModel(irradiance="1/r^2")
    magnitude = apparent_magnitude(
        [0.0, 0.0, 0.0, 1.0], sun, view, 1.0, facet, material, model, sun_magnitude=0.0
    )
    summed = 2.0 * np.pi * np.mean(10.0 ** (-0.4 * magnitude)) / sun[2]
    assert returned_light(material, incidence, model) == pytest.approx(summed, rel=4e-3)


def test_the_equal_sphere_of_a_diffuse_material_has_its_albedo():
    diffuse = Material(diffuse_weight=0.8, specular_weight=0.0, diffuse_albedo=0.5)
    physical = PhotometryModel(irradiance="1/r^2")
    assert equal_sphere_coefficient(diffuse, physical) == pytest.approx(0.4, rel=1e-12)
    darker = equal_sphere_coefficient(diffuse, PhotometryModel(irradiance="4pi"))
    assert darker == pytest.approx(0.4 / (4.0 * np.pi), rel=1e-12)


def test_impossible_spheres_and_angles_are_refused():
    for call, words in (
        (lambda: sphere_magnitude(1e8, 0.5, radius_m=-1.0), "radius_m"),
        (lambda: sphere_magnitude(1e8, 0.5, diffuse_reflection_coefficient=-1.0), "diffuse"),
        (lambda: sphere_magnitude(1e8, 90.0), "phase_angle: give angles from 0 to pi"),
        (lambda: sphere_magnitude([1e8, 0.0], 0.5), "range_m: give positive distances"),
        (lambda: returned_light(PANEL, 2.0), "incidence = 2.0"),
        (lambda: returned_light(PANEL, np.nan), "incidence = nan"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            call()


def test_a_drawn_material_may_have_an_albedo_above_one():
    """As materials of true bodies that are drawn from a distribution may; others are refused."""
    row = [1.0, 0.0, 1.05, 0.3, 0.5]
    physical = PhotometryModel(irradiance="1/r^2")
    assert equal_sphere_coefficient(material_of(row), physical) == pytest.approx(1.05)
    np.testing.assert_array_equal(material_of(row).as_array(), row)
    with pytest.raises(ConfigurationError, match=r"diffuse_albedo = 1\.05"):
        Material(*row)
