"""Content of the tracking figures: cells and targets, values of heat maps and panels, units."""

import json

import numpy as np
import pytest
import xarray as xr
from campaign_folder import read_campaign
from tracking_cell_data import RECORDS, cell_data

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.settings.families import with_families
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.errors import InputFileError
from cislunar.evaluation.metrics import (
    INCONSISTENT,
    NEVER_OBSERVED,
    TRACKED,
    attitude_angle_deg,
)
from cislunar.figures.tracking.choice import (
    figure_architectures,
    high_load_cells,
    interval_cells,
    learned_cell,
    selected_cell,
    target_count_cells,
    tasking_variants,
)
from cislunar.figures.tracking.errors import (
    histories,
    least_errors,
    part_scale,
    representative_target,
    selected_targets,
)
from cislunar.figures.tracking.heatmaps import (
    block_rows,
    target_rows,
)
from cislunar.figures.tracking.learned import learned_figure, shares_of_prior
from cislunar.figures.tracking.representative import representative_target_figure
from cislunar.figures.tracking.tasking import METHODS

VELOCITY_UNIT_M_S = 1000.0 * LENGTH_UNIT_KM / TIME_UNIT_S


def task2(*files):
    """Key `task2` of the configuration, with further files over it."""
    return with_families(read_campaign(*files))["task2"]


def test_paper_cells_are_chosen_from_the_full_configuration():
    settings = task2()
    counts = target_count_cells(settings, "tpe")
    assert [c.targets for c in counts] == [20, 30, 50, 100]
    assert {c[:3] + c[4:] for c in counts} == {
        ("A", "tpe", "mukf", settings["interval_minutes"], "")
    }
    assert selected_cell(settings, "published") == [Cell("A", "published", "mukf", 20, 60)]
    intervals = interval_cells(settings, "tpe")
    assert [(c.scenario, c.targets, c.interval_minutes) for c in intervals] == [
        (*place, minutes) for place in (("A", 20), ("B", 33)) for minutes in (30, 60, 120, 180, 240)
    ]
    load = high_load_cells(settings, "tpe")
    assert [(c.scenario, c.targets, c.interval_minutes) for c in load] == [
        ("A", 50, minutes) for minutes in (30, 60, 120, 180, 240)
    ]
    assert figure_architectures(settings)[0] == "tpe"


def test_small_configuration_has_its_own_cells():
    settings = task2("quick.yaml")
    assert [c.targets for c in target_count_cells(settings, "tpe")] == [20, 30]
    assert {c.targets for c in high_load_cells(settings, "tpe")} == {20}
    variants = tasking_variants(settings)
    assert variants == {"": "exact", "tpe": "tpe-compiled", "greedy": "greedy"}
    assert set(variants.values()) <= set(METHODS), "a method without a look"


def test_other_counts_and_missing_cells():
    settings = task2()
    settings["target_counts"] = {"C": [90, 45, 60, 70, 80]}
    assert [c.targets for c in target_count_cells(settings, "tpe")] == [45, 60, 70, 90]
    settings["intervals"]["target_counts"] = {"A": [], "B": []}
    assert interval_cells(settings, "tpe") == high_load_cells(settings, "tpe") == []
    assert target_count_cells(settings, "unheard-of") == []
    assert selected_cell(settings, "unheard-of") == []
    settings["variants"]["cells"] = {}
    assert tasking_variants(settings) == {"": "exact"}


def test_rows_of_the_heat_maps():
    """A row for each target of any cell, named, and empty where a cell does not monitor it."""
    few, many = cell_data(6), cell_data(9)
    table = target_rows([few, many])
    assert list(table) == list(range(40, 49))
    assert list(table.values())[:3] == ["L2 halo N 40", "DRO 41", "polar, KPLO 42"]
    rows = block_rows(few, "anees", list(table))
    assert rows.last == 6 and np.isnan(rows.values[6:]).all()
    np.testing.assert_array_equal(np.flatnonzero(rows.unseen), [0])
    np.testing.assert_array_equal(np.flatnonzero(rows.inconsistent[0]), [1])
    assert not rows.inconsistent[1].any()
    assert np.isnan(rows.values[rows.unseen]).all()
    swapped = block_rows(few, "anees", list(table)[::-1])
    np.testing.assert_array_equal(swapped.values[::-1], rows.values)
    np.testing.assert_allclose(rows.values[2], few["anees"].values[0, 2])
    errors = block_rows(few, "rmse", list(table)).values[2]
    practical = np.repeat(
        [np.rad2deg(1.0), np.rad2deg(3600.0), LENGTH_UNIT_KM, VELOCITY_UNIT_M_S], 3
    )
    np.testing.assert_allclose(errors, practical * few["rmse"].values[0, 2])


