"""What a configuration is refused for, and the documents of its settings."""

import json
import os
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import yaml
from campaign_folder import ROOT, read_campaign, with_change

from cislunar.campaign.architectures.exact import exact_dataset
from cislunar.campaign.architectures.search_runs import best_run_dataset, search_run_dataset
from cislunar.campaign.architectures.table2 import near_optimal_rows
from cislunar.campaign.architectures.visibility import cost_function, visibility_dataset
from cislunar.campaign.data.inputs import sun_dataset
from cislunar.campaign.settings.architecture_tree import Design, ObjectiveFront, OwnInformation
from cislunar.campaign.settings.cell_tree import SensorGroup, Station
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.reading import RENAMED, merged
from cislunar.campaign.settings.schema import SCHEMA_FILE, schema_text
from cislunar.campaign.settings.tree import StatedSurvey
from cislunar.errors import ConfigurationError
from cislunar.estimation.initial_sigma import InitialSigma
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.runtime.netcdf import write_dataset
from workflow.documents.markdown import fill_blocks, generated_blocks
from workflow.documents.settings_tables import SETTINGS_BLOCKS


def random_runs(early_stop):
    """Three random searches over small tables, and the data sets of these tables."""
    rng = np.random.default_rng(2)
    per_count = ("orbit", "satellites")
    visibility = xr.Dataset(
        {
            "observations": ((*per_count, "target"), rng.integers(0, 30, (12, 3, 8)).astype("u2")),
            "distance": (per_count, rng.uniform(1.0, 3.0, (12, 1)) * np.arange(1, 4)),
        },
        attrs={"diffuse_reflection_coefficient": 1.0, "visibility_magnitude": 18.0, "n_steps": 10},
    )
    orbits = xr.Dataset(
        {
            "stability_index": ("orbit", 1.0 + rng.exponential(2.0, 12)),
            "family": ("orbit", np.repeat(["Halo_L1_N", "Lyap_L2"], 6)),
        }
    )
    runs = [
        search_run_dataset(
            visibility, orbits, scenario="A", method="random", labels="family_position", run=run,
            seed=7, slots=4, max_evaluations=150, early_stop=early_stop, sampler="compiled",
        )
        for run in range(3)
    ]  # fmt: skip
    return runs, visibility, orbits


@pytest.mark.parametrize("path", sorted((ROOT / "config").glob("*.yaml")), ids=lambda p: p.stem)
def test_the_studies_of_the_repository_are_valid(path, monkeypatch):
    monkeypatch.chdir(ROOT)
    check_campaign(read_campaign(path))


def test_best_of_runs_under_the_early_stop(tmp_path):
    patience = 12
    runs, *tables = random_runs(patience)
    assert all(run.sizes["evaluation"] == 150 for run in runs)
    best = best_run_dataset(runs, *tables, patience)
    for i, run in enumerate(runs):
        history = run["J_history"].values
        stop = next(k for k in range(patience, 150) if history[: k + 1].argmax() <= k - patience)
        assert best["run_evaluations"][i] == stop + 1
        reached = history[: stop + 1].max()
        assert best["run_J"][i] == reached
        assert best["full_J"][i] == history.max()
        k = int(history[: stop + 1].argmax())
        assert best["run_satellites"][i] == run["trial_satellites"][k].sum()
        np.testing.assert_array_equal(best["run_orbit"][i], run["trial_orbit"][k])
        np.testing.assert_array_equal(best["run_J_history"][i, : stop + 1], history[: stop + 1])
    assert np.any(best["run_J"] < best["full_J"])
    assert float(best["J"]) == pytest.approx(float(best["run_J"].max()), rel=1e-13)
    assert best["J_history"].max() == best["run_J"].max()
    cost = cost_function(*tables)
    assert cost.value(best["orbit"].values, best["satellites"].values) == float(best["J"])
    lambdas = [float(best[f"lambda_{k}"]) for k in range(1, 7)]
    assert abs(np.prod(lambdas)) == pytest.approx(float(best["J"]), rel=1e-13)
    write_dataset(best, tmp_path / "random.nc")


