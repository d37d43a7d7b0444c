"""Faults that are refused before any job starts."""

import importlib.util
import os

import numpy as np
import pytest
import xarray as xr
from campaign_folder import ROOT, read_campaign, with_change

from cislunar.architecture.published import PUBLISHED
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.preflight import (
    check_inputs,
    check_request,
    check_target_count,
)
from cislunar.campaign.settings.reading import merged
from cislunar.errors import CislunarError, ConfigurationError, InputFileError
from cislunar.runtime.netcdf import variable, write_dataset
from cislunar.runtime.provenance import provenance


@pytest.fixture
def config():
    """The configuration of the full campaign, wherever the tests are started."""
    settings = read_campaign()
    settings["targets"]["missions"] = str(ROOT / settings["targets"]["missions"])
    return settings


def test_full_configuration_is_accepted(config):
    check_inputs(config)


@pytest.mark.parametrize("text", ["", "none", "-1", "nan"])
def test_mission_without_a_possible_jacobi_constant_is_named(config, tmp_path, text):
    table = tmp_path / "missions.csv"
    table.write_text(f"mission,jacobi\nGateway,3.05\nLost Probe,{text}\n", encoding="utf-8")
    with pytest.raises(InputFileError, match=r"missions\.csv, row 3, mission 'Lost Probe'"):
        check_inputs(with_change(config, "targets.missions", str(table)))


def test_missing_mission_table_is_named(config, tmp_path):
    with pytest.raises(InputFileError, match=r"nowhere\.csv: no such file"):
        check_inputs(with_change(config, "targets.missions", str(tmp_path / "nowhere.csv")))


def test_a_table_of_a_surveys_prior_is_checked_before_anything_runs(config, tmp_path):
    table = tmp_path / "states.csv"
    mine = {"scenario": "A", "architecture": "tpe", "prior_table": str(table)}
    config = check_campaign(config | {"results": str(tmp_path), "surveys": {"mine": mine}})
    for text, message in ((None, "no such file"), ("id,x\na,1\n", "needs the columns")):
        if text is not None:
            table.write_text(text, encoding="utf-8")
        with pytest.raises(InputFileError, match=message) as caught:
            check_inputs(config)
        assert f"'surveys.mine.prior_table': {table}" in str(caught.value)
    table.write_text("id,x,y,z,vx,vy,vz\na,1.1,0,0,0,0.1,0\n", encoding="utf-8")
    check_inputs(config)


def test_a_kernel_cut_short_is_named(config, tmp_path):
    whole = (ROOT / "config/examples/de421_2027.bsp").read_bytes()
    kernel = tmp_path / "short.bsp"
    kernel.write_bytes(whole[: len(whole) // 2])
    changed = config | {"epoch_jd": 2461465.5, "ephemeris": {"kernel": str(kernel)}}
    changed["ephemeris"]["step_minutes"] = 10
    with pytest.raises(InputFileError, match=r"short\.bsp: is incomplete"):
        check_inputs(changed)


def test_a_mesh_in_another_unit_is_refused(config, tmp_path):
    mesh = tmp_path / "millimeters.obj"
    corners = "v 1e3 1e3 1e3\nv 1e3 -1e3 -1e3\nv -1e3 1e3 -1e3\nv -1e3 -1e3 1e3\n"
    mesh.write_text(corners + "f 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n")
    body = {"shape": str(mesh), "radius_m": None, "meters_per_unit": 1}
    with pytest.raises(ConfigurationError, match=r"body\.shape.*1\.05e\+03 m; .*meters_per_unit"):
        check_inputs(merged(config, {"task2": {"body": body}}))
    check_inputs(merged(config, {"task2": {"body": body | {"meters_per_unit": 0.001}}}))


OUTPUTS = ["r/task2/{scenario}/{architecture}/nt{n,[1-9]}_dt{minutes}.nc", "r/orbits/tracked.nc"]
OUTPUTS += ["r/told_{scenario}.csv", "r/told_elsewhere_{scenario}.csv"]
KNOWN = {"scenario": ["A", "B"], "architecture": ["tpe"]}


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ("r/task2/Q/tpe/nt5_dt60.nc", "scenario 'Q' is none of this configuration, which has A, B"),
        ("r/task2/A/tpx/nt5_dt60.nc", "architecture 'tpx' is none of this"),
        ("r/told_elsewhere_Q.csv", "scenario 'elsewhere_Q' is none of this"),
        ("r/fig99.png", "r/fig99.png: nothing makes a file of this name"),
    ],
)
def test_a_file_nothing_makes_is_refused_by_what_is_wrong(asked, message):
    for name in ("r/task2/B/tpe/nt5_dt60.nc", "r/told_elsewhere_A.csv"):
        check_request(name, OUTPUTS, KNOWN, made=True)
    with pytest.raises(ConfigurationError) as refused:
        check_request(asked, OUTPUTS, KNOWN, made=False)
    assert message in str(refused.value) and "\n" not in str(refused.value)


