"""Settings of the cells of the tracking campaign."""

import copy
import re
from pathlib import Path

import numpy as np
import pytest
from campaign_folder import read_campaign

from cislunar.campaign.settings.cell_settings import cell_settings, true_settings
from cislunar.campaign.settings.cell_tree import CellSettings, Filter
from cislunar.campaign.settings.cells import (
    TRACKED_TARGETS,
    Cell,
    campaign_cells,
    check_cell,
    estimator_names,
    grid_cells,
    variant_cells,
)
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.families import with_families
from cislunar.campaign.settings.library import (
    estimator_factory,
    loop_settings,
    truth_model,
)
from cislunar.campaign.settings.observing.sensors import observer_sensors, true_sensors
from cislunar.campaign.settings.reading import merged, typed, with_types
from cislunar.campaign.settings.scenarios import in_study, scenario_settings
from cislunar.campaign.settings.tracking_checks import shortened_intervals
from cislunar.campaign.tracking.cell import realization_seeds
from cislunar.errors import ConfigurationError
from cislunar.estimation.initial_sigma import PAPER_INITIAL_SIGMA, ProcessNoise
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.sensor import Atmosphere, ExclusionAngles, GroundSensor, PhotonNoise
from cislunar.orbits import tracked as tracked_orbits
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.closed_loop import LoopSettings
from cislunar.tasking.initial_conditions import INITIAL_RATE_DEG_H

NAMES = [["0"], ["1"], ["2"]]
ROOT = Path(__file__).resolve().parents[2]
PAPER_COUNTS = {
    "A": [20, 25, 30, 50, 75, 100, 125, 150, 175, 202],
    "B": [33, 50, 75, 100, 125, 150, 175, 202],
    "C": [43, 50, 75, 100, 125, 150, 175, 202],
}


@pytest.fixture
def config(tmp_path):
    return read_campaign(ROOT / "config") | {"results": str(tmp_path)}


@pytest.fixture
def task2(config):
    """Key `task2` with every variant its families make."""
    return with_families(config)["task2"]


def _set(config, path, value):
    *above, last = path.split(".")
    for key in above:
        config = config[key]
    config[last] = value


def test_the_sweeps_are_the_papers(config):
    cells = grid_cells(config["task2"])
    for architecture in ("published", "tpe"):
        for scenario, counts in PAPER_COUNTS.items():
            own = [c for c in cells if (c.architecture, c.scenario) == (architecture, scenario)]
            assert sorted({c.targets for c in own if c.interval_minutes == 60}) == counts
        intervals = {
            (c.scenario, c.targets, c.interval_minutes)
            for c in cells
            if c.architecture == architecture and c.interval_minutes != 60
        }
        wanted = {("A", 20), ("B", 33), ("A", 50)}
        assert intervals == {(*cell, t) for cell in wanted for t in (30, 120, 180, 240)}
    assert len(set(cells)) == len(cells)


def test_default_settings_are_those_of_the_library(config):
    """The library's defaults are the paper's; the configuration must not drift from them."""
    paper = scenario_settings(config, "A")["task2"]
    made = loop_settings(CellSettings(**cell_settings(paper)), 60)
    default = LoopSettings(record_every=10)
    assert made.sensor == default.sensor
    assert made.initial == PAPER_INITIAL_SIGMA
    assert made.tasking.radius_m == pytest.approx(1.0, rel=1e-12)
    for key in ("step_s", "duration_hours", "method", "max_evaluations", "early_stop"):
        assert getattr(made, key) == getattr(default, key), key
    assert made.record_every == default.record_every
    assert made.tasking.pointing_uncertainty_gate == default.tasking.pointing_uncertainty_gate
    coefficient = default.tasking.diffuse_reflection_coefficient
    assert made.tasking.diffuse_reflection_coefficient == coefficient


