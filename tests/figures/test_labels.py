"""Labels in words: of all that the shipped configurations name, and of what they do not know."""

import numpy as np
import pytest
import xarray as xr
from campaign_folder import read_settings
from matplotlib.text import Text

from cislunar.figures.labels import (
    ARCHITECTURES,
    PIPELINES,
    VALUES,
    architecture_label,
    estimator_label,
    pipeline_label,
    plain,
    target_text,
    value_label,
    without_number,
    words,
)
from cislunar.figures.space.geometry import geometry_figure


def test_every_pipeline_of_the_study_has_a_label_of_its_own():
    variants = read_settings("real.yaml")["task2"]["variants"]
    named = {
        (without_number(family["architecture"]), estimator, change)
        for family in variants["families"].values()
        for estimator in family["estimators"]
        for change in family["changes"]
        # days count as realizations of a pipeline
        if change not in variants["pooled"]
    }
    assert len(named) > 10 and named <= set(PIPELINES)
    assert len(set(PIPELINES.values())) == len(PIPELINES)


@pytest.mark.parametrize("name", ["tasking.yaml", "dynamics.yaml"])
def test_every_value_of_the_shipped_sweeps_has_a_label(name):
    for sweep in read_settings(name)["sweeps"].values():
        for key, value in sweep["values"].items():
            assert (value if isinstance(value, str) else key) in VALUES, key


def test_designs_have_the_label_of_their_kind_and_their_number():
    assert architecture_label("information-20") == "maximum orbit information, 20 satellites"
    assert architecture_label("information") == "maximum orbit information"
    assert architecture_label("my_own-3") == "my own 3"
    designs = read_settings("objectives.yaml")["architecture"]["designs"]
    assert {without_number(name) for name in designs} <= set(ARCHITECTURES)


def test_what_has_no_label_keeps_its_name():
    assert estimator_label("batch") == "batch estimator"
    assert estimator_label("particle-filter") == "particle filter"
    assert value_label("two_stations-more") == "two stations more"
    assert words("config/missions.csv") == "config/missions.csv"
    assert words("0.5") == "0.5"
    own = pipeline_label("mine-12", "batch", "less-noise")
    assert own == "mine, batch estimator, less noise"


def test_names_of_a_user_are_no_formulas():
    """By the words that Matplotlib draws."""
    name, path = "US$ and A$_1", np.zeros((2, 3))
    cell = xr.Dataset(
        {
            "family": ("target", ["own"]),
            "target_id": ("target", [0]),
            "target_name": ("target", [name]),
        }
    )
    own = geometry_figure({name: (path[0] + 0.5, path + 0.5)}, {name: (path[0] + 0.7, path + 0.7)})
    found = [each.get_text() for each in own.legends[0].get_texts()]
    for text in (target_text(cell, 0), plain(name), *found[:2]):
        drawn, formula = Text(text=text)._preprocess_math(text)
        assert (drawn, formula) == (name, False)


def test_targets_of_a_user_keep_their_names():
    cell = xr.Dataset(
        {
            "family": ("target", ["own", "Halo_L2_S"]),
            "target_id": ("target", [14, 12]),
            "target_name": ("target", ["transfer", "Halo_L2_S 12"]),
        }
    )
    assert target_text(cell, 0) == "transfer"
    assert target_text(cell, 1) == target_text(cell.drop_vars("target_name"), 1)