@pytest.fixture
def config(tmp_path):
    """The configuration of the full campaign, writing to a folder of the test."""
    return read_campaign() | {"results": str(tmp_path / "results")}


def test_a_run_without_observations_is_reported(config, caplog):
    config = with_change(config, "visibility.duration_days", 1)
    config = with_change(config, "visibility.limiting_magnitude", -20)
    state = [[1.14, 0.0, -0.16, 0.0, -0.223, 0.0], [1.14, 0.0, 0.16, 0.0, -0.223, 0.0]]
    orbits = xr.Dataset(
        {
            "family": ("orbit", ["Halo_L2_N", "Halo_L2_S"]),
            "state": (("orbit", "component"), state),
            "period": ("orbit", [3.2, 3.2]),
            "jacobi": ("orbit", [3.05, 3.05]),
            "stability_index": ("orbit", [50.0, 60.0]),
        }
    )
    targets = xr.Dataset({"position": (("target", "axis"), [[0.8, 0.0, 0.1], [0.6, 0.2, 0.0]])})
    seen = visibility_dataset(orbits, targets, sun_dataset(config), config, 2)
    assert "no static target is ever seen from any orbit" in caplog.text
    assert "raise visibility.limiting_magnitude = -20 or" in caplog.text
    study = {"slots": 1, "restarts": 1, "certificate": {"within": 0.01, "nodes": 100}}
    exact = exact_dataset(seen, orbits, scenario="A", seed=1, **study)
    assert "J is 0 for every architecture" in caplog.text
    with warnings.catch_warnings(action="error"):
        assert near_optimal_rows("A", exact, orbits)["share_of_optimum"].isna().all()


def refusal(config):
    """The message a configuration is refused with."""
    with pytest.raises(ConfigurationError) as refused:
        check_campaign(config)
    return str(refused.value)


def test_full_configuration_is_accepted(config):
    check_campaign(config)
    assert not Path(config["results"]).exists()


@pytest.mark.parametrize(
    "key, value, message",
    [
        ("visibilty", {}, "unknown configuration key 'visibilty': did you mean 'visibility'?"),
        (
            "visibility.limiting_magnitud",
            18,
            "unknown configuration key 'visibility.limiting_magnitud': "
            "did you mean 'limiting_magnitude'?",
        ),
        (
            "orbits.members.Halo_L2",
            3,
            "unknown configuration key 'orbits.members.Halo_L2': did you mean 'Halo_L2_",
        ),
        ("orbits.members.Vertical", 3, "orbits.members.Vertical': known keys: Butterfly_N"),
        ("orbits.members.Vertical_L1", 3, "'orbits.members.Vertical_L1'"),
        ("visibility.step_hours", "one", "'visibility.step_hours' = 'one'"),
        ("visibility.step_hours", 0, "'visibility.step_hours' = 0"),
        ("seed", 1.5, "'seed' = 1.5"),
        ("seed", True, "'seed' = True"),
        ("scenarios.A.targets", 0, "'scenarios.A.targets' = 0"),
        ("scenarios.A.targets", "100", "'scenarios.A.targets' = '100'"),
        ("scenarios.a_b", {"targets": 3}, "'a_b'"),
        ("propagator", "euler", "'propagator' = 'euler'"),
        ("architecture.slots", 0, "'architecture.slots' = 0"),
        ("architecture.slots", 303, "'architecture.slots' = 303 exceeds the 302 orbits"),
        ("architecture.optimizers", ["annealing"], "annealing"),
        ("architecture.labels", "color", "'architecture.labels' = 'color'"),
        ("architecture.label_comparison.scenario", "D", "'architecture.label_comparison.scenario'"),
        ("architecture.front.fewest", 9, "'architecture.front'"),
        ("architecture.front.most", 101, "'architecture.front'"),
    ],
)
def test_faulty_key_is_named(config, key, value, message):
    assert message in refusal(with_change(config, key, value))