def test_number_of_tracked_targets_is_that_of_the_orbits():
    parts = [
        *tracked_orbits.HALO_COUNTS.values(),
        len(tracked_orbits.NRHO_RESONANCES),
        tracked_orbits.RETROGRADE_COUNT,
        *tracked_orbits.RESONANT_COUNTS.values(),
        len(tracked_orbits.POLAR_ORBITS),
    ]
    assert sum(parts) == TRACKED_TARGETS


@pytest.mark.parametrize("name", ["quick.yaml", "paper_tpe.yaml"])
def test_the_other_configurations_are_valid(name, tmp_path):
    whole = read_campaign(ROOT / "config", ROOT / "config" / name) | {"results": str(tmp_path)}
    check_campaign(whole)
    assert len(campaign_cells(with_families(whole)["task2"])) > 0


def test_all_cells_have_paths_of_their_own_and_variants_their_counterpart(task2):
    cells = campaign_cells(task2)
    assert len({cell.path for cell in cells}) == len(cells)
    assert all(cell._replace(variant="") in cells for cell in cells)
    assert Cell("A", "tpe", "mukf", 50, 60).path == "task2/A/tpe/mukf/nt50_dt60.nc"
    assert Cell("A", "tpe", "mukf", 50, 60, "fresnel").path.endswith("nt50_dt60_fresnel.nc")


def test_a_scenario_beyond_the_paper_has_no_published_cells(config):
    config["scenarios"]["D"] = {"targets": 10}
    config["task2"]["target_counts"]["D"] = [20]
    check_campaign(config)
    found = {c.architecture for c in grid_cells(config["task2"]) if c.scenario == "D"}
    assert found == {"tpe"}


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("task2.sensor.magnitude_noise", 0),
        ("task2.sensor.angle_noise_arcsec", -3),
        ("task2.sensor.field_of_view_deg", 0),
        ("task2.initial_sigma.position_km", 0),
        ("task2.process_noise.attitude_deg", -0.1),
        ("task2.custody.position_km", 0),
        ("task2.seeds", 0),
        ("task2.step_s", 0),
        ("task2.target_counts.A", [20, 203]),
        ("task2.tasking.method", "best"),
        ("task2.photometry.irradiance", "r^2"),
        ("task2.material.rms_slope", 0),
        ("task2.body.shape", "teapot"),
        ("task2.estimators", []),
        ("task2.record_minutes", 1.5),
        ("task2.duration_hours", 24.0001),
        ("task2.tasking.slot_minutes", 0.5),
        ("task2.stations", {"hill": {"latitude_deg": 91, "longitude_deg": 0}}),
        ("task2.sensor.photon_noise", {"aperture_m": 0}),
        ("task2.eclipse", "partial"),
        ("task2.communication.delay_minutes", 1440),
        ("task2.duration_hours", 24 * 31),
        ("task2.interval_minutes", 61),
        ("task2.target_counts.D", [20]),
        ("task2.variants.scenario", "D"),
        ("task2.tasking_comparison.epochs", [24]),
        ("task2.tasking_comparison.tpe_evaluations", 10),
        ("task2.tasking_comparison.targets", []),
        ("task2.replay", "A/published/mukf/nt21_dt60"),
        ("task2.body.radius_m", None),
        ("task2.body.axis_scale", [1, 1]),
        ("task2.body.axis_scale", [1, 1, 0]),
        ("task2.body.inertia", [1, 1, 3]),
        ("task2.body.inertia", [1, 2]),
        ("task2.truth.material", {"rms_slope": 0}),
        ("task2.truth.sensor", {"magnitude_noise": -0.1}),
        ("task2.truth.angular_acceleration_deg_h2", 0.1),
        ("task2.truth.parameter_sigma", {"log_slope": -0.1}),
        ("task2.truth.reflection", "hapke"),
        ("task2.truth.parameter_freedom", 2),
        ("task2.truth.parameter_freedom", 4),  # of no deviation
        ("task2.truth.torque", {"random_deg_h2": -1}),
        ("task2.truth.maneuvers", {"drawn": [{"smallest_m_s": 1}]}),
        ("task2.truth.maneuvers", {"drawn": [{"smallest_m_s": 2, "largest_m_s": 1}]}),
        ("task2.maneuver_detection", {"false_alarms_per_target_day": 1}),
        ("task2.maneuver_detection", {"spacing_minutes": 90, "window_hours": 1}),
        ("task2.maneuver_detection.spacing_minutes", 0.5),
        ("task2.truth.body", {"shape": "sphere"}),
        ("task2.batch.estimated_parameters", {"log_slope": -0.1}),
        ("task2.batch.noise_freedom", 0),
    ],
)
def test_impossible_values_name_the_key(config, key, value):
    _set(config, key, value)
    if key == "task2.interval_minutes":
        config["task2"]["step_s"] = 40
        config["task2"]["duration_hours"] = 24
    with pytest.raises(ConfigurationError, match=re.escape(key)):
        check_campaign(config)


