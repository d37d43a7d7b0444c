"""Reflection laws against their sources, closed forms and quadrature; tables of measured laws."""

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numba import njit
from oracles.geometries import unit
from oracles.reflection import TRILINEAR, example_law, microfacet_ggx, trilinear

from cislunar.errors import ConfigurationError, InputFileError
from cislunar.observation.target_surfaces import joined_surfaces, target_surfaces
from cislunar.photometry.bodies import apparent_body_magnitude, plain_body
from cislunar.photometry.materials import (
    FOIL,
    PANEL,
    REFLECTION_LAWS,
    TABULATED,
    Material,
    PhotometryModel,
)
from cislunar.photometry.reflection.laws import LOMMEL_SEELIGER, reflectance
from cislunar.photometry.reflection.tables import NO_TABLE, load_reflectance_table
from cislunar.photometry.shapes import icosahedron, icosphere
from cislunar.photometry.sphere import phase_function, returned_light

LAWS = range(1, len(REFLECTION_LAWS))
GGX = REFLECTION_LAWS.index("lommel-seeliger-ggx")
NORMAL = np.array([0.0, 0.0, 1.0])
EXAMPLE = Path(__file__).parents[2] / "config/examples/brdf.csv"


def directions(count, seed):
    """Random pairs of directions above a facet."""
    light, view = unit(np.random.default_rng(seed).normal(size=(2, count, 3)))
    light[:, 2], view[:, 2] = abs(light[:, 2]), abs(view[:, 2])
    return zip(light, view, strict=True)


def of_pair(law, light, view, material, table=NO_TABLE):
    """pi f_r of a facet with its normal along z."""
    inverse_half2 = 1.0 / np.sum((light + view) ** 2)
    found = reflectance(law, light[2], view[2], inverse_half2, material.as_array(), table)
    return found[0] + found[1]


@pytest.mark.parametrize("law", [*LAWS, TABULATED])
def test_sun_and_observer_may_be_exchanged(law):
    for light, view in directions(200, law):
        given = PANEL, TRILINEAR
        there, back = of_pair(law, light, view, *given), of_pair(law, view, light, *given)
        assert there > 0.0
        assert there == pytest.approx(back, rel=1e-12)


@njit
def quadrature(law, incidence, material, seen, seen_weight, azimuth, azimuth_weight):
    """Share of the light that is returned, summed over nodes of the cosine of the emission angle
    and of the azimuth."""
    x, z, total = np.sin(incidence), np.cos(incidence), 0.0
    for i, v in enumerate(seen):
        across = np.sqrt(1.0 - v * v)
        for j, angle in enumerate(azimuth):
            half2 = (x + across * np.cos(angle)) ** 2 + (across * np.sin(angle)) ** 2 + (z + v) ** 2
            found = reflectance(law, z, v, 1.0 / half2, material, NO_TABLE)
            total += (found[0] + found[1]) / np.pi * v * seen_weight[i] * azimuth_weight[j]
    return total


@pytest.mark.parametrize("material", [PANEL, FOIL, Material(0.5, 0.1, 0.45, 0.6, 0.9)])
@pytest.mark.parametrize("law", LAWS)
def test_no_facet_returns_more_light_than_it_receives(law, material):
    """Quadrature over all views; and the library's own integral."""
    most = LOMMEL_SEELIGER * 2.0 * material.diffuse_weight * material.diffuse_albedo
    assert most + 4.0 * material.specular_weight <= 1.0  # as the module requires
    nodes, weights = np.polynomial.legendre.leggauss(144)
    azimuth, azimuth_weight = 0.5 * np.pi * (nodes + 1.0), np.pi * weights  # both halves alike
    seen, seen_weight = 0.5 * (nodes + 1.0), 0.5 * weights
    model = PhotometryModel(reflection=REFLECTION_LAWS[law])
    for incidence in np.deg2rad([0.0, 30.0, 60.0, 80.0, 89.0]):
        views = seen, seen_weight, azimuth, azimuth_weight
        total = quadrature(law, incidence, material.as_array(), *views)
        assert 0.0 < total <= 1.0
        assert returned_light(material, incidence, model) == pytest.approx(total, rel=1e-5)


