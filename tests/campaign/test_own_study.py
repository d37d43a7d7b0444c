"""Scenarios of a user: their settings, tables of targets, and sweeps."""

import datetime
import json
import os
import re

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml
from campaign_folder import ROOT, copy_workflow, read_campaign, snakemake, with_change

from cislunar.campaign.data.own_targets import own_static_dataset, own_tracked_dataset
from cislunar.campaign.kernels import kernel_set, tracking_kernels
from cislunar.campaign.settings.cell_settings import RECOMMENDED, cell_settings, in_mode
from cislunar.campaign.settings.cells import campaign_cells, variant_cells
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.families import sweep_points, swept_cells, with_families
from cislunar.campaign.settings.preflight import check_inputs, check_orbits
from cislunar.campaign.settings.reading import merged, with_types
from cislunar.campaign.settings.scenarios import (
    SECTIONS,
    in_study,
    longest_horizon,
    orbits_of,
    scenario_settings,
    shared_dataset,
    tracked_count,
)
from cislunar.campaign.tracking.summary import PER_CELL, PER_PART
from cislunar.campaign.tracking.sweep_table import COLUMNS, plotted_values, sweep_rows
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.figures.search.sweep import sweep_figure
from cislunar.runtime.netcdf import read_dataset
from cislunar.targets.tables import load_target_positions, load_target_states
from cislunar.tasking.initial_conditions import epoch_states


def _yaml(name):
    return yaml.safe_load((ROOT / "config" / name).read_text(encoding="utf-8"))


@pytest.fixture
def paper(tmp_path):
    """The configuration of the full campaign."""
    return read_campaign(ROOT / "config") | {"results": str(tmp_path)}


@pytest.fixture
def study(paper, monkeypatch):
    """The example, read from the repository's root as its command does."""
    monkeypatch.chdir(ROOT)
    return merged(paper, _yaml("examples/own_study.yaml") | {"results": paper["results"]})


# Settings of a scenario


def test_the_papers_scenarios_have_the_settings_of_the_campaign(paper):
    printed = {"photometry": {"irradiance": "4pi"}}
    printed["tasking"] = {"diffuse_reflection_coefficient": 0.5}
    for scenario in "ABC":
        own = scenario_settings(paper, scenario)
        assert own == merged({key: paper[key] for key in SECTIONS}, {"task2": printed})
        for name in ("ephemeris/sun", "targets/zvs_points", "orbits/tracked"):
            assert shared_dataset(paper, scenario, name) == f"{name}.nc"
    whole = with_families(in_study(paper))
    whole["task2"]["variants"] = paper["task2"]["variants"]
    assert whole == paper


def test_a_scenario_inherits_other_settings(study):
    own = scenario_settings(study, "D")
    assert own["visibility"]["exclusion_deg"] == {"sun": 40, "moon": 8, "earth": 20}
    assert own["visibility"]["target_radius_m"] == study["visibility"]["target_radius_m"]
    assert own["task2"]["material"]["diffuse_albedo"] == 0.3
    assert own["task2"]["material"]["specular_weight"] == 0.5
    assert own["ephemeris"]["step_minutes"] == study["ephemeris"]["step_minutes"]
    assert study["visibility"]["exclusion_deg"] == {"sun": 35, "moon": 5, "earth": 15}
    assert cell_settings(own["task2"])["sensor"]["magnitude_noise"] == 0.05


def test_scenarios_with_the_same_settings_share_their_data(study):
    whole = with_families(
        study | {"scenarios": {"A": {"targets": 9}, "D": study["scenarios"]["D"]}}
    )
    whole["scenarios"]["E"] = {"targets": 5, "settings": {"targets": {"seeding": "random"}}}
    for name in ("ephemeris/sun", "targets/zvs_points", "orbits/tracked"):
        assert shared_dataset(whole, "A", name) == f"{name}.nc"
        assert shared_dataset(whole, "E", name) == f"{name}.nc"
        assert shared_dataset(whole, "D", name) == f"{name}_D.nc"
        assert shared_dataset(whole, "D-limit-17", name) == f"{name}_D.nc"
    longer = merged(
        whole, {"scenarios": {"A": {"settings": {"visibility": {"duration_days": 31}}}}}
    )
    assert shared_dataset(longer, "A", "ephemeris/sun") == "ephemeris/sun_A.nc"
    assert shared_dataset(longer, "A", "targets/zvs_points") == "targets/zvs_points.nc"


