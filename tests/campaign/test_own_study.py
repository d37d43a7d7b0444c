"""Scenarios of a user: their settings, and the example by its command."""

import datetime
import json
import os
import re

import numpy as np
import pandas as pd
import pytest
import yaml
from campaign_folder import (
    ROOT,
    copy_workflow,
    read_settings,
    snakemake,
    with_change,
)

from cislunar.campaign.settings.cell_settings import cell_settings
from cislunar.campaign.settings.cells import campaign_cells, variant_cells
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.families import swept_cells, with_families
from cislunar.campaign.settings.preflight import check_inputs, check_orbits
from cislunar.campaign.settings.reading import merged, read_yaml, with_types
from cislunar.campaign.settings.scenarios import (
    SECTIONS,
    in_study,
    longest_horizon,
    orbits_of,
    scenario_settings,
    shared_dataset,
    tracked_count,
)
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.runtime.netcdf import read_dataset
from cislunar.targets.tables import load_target_states

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
    "values",
    [
        [datetime.date(2027, 3, 1), "2027-03-02"],
        {"first": datetime.date(2027, 3, 1), "second": datetime.datetime(2027, 3, 2)},
    ],
)
def test_values_of_a_sweep_may_be_dates(paper, values):
    sweep = {"scenario": "A", "key": "settings.epoch_jd", "architecture": "tpe", "values": values}
    checked = check_campaign(with_types(merged(paper, {"sweeps": {"date": sweep}})))
    made = [*with_families(in_study(checked))["scenarios"].values()][-2:]
    assert [each["settings"]["epoch_jd"] for each in made] == [2461465.5, 2461466.5]
    sweep["key"] = "targets"
    words = r"^configuration key 'sweeps.date': .*targets' = '2027-03-01': must be a whole number"
    with pytest.raises(ConfigurationError, match=words):
        check_campaign(with_types(merged(paper, {"sweeps": {"date": sweep}})))


def test_a_date_may_have_a_time_zone(paper):
    date = datetime.datetime.fromisoformat("2027-03-02T12:00:00+02:00")
    assert check_campaign(with_types(paper | {"epoch_jd": date}))["epoch_jd"] == pytest.approx(
        2461466.5 + 10.0 / 24.0, abs=1e-8
    )


@pytest.mark.parametrize(
    "text",
    [
        "a: {b: {c: &base {x: 1, y: 2}}, d: {e: &mid {<<: *base, y: 3}}}\nc: {<<: *mid, z: 4}\n",
        '{\n\t"a": 1,\n\t"b": [{"a": 2}]\n}',
        "a: &x\n  b: 1\nc: *x\n",
    ],
)
def test_files_of_settings_are_read_as_usual(tmp_path, text):
    path = tmp_path / "own.yaml"
    path.write_text(text)
    try:
        usual = json.loads(text)
    except json.JSONDecodeError:
        usual = yaml.safe_load(text)
    assert read_yaml(path, "a file of settings") == usual


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


# The example by its command

SMALLER = {
    "orbits": {"members": dict.fromkeys(read_settings("config.yaml")["orbits"]["members"], 1)},
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