def test_telescopes_are_those_of_all_of_groups_and_of_stations(config):
    """Each with what is otherwise about it; what is truly otherwise holds for all."""
    own = {
        "sensors": {"small": {"observers": [1], "sensor": {"limiting_magnitude": 16}}},
        "stations": {"hill": {"latitude_deg": 10, "longitude_deg": 20, "sun_below_deg": 18}},
        "truth": {"sensor": {"magnitude_noise": 0.3}},
    }
    usual = typed(cell_settings(config["task2"]), CellSettings)
    chosen = typed(merged(cell_settings(config["task2"]), own), CellSettings)
    alike = observer_sensors(usual, 3)
    found = observer_sensors(chosen, 3, [{}, {}, {"exclusion_deg": {"sun": 50}}])
    assert found[0] == alike and true_sensors(usual, alike) is None
    assert found[1] == alike.model_copy(update={"limiting_magnitude": 16})
    assert found[2] == alike.model_copy(update={"exclusion_deg": ExclusionAngles(sun=50)})
    assert found[3] == GroundSensor(**dict(alike), atmosphere=Atmosphere(sun_below_deg=18))
    true, noise = true_sensors(chosen, found), {"magnitude_noise": 0.3}
    assert true == tuple(each.model_copy(update=noise) for each in found)
    photons = alike.model_copy(update={"photon_noise": PhotonNoise(0.2)})
    assert true_sensors(chosen, photons) == photons.model_copy(update=noise)
    with pytest.raises(ConfigurationError, match=r"small.observers': 1 is none of .* 0 \.\. 0"):
        observer_sensors(typed(merged(chosen.model_dump(), {"stations": {}}), CellSettings), 0)


def test_unknown_keys_are_refused_with_a_suggestion(config):
    config["task2"]["taskng"] = config["task2"].pop("tasking")
    with pytest.raises(ConfigurationError, match=r"'task2\.taskng'.*did you mean 'tasking'"):
        check_campaign(config)


