"""Magnitudes of Cook-Torrance facets against the paper's equations, spheres and symmetries."""

import math
import warnings

import numpy as np
import pytest
from oracles.geometries import IDENTITY, geometries
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from cislunar.attitude.quaternion import compose, from_rotation_vector
from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.errors import ConfigurationError
from cislunar.photometry.facet_derivatives import facet_magnitude_derivatives
from cislunar.photometry.facets import (
    FLOOR_MAGNITUDE,
    IRRADIANCE_FLOOR,
    apparent_magnitude,
    facet_irradiance,
    facet_magnitude,
)
from cislunar.photometry.materials import PRINTED, Material, PhotometryModel
from cislunar.photometry.shapes import Facets, icosahedron, icosphere
from cislunar.photometry.sphere import sphere_magnitude

DIFFUSE = Material(diffuse_weight=1.0, specular_weight=0.0, diffuse_albedo=0.5)
INVERSE_SQUARE = PhotometryModel(irradiance="1/r^2")
ONE_FACET = np.array([2.0]), np.array([[0.0, 0.0, 1.0]]), Material().as_array()
"""Area, normal and material."""


def directions(phase_angle):
    """Sun and observer directions a phase angle apart, off any axis."""
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5])
    sun = turn.apply([1.0, 0.0, 0.0])
    view = turn.apply([math.cos(phase_angle), math.sin(phase_angle), 0.0])
    return sun, view


def paper_irradiance(quaternion, sun, view, r, facets, material, model):
    """F_t / I, term by term as the paper's section 2.2 prints it."""
    normals = Rotation.from_quat(quaternion).apply(facets.normals)  # body to inertial
    half = (sun + view) / np.linalg.norm(sun + view)
    d, s = material.diffuse_weight, material.specular_weight
    total = 0.0
    for area, normal in zip(facets.areas, normals, strict=True):
        lit, seen, tilt = normal @ sun, normal @ view, normal @ half
        if lit <= 0 or seen <= 0:
            continue
        phi = math.acos(min(1.0, tilt))
        beckmann = (
            material.rms_slope**-2
            * math.cos(phi) ** -4
            * math.exp(-(math.tan(phi) ** 2) / material.rms_slope**2)
        )
        alpha = min(1.0, 2 * tilt * seen / (half @ view), 2 * tilt * lit / (half @ view))
        q = view @ half
        b = (1 + math.sqrt(material.normal_reflectance)) / (
            1 - math.sqrt(material.normal_reflectance)
        )
        p = (q**2 - 1) + b**2
        if model.fresnel == "sqrt":
            p = math.sqrt(p)
        fresnel = (
            (p - q) ** 2 / (2 * (p + q) ** 2) * (1 + ((q * (p + q) - 1) / (q * (p - q) + 1)) ** 2)
        )
        rho_s = alpha * beckmann * fresnel / math.pi / (lit * seen)
        rho_d = material.diffuse_albedo / math.pi
        total += area * (d * rho_d + s * rho_s) * lit * seen
    return total / ((4 * math.pi if model.irradiance == "4pi" else 1.0) * r**2)


# ---- the paper's equations -------------------------------------------------------------------


@pytest.mark.parametrize("irradiance", ["4pi", "1/r^2"])
@pytest.mark.parametrize("fresnel", ["sqrt", "printed"])
def test_agrees_with_the_equations_as_printed(irradiance, fresnel):
    model = PhotometryModel(irradiance, fresnel)
    facets = icosahedron()
    worst, bright = 0.0, 0
    for i, (q, sun, view) in enumerate(zip(*geometries(1000), strict=True)):
        material = Material(0.4, 0.6, 0.3, rms_slope=0.1 + 0.1 * (i % 5), normal_reflectance=0.45)
        surface = facets.areas, facets.normals, material.as_array()
        flux = facet_irradiance(
            q, sun, view, 3e4, *surface, model.irradiance_4pi, model.fresnel_sqrt
        )
        expected = paper_irradiance(q, sun, view, 3e4, facets, material, model)
        if expected > 0.0:
            worst, bright = max(worst, abs(flux / expected - 1.0)), bright + 1
        else:
            assert flux == 0.0
    assert bright > 900
    assert worst < 1e-12


def test_magnitude_is_relative_to_the_sun():
    """F/I = 1 has the magnitude of the Sun, and a factor of 100 is 5 mag."""
    facets = Facets(np.array([np.pi]), np.array([[0.0, 0.0, 1.0]]))
    material = Material(1.0, 0.0, 1.0)
    up = np.array([0.0, 0.0, 1.0])
    magnitudes = apparent_magnitude(IDENTITY, up, up, [1.0, 10.0], facets, material, INVERSE_SQUARE)
    np.testing.assert_allclose(magnitudes, [SUN_APPARENT_MAGNITUDE, SUN_APPARENT_MAGNITUDE + 5.0])
    shifted = apparent_magnitude(
        IDENTITY, up, up, 1.0, facets, material, INVERSE_SQUARE, sun_magnitude=-27.0
    )
    assert shifted == pytest.approx(-27.0)


