"""Families of variants, and what the typed settings make of what is written."""

import json

import pytest

from cislunar.campaign.settings.cell_settings import cell_settings
from cislunar.campaign.settings.cell_tree import CellChange, CellSettings
from cislunar.campaign.settings.cells import campaign_cells, variant_cells
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.families import with_families
from cislunar.campaign.settings.reading import checked, merged
from cislunar.campaign.tracking.cell import realization_seeds
from cislunar.errors import ConfigurationError


def variants(paper, **families):
    """Key `task2` of a configuration with these families alone, with their variants."""
    paper["task2"]["variants"]["families"] = families
    return with_families(check_campaign(paper))["task2"]


def test_a_family_states_values_changes_or_combinations(paper):
    task2 = variants(
        paper,
        slope={"targets": [20], "key": "truth.material.rms_slope", "values": {"rough": 0.4}},
        steps={"targets": [20], "key": "step_s", "values": [30, 20]},
        trust={"targets": [50], "changes": {"wide": {"batch": {"magnitude_noise_factor": 4}}}},
        both={"targets": [50], "estimators": ["batch"], "combine": {"wide": ["rough"]}},
    )
    entries = task2["variants"]["cells"]
    assert list(entries) == ["rough", "steps-30", "steps-20", "wide", "rough-wide"]
    assert entries["rough-wide"]["change"] == {
        "truth": {"material": {"rms_slope": 0.4}},
        "batch": {"magnitude_noise_factor": 4},
    }
    assert cell_settings(task2, "steps-20")["step_s"] == 20
    paths = [cell.path for cell in variant_cells(task2)]
    assert paths[0] == "task2/A/published/mukf/nt20_dt60_rough.nc"
    assert paths[-1] == "task2/A/published/batch/nt50_dt60_rough-wide.nc"


DAYS = {
    "day3": {"start_day": 3, "monitored_seed": 1, "first_realization": 1},
    "day6": {"start_day": 6, "monitored_seed": 2, "first_realization": 2},
}


def test_every_cell_is_repeated_on_the_pooled_days(paper):
    paper["task2"]["variants"]["pooled"] = DAYS
    paper["task2"] |= {
        "target_counts": {"A": [20], "B": [], "C": []},
        "intervals": {"minutes": [60], "target_counts": {"A": [], "B": []}},
        "architectures": ["published"],
        "estimators": ["mukf"],
        "other_architectures": {},
    }
    task2 = variants(
        paper,
        rough={"targets": [30], "changes": {"rough": {"material": {"rms_slope": 0.4}}}},
        few={"targets": [20], "pooled": ["day6"], "changes": {"steps": {"step_s": 30}}},
    )
    found = [(cell.targets, cell.variant) for cell in campaign_cells(task2)]
    assert found == [
        *((20, ""), (30, "")),
        *((30, "rough"), (30, "rough-day3"), (30, "rough-day6"), (20, "steps"), (20, "steps-day6")),
        *((20, "day3"), (20, "day6"), (30, "day3"), (30, "day6")),
    ]
    changed = cell_settings(task2, "rough-day6")
    assert changed["material"]["rms_slope"] == 0.4
    assert {key: changed[key] for key in DAYS["day6"]} == DAYS["day6"]
    assert cell_settings(task2, "day3")["start_day"] == 3
    # the default is not kept, so that usual cells stay the same
    assert "first_realization" not in cell_settings(task2, "rough")
    with pytest.raises(ConfigurationError, match=r"families\.few\.pooled': 'day9' is none of"):
        variants(paper, few={"targets": [20], "pooled": ["day9"], "changes": {"s": {"step_s": 30}}})
    paper["task2"]["variants"]["pooled"] = {"late": {"start_day": 40}}
    with pytest.raises(ConfigurationError, match=r"variants\.pooled\.late"):
        variants(paper)
    paper["task2"]["variants"]["pooled"] = {"late": {"start_days": 4}}
    with pytest.raises(ConfigurationError, match=r"pooled\.late.*start_days"):
        variants(paper)


def test_pooled_days_have_random_draws_of_their_own():
    every = realization_seeds(7, 5)
    assert realization_seeds(7, 2, first=3) == every[3:] and len(set(every)) == 5


def test_values_of_the_command_line_get_their_types(paper):
    family = {"targets": [20], "key": "body.inertia", "values": {"long": "[1, 1, 0.2]"}}
    task2 = variants(paper, shape=family)
    assert cell_settings(task2, "long")["body"]["inertia"] == [1, 1, 0.2]