IN_FIELD = {"detections": "all-in-field"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tasking": {"metod": "tpe"}}, "did you mean 'method'"),
        ({"architectures": ["tpe"]}, "architectures"),
        ({"sensor": {"magnitude_noise": 0}}, "sensor.magnitude_noise"),
        ({"step_s": 7}, "multiple of step_s"),
        ({"step_s": 24, "record_minutes": 6}, None),
        ({"truth": {"sensors": {"magnitude_noise": 0.2}}}, "truth.sensors'.*did you mean 'sensor'"),
        ({"truth": {"sensor": {"field_of_view_deg": 2}}}, "truth.sensor.field_of_view_deg"),
        ({"truth": {"material": {"rms_slop": 0.3}}}, "truth.material.rms_slop"),
        ({"truth": {"body": {"inertia": [1, 1, 3]}}}, "truth.body.inertia': principal moments"),
        ({"truth": {"body": {"radius_m": None}}}, "truth.body.radius_m': an icosahedron"),
        (
            {"truth": {"parameter_sigma": {"log_slop": 0.3}}},
            "truth.parameter_sigma.log_slop'.*'log_slope'",
        ),
        (
            {
                "batch": {"estimated_parameters": {"log_slope": 0.3}},
                "material": {"specular_weight": 0},
            },
            "batch.estimated_parameters': log_slope = 0.3: the light of such a surface",
        ),
        ({"batch": {"noise_freedom": 8, "window_hours": 3}}, "exclude each other"),
        (
            {"communication": {"update_minutes": 0.5}},
            "communication.update_minutes' = 0.5 must be a multiple of step_s",
        ),
        (
            {"communication": {"contact": {"moon": True}}, "tasking": {"states": "full"}},
            "communication.use_pending_measurements' needs states = 'translation', "
            "but states = 'full'",
        ),
        (
            {"fusion": "alone", "dynamics": {"truth": "ephemeris"}},
            "dynamics.filter': fusion = 'alone' needs",
        ),
        ({"fusion": "alone", "tasking": {"states": "full"}}, "tasking.states': fusion = 'alone'"),
        (
            {"fusion": "alone", "batch": {"estimated_parameters": {"log_slope": 0.3}}},
            "batch.estimated_parameters': fusion = 'alone'",
        ),
        ({"filter": {"use_magnitude": False, "noise_memory": 9}}, "exclude each other"),
        ({"filter": {"noise_memory": 1}}, "filter.noise_memory' = 1"),
        ({"filter": {"extra_magnitude_noise": -0.1}}, "filter.extra_magnitude_noise' = -0.1"),
        ({"filter": {"estimate_parameters": True}}, "filter.estimate_parameters' needs"),
        (
            {
                "filter": {"estimate_parameters": True},
                "batch": {"estimated_parameters": {"log_facets": 0.2}},
            },
            "filter.estimate_parameters' needs",
        ),
        ({"association": {"method": "nearest"}}, "association.method' = 'nearest'"),
        ({"association": {"false_alarms_deg2": -1}}, "association.false_alarms_deg2' = -1"),
        (
            {"association": {"window_steps": 4, "committed_steps": 5}},
            "association.*committed_steps = 5 must not exceed window_steps = 4",
        ),
        (
            {"association": {"confirmations": 6}},
            "association.*confirmations = 6 must not exceed confirmation_exposures = 5",
        ),
        (
            {"association": IN_FIELD, "fusion": "covariance-intersection"},
            "association.detections' = 'all-in-field': .* fusion = 'covariance-intersection'",
        ),
        (
            {"association": IN_FIELD, "communication": {"delay_minutes": 30}},
            "association.detections' = 'all-in-field': .*communication.delay_minutes",
        ),
        (
            {"association": IN_FIELD, "communication": {"contact": {"moon": True}}},
            "association.detections' = 'all-in-field': .*communication.contact",
        ),
        (
            {"association": IN_FIELD, "batch": {"use_non_detections": True}},
            "batch.use_non_detections': with association.detections = 'all-in-field'",
        ),
    ],
)
def test_changes_of_a_variant_are_checked_like_settings(config, change, message):
    families = config["task2"]["variants"]["families"]
    families["other"] = {"targets": [20], "changes": {"other": change}}
    if message is None:
        check_campaign(config)
        assert cell_settings(with_families(config)["task2"], "other")["step_s"] == 24
        return
    with pytest.raises(ConfigurationError, match=message) as caught:
        check_campaign(config)
    assert "task2.variants.families.other.changes.other" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_truth_is_the_assumed_model_unless_stated(config):
    assumed = CellSettings(**cell_settings(config["task2"]))
    true = true_settings(assumed)
    for key in ("material", "body", "sensor"):
        assert getattr(true, key) == getattr(assumed, key)
    assert true.truth.angular_acceleration_deg_h2 == [0, 0, 0]
    model = truth_model(assumed, NAMES[:3])
    loop = loop_settings(assumed, 60)
    np.testing.assert_array_equal(model.noise, loop.sensor.noise)
    np.testing.assert_array_equal(model.surfaces.areas, np.tile(icosahedron(1.0).areas, 3))
    np.testing.assert_array_equal(model.surfaces.inertia, np.tile(np.eye(3), (3, 1, 1)))
    assert not model.angular_acceleration.any()