def test_references_to_an_omitted_scenario_are_omitted(paper):
    changed = merged(paper, {"scenarios": {"A": None}})
    check_campaign(changed)
    left = in_study(changed)
    assert list(left["scenarios"]) == ["B", "C"]
    cells = campaign_cells(with_families(left)["task2"])
    assert {cell.scenario for cell in cells} == {"B", "C"}
    assert variant_cells(with_families(left)["task2"]) == []
    for section, key in (("architecture", "readings"), ("task2", "tasking_comparison")):
        assert left[section][key]["scenario"] is None
    assert paper["scenarios"]["A"]["targets"] == 100
    with pytest.raises(ConfigurationError, match="'scenarios': every scenario is null"):
        check_campaign(merged(paper, {"scenarios": dict.fromkeys("ABC")}))


def test_a_variant_may_name_its_scenario(study):
    family = {"scenario": "D", "architecture": "exact", "targets": [6], "changes": {}}
    family["changes"]["few"] = {"seeds": 1}
    changed = with_change(study, "task2.variants.families.few", family)
    check_campaign(changed)
    assert [cell.path for cell in variant_cells(with_families(in_study(changed))["task2"])][:1] == [
        f"task2/D/exact/{study['task2']['estimators'][0]}/nt6_dt60_few.nc"
    ]


def test_the_example_is_accepted(study):
    check_campaign(study)
    check_inputs(study)
    assert tracked_count(study, "D") == 12
    typed = with_types({"scenarios": {"D": {"settings": {"epoch_jd": "2461465.5"}}}})
    assert typed["scenarios"]["D"]["settings"]["epoch_jd"] == 2461465.5


@pytest.mark.parametrize(
    "date",
    [
        *("2027-03-01", "2027-03-01T00:00:00", "2027-060", "2461465.5"),
        *(datetime.date(2027, 3, 1), datetime.datetime(2027, 3, 1, tzinfo=datetime.UTC)),
    ],
)
def test_an_epoch_may_be_a_date(paper, date):
    checked = check_campaign(with_types(paper | {"epoch_jd": date}))
    assert checked["epoch_jd"] == 2461465.5