FORMER = {
    "task2.communication.credit_under_way": "use_pending_measurements",
    "task2.tasking.credited_measurements": "expected_measurements",
    "task2.tasking.track_gate": "pointing_uncertainty_gate",
    "architecture.elsewhere": "generalization",
    "task2.batch.unknowns": "estimated_parameters",
    "task2.dynamics.srp.believed_factor": "assumed_factor",
    "task2.batch.estimated_parameters.log_stretch": "log_axis_scale",
    "task2.body.metres_per_unit": "meters_per_unit",
    "task2.body.stretch": "axis_scale",
    "task2.truth.spread": "parameter_sigma",
    "task2.truth.body.stretch": "axis_scale",
}


@pytest.mark.parametrize(("former", "name"), FORMER.items())
def test_a_line_gives_the_present_name_of_a_former_key(config, former, name):
    config["task2"]["truth"] = {"body": {}}
    with pytest.raises(ConfigurationError) as caught:
        check_campaign(with_change(config, former, 1))
    message = f"unknown configuration key {former!r}: it is now called {name!r}"
    assert str(caught.value) == message


def test_every_former_name_is_tried():
    assert {key.rpartition(".")[2] for key in FORMER} | {"held"} == set(RENAMED)


def test_a_line_gives_the_present_name_of_a_former_value(config):
    with pytest.raises(ConfigurationError) as caught:
        check_campaign(with_change(config, "task2.dynamics.unrefined", "held"))
    message = "'task2.dynamics.unrefined' = 'held': this value is now called 'reference'"
    assert str(caught.value) == f"configuration key {message}"


def test_a_former_key_of_a_family_is_named_with_the_family(config):
    config["task2"]["variants"]["families"]["gate"] = {
        "targets": [20], "key": "tasking.track_gate", "values": [False],
    }  # fmt: skip
    with pytest.raises(ConfigurationError, match="is now called 'pointing_uncertainty_gate'") as e:
        check_campaign(config)
    assert str(e.value).startswith("configuration key 'task2.variants.families.gate.key': ")


def test_an_impossible_setting_of_the_library_is_named_in_a_line():
    with pytest.raises(ConfigurationError) as caught:
        InitialSigma(5.0, 2.4, -1.0)
    message = "position_km = -1.0 must be a number above 0; velocity_m_s is missing"
    assert str(caught.value) == message
    with pytest.raises(ConfigurationError, match="pool = 2 must be at least as large as starts"):
        BatchSettings(pool=np.int64(2))


def test_the_front_is_of_what_slots_and_satellites_allow(config):
    assert "front" not in yaml.safe_load((ROOT / "config/config.yaml").read_text())["architecture"]
    for slots, most, expected in ((10, 10, (10, 60)), (2, 1, (2, 2)), (3, 4, (3, 12))):
        small = with_change(config, "architecture.slots", slots)
        small = with_change(small, "architecture.max_satellites", most)
        small = with_change(small, "architecture.front", {"restarts": 4})
        front = check_campaign(small)["architecture"]["front"]
        assert (front["fewest"], front["most"]) == expected


def test_missing_key_is_named(config):
    del config["visibility"]["exclusion_deg"]["moon"]
    message = "configuration key 'visibility.exclusion_deg.moon' is missing"
    assert refusal(config) == message


def test_every_fault_is_reported_at_once(config):
    faulty = with_change(with_change(config, "seed", -1), "epoch_jdd", 1)
    message = refusal(faulty)
    assert "'seed' = -1" in message
    assert "did you mean 'epoch_jd'?" in message


def test_results_that_are_a_file_are_refused(config, tmp_path):
    (tmp_path / "file").write_text("")
    for place in ("file", "file/inside"):
        message = refusal(config | {"results": str(tmp_path / place)})
        assert f"configuration key 'results' = '{tmp_path / place}'" in message