def test_deviations_are_reported_where_there_are_some(config):
    """A file made without them is that of today: jobs are not made anew for a key of no effect."""
    usual = cell_settings(config["task2"])
    assert not {"estimated_parameters", "noise_freedom"} & set(usual["batch"])
    assert list(usual["filter"]) == ["splitting"]
    batch = {"estimated_parameters": {"log_slope": 0.25}, "noise_freedom": 8}
    change = {"batch": batch, "truth": {"parameter_sigma": {"log_slope": 0.2}}}
    config["task2"]["variants"]["families"]["u"] = {"targets": [20], "changes": {"u": change}}
    check_campaign(config)
    settings = CellSettings(**cell_settings(with_families(config)["task2"], "u"))
    assert settings.batch.estimated_parameters == BodyParameterPrior(log_slope=0.25)
    assert settings.batch.noise_freedom == 8
    assert not estimator_factory("mukf", settings).estimated_parameters
    augmented = settings.model_copy(update={"filter": Filter(estimate_parameters=True)})
    made = estimator_factory("mukf", augmented)
    assert made.estimated_parameters == settings.batch.estimated_parameters
    assert truth_model(settings, NAMES[:2]).parameter_sigma == BodyParameterPrior(log_slope=0.2)


def test_truth_changes_alone(config):
    """Noise, surface, shape, inertia and torque of the truth; the settings of the loop stay."""
    usual = loop_settings(CellSettings(**cell_settings(config["task2"])), 60)
    change = {
        "material": {"rms_slope": 0.4},
        "body": {"axis_scale": [1, 1, 1.2], "inertia": [1, 1, 1.2]},
        "sensor": {"magnitude_noise": 0.2},
        "angular_acceleration_deg_h2": [0, 0, 0.1],
    }
    config["task2"]["truth"] = change
    check_campaign(config)
    settings = CellSettings(**cell_settings(config["task2"]))
    assert loop_settings(settings, 60) == usual
    model = truth_model(settings, NAMES[:2])
    assert model.noise[0] == 0.2
    np.testing.assert_array_equal(model.noise[1:], usual.sensor.noise[1:])
    np.testing.assert_allclose(model.surfaces.material[:, 3], 0.4)
    np.testing.assert_allclose(model.surfaces.inertia[1], np.diag([1, 1, 1.2]))
    # stretched, and scaled back to the surface of the sphere
    assert model.surfaces.areas.sum() == pytest.approx(2 * 4.0 * np.pi)
    assert np.ptp(model.surfaces.areas) > 0.05
    assert model.angular_acceleration[2] == pytest.approx(np.deg2rad(0.1) / 3600.0**2)
    # half a day of 0.1 deg/h^2 turns by 0.1 * 12^2 / 2 = 7.2 deg
    seconds = 43_200.0
    turned = np.rad2deg(0.5 * model.angular_acceleration[2] * seconds**2)
    assert turned == pytest.approx(7.2)


def test_torques_of_the_variants_turn_by_what_their_names_say(task2):
    for name, degrees in (("torque-5", 5.0), ("torque-30", 30.0)):
        settings = CellSettings(**cell_settings(task2, name))
        pushed = np.array(settings.truth.angular_acceleration_deg_h2)
        assert 0.5 * np.linalg.norm(pushed) * 24.0**2 == pytest.approx(degrees, rel=1e-3)
        spin = np.array(INITIAL_RATE_DEG_H)
        cosine = pushed @ spin / np.linalg.norm(pushed) / np.linalg.norm(spin)
        assert cosine == pytest.approx(1.0)