def test_ggx_as_published():
    roughness, reflectance_0 = 0.35, 0.3
    material = Material(0.0, 0.25, 0.5, roughness, reflectance_0)  # 4 s = 1
    for light, view in directions(300, 1):
        published = microfacet_ggx(light, view, NORMAL, roughness, reflectance_0)
        found = of_pair(GGX, light, view, material) / np.pi
        assert found == pytest.approx(published, rel=1e-10)


@pytest.mark.parametrize("law", LAWS)
def test_every_lobe_is_as_bright_at_its_peak(law):
    """At normal incidence the lobe is s F0 / delta^2, as in the Cook-Torrance model."""
    material = Material(0.0, 0.2, 0.5, 0.3, 0.4)
    assert of_pair(law, NORMAL, NORMAL, material) == pytest.approx(0.2 * 0.4 / 0.09, rel=1e-12)


def sphere_light(law, phase_angles, material, table=NO_TABLE):
    """Light of a sphere of 1 m, of 20 480 facets, in units of the solar irradiance at 1 m."""
    body = plain_body(icosphere(5), material)._replace(composite=True, law=law, table=table)
    turned = np.stack([np.cos(phase_angles), np.sin(phase_angles), 0.0 * phase_angles], axis=1)
    magnitude = apparent_body_magnitude(
        [0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0], turned, 1.0, body, sun_magnitude=0.0
    )
    return 10.0 ** (-0.4 * magnitude)


def test_phase_functions_of_spheres():
    """Lommel-Seeliger: 1 - sin(a/2) tan(a/2) ln cot(a/4), and the same Bond albedo as Lambert."""
    angles = np.deg2rad([1.0, 20.0, 50.0, 90.0, 120.0])
    matte = Material(0.5, 0.0, 0.6, 0.3, 0.0)
    lambert = 0.3 * 2.0 / (3.0 * np.pi) * phase_function(angles)
    np.testing.assert_allclose(sphere_light(1, angles, matte), lambert, rtol=2e-3)
    half = 0.5 * angles
    seeliger = 1.0 - np.sin(half) * np.tan(half) * np.log(1.0 / np.tan(0.5 * half))
    found = sphere_light(2, angles, matte)
    np.testing.assert_allclose(found, 0.3 * LOMMEL_SEELIGER / 2.0 * seeliger, rtol=4e-3)
    squares = (np.arange(400) + 0.5) / 400
    model = PhotometryModel(reflection="lommel-seeliger-phong")
    shares = [returned_light(matte, angle, model) for angle in np.arccos(np.sqrt(squares))]
    assert np.mean(shares) == pytest.approx(0.3, rel=1e-3)


def test_a_table_of_a_law_that_is_linear_in_the_cosines():
    for light, view in directions(300, 2):
        across = np.sqrt((1.0 - light[2] ** 2) * (1.0 - view[2] ** 2))
        azimuth = (light @ view - light[2] * view[2]) / across
        expected = trilinear(light[2], view[2], azimuth)
        found = of_pair(TABULATED, light, view, PANEL, TRILINEAR)
        assert found == pytest.approx(expected, rel=1e-9)


def test_the_example_table_is_the_law_that_it_states():
    table = load_reflectance_table(EXAMPLE)
    angles = [np.arccos(each) for each in table[:3]]
    stated = np.pi * example_law(*np.meshgrid(*angles, indexing="ij"))
    np.testing.assert_allclose(table.values, stated, atol=1e-5, rtol=1e-4)
    model = PhotometryModel(reflection=str(EXAMPLE))
    assert 0.2 < returned_light(Material(), 0.5, model) < 0.5
    assert returned_light(Material(), np.deg2rad(89.0), model) < 1.0
    errors = []
    for light, view in directions(2000, 3):
        across = np.sqrt((1.0 - light[2] ** 2) * (1.0 - view[2] ** 2))
        azimuth = np.arccos(np.clip((light @ view - light[2] * view[2]) / across, -1.0, 1.0))
        between = of_pair(TABULATED, light, view, PANEL, table)
        exact = np.pi * example_law(np.arccos(light[2]), np.arccos(view[2]), azimuth)
        errors.append(abs(2.5 * np.log10(between / exact)))
    assert np.quantile(errors, 0.95) < 0.1


