"""Fresnel reflectance, and the share of the light that a facet returns, by quadrature."""

import math

import numpy as np
import pytest
from oracles.geometries import IDENTITY
from test_facets import INVERSE_SQUARE

from cislunar.constants import SUN_APPARENT_MAGNITUDE
from cislunar.photometry.facets import apparent_magnitude, fresnel_reflectance
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import Facets


@pytest.mark.parametrize("f0", [0.02, 0.2, 0.5, 0.9])
def test_fresnel_with_the_root_is_the_physical_reflectance(f0):
    """Against the s and p amplitudes of a dielectric with refractive index b."""
    b = (1 + math.sqrt(f0)) / (1 - math.sqrt(f0))
    assert fresnel_reflectance(1.0, f0, True) == pytest.approx(f0, rel=1e-13)
    for incidence in np.linspace(0.0, 1.55, 9):
        inside = math.asin(math.sin(incidence) / b)
        ci, ct = math.cos(incidence), math.cos(inside)
        s = (ci - b * ct) / (ci + b * ct)
        p = (b * ci - ct) / (b * ci + ct)
        assert fresnel_reflectance(ci, f0, True) == pytest.approx((s * s + p * p) / 2, rel=1e-12)


def test_fresnel_as_printed_is_0_889_at_normal_incidence():
    assert fresnel_reflectance(1.0, 0.5, False) == pytest.approx(8.0 / 9.0, rel=1e-14)


def test_fresnel_without_contrast_reflects_nothing():
    assert fresnel_reflectance(0.7, 0.0, True) == pytest.approx(0.0, abs=1e-30)


def directional_hemispherical(material, incidence, n=200):
    """Share of the light on one facet that leaves it: Gauss rule over the view hemisphere."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    cosine = 0.5 * (nodes + 1.0)
    azimuth = 2 * np.pi * (np.arange(n) + 0.5) / n
    c, phi = np.meshgrid(cosine, azimuth, indexing="ij")
    sine = np.sqrt(1 - c**2)
    view = np.stack([sine * np.cos(phi), sine * np.sin(phi), c], axis=-1)
    sun = np.array([math.sin(incidence), 0.0, math.cos(incidence)])
    facet = Facets(np.array([1.0]), np.array([[0.0, 0.0, 1.0]]))
    magnitude = apparent_magnitude(IDENTITY, sun, view, 1.0, facet, material, INVERSE_SQUARE)
    flux = 10 ** ((SUN_APPARENT_MAGNITUDE - magnitude) / 2.5)
    # reflected power over incident power A (N.L)
    return float((flux * 0.5 * weights[:, None]).sum() * 2 * np.pi / n / math.cos(incidence))


@pytest.mark.parametrize("incidence_deg", [0.0, 40.0, 75.0])
def test_diffuse_facet_returns_its_albedo(incidence_deg):
    share = directional_hemispherical(Material(0.8, 0.0, 0.6), math.radians(incidence_deg))
    assert share == pytest.approx(0.8 * 0.6, rel=1e-9)


def test_specular_facet_returns_four_times_its_fresnel_share():
    """A property of the paper's normalization, stated in `Material`: it does not conserve energy.

    For narrow slopes, where no light is masked, microfacets should return F0 of the light.
    """
    share = directional_hemispherical(Material(0.0, 1.0, rms_slope=0.1), 0.0, n=400)
    assert share == pytest.approx(4.0 * 0.5, rel=1e-3)
    assert directional_hemispherical(Material(), 0.0) == pytest.approx(1.245, abs=1e-3)
    for incidence in (0.0, 0.7, 1.4):
        share = directional_hemispherical(Material(specular_weight=0.125), incidence)
        assert 0.25 < share < 0.5