def test_a_variant_names_its_estimators(task2):
    task2["estimators"] = ["mukf", "other"]
    task2["variants"]["cells"] = {
        "plain": {"targets": [20], "change": {"step_s": 30}},
        "both": {"targets": [20], "estimators": ["other", "mukf"], "change": {"step_s": 30}},
        "foreign": {"targets": [20], "estimators": ["third"], "change": {"step_s": 30}},
    }
    found = [(cell.variant, cell.estimator) for cell in variant_cells(task2)]
    assert found == [
        ("plain", "mukf"), ("both", "other"), ("both", "mukf"), ("foreign", "third"),
    ]  # fmt: skip
    assert estimator_names(task2) == ["mukf", "other", "third"]
    plain = {cell for cell in campaign_cells(task2) if not cell.variant and cell.targets == 20}
    assert Cell("A", "published", "third", 20, 60) in plain


def test_a_change_leaves_the_other_settings_alone(task2):
    before = copy.deepcopy(task2)
    changed = cell_settings(task2, "irradiance")
    usual = cell_settings(task2)
    assert task2 == before
    differing = [key for key in usual if usual[key] != changed[key]]
    assert differing == ["photometry"]
    assert changed["photometry"] == {"irradiance": "1/r^2", "fresnel": "sqrt"}
    with pytest.raises(ConfigurationError, match=r"nothing.*task2\.variants\.families"):
        cell_settings(task2, "nothing")


def test_cells_asked_for_by_name_are_checked(config):
    settings = typed(cell_settings(config["task2"]), CellSettings)
    cell = Cell("A", "published", "batch", 202, 240)
    check_cell(cell, settings)
    with pytest.raises(ConfigurationError, match=r"n_T = 203 .*202"):
        check_cell(cell._replace(targets=203), settings)
    with pytest.raises(ConfigurationError, match=r"dt7.*task2\.step_s"):
        check_cell(cell._replace(interval_minutes=7), settings.model_copy(update={"step_s": 50}))
    noise = ProcessNoise(attitude_deg=0.03, acceleration_m2_s3=1e-11)
    noisy = settings.model_copy(update={"process_noise": noise})
    check_cell(cell._replace(estimator="mukf"), noisy)
    with pytest.raises(ConfigurationError, match=r"task2\.process_noise\.attitude_deg' = 0\.03:"):
        check_cell(cell, noisy)


def test_seeds_do_not_depend_on_their_number():
    assert realization_seeds(5, 10)[:3] == realization_seeds(5, 3)
    assert len({*realization_seeds(5, 50), *realization_seeds(6, 50)}) == 100


def test_unusual_settings_of_bodies_are_reported(config):
    usual = cell_settings(config["task2"])
    assert not {"materials", "table"} & set(usual["body"])
    config["task2"]["body"] |= {"shape": "upper-stage", "radius_m": None, "materials": "a=foil"}
    assert cell_settings(config["task2"])["body"]["materials"] == "a=foil"


def test_settings_from_the_command_line_get_their_types(config):
    """Snakemake hands nested values of --config over as strings."""
    task2 = {"seeds": "3", "step_s": "30", "body": {"radius_m": "null"}, "estimators": ["mukf"]}
    task2 |= {
        "target_counts": {"A": ["20", "30"]},
        "tasking": {"pointing_uncertainty_gate": "false"},
    }
    typed = with_types(merged(config, {"task2": task2}))["task2"]
    assert (typed["seeds"], typed["step_s"], typed["body"]["radius_m"]) == (3, 30, None)
    assert typed["target_counts"]["A"] == [20, 30]
    assert typed["tasking"]["pointing_uncertainty_gate"] is False
    assert typed["photometry"] == config["task2"]["photometry"]
    wrong = with_types(merged(config, {"task2": {"seeds": "many"}}))
    with pytest.raises(ConfigurationError, match=r"task2\.seeds"):
        check_campaign(wrong)


def test_runs_that_end_within_an_interval_are_announced(config):
    study = with_families(in_study(config))
    assert shortened_intervals(study) == []
    study["task2"]["duration_hours"] = 6.5
    assert "duration_hours = 6.5 is no multiple of" in shortened_intervals(study)[0]