def as_csv(path, header, rows):
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


HEADER = "incidence_deg,emission_deg,azimuth_deg,brdf_per_sr"
GRID = [f"{i},{e},{a},0.1" for i in (0, 45, 90) for e in (0, 90) for a in (0, 180)]


def test_tables_of_either_format_agree(tmp_path):
    of_text = load_reflectance_table(as_csv(tmp_path / "law.csv", HEADER, GRID[::-1]))
    values = xr.DataArray(
        np.full((2, 3, 2), 0.1),
        coords={"azimuth_deg": [0.0, 180.0], "incidence_deg": [0.0, 45.0, 90.0],
            "emission_deg": [90.0, 0.0]},
    )  # fmt: skip
    values.to_dataset(name="brdf_per_sr").to_netcdf(tmp_path / "law.nc")
    of_netcdf = load_reflectance_table(tmp_path / "law.nc")
    for one, other in zip(of_text, of_netcdf, strict=True):
        np.testing.assert_array_equal(one, other)
    plain = [row for row in GRID if ",180," not in row]
    columns = [",".join(row.split(",")[i] for i in (0, 1, 3)) for row in plain]
    header = "incidence_deg,emission_deg,brdf_per_sr"
    isotropic = load_reflectance_table(as_csv(tmp_path / "plain.csv", header, columns))
    for light, view in directions(20, 4):
        for table in (of_text, isotropic):
            found = of_pair(TABULATED, light, view, PANEL, table)
            assert found == pytest.approx(0.1 * np.pi, rel=1e-12)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (GRID[:-1], "no brdf_per_sr at incidence_deg = 90, emission_deg = 90, azimuth_deg = 180"),
        ([*GRID[:-1], "90,90,180,-0.1"], "brdf_per_sr = -0.1 at incidence_deg = 90, "),
        ([*GRID[:-1], "90,90,180,x"], "brdf_per_sr = 'x' must be a finite number"),
        ([*GRID, GRID[0]], "these angles occur twice"),
        ([row for row in GRID if not row.startswith("90")], "reaches from 0 to 45; give it from 0"),
        ([row for row in GRID if ",180," not in row and row.startswith("0")], "one value"),
        ([*GRID[:1], "0,0,180,0.2", *GRID[2:]], "depends on azimuth_deg at incidence_deg = 0"),
    ],
)
def test_a_faulty_table_is_refused_in_one_line(tmp_path, rows, message):
    path = as_csv(tmp_path / "law.csv", HEADER, rows)
    with pytest.raises(InputFileError, match=re.escape(message)) as error:
        load_reflectance_table(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_unknown_laws_and_files_are_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="lommel-seeliger-ggx, or a table ending in"):
        PhotometryModel(reflection="hapke")
    with pytest.raises(InputFileError, match="no such table of a reflection law"):
        load_reflectance_table(tmp_path / "nowhere.csv")
    (tmp_path / "empty.nc").write_bytes(b"")
    with pytest.raises(InputFileError, match="no brdf_per_sr can be read"):
        load_reflectance_table(tmp_path / "empty.nc")


def test_one_table_for_all_targets(tmp_path):
    """Targets with and without the table join, those with different tables do not."""
    model = PhotometryModel(reflection=str(EXAMPLE))
    tabulated = target_surfaces(icosahedron(), Material(), 2, model)
    joined = joined_surfaces([target_surfaces(icosahedron(), Material(), 1), tabulated])
    assert joined.law.tolist() == [0, TABULATED, TABULATED]
    assert joined.composite.tolist() == [False, True, True]
    assert joined.table is tabulated.table
    other = tabulated._replace(table=TRILINEAR)
    with pytest.raises(ConfigurationError, match="the table of the reflection law must be the sa"):
        joined_surfaces([tabulated, other])