@pytest.mark.parametrize(
    "date, message",
    [
        ("2027-02-29", "'2027-02-29' is not a date: write it like 2024-10-01T00:00:00"),
        ("1969-07-20", "must be a Julian date, at least 2,441,317.5, or a date like"),
        (True, "must be a Julian date"),
        ([2027, 3, 1], "must be a Julian date"),
        ("soon", "'soon' is not a date"),
    ],
)
def test_an_epoch_that_is_no_date_is_refused_in_a_line(paper, date, message):
    with pytest.raises(ConfigurationError, match=message) as caught:
        check_campaign(with_types(paper | {"epoch_jd": date}))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("scenarios.D.settings.visibility.limiting_magnitud", 18, "did you mean 'limiting_magn"),
        ("scenarios.D.settings.seed", 1, "unknown configuration key 'scenarios.D.settings.seed'"),
        ("scenarios.D.settings.task2.estimators", ["mukf"], "scenarios.D.settings.task2.estimat"),
        ("scenarios.D.settings.task2.step_s", 70, "'scenarios.D.settings.task2.duration_hours'"),
        ("scenarios.D.settings.visibility.duration_days", 0.2, "exceeds the ephemeris"),
        ("scenarios.D.static_targets", "some.csv", "'scenarios.D': give either targets"),
        ("scenarios.D.tracked", "nowhere.csv", "nowhere.csv: no such file"),
        ("task2.target_counts.D", [13], "'task2.target_counts.D': 13 targets, but scenario D has"),
        ("sweeps.noise.targets", [13], "'sweeps.noise.targets': 13 targets"),
        ("sweeps.noise.targets", [], "'sweeps.noise.targets' is empty"),
        ("sweeps.noise.scenario", "E", "'sweeps.noise.scenario' = 'E' is none of"),
        ("sweeps.noise.key", "settings.task2.sensor.noise", "'sweeps.noise.key': unknown"),
        ("sweeps.noise.values", [0.1, 0], "'sweeps.noise.values': configuration key 'sensor.mag"),
        ("sweeps.noise.values", ["a b", "a-b"], "would be called 'noise-a-b'"),
        ("sweeps.limit.key", "visibility.limiting_magnitude", "scenarios.D-limit-17.visibility'"),
        ("sweeps.limit.architecture", "published", "'sweeps.limit.architecture' = 'published'"),
        ("sweeps.noise.architecture", "pear", "'sweeps.noise.architecture' = 'pear': must be one"),
        ("task2.architectures", ["exact", "pear"], "'task2.architectures.1' = 'pear': must be one"),
        ("task2.other_architectures.pear", {"D": [6]}, "'task2.other_architectures' = 'pear': mus"),
        ("observers.exact", "some.csv", "'observers': name 'exact' is taken; choose another"),
        ("observers.a_b", "some.csv", "'observers': name 'a_b' is not allowed: must be one of tpe"),
    ],
)
def test_faults_of_a_study_are_one_line_that_names_the_key(study, key, value, message):
    with pytest.raises((ConfigurationError, InputFileError)) as refused:
        check_campaign(with_change(study, key, value))
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("targets.missions", "nowhere.csv", "nowhere.csv: no such file"),
        ("ephemeris.kernel", "nowhere.bsp", "nowhere.bsp: no such file"),
        ("ephemeris.kernel", "config/config.yaml", "config/config.yaml: not a"),
        ("epoch_jd", 2461500.5, "de421_2027.bsp: covers 2027-02-28T00:01 to 2027-04-11"),
        ("visibility.step_hours", 7, "'scenarios.D.settings.visibility.duration_days' = 10"),
    ],
)
def test_faulty_files_of_a_scenario_are_found_before_anything_runs(study, key, value, message):
    changed = with_change(study, f"scenarios.D.settings.{key}", value)
    with pytest.raises((ConfigurationError, InputFileError), match=re.escape(message)) as refused:
        check_inputs(changed)
    assert "\n" not in str(refused.value)


def test_a_faulty_table_of_observers_is_found_before_anything_runs(study, tmp_path):
    table, made = tmp_path / "observers.csv", tmp_path / "orbits/observers_pair.nc"
    changed = in_study(check_campaign(with_change(study, "observers.pair", str(table))))
    with pytest.raises(InputFileError, match=r"observers\.csv: no such file"):
        check_orbits(changed)
    table.write_text("id,family,jacobi\none,Vertical_L1,5\n")
    with pytest.raises(InputFileError, match=r"row 2, observer 'one': no member of Vertical_L1"):
        check_orbits(changed)
    table.write_text("id,x,y,z,vx,vy,vz\none,0.8,0.1,0.05,0.1,-0.2,0.1\n")
    check_orbits(changed)
    # orbits that are newer than the table are not computed again
    made.parent.mkdir()
    made.touch()
    table.write_text("nonsense")
    os.utime(table, (1e9, 1e9))
    check_orbits(changed)


def test_observers_of_a_user_are_an_architecture(study):
    changed = with_change(study, "sweeps.noise.architecture", "pair")
    check_campaign(changed)
    assert swept_cells(changed, "noise")[0].path.startswith("task2/D/pair/")
    assert orbits_of("pair", own=True) == "orbits/observers_pair.nc"
    assert orbits_of("tpe", own=False) == "orbits/families.nc"
    assert longest_horizon(with_families(in_study(study))) == 10


def test_epoch_outside_the_kernel_of_the_campaign_is_named(paper, monkeypatch):
    monkeypatch.chdir(ROOT)
    with pytest.raises(InputFileError, match=r"de421\.bsp: covers 1899.*change epoch_jd"):
        check_inputs(paper | {"epoch_jd": 2480000.5})


# Tables of targets

HEADER = "id,x,y,z,vx,vy,vz"
KM = "id,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s"
GOOD = "one,0.5,0.1,0,0.1,0.2,0"
NEAR_RECTILINEAR = "1.02869104,0,-0.18633781,0,-0.11733440,0"