def test_4pi_law_is_fainter_by_2_748_mag():
    geometry = geometries(50)
    literal = apparent_magnitude(*geometry, 1e7, icosahedron(), model=PRINTED)
    physical = apparent_magnitude(*geometry, 1e7, icosahedron())  # the default
    finite = np.isfinite(literal)
    assert 30 < finite.sum() < 50
    np.testing.assert_allclose(literal[finite] - physical[finite], 2.748, atol=5e-4)


# ---- limits and symmetries -------------------------------------------------------------------


@pytest.mark.parametrize("phase_angle_deg", [10.0, 30.0, 90.0, 120.0])
def test_diffuse_icosphere_tends_to_the_lambert_sphere(phase_angle_deg):
    """C_d of the sphere is d rho of the facets, and its light follows 1/r^2."""
    phase_angle = math.radians(phase_angle_deg)
    sun, view = directions(phase_angle)
    closed = sphere_magnitude(
        1e7, phase_angle, radius_m=2.0, diffuse_reflection_coefficient=1.0 * 0.5
    )
    errors = [
        float(
            apparent_magnitude(IDENTITY, sun, view, 1e7, icosphere(n, 2.0), DIFFUSE, INVERSE_SQUARE)
            - closed
        )
        for n in (2, 5)
    ]
    assert abs(errors[1]) < 1e-3
    assert abs(errors[1]) < abs(errors[0])
    literal = apparent_magnitude(IDENTITY, sun, view, 1e7, icosphere(5, 2.0), DIFFUSE, PRINTED)
    assert literal - closed == pytest.approx(2.5 * math.log10(4 * math.pi), abs=1e-3)


def test_diffuse_icosahedron_is_a_sphere_at_full_phase():
    """Exactly and in any attitude: sum of A N N^T is isotropic for icosahedral symmetry."""
    q, sun, _ = geometries(20)
    magnitudes = apparent_magnitude(q, sun, sun, 1e7, icosahedron(), DIFFUSE, INVERSE_SQUARE)
    closed = sphere_magnitude(1e7, 0.0, diffuse_reflection_coefficient=0.5)
    np.testing.assert_allclose(magnitudes, closed, rtol=1e-14)


def test_specular_icosphere_at_full_phase_tends_to_its_integral():
    material = Material(0.0, 0.7, rms_slope=0.3, normal_reflectance=0.5)

    def ring(theta):
        c = math.cos(theta)
        if c < 1e-3:
            return 0.0
        beckmann = math.exp(-(math.tan(theta) ** 2) / 0.09) / (0.09 * c**4)
        return min(1.0, 2 * c * c) * beckmann * math.sin(theta)

    integral = quad(ring, 0.0, math.pi / 2, points=[math.pi / 4], epsabs=1e-12)[0]
    expected = 0.7 * 0.5 / math.pi * 2 * math.pi * integral / 1e7**2
    sun, _ = directions(0.0)
    magnitude = apparent_magnitude(IDENTITY, sun, sun, 1e7, icosphere(5), material, INVERSE_SQUARE)
    assert magnitude == pytest.approx(SUN_APPARENT_MAGNITUDE - 2.5 * math.log10(expected), abs=2e-3)


def test_reciprocity():
    q, sun, view = geometries(200)
    facets = icosahedron()
    np.testing.assert_allclose(
        apparent_magnitude(q, sun, view, 1e7, facets),
        apparent_magnitude(q, view, sun, 1e7, facets),
        rtol=1e-14,
    )


def test_common_rotation_changes_nothing():
    """Body, Sun and observer rotated together; and a symmetry of the icosahedron."""
    q, sun, view = geometries(100)
    turn = Rotation.from_rotvec([0.4, 1.3, -0.7])
    turned = (Rotation.from_quat(q).inv() * turn.inv()).inv().as_quat()
    before = apparent_magnitude(q, sun, view, 1e7, icosahedron())
    after = apparent_magnitude(turned, turn.apply(sun), turn.apply(view), 1e7, icosahedron())
    np.testing.assert_allclose(after, before, rtol=1e-12)
    # The icosahedron with vertices at cyclic permutations of (0, +-1, +-golden) is unchanged by a
    # rotation by 120 degrees about (1, 1, 1).
    symmetry = from_rotation_vector(2 * np.pi / 3 * np.ones(3) / math.sqrt(3))
    folded = np.array([compose(symmetry, row) for row in q])
    np.testing.assert_allclose(
        apparent_magnitude(folded, sun, view, 1e7, icosahedron()), before, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("sun_z", "view_z"), [(-0.1, 0.5), (0.5, -0.1), (-0.5, -0.5), (0.0, 0.5), (0.5, 0.0)]
)
def test_unlit_or_unseen_facets_give_nothing(sun_z, view_z):
    sun = np.array([math.sqrt(1 - sun_z**2), 0.0, sun_z])
    view = np.array([math.sqrt(1 - view_z**2), 0.0, view_z])
    arguments = IDENTITY, sun, view, 10.0, *ONE_FACET, True, True
    assert facet_irradiance(*arguments) == 0.0
    assert facet_magnitude(*arguments) == FLOOR_MAGNITUDE
    turned = facet_magnitude_derivatives(*arguments)
    assert turned == (FLOOR_MAGNITUDE, *3 * ((0.0, 0.0, 0.0),), 0.0)


