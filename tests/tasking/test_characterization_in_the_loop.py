"""Characterization at the end of a run: estimates from light curves, and the truth beside them."""

import numpy as np
import pytest
import xarray as xr

from cislunar.attitude.quaternion import attitude_matrix
from cislunar.campaign.tracking.summary import BRIGHT_ROWS, _characterized, _with_status
from cislunar.errors import InputFileError
from cislunar.estimation.light_curves.batch import batch
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.light_curves.model_selection.characterization import (
    amplitude_of,
    area_albedo_of,
)
from cislunar.estimation.light_curves.model_selection.settings import ModelSelectionSettings
from cislunar.estimation.light_curves.row_blocks import MAGNITUDE
from cislunar.evaluation.characterization import CHARACTERIZED_FIELDS, within_intervals
from cislunar.figures.tracking.choice import characterized_cells
from cislunar.figures.tracking.learned import characterization_figure
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material, PhotometryModel
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.closed_loop import ClosedLoop, run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import CHARACTERIZATION, stream
from cislunar.tasking.realization import advance_interval, start_realization
from cislunar.tasking.truth import TruthModel

SEED = 1


@pytest.fixture(scope="module")
def run():
    """A realization with a Lambert-Phong truth whose magnitudes have no noise."""
    problem = tracking_problem(6, 3, PhotometryModel(), duration_hours=2.0)
    law = PhotometryModel(reflection="lambert-phong")
    surfaces = target_surfaces(icosahedron(), Material(), 3, law)
    noise = problem.loop.sensor.noise * [1e-9, 1.0, 1.0]
    truth = TruthModel(surfaces, noise, np.zeros(3))
    loop = ClosedLoop(
        *problem[:4], [SEED], problem.loop, truth=truth,
        estimator=batch(BatchSettings(model_selection=ModelSelectionSettings(1))),
    )  # fmt: skip
    own, moved = start_realization(loop.inputs, 0, SEED), []
    motion = loop.inputs.true_motion(own.truth, SEED).advance(1)
    for number in range(problem.loop.epochs.size):
        moved.append(advance_interval(loop.inputs, own, number))
    return loop, own, motion, own.end(loop.inputs).characterized


def test_truth_is_that_of_the_measured_light(run):
    """Magnitudes without noise are the true ones, and the rotation is that at the epoch."""
    _, own, motion, found = run
    seen = 0
    for j in range(3):
        data, model, _ = own.estimator.light_curve(j)
        omega = motion.angular_velocity[j, 0]
        rate = np.linalg.norm(omega)
        assert found.true_spin_period[j] == pytest.approx(np.pi / 1800.0 / rate, rel=1e-12)
        axis = attitude_matrix(motion.quaternion[j, 0]).T @ omega / rate
        np.testing.assert_allclose(found.true_spin_axis[j], axis, atol=1e-12)
        if len(data) == 0:
            assert np.isnan(found.true_amplitude[j])
            continue
        seen += 1
        measured = data[:, MAGNITUDE], data, model.irradiance_4pi
        # the direction of the estimated position is not exactly the true one
        assert found.true_amplitude[j] == pytest.approx(amplitude_of(*measured), abs=2e-3)
        assert found.true_area_albedo[j] == pytest.approx(area_albedo_of(*measured), rel=2e-3)
    assert seen >= 2


def test_estimates_follow_from_the_light_curves_alone(run):
    """The estimator is not told of the truth: its own values are those of the result."""
    loop, own, _, found = run
    again = own.estimator.characterizations([stream(CHARACTERIZATION, SEED, j) for j in range(3)])
    for j, each in enumerate(again):
        if each is None:
            assert np.isnan(found.spin_period[j]).all()
            continue
        np.testing.assert_array_equal(found.spin_period[j], each.spin_period_h)
        np.testing.assert_array_equal(found.area_albedo[j], each.area_albedo_m2)
        np.testing.assert_array_equal(found.spin_axis[j], each.spin_axis)
    inside = within_intervals(found)
    for name in ("spin_period", "amplitude", "area_albedo"):
        for j in range(3):
            _, low, high = getattr(found, name)[j]
            assert inside[name][j] == (low <= getattr(found, f"true_{name}")[j] <= high)
    assert loop.inputs.abilities.chooses_models


def test_usual_runs_have_no_characterization():
    problem = tracking_problem(3, 2, PhotometryModel(), duration_hours=1.0)
    assert (
        run_closed_loop(*problem[:4], [SEED], problem.loop, estimator="batch").characterized is None
    )