def table(tmp_path, *rows):
    path = tmp_path / "targets.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_both_units_give_the_same_states(tmp_path):
    plain = load_target_states(table(tmp_path, HEADER + ",period,family", GOOD + ",2.5,halo"))
    speed = LENGTH_UNIT_KM / TIME_UNIT_S
    scaled = [0.5 * LENGTH_UNIT_KM, 0.1 * LENGTH_UNIT_KM, 0.0, 0.1 * speed, 0.2 * speed, 0.0]
    row = ",".join(map(repr, [*scaled, 2.5 * TIME_UNIT_S / 86400.0]))
    header = "x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s,period_days,id,note"
    practical = load_target_states(table(tmp_path, header, f'{row},one,"a, note"'))
    np.testing.assert_allclose(practical.state, plain.state, rtol=1e-15)
    np.testing.assert_allclose(plain.state, [[0.5, 0.1, 0.0, 0.1, 0.2, 0.0]])
    assert practical.period[0] == pytest.approx(2.5, rel=1e-15)
    assert plain.period[0] == 2.5
    assert (plain.name, plain.family) == (["one"], ["halo"])
    assert (practical.name, practical.family) == (["one"], ["own"])


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([], "row 1: no column id"),
        ([HEADER], "contains no target"),
        (["x,y,z,vx,vy,vz", "0.5,0,0,0,0,0"], "row 1: no column id"),
        (["id,x,y,z,vx,vy", "one,0.5,0,0,0,0"], "needs the columns vx, vy, vz (nondimensional)"),
        (["id,x,y,z_km,vx,vy,vz", "one,0.5,0,0,0,0,0"], "needs the columns x, y, z (nondim"),
        (["id,x,y,z,x_km,y_km,z_km,vx,vy,vz", "one,.5,0,0,2,0,0,0,0,0"], "both x, y, z and x_km"),
        ([HEADER + ",x", GOOD + ",1"], "row 1: column x occurs twice"),
        ([HEADER, GOOD, GOOD], "row 3, target 'one': the id is taken already in row 2"),
        ([HEADER, ",0.5,0.1,0,0.1,0.2,0"], "row 2: the target has no id"),
        ([HEADER, "one,0.5,nan,0,0.1,0.2,0"], "row 2, target 'one': y = 'nan' must be a finite"),
        ([HEADER, "one,0.5,0.1,0,0.1,fast,0"], "row 2, target 'one': vy = 'fast' must be a fin"),
        ([HEADER, "one,0.5,0.1,0,0.1,,0"], "vy = '' must be a finite number"),
        ([HEADER, "one,0.5,0.1"], "row 2: 3 fields where the header has 7"),
        ([HEADER, GOOD, "", "two,0.99,0.001,0,0,0,0"], "row 4, target 'two': lies inside the Moon"),
        ([HEADER, "one,-0.01,0,0.01,0,0,0"], "lies inside the Earth"),
        ([HEADER + ",period", GOOD + ",-1"], "period = -1, taken in units of 4.34248 days, must"),
        ([HEADER, "one,388000,1,0,0.1,0.2,0"], "'one': x = 388000 is taken in units of 384400 km"),
        ([HEADER, "one,0.8,0,0.1,100,0,0"], "vx = 100 is taken in units of 1.02455 km/s, which"),
        ([KM, "one,331602,-21210,0,-29,-120,89"], "'one': vy_km_s = -120 is taken in km/s"),
        ([KM, "one,331602056,0,0,0,.1,0"], "x_km = 3.31602e+08 is taken in km, which puts"),
        ([KM + ",period_days", "one,331602,0,0,0,.1,0,1e6"], "period_days = 1e+06, taken in days"),
    ],
)
def test_faults_of_target_tables_are_one_line_that_names_the_field(tmp_path, rows, message):
    path = table(tmp_path, *rows)
    with pytest.raises(InputFileError) as refused:
        load_target_states(path)
    assert message in str(refused.value)
    assert str(refused.value).startswith(str(path))
    assert "\n" not in str(refused.value)


def test_unreadable_tables_are_refused(tmp_path):
    with pytest.raises(InputFileError, match=r"nowhere\.csv: no such file"):
        load_target_positions(tmp_path / "nowhere.csv")
    with pytest.raises(InputFileError, match="cannot be read as a table in UTF-8"):
        load_target_positions(tmp_path)
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00id")
    with pytest.raises(InputFileError, match="cannot be read as a table in UTF-8"):
        load_target_positions(binary)