def test_grazing_facet_is_finite_and_free_of_cancellation():
    view = np.array([0.6, 0.0, 0.8])
    for graze in (1e-6, 1e-100, 1e-200, 5e-324):
        sun = np.array([1.0, 0.0, graze])
        flux = facet_irradiance(IDENTITY, sun, view, 1.0, *ONE_FACET, False, True)
        assert 0.0 <= flux < 1e-5
        if graze == 1e-6:
            assert flux > 1e-12
    both = np.array([1.0, 0.0, 1e-200])
    assert facet_irradiance(IDENTITY, both, both, 1.0, *ONE_FACET, False, True) == 0.0


@pytest.mark.parametrize("phase_angle", [math.pi, math.pi - 1e-9])
def test_unlit_target_has_infinite_magnitude_without_a_warning(phase_angle):
    sun, view = directions(phase_angle)
    if phase_angle == math.pi:
        view = -sun
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        magnitude = apparent_magnitude(IDENTITY, sun, view, 1e7, icosahedron())
    assert magnitude == np.inf
    facets = icosahedron()
    shared = (1e7, facets.areas, facets.normals, Material().as_array(), True, True)
    assert facet_magnitude_derivatives(IDENTITY, sun, view, *shared)[:2] == (
        FLOOR_MAGNITUDE,
        (0.0, 0.0, 0.0),
    )


def test_filter_floor():
    """`facet_magnitude` is limited by the floor, `apparent_magnitude` is not."""
    assert pytest.approx(-26.74 - 2.5 * math.log10(IRRADIANCE_FLOOR)) == FLOOR_MAGNITUDE
    facets, sun = icosahedron(), np.array([0.0, 0.6, 0.8])
    shared = (facets.areas, facets.normals, Material().as_array(), False, True)
    near = facet_magnitude(IDENTITY, sun, sun, 1e7, *shared)
    assert near == pytest.approx(float(apparent_magnitude(IDENTITY, sun, sun, 1e7, facets)))
    far = 1e12
    assert facet_magnitude(IDENTITY, sun, sun, far, *shared) == FLOOR_MAGNITUDE
    assert apparent_magnitude(IDENTITY, sun, sun, far, facets) == pytest.approx(near + 25.0)


# ---- settings --------------------------------------------------------------------------------


def test_broadcasting():
    q, sun, view = geometries(6)
    magnitudes = apparent_magnitude(
        q[:, None], sun[0], view[None, :4], np.full((6, 1), 1e6), icosahedron()
    )
    assert magnitudes.shape == (6, 4)
    single = apparent_magnitude(q[3], sun[0], view[2], 1e6, icosahedron())
    assert single.shape == ()
    assert magnitudes[3, 2] == single


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("diffuse_weight", -0.1),
        ("specular_weight", np.nan),
        ("diffuse_albedo", 1.1),
        ("rms_slope", 0.0),
        ("normal_reflectance", 1.0),
    ],
)
def test_impossible_material_is_refused(name, value):
    with pytest.raises(ConfigurationError, match=name):
        Material(**{name: value})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"quaternion": [0, 0, 0, 2]}, "quaternion has norm 2; divide it by its norm"),
        ({"sun_direction": [[1, 0, 0], [3, 0, 0]]}, "sun_direction has norm 3"),
        ({"range_m": 0.0}, "range_m = 0 must be positive"),
        ({"sun_magnitude": "-27"}, "sun_magnitude = '-27' must be a finite number"),
        ({"model": PhotometryModel(reflection="lambert-phong")}, "model.reflection = 'lambert-ph"),
    ],
)
def test_an_impossible_geometry_is_refused(change, message):
    given = {"quaternion": [0, 0, 0, 1], "sun_direction": [1, 0, 0], "view_direction": [1, 0, 0]}
    with pytest.raises(ConfigurationError, match=message):
        apparent_magnitude(**given | {"range_m": 1e8, "facets": icosahedron()} | change)


def test_unknown_reading_is_refused():
    with pytest.raises(ConfigurationError, match="irradiance = '2pi' must be one of 4pi, 1/r"):
        PhotometryModel(irradiance="2pi")
    with pytest.raises(ConfigurationError, match="fresnel"):
        PhotometryModel(fresnel="schlick")