def test_missing_kernel_is_named(config, tmp_path):
    with pytest.raises(InputFileError, match=r"de440\.bsp: no such file"):
        check_inputs(with_change(config, "ephemeris.kernel", str(tmp_path / "de440.bsp")))


@pytest.mark.parametrize(
    ("key", "named"),
    [
        ("task2.body.shape", r"'task2\.body\.shape'"),
        ("scenarios.B.settings.task2.truth.body.shape", r"'scenarios\.B\.settings.*truth.*shape'"),
        (
            "task2.variants.families.f.changes.odd.truth.body.shape",
            r"families\.f\..*truth\.body\.shape'",
        ),
    ],
)
@pytest.mark.parametrize(("content", "said"), [(None, "cannot read"), ("v 0 0 0\n", "0 facets")])
def test_a_mesh_that_cannot_be_used_is_named(config, tmp_path, key, named, content, said):
    mesh = tmp_path / "body.obj"
    if content is not None:
        mesh.write_text(content, encoding="utf-8")
    change = str(mesh)
    for part in reversed(key.split(".")):
        change = {part: change}
    with pytest.raises(ConfigurationError, match=rf"{named}: .*body\.obj: {said}"):
        check_inputs(merged(config, change))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "there is no such table"),
        ("incidence_deg,emission_deg,brdf_per_sr\n0,0,0.1\n90,90,0.1\n", "no brdf_per_sr at"),
    ],
)
def test_a_table_of_a_reflection_law_is_checked_before_anything_runs(
    config, tmp_path, content, said
):
    table = tmp_path / "law.csv"
    if content is not None:
        table.write_text(content, encoding="utf-8")
    change = {"task2": {"truth": {"reflection": str(table)}}}
    message = rf"'task2\.truth\.reflection': .*law\.csv: {said}"
    with pytest.raises(InputFileError, match=message):
        check_inputs(merged(config, change))


CUBE = """
v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1
usemtl tank\nf 1 3 2\nf 1 2 4\nf 1 4 3\nusemtl nozzle\nf 2 3 4
"""


OWN = "row 2, target '0'"


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("0,{mesh},,tank=foil", rf"{OWN}: .*facet 4, of group 'nozzle', has no material"),
        ("0,{open},,", rf"{OWN}: .*open.obj: 3 facets cannot close a body"),
        ("0,{inverted},,", rf"{OWN}: .*facet 1 and all others face inward"),
        ("0,icosahedron,-1,", rf"{OWN}: radius_m = '-1' must be a number above 0"),
        ("0,icosahedron,,", rf"{OWN}: an icosahedron has no size"),
        ("0,teapot,1,", rf"{OWN}: shape 'teapot' is none of"),
        ("0,{mesh},1000,", rf"{OWN}: .*as large as a sphere of 1e\+03 m"),
        (
            "0,{mesh},1,tank=gold; nozzle=foil",
            rf"{OWN}: material 'gold' of group 'tank' is none of",
        ),
        ("0,{mesh},1,tank=1 1 2 1 0; nozzle=foil", rf"{OWN}: material diffuse_albedo = 2"),
        ("GATEWAY,icosahedron,1,", r"row 2, target 'GATEWAY': is none of scenario A, .* 0 to 201"),
        (
            "0,icosahedron,1,\n0,icosahedron,1,",
            r"row 3, target '0': the target is taken already in row 2",
        ),
        ("0,icosahedron", r"row 2: 2 fields where the header has 4"),
    ],
)
def test_a_table_of_bodies_is_checked_before_anything_runs(config, tmp_path, row, message):
    closed = CUBE.splitlines()
    meshes = {"mesh": closed, "open": closed[:-1], "inverted": []}
    turned = {line: " ".join(["f", *line.split()[:0:-1]]) for line in closed if line[:1] == "f"}
    meshes["inverted"] = [turned.get(line, line) for line in closed]
    paths = {}
    for name, lines in meshes.items():
        paths[name] = tmp_path / f"{name}.obj"
        paths[name].write_text("\n".join(lines))
    table = tmp_path / "bodies.csv"
    table.write_text("target,shape,radius_m,materials\n" + row.format(**paths))
    change = {"task2": {"truth": {"body": {"table": str(table)}}}}
    with pytest.raises(CislunarError, match=rf"bodies\.csv, {message}") as refused:
        check_inputs(merged(config, change))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("moments", "message"),
    [
        ("1,1.2,", r"give all of inertia_x, inertia_y, inertia_z, or none"),
        ("1,-1,1", r"inertia_y = '-1' must be a number above 0"),
        ("1,heavy,1", r"inertia_y = 'heavy' must be a number above 0"),
        ("1,1,3", r"principal moments of inertia .* none may exceed the sum of the other two"),
    ],
)
def test_impossible_inertia_in_a_table_of_bodies_is_named(config, tmp_path, moments, message):
    table = tmp_path / "bodies.csv"
    header = "target,shape,radius_m,inertia_x,inertia_y,inertia_z\n"
    table.write_text(f"{header}0,icosahedron,1,{moments}")
    change = {"task2": {"body": {"table": str(table)}}}
    with pytest.raises(CislunarError, match=rf"bodies\.csv, {OWN}: {message}") as refused:
        check_inputs(merged(config, change))
    assert "\n" not in str(refused.value)