def test_components_are_in_practical_units():
    """Rotation vectors in degrees, of large attitude errors as well; small factors for others."""
    data = cell_data(6)
    data["error"][0, :, 2, :3] = [0.3, -0.6, 0.2]
    hours, error, sigma = histories(data, 2)
    angles = np.linalg.norm(error[:, :3], axis=1)
    np.testing.assert_allclose(angles, attitude_angle_deg(data["error"].values[0, :, 2, :3]))
    np.testing.assert_allclose(error[:, :3] / angles[:, None], RECORDS * [np.array([3, -6, 2]) / 7])
    np.testing.assert_allclose(hours, data["time"].values / 3600.0)
    scaled = data["sigma"].values[0, :, 2].reshape(RECORDS, 4, 3)
    practical = [*np.rad2deg([1.0, 3600.0]).tolist(), LENGTH_UNIT_KM, VELOCITY_UNIT_M_S]
    expected = scaled * np.array(practical)[:, None]
    np.testing.assert_allclose(sigma.reshape(RECORDS, 4, 3), expected)
    np.testing.assert_allclose(least_errors(data, 2), 0.5 * sigma)


def test_targets_selected_by_rule():
    cell = cell_data(12)
    final = cell["final_attitude_error"].values[0]
    tracked = np.arange(2, 12)[np.argsort(final[2:])]
    chosen = selected_targets(cell)
    assert chosen == {
        int(tracked[0]): "best attitude",
        int(tracked[4]): "median attitude",
        1: "rotation inconsistent",
        0: "never observed",
    }
    cell["status"][:] = TRACKED
    order = np.argsort(final)
    assert list(selected_targets(cell)) == [order[0], order[5], order[11], order[10]]
    cell["status"][:] = INCONSISTENT
    cell["status_translation"][:] = INCONSISTENT
    assert selected_targets(cell) == {0: "all inconsistent"}


def test_representative_target_is_the_median_of_those_tracked_in_both():
    first, second = cell_data(6), cell_data(6)
    factors = np.array([9.0, 9.0, 1.0, 5.0, 2.0, 3.0])
    second["rmse"] = first["rmse"] * xr.DataArray(factors, dims="target")
    second["status"][:, 3] = INCONSISTENT
    assert representative_target(first, second) == 4
    second["status"][:] = INCONSISTENT
    assert representative_target(first, second) is None
    figure = representative_target_figure(
        {Cell("A", "tpe", "mukf", 6, m): data for m, data in ((30, first), (60, second))}
    )
    assert any("no target is tracked" in text.get_text() for text in figure.texts)


def test_axis_of_errors_holds_them():
    error, sigma = np.array([[1e-3], [2e-6], [np.nan]]), np.array([[1e-5], [1e-6], [1e-6]])
    scale = part_scale([error], [sigma])
    assert scale.reach > 1e-3
    assert 3e-6 <= scale.linear < 3e-5


def test_what_is_learned_is_drawn_over_the_prior():
    names = ["log_inertia_y", "log_inertia_z", "log_albedo"]
    rng = np.random.default_rng(0)
    prior = np.array([0.1, 0.1, 0.25])
    share = np.linspace(1.0, 0.2, 5)[:, None, None] * np.ones((5, 40, 3))
    errors = share * prior * rng.standard_normal(share.shape)
    dims = ("seed", "epoch", "target", "parameter")
    share[:, 0] = 7.0  # of a target nobody has seen
    cell = xr.Dataset(
        {
            "parameter_sigma": (dims, (share * prior)[None]),
            "parameter_error": (dims, errors[None]),
            "status": (("seed", "target"), np.full((1, 40), TRACKED)),
        },
        {"parameter": names, "epoch": 3600.0 * np.arange(5)},
        {
            "settings": json.dumps(
                {"batch": {"estimated_parameters": {"log_inertia": 0.1, "log_albedo": 0.25}}}
            )
        },
    )
    cell["status"][0, 0] = NEVER_OBSERVED
    found = shares_of_prior(cell)
    assert list(found) == ["log_albedo", "log_inertia"]
    assert found["log_inertia"][0].shape == (5, 78)
    figure = learned_figure(cell)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["(a) albedo", "(b) inertia"]
    claimed = figure.axes[1].lines[0]
    np.testing.assert_allclose(claimed.get_xdata(), [1, 2, 3, 4, 5])
    np.testing.assert_allclose(claimed.get_ydata(), np.linspace(1.0, 0.2, 5))
    settings = task2()
    assert [each.variant for each in learned_cell(settings)] == ["everything-joint-turning"]
    settings["variants"] = {**settings["variants"], "cells": {}}
    assert learned_cell(settings) == []
    with pytest.raises(InputFileError, match=r"task2\.batch\.estimated_parameters"):
        learned_figure(cell.drop_vars("parameter_sigma"))
