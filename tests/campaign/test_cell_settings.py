"""Settings of the cells of the tracking campaign."""

import re

import pytest
from campaign_folder import read_campaign

from cislunar.campaign.settings.cell_settings import cell_settings, observer_sensors, true_sensors
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.cells import (
    TRACKED_TARGETS,
    Cell,
    campaign_cells,
    check_cell,
    grid_cells,
)
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.families import with_families
from cislunar.campaign.settings.library import (
    loop_settings,
)
from cislunar.campaign.settings.reading import merged, typed, with_types
from cislunar.campaign.settings.scenarios import in_study, scenario_settings
from cislunar.campaign.settings.tracking_checks import shortened_intervals
from cislunar.campaign.tracking.cell import realization_seeds
from cislunar.errors import ConfigurationError
from cislunar.estimation.initial_sigma import PAPER_INITIAL_SIGMA, ProcessNoise
from cislunar.observation.sensor import Atmosphere, ExclusionAngles, GroundSensor, PhotonNoise
from cislunar.orbits import tracked as tracked_orbits
from cislunar.tasking.closed_loop import LoopSettings

PAPER_COUNTS = {
    "A": [20, 25, 30, 50, 75, 100, 125, 150, 175, 202],
    "B": [33, 50, 75, 100, 125, 150, 175, 202],
    "C": [43, 50, 75, 100, 125, 150, 175, 202],
}


def _set(paper, path, value):
    *above, last = path.split(".")
    for key in above:
        paper = paper[key]
    paper[last] = value


def test_the_sweeps_are_the_papers(paper):
    cells = grid_cells(paper["task2"])
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


def test_default_settings_are_those_of_the_library(paper):
    """The library's defaults are the paper's; the configuration must not drift from them."""
    paper = scenario_settings(paper, "A")["task2"]
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
    whole = read_campaign(name) | {"results": str(tmp_path)}
    check_campaign(whole)
    assert len(campaign_cells(with_families(whole)["task2"])) > 0


def test_all_cells_have_paths_of_their_own_and_variants_their_counterpart(task2):
    cells = campaign_cells(task2)
    assert len({cell.path for cell in cells}) == len(cells)
    assert all(cell._replace(variant="") in cells for cell in cells)
    assert Cell("A", "tpe", "mukf", 50, 60).path == "task2/A/tpe/mukf/nt50_dt60.nc"
    assert Cell("A", "tpe", "mukf", 50, 60, "fresnel").path.endswith("nt50_dt60_fresnel.nc")


def test_a_scenario_beyond_the_paper_has_no_published_cells(paper):
    paper["scenarios"]["D"] = {"targets": 10}
    paper["task2"]["target_counts"]["D"] = [20]
    check_campaign(paper)
    found = {c.architecture for c in grid_cells(paper["task2"]) if c.scenario == "D"}
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
        (
            "task2.maneuver_detection",
            {"spacing_minutes": 7.5, "false_alarms_per_target_day": 1e-3},
        ),
        ("task2.truth.body", {"shape": "sphere"}),
        ("task2.batch.estimated_parameters", {"log_slope": -0.1}),
        ("task2.batch.noise_freedom", 0),
    ],
)
def test_impossible_values_name_the_key(paper, key, value):
    _set(paper, key, value)
    if key == "task2.interval_minutes":
        paper["task2"]["step_s"] = 40
        paper["task2"]["duration_hours"] = 24
    with pytest.raises(ConfigurationError, match=re.escape(key)):
        check_campaign(paper)


def test_telescopes_are_those_of_all_of_groups_and_of_stations(paper):
    """Each with what is otherwise about it; what is truly otherwise holds for all."""
    own = {
        "sensors": {"small": {"observers": [1], "sensor": {"limiting_magnitude": 16}}},
        "stations": {"hill": {"latitude_deg": 10, "longitude_deg": 20, "sun_below_deg": 18}},
        "truth": {"sensor": {"magnitude_noise": 0.3}},
    }
    usual = typed(cell_settings(paper["task2"]), CellSettings)
    chosen = typed(merged(cell_settings(paper["task2"]), own), CellSettings)
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


def test_unknown_keys_are_refused_with_a_suggestion(paper):
    paper["task2"]["taskng"] = paper["task2"].pop("tasking")
    with pytest.raises(ConfigurationError, match=r"'task2\.taskng'.*did you mean 'tasking'"):
        check_campaign(paper)


def test_cells_asked_for_by_name_are_checked(paper):
    settings = typed(cell_settings(paper["task2"]), CellSettings)
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


def test_unusual_settings_of_bodies_are_reported(paper):
    usual = cell_settings(paper["task2"])
    assert not {"materials", "table"} & set(usual["body"])
    paper["task2"]["body"] |= {"shape": "upper-stage", "radius_m": None, "materials": "a=foil"}
    assert cell_settings(paper["task2"])["body"]["materials"] == "a=foil"


def test_settings_from_the_command_line_get_their_types(paper):
    """Snakemake hands nested values of --config over as strings."""
    task2 = {"seeds": "3", "step_s": "30", "body": {"radius_m": "null"}, "estimators": ["mukf"]}
    task2 |= {
        "target_counts": {"A": ["20", "30"]},
        "tasking": {"pointing_uncertainty_gate": "false"},
    }
    typed = with_types(merged(paper, {"task2": task2}))["task2"]
    assert (typed["seeds"], typed["step_s"], typed["body"]["radius_m"]) == (3, 30, None)
    assert typed["target_counts"]["A"] == [20, 30]
    assert typed["tasking"]["pointing_uncertainty_gate"] is False
    assert typed["photometry"] == paper["task2"]["photometry"]
    wrong = with_types(merged(paper, {"task2": {"seeds": "many"}}))
    with pytest.raises(ConfigurationError, match=r"task2\.seeds"):
        check_campaign(wrong)


def test_runs_that_end_within_an_interval_are_announced(paper):
    study = with_families(in_study(paper))
    assert shortened_intervals(study) == []
    study["task2"]["duration_hours"] = 6.5
    assert "duration_hours = 6.5 is no multiple of" in shortened_intervals(study)[0]