def test_horizon_that_is_no_whole_number_of_steps_is_named(config):
    with pytest.raises(ConfigurationError, match=r"'visibility\.duration_days' = 30 .*= 7"):
        check_inputs(with_change(config, "visibility.step_hours", 7))


def test_atpe_without_its_package_is_named(config, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigurationError, match=r"architecture\.optimizers.*lightgbm"):
        check_inputs(with_change(config, "architecture.optimizers", ["atpe"]))


def test_family_too_small_for_the_published_architecture_is_named(config):
    assert [family for family, _ in PUBLISHED["A"]].count("Halo_L2_S") == 4
    small = with_change(config, "orbits.members.Halo_L2_S", 3)
    with pytest.raises(ConfigurationError, match=r"Halo_L2_S' = 3.*scenario A needs 4"):
        check_inputs(small)
    check_inputs(with_change(small, "architecture.optimizers", ["exact", "tpe"]))
    del small["orbits"]["members"]["Halo_L2_S"]
    with pytest.raises(ConfigurationError, match=r"Halo_L2_S' = 0"):
        check_inputs(small)


def test_too_few_satellites_for_the_published_architecture_are_named(config):
    few = with_change(config, "architecture.max_satellites", 8)
    with pytest.raises(ConfigurationError, match=r"max_satellites' = 8.*scenario C has 10"):
        check_inputs(few)
    check_inputs(with_change(few, "scenarios", {"A": {"targets": 100}}))


@pytest.fixture
def points(config, tmp_path):
    """A file of sampled points, newer than the mission table."""
    path = tmp_path / "zvs_points.nc"
    dataset = xr.Dataset(
        {"position": variable(("point", "axis"), np.zeros((50, 3)), "1", "points")},
        attrs=provenance("points", settings={"targets": config["targets"]})
        | {"distinct_points": 40},
    )
    write_dataset(dataset, path)
    return path


def test_more_targets_than_points_are_refused(config, points):
    check_target_count(points, "A", 40, config["targets"])
    with pytest.raises(ConfigurationError, match=r"'scenarios\.A\.targets' = 41: only 40"):
        check_target_count(points, "A", 41, config["targets"])


def test_points_that_will_be_made_anew_are_not_judged(config, points, tmp_path):
    finer = config["targets"] | {"angular_step_deg": 1}
    check_target_count(points, "A", 41, finer)
    check_target_count(tmp_path / "none_yet.nc", "A", 41, config["targets"])
    table = tmp_path / "missions.csv"
    table.write_text("mission,jacobi\nGateway,3.05\n", encoding="utf-8")
    os.utime(table, (points.stat().st_mtime + 10,) * 2)
    check_target_count(points, "A", 41, config["targets"] | {"missions": str(table)})


def test_other_seeding_keeps_the_points(config, points):
    with pytest.raises(ConfigurationError, match="only 40"):
        check_target_count(points, "A", 41, config["targets"] | {"seeding": "random"})


def test_damaged_points_are_left_to_the_job(config, points):
    points.write_bytes(points.read_bytes()[:100])
    check_target_count(points, "A", 41, config["targets"])