def test_targets_without_a_period_start_at_their_states(tmp_path):
    rows = ["one,0.5,0.1,0,0.1,0.2,0,", f"two,{NEAR_RECTILINEAR},1.59919"]
    tracked = own_tracked_dataset(table(tmp_path, HEADER + ",period", *rows))
    start = epoch_states(tracked["state"].values, tracked["period"].values, seed=4)
    np.testing.assert_array_equal(start[0], tracked["state"].values[0])
    assert np.abs(start[1] - tracked["state"].values[1]).max() > 1e-3


def test_targets_with_a_period_must_be_on_closed_orbits(study, tmp_path):
    row = f"two,{NEAR_RECTILINEAR},1.4"
    path = table(tmp_path, HEADER + ",period", "one,0.5,0.1,0,0.1,0.2,0,", row)
    changed = with_change(in_study(study), "scenarios.D.tracked", str(path))
    changed = with_change(changed, "results", str(tmp_path)) | {"observers": {}}
    with pytest.raises(InputFileError, match=r"csv, target 'two': not closed: half a period ahead"):
        check_orbits(changed)
    made = tmp_path / "orbits/tracked_D.nc"
    made.parent.mkdir()
    made.touch()
    os.utime(path, (1e9, 1e9))
    check_orbits(changed)


def test_static_targets_need_no_velocities(tmp_path):
    static = own_static_dataset(table(tmp_path, "id,x,y,z", "one,0.5,0.1,0", "two,1.2,0,0.3"), "D")
    np.testing.assert_array_equal(static["position"], [[0.5, 0.1, 0.0], [1.2, 0.0, 0.3]])
    assert list(static["name"].values) == ["one", "two"]


# Sweeps


def test_a_sweep_of_the_tracking_makes_variants(study):
    points = sweep_points(study, "noise")
    assert [point.variant for point in points] == [f"noise-{v}" for v in (0.02, 0.05, 0.2)]
    assert {point.scenario for point in points} == {"D"}
    whole = with_families(in_study(study))
    own = scenario_settings(whole, "D")["task2"]
    changed = cell_settings(own, "noise-0.2")
    assert changed["sensor"] == cell_settings(own)["sensor"] | {"magnitude_noise": 0.2}
    without = with_families(in_study(study | {"sweeps": {}}))
    assert campaign_cells(whole["task2"]) == campaign_cells(without["task2"])
    estimators = study["task2"]["estimators"]
    paths = [cell.path for cell in swept_cells(study, "noise")]
    assert paths[0] == f"task2/D/exact/{estimators[0]}/nt12_dt60_noise-0.02.nc"
    assert len(set(paths)) == 3 * len(estimators)


def test_a_sweep_of_the_optimization_makes_scenarios(study):
    whole = with_families(in_study(study))
    names = [f"D-limit-{value}" for value in (17, 18.5, 20)]
    assert list(whole["scenarios"]) == ["D", *names]
    for value, name in zip((17, 18.5, 20), names, strict=True):
        own = scenario_settings(whole, name)
        assert own["visibility"]["limiting_magnitude"] == value
        del own["visibility"]["limiting_magnitude"]
        usual = scenario_settings(whole, "D")
        del usual["visibility"]["limiting_magnitude"]
        assert own == usual
    assert swept_cells(study, "limit") == []
    tracking = with_change(study, "sweeps.limit.targets", [12])
    assert swept_cells(tracking, "limit")[0].path.startswith("task2/D-limit-17/exact/")


def test_values_of_a_sweep_have_different_names(study):
    values = [-1, 1, 1e-5, 0.5, True, "config/some missions.csv"]
    changed = with_change(study, "sweeps.noise.values", values)
    assert [point.variant.removeprefix("noise-") for point in sweep_points(changed, "noise")] == [
        *("m1", "1", "1em05", "0.5", "true", "config-some-missions.csv")
    ]