def test_results_that_cannot_be_written_are_refused(config, tmp_path, monkeypatch):
    closed = tmp_path / "closed"
    closed.mkdir()
    access = os.access
    # The superuser may write anywhere, so permissions are played.
    monkeypatch.setattr(os, "access", lambda p, mode: Path(p) != closed and access(p, mode))
    message = refusal(config | {"results": str(closed / "new")})
    assert (
        f"'results' = '{closed / 'new'}': {closed} is not a folder that can be written" in message
    )


def test_schema_for_editors_is_that_of_the_settings():
    assert (ROOT / SCHEMA_FILE).read_text(encoding="utf-8") == schema_text()


def test_schema_for_editors_takes_what_the_campaign_takes():
    jsonschema = pytest.importorskip("jsonschema")
    judge = jsonschema.Draft202012Validator(json.loads(schema_text()))
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))
    assert list(judge.iter_errors(config)) == []
    assert list(judge.iter_errors(read_campaign())) == []
    for key, value in (("task2.step_s", 0), ("task2.stp_s", 1), ("targets.radial_step_km", 0.1)):
        assert len(list(judge.iter_errors(with_change(config, key, value)))) == 1, key


def explained_keys():
    """Keys with a row in config/README.md; a part in capitals or braces is any name."""
    keys = set()
    for line in (ROOT / "config/README.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("| `"):
            names = re.findall(r"`([^`]+)`", line.split("|")[1])
            parent = names[0].rpartition(".")[0]
            keys |= {parent + name if name.startswith(".") else name for name in names}
    return keys


LEFT_OUT = ("changes", "combine", "settings", "values")


def leaves(mapping, prefix=""):
    """Paths of the innermost keys; what a variant or a scenario changes is explained elsewhere."""
    for key, value in mapping.items():
        if isinstance(value, dict) and value and key not in LEFT_OUT:
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}"


def is_any(part):
    """Whether a part of a row stands for any name."""
    return part.isupper() or part.startswith("{")


def explains(row, key):
    """Whether a row explains a key."""
    parts, wanted = row.split("."), key.split(".")
    alike = (r == k or is_any(r) for r, k in zip(parts, wanted, strict=False))
    return len(parts) == len(wanted) and all(alike)


def all_keys(config):
    """Keys of the configuration, with those that only a study of one's own has."""
    own = (ROOT / "config/examples/own_study.yaml").read_text(encoding="utf-8")
    study = merged(config, yaml.safe_load(own))
    windows = dict.fromkeys(OwnInformation.model_fields)
    rarely = {
        "scenarios": {"E": {"static_targets": "table.csv", "photometry": "physical"}},
        "sweeps": {"noise": {"estimators": ["mukf"]}},
        "surveys": {"usual": StatedSurvey(architecture="published").model_dump()},
        "task2": {
            "variants": {
                "pooled": {"day3": {}},
                "families": {
                    "slope": {
                        "scenario": "D",
                        "architecture": "exact",
                        "other_architectures": [],
                        "pooled": [],
                    }
                },
            },
            "sensors": {"small": dict.fromkeys(SensorGroup.model_fields)},
            "stations": {"tenerife": dict.fromkeys(Station.model_fields)},
        },
        "architecture": {
            "designs": {"union": dict.fromkeys(Design.model_fields) | {"information": windows}},
            "objective_fronts": {"union": dict.fromkeys(ObjectiveFront.model_fields)},
        },
    }
    return list(leaves(merged(study, rarely)))


def test_tables_of_settings_are_those_of_the_settings():
    text = (ROOT / "config/README.md").read_text(encoding="utf-8")
    assert sorted(generated_blocks(text)) == sorted(SETTINGS_BLOCKS)
    assert fill_blocks(text, SETTINGS_BLOCKS, "config/README.md") == text


def test_every_key_is_explained(config):
    rows = explained_keys()
    keys = all_keys(config)
    assert [key for key in keys if not any(explains(row, key) for row in rows)] == []


def test_only_keys_are_explained(config):
    keys = all_keys(config)
    assert [row for row in explained_keys() if not any(explains(row, key) for key in keys)] == []
