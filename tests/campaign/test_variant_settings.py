"""Variants of cells, and truths that differ from what the estimators assume."""

import copy

import numpy as np
import pytest

from cislunar.campaign.settings.cell_settings import cell_settings, true_settings
from cislunar.campaign.settings.cell_tree import CellSettings, Filter
from cislunar.campaign.settings.cells import (
    Cell,
    campaign_cells,
    estimator_names,
    variant_cells,
)
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.families import with_families
from cislunar.campaign.settings.library import (
    estimator_factory,
    loop_settings,
    truth_model,
)
from cislunar.errors import ConfigurationError
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.initial_conditions import INITIAL_RATE_DEG_H

NAMES = [["0"], ["1"], ["2"]]


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
def test_changes_of_a_variant_are_checked_like_settings(paper, change, message):
    families = paper["task2"]["variants"]["families"]
    families["other"] = {"targets": [20], "changes": {"other": change}}
    if message is None:
        check_campaign(paper)
        assert cell_settings(with_families(paper)["task2"], "other")["step_s"] == 24
        return
    with pytest.raises(ConfigurationError, match=message) as caught:
        check_campaign(paper)
    assert "task2.variants.families.other.changes.other" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_shipped_variant_that_excludes_a_users_setting_can_be_omitted(paper):
    paper["task2"]["eclipse"] = True
    words = r"non-detections: .*leave out 'eclipse', or omit all variants: task2.variants.scenario"
    with pytest.raises(ConfigurationError, match=words):
        check_campaign(paper)
    paper["task2"]["variants"]["scenario"] = None
    check_campaign(paper)


def test_the_truth_is_the_assumed_model_unless_stated(paper):
    assumed = CellSettings(**cell_settings(paper["task2"]))
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


def test_deviations_are_reported_where_there_are_some(paper):
    """A file made without them is that of today: jobs are not made anew for a key of no effect."""
    usual = cell_settings(paper["task2"])
    assert not {"estimated_parameters", "noise_freedom"} & set(usual["batch"])
    assert list(usual["filter"]) == ["splitting"]
    batch = {"estimated_parameters": {"log_slope": 0.25}, "noise_freedom": 8}
    change = {"batch": batch, "truth": {"parameter_sigma": {"log_slope": 0.2}}}
    paper["task2"]["variants"]["families"]["u"] = {"targets": [20], "changes": {"u": change}}
    check_campaign(paper)
    settings = CellSettings(**cell_settings(with_families(paper)["task2"], "u"))
    assert settings.batch.estimated_parameters == BodyParameterPrior(log_slope=0.25)
    assert settings.batch.noise_freedom == 8
    assert not estimator_factory("mukf", settings).abilities.estimated_parameters
    augmented = settings.model_copy(update={"filter": Filter(estimate_parameters=True)})
    made = estimator_factory("mukf", augmented)
    assert made.abilities.estimated_parameters == settings.batch.estimated_parameters
    assert truth_model(settings, NAMES[:2]).parameter_sigma == BodyParameterPrior(log_slope=0.2)


def test_truth_changes_alone(paper):
    """Noise, surface, shape, inertia and torque of the truth; the settings of the loop stay."""
    usual = loop_settings(CellSettings(**cell_settings(paper["task2"])), 60)
    change = {
        "material": {"rms_slope": 0.4},
        "body": {"axis_scale": [1, 1, 1.2], "inertia": [1, 1, 1.2]},
        "sensor": {"magnitude_noise": 0.2},
        "angular_acceleration_deg_h2": [0, 0, 0.1],
    }
    paper["task2"]["truth"] = change
    check_campaign(paper)
    settings = CellSettings(**cell_settings(paper["task2"]))
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