def _summary(cells, quantity="coverage"):
    """Statistics of some cells with two seeds, every value an eighth of the cell's number."""
    shape = (len(cells), 2)
    data = {name: (("cell", "seed", "part"), np.ones((*shape, 4))) for name in PER_PART}
    data |= {name: (("cell", "seed"), np.ones(shape)) for name in PER_CELL}
    whole = np.broadcast_to(np.arange(len(cells))[:, None, None] / 8.0, (*shape, 4))
    data[quantity] = (("cell", "seed", "part"), whole)
    fields = ("scenario", "architecture", "estimator", "variant", "targets", "interval_minutes")
    coords = {field: ("cell", [getattr(cell, field) for cell in cells]) for field in fields}
    coords["observers"] = ("cell", [7] * len(cells))
    coords["part_unit"] = ("part", ["1", "rad s-1", "1", "1"])
    return xr.Dataset(data, coords=coords)


def test_the_table_of_a_sweep_has_every_value(study, tmp_path):
    cells, points = swept_cells(study, "noise"), sweep_points(study, "noise")
    table = sweep_rows("noise", study["sweeps"]["noise"], points, [], _summary(cells))
    assert tuple(table.columns) == COLUMNS
    covered = table[(table["quantity"] == "coverage") & (table["part"] == "attitude")]
    assert [*zip(covered["estimator"], covered["value"], covered["mean"], strict=True)] == [
        (cell.estimator, value, k / 8.0)
        for k, (cell, value) in enumerate(zip(cells, [0.02, 0.05, 0.2] * 2, strict=False))
    ]
    assert set(table["key"]) == {"settings.task2.sensor.magnitude_noise"}


def test_values_of_several_keys_are_shown_by_their_names(paper, tmp_path):
    """Tested with the study of tasking."""
    tasking = merged(paper, _yaml("tasking.yaml") | {"results": str(tmp_path)})
    study = in_study(check_campaign(tasking))
    points = sweep_points(study, "tasking")
    cells = swept_cells(study, "tasking")[: len(points)]
    own = scenario_settings(with_families(study), "A")["task2"]
    changed = cell_settings(own, "recommended")["tasking"]
    usual = cell_settings(own, "as-in-the-paper")
    longer = {**RECOMMENDED, "slot_minutes": 30}
    assert in_mode({"mode": "recommended", "slot_minutes": 30}) == longer
    assert usual == cell_settings(own) and changed != usual["tasking"]
    assert changed["slot_minutes"] == changed["expected_measurements"] == 20
    table = sweep_rows("tasking", study["sweeps"]["tasking"], points, [], _summary(cells))
    assert list(table["value"].unique()) == [point.variant for point in points]
    assert sweep_figure(table).axes
    gap = np.full((len(cells), 2), np.nan)
    gap[-1] = 0.02
    known = _summary(cells).assign(planning_gap=(("cell", "seed"), gap))
    rows = sweep_rows("tasking", study["sweeps"]["tasking"], points, [], known)
    rows = rows[rows["quantity"] == "planning_gap"]
    assert rows["mean"].dropna().tolist() == [0.02]
    assert "planning_gap" not in set(table["quantity"])


def test_a_sweep_may_change_several_keys_of_the_tracking(paper, tmp_path):
    """Tested with the study of dynamics."""
    changed = merged(paper, _yaml("dynamics.yaml") | {"results": str(tmp_path)})
    study = in_study(check_campaign(changed))
    cells, points = swept_cells(study, "perigee"), sweep_points(study, "perigee")
    assert {point.scenario for point in points} == {"A"} and len(cells) == 2 * len(points)
    task2 = scenario_settings(with_families(study), "A")["task2"]
    chosen = cell_settings(task2, "perigee-real-cr3bp-noise")
    assert chosen["start_day"] == 15 and chosen["process_noise"]["acceleration_m2_s3"] == 3e-5
    assert chosen["dynamics"]["filter"] == "cr3bp"
    assert tracking_kernels(chosen, "mukf") == kernel_set("tracking-mukf-cr3bp")
    real = cell_settings(task2, "real")
    assert tracking_kernels(real, "batch") == kernel_set("tracking-batch-ephemeris")
    plain = cell_settings(task2, "cr3bp")
    assert tracking_kernels(plain, "mukf") == kernel_set("tracking-mukf")