def _cell(status, rng):
    """Cell with targets whose truth lies within, below, and outside of their intervals."""
    count = status.shape[1]
    truth = rng.uniform(6.0, 9.0, (1, count))
    interval = truth[..., None] * [1.0, 0.9, 1.1]
    interval[0, :2] += 5.0
    axis = np.zeros((1, count, 3))
    axis[..., 0] = 1.0
    turned = np.stack([np.cos([0.1] * count), np.sin([0.1] * count), [0.0] * count], axis=-1)[None]
    values = {
        "spin_period": interval, "amplitude": interval, "area_albedo": interval,
        "true_spin_period": truth, "true_amplitude": truth, "true_area_albedo": truth,
        "spin_axis": axis, "true_spin_axis": turned,
        "spin_axis_radius": np.linspace(1.0, 20.0, count)[None],
    }  # fmt: skip
    found = xr.Dataset({
        name: (("seed", "target", *CHARACTERIZED_FIELDS[name].dims), each)
        for name, each in values.items()
    })  # fmt: skip
    found["attitude_status"] = ("seed", "epoch", "target"), status[:, None]
    share, squares = [0.5, 1.0, 0.5, 0.0, 0.0, 0.0], [2.0, 1.0, 4.0, np.nan, np.nan, np.nan]
    found["unique_share"] = ("seed", "target"), [share]
    found["anees_unique"] = ("seed", "target"), [squares]
    rows = np.full((1, count), BRIGHT_ROWS)
    rows[0, -1] = BRIGHT_ROWS - 1
    found["updates"] = ("seed", "target"), rows
    return found


def test_shares_of_bright_targets_within_their_intervals():
    cell = _cell(np.array([[0, 0, 1, 2, 2, 2]]), np.random.default_rng(0))
    found = _characterized(cell) | _with_status(cell, np.ones((1, 6), dtype=bool))
    assert found["bright"] == [5]
    assert found["spin_period_within_share"] == pytest.approx(3 / 5)
    # half angles of 1, 4.8, 8.6, 12.4 and 16.2 deg against 5.7 deg
    assert found["spin_axis_within_share"] == pytest.approx(3 / 5)
    assert found["unknown_attitude_share"] == pytest.approx(1 / 2)
    assert found["unique_attitude_share"] == pytest.approx(1 / 3)
    assert found["spin_axis_width_median"] == pytest.approx(8.6)
    # over the time while they are unique: 0.5, 1 and 0.5 of it with squares of 2, 1 and 4
    assert found["anees_unique"] == pytest.approx((0.5 * 2.0 + 1.0 + 0.5 * 4.0) / 2.0)
    nobody = _characterized(cell.assign(updates=0 * cell["updates"]))
    assert nobody["bright"] == [0] and np.isnan(nobody["spin_period_within_share"]).all()


def test_figure_of_bright_targets():
    cell = _cell(np.array([[0, 0, 1, 2, 2, 2]]), np.random.default_rng(0))
    figure = characterization_figure([cell, cell])
    titles = ["spin period", "amplitude", "area times albedo", "spin axis"]
    assert [axes.get_title(loc="left")[4:] for axes in figure.axes] == titles
    drawn = [each.lines[0].get_xdata().size for each in figure.axes[0].containers]
    assert drawn == [4, 2, 4]  # by status, without the faint target
    bars = figure.axes[0].containers[1].lines[2][0].get_segments()
    truth = cell["true_spin_period"].values[0, 2]
    np.testing.assert_allclose(np.array(bars)[0, :, 1], [0.9 * truth, 1.1 * truth])
    with pytest.raises(InputFileError, match=r"batch\.model_selection\.effort"):
        characterization_figure([cell.drop_vars("spin_period")])


def test_cells_of_all_days_make_one_figure():
    change = {"batch": {"model_selection": {"effort": 1}}}
    place = {"scenario": "A", "architecture": "exact", "targets": [20], "estimators": ["batch"]}
    cells = {
        "boxes": {**place, "change": change},
        "boxes-day3": {**place, "change": change},
        "usual": {**place, "change": {}},
    }
    task2 = {
        "interval_minutes": 60,
        "estimators": ["batch"],
        "variants": {
            "scenario": "A", "architecture": "exact", "cells": cells, "pooled": {"day3": {}},
        },
    }  # fmt: skip
    found = characterized_cells(task2)
    assert list(found) == ["A_exact_boxes_nt20"]
    assert [each.variant for each in found["A_exact_boxes_nt20"]] == ["boxes", "boxes-day3"]