def test_a_smaller_campaign_names_the_variants_it_keeps(paper):
    paper["task2"]["variants"] |= {"only": ["slope-25", "unknown-material"], "targets": [30]}
    task2 = with_families(check_campaign(paper))["task2"]
    assert {(cell.variant, cell.targets) for cell in variant_cells(task2)} == {
        ("slope-25", 30), ("unknown-material", 30),
    }  # fmt: skip
    assert {cell.scenario for cell in variant_cells(task2)} == {"A", "B", "C"}
    # the others can still be asked for by name
    assert cell_settings(task2, "fresnel")["photometry"]["fresnel"] == "printed"


@pytest.mark.parametrize(
    ("family", "message"),
    [
        (
            {"changes": {"a": {"seeds": 1}}, "other_scenarios": {"D": [20]}},
            "'task2.variants.families.f.other_scenarios' = 'D' is none of",
        ),
        (
            {"changes": {"a": {"seeds": 1}}, "other_scenarios": {"B": [20, 999]}},
            "'task2.variants.families.f.other_scenarios.B': 999 targets",
        ),
        ({}, "'task2.variants.families.f': give either key and values or changes, or combine"),
        ({"key": "step_s"}, "'task2.variants.families.f': give either"),
        ({"key": "step_s", "values": {"a": 30}, "changes": {"b": {"seeds": 1}}}, "give either"),
        ({"combine": {"a": ["b"]}}, "'task2.variants.families.f.combine.a': 'b' is no variant"),
        ({"key": "step", "values": {"a": 30}}, "'task2.variants.families.f.key': unknown"),
        (
            {"key": "step_s", "values": {"a": 0}},
            "'task2.variants.families.f.values': configuration",
        ),
        ({"key": "step_s", "values": {"a": 7}}, "families.f.values: duration_hours'"),
        ({"changes": {"a": {"seed": 1}}}, "families.f.changes.a.seed': did you mean 'seeds'?"),
        ({"changes": {"A": {"seeds": 1}}}, "families.f.changes': name 'A' is not allowed"),
        ({"key": "seeds", "values": {"A/b": 1}}, "families.f.values' = {'A/b': 1}: 'A/b' is no"),
        ({"key": "seeds", "values": {"a": 1}, "scenario": "D"}, "families.f.scenario' = "),
        ({"key": "seeds", "values": {"a": 1}, "changes": {}}, "give either key and values"),
        ({"key": "seeds", "values": {"a": 1}, "targets": [203]}, "families.f.targets': 203"),
    ],
)
def test_faults_of_a_family_are_one_line_that_names_the_key(paper, family, message):
    with pytest.raises(ConfigurationError) as refused:
        variants(paper, f=family)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_variants_have_names_of_their_own(paper):
    family = {"key": "seeds", "values": {"few": 1}}
    with pytest.raises(ConfigurationError, match=r"families.g.values': there is another .* 'few'"):
        variants(paper, f=family, g=family)


def test_a_variant_to_keep_has_to_be_there(paper):
    paper["task2"]["variants"]["only"] = ["slop-25"]
    with pytest.raises(ConfigurationError, match="'slop-25' is none of the variants"):
        check_campaign(paper)


def test_numbers_stay_as_they_are_written_and_defaults_are_filled_in(paper):
    written = {"step_s": 60, "record_minutes": 10.0, "seeds": 3.0}
    task2 = merged({key: paper["task2"][key] for key in CellSettings.model_fields}, written)
    del task2["material"]
    again = checked(task2, CellSettings)
    assert json.dumps([again[key] for key in written]) == "[60, 10.0, 3]"
    assert again["material"] == paper["task2"]["material"]


def test_a_change_holds_what_is_given_and_nothing_else():
    change = {"body": {"inertia": None}, "truth": {"sensor": {"magnitude_noise": 1}}}
    assert checked(change, CellChange) == change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seeds": 0}, "'seeds' = 0: must be a whole number at least 1 and at most 10,000"),
        ({"sensor": {"occultation": "no"}}, "'sensor.occultation' = 'no': must be true or false"),
        ({"photometry": {"fresnel": "root"}}, "= 'root': must be one of sqrt, printed"),
        ({"body": {"radius_m": -1}}, "'body.radius_m' = -1: must be a number above 0, or null"),
        ({"body": {"axis_scale": [1, 1]}}, "must be a list of 3 of: a number above 0"),
        ({"batch": 3}, "'batch' = 3: must be a mapping"),
    ],
)
def test_a_message_says_what_was_given_and_what_is_allowed(change, message):
    with pytest.raises(ConfigurationError) as refused:
        checked(change, CellChange)
    assert message in str(refused.value)