def test_the_ephemeris_campaign_shares_refined_orbits_among_scenarios(paper, tmp_path):
    real = merged(paper, _yaml("ephemeris.yaml") | {"results": str(tmp_path)})
    again = {"settings": {"visibility": {"limiting_magnitude": 17}}}
    other = {"settings": {"task2": {"dynamics": {"observers": "reference"}}}}
    scenarios = {"D": {"targets": 10, **again}, "E": {"targets": 10, **other}}
    study = in_study(check_campaign(merged(real, {"scenarios": scenarios})))
    assert list(study["scenarios"]) == ["A", "D", "E"]
    for name, file in (("A", "paths"), ("D", "paths"), ("E", "paths_E")):
        own = scenario_settings(study, name)
        assert own["visibility"]["dynamics"] == own["task2"]["dynamics"]["truth"] == "ephemeris"
        assert shared_dataset(study, name, "orbits/paths") == f"orbits/{file}.nc"
    usual = check_campaign(merged(paper, {"results": str(tmp_path)}))
    assert "dynamics" not in usual["visibility"]


def test_the_table_of_a_sweep_of_architectures_has_their_values(study, tmp_path):
    points = sweep_points(study, "limit")
    reached = [{"J": 1e-3 * k, "satellites": 10.0 + k} for k in range(3)]
    table = sweep_rows("limit", study["sweeps"]["limit"], points, reached, None)
    table.to_csv(tmp_path / "table.csv", index=False)
    read = pd.read_csv(tmp_path / "table.csv")
    assert list(read[read["quantity"] == "J"]["mean"]) == [0.0, 1e-3, 2e-3]
    assert list(read[read["quantity"] == "J"]["observers"]) == [10, 11, 12]
    assert read["targets"].isna().all()
    names, numbers = plotted_values(read)
    assert names == ["17.0", "18.5", "20.0"]
    np.testing.assert_array_equal(numbers, [17.0, 18.5, 20.0])
    assert plotted_values(pd.DataFrame({"value": [True, False]}))[1] is None


REACHED = {"J": 1e-3, "satellites": 10.0, "union_coverage": 0.5, "static_never_seen": 2.0}


@pytest.mark.parametrize(
    ("values", "architectures", "log"),
    [
        ([0.02, 0.05, 0.2], [], True),
        ([17, 18.5, 20], [REACHED] * 3, False),
        (["config/missions.csv", "b.csv", "c.csv"], [REACHED] * 3, False),
    ],
)
def test_the_figure_of_a_sweep_shows_every_value(study, tmp_path, values, architectures, log):
    changed = with_change(study, "sweeps.noise.values", values)
    cells, points = swept_cells(changed, "noise"), sweep_points(changed, "noise")
    sweep = changed["sweeps"]["noise"]
    table = sweep_rows("noise", sweep, points, architectures, _summary(cells))
    table.to_csv(tmp_path / "table.csv", index=False)
    figure = sweep_figure(pd.read_csv(tmp_path / "table.csv"))
    assert len(figure.axes) == 4 * (2 + bool(architectures))
    tracked = figure.axes[-8]
    assert tracked.get_xscale() == ("log" if log else "linear")
    lines = [line for line in tracked.lines if len(line.get_xdata()) == len(values)]
    estimators = len(study["task2"]["estimators"])
    named = isinstance(values[0], str)
    drawn = np.array([line.get_xdata() if named else line.get_ydata()
                      for line in lines if line.get_marker() not in ("_", "|")])  # fmt: skip
    np.testing.assert_allclose(
        drawn[:estimators], 12.5 * np.arange(3 * estimators).reshape(estimators, 3)
    )
    written = " ".join(text.get_text() for text in figure.texts)
    assert "noise of the magnitudes, mag" in written
    labels = [tick.get_text() for tick in figure.axes[0].get_yticklabels()]
    assert ("config/missions.csv" in labels) == named


# The example by its command

SMALLER = {
    "orbits": {"members": dict.fromkeys(_yaml("config.yaml")["orbits"]["members"], 1)},
    "scenarios": {"D": {"targets": 8, "settings": {"task2": {"seeds": 1, "duration_hours": 2}}}},
    "architecture": {"certificate": {"nodes": 1000}},
    "task2": {"estimators": ["mukf"], "realization_jobs": True},
    "sweeps": {"limit": {"values": [17, 20], "targets": [3]}},
}


# with sweeps of a scenario that is left out
OBSERVERS_ALONE = {
    "architecture": {"optimizers": []},
    "task2": {"architectures": ["pair"]},
    "sweeps": {"limit": {"scenario": "A"}, "noise": {"architecture": "pair"}},
}


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """A copy of the workflow, with a configuration smaller than the example."""
    folder = copy_workflow(tmp_path_factory.mktemp("own"))
    (folder / "smaller.yaml").write_text(yaml.safe_dump(SMALLER), encoding="utf-8")
    (folder / "pair.yaml").write_text(yaml.safe_dump(OBSERVERS_ALONE), encoding="utf-8")
    return folder


OWN = ("--configfile", "config/examples/own_study.yaml")


def planned(folder, *files):
    """Numbers of jobs by their rules."""
    output, code = snakemake(folder, "--dry-run", "--cores", "2", *OWN, *files)
    assert code == 0, output[-3000:]
    return {name: int(n) for name, n in re.findall(r"^(\w+) +(\d+)$", output, flags=re.MULTILINE)}


@pytest.mark.workflow
def test_given_observers_need_no_search(copied):
    jobs = planned(copied, "pair.yaml")
    assert jobs["own_architecture"] == jobs["observers_table"] == jobs["sweep_figure"] == 1
    assert jobs["tracking_cell_small"] > 4 and jobs["against_targets_figure"] == 1
    assert not {"families", "visibility", "search_run", "exact", "front", "readings"} & set(jobs)


@pytest.mark.workflow
def test_dry_run_of_the_example(copied):
    jobs = planned(copied)
    # D and the three values of its sweep over the limiting magnitude
    assert jobs["static_targets"] == jobs["visibility"] == jobs["exact"] == 4
    assert jobs["own_tracked_targets"] == jobs["ephemeris_of_scenario"] == 1
    assert jobs["zvs_points_of_scenario"] == 1
    assert jobs["sweep_table"] == jobs["sweep_figure"] == 2
    assert not {"ephemeris", "tracked_targets", "zvs_points", "published", "readings"} & set(jobs)
    assert not {"paper_vs_ours", "tasking_comparison", "tracking_claims"} & set(jobs)


@pytest.mark.workflow
def test_a_sweep_runs_from_input_tables_to_its_table(copied):
    results = copied / "results/own_study"
    wanted = "results/own_study/tables/sweep_limit.csv"
    output, code = snakemake(copied, "--cores", "2", *OWN, "smaller.yaml", "--", wanted)
    assert code == 0, output[-6000:]
    assert [*results.glob("benchmarks/tracking_realization/*/*/mukf/nt3_dt60*_0.tsv")]
    assert not [*results.glob("task2/*/*/mukf/*.checkpoint")]
    table = pd.read_csv(results / "tables/sweep_limit.csv")
    reached = table[table["quantity"] == "J"].set_index("value")["mean"]
    assert reached[20] > reached[17] > 0.0
    assert set(table.loc[table["targets"] == 3, "scenario"]) == {"D-limit-17", "D-limit-20"}
    for folder, names in (("ephemeris", ["sun_D.nc"]), ("orbits", ["families.nc", "tracked_D.nc"])):
        assert sorted(path.name for path in (results / folder).iterdir()) == names
    static = [read_dataset(results / f"targets/static_D-limit-{limit}.nc") for limit in (17, 20)]
    np.testing.assert_array_equal(static[0]["position"], static[1]["position"])
    cell = read_dataset(results / "task2/D-limit-20/exact/mukf/nt3_dt60.nc")
    used = json.loads(cell.attrs["settings"])
    assert used["sensor"]["magnitude_noise"] == 0.05
    assert used["material"]["diffuse_albedo"] == 0.3
    assert set(cell["family"].values) <= {"L1 halo", "L2 halo", "DRO", "resonant", "transfer"}
    # the initial estimate is within its uncertainty of the state in the table
    named = load_target_states(copied / "config/examples/targets.csv")
    error = cell["error"].isel(seed=0, time=0, component=slice(6, 9)).values
    assert np.abs(error).max() * LENGTH_UNIT_KM < 500.0
    assert cell["target_id"].max() < len(named)
