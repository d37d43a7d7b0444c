"""Model errors: their size from the configuration, the table of their cost, the figure's curves."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from cislunar.campaign.settings.cells import Cell, variant_cells
from cislunar.campaign.tracking.model_errors import NONE, SEVERAL, model_errors, plotted_errors
from cislunar.campaign.tracking.summary import summary_dataset
from cislunar.campaign.tracking.tables import ERROR_COLUMNS, ERROR_QUANTITIES, model_error_rows
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.errors import InputFileError
from cislunar.evaluation.intervals import t_interval
from cislunar.figures.tracking.model_error import ROWS, curve, model_error_figure

SEEDS, TARGETS = 4, 6


def cell_data(level, seed):
    """A synthetic tracking cell: errors grow with the level, realizations differ by an offset."""
    rng = np.random.default_rng(seed)
    shape = (SEEDS, TARGETS)
    offset = np.linspace(0.0, 0.1, SEEDS)[:, None]
    zeros = np.zeros(shape, dtype=np.uint8)
    inconsistent = zeros.copy()
    inconsistent[:, : int(level)] = 2
    parts = offset[..., None] * np.ones((*shape, 12))
    data = {
        "coverage": (("seed", "target", "component"), 0.8 - 0.1 * level + parts),
        "final_coverage": (("seed", "target", "component"), 0.8 + parts),
        "custody": (("seed", "target"), (inconsistent == 0).astype(int)),
        "anees": (("seed", "target", "component"), rng.lognormal(size=(*shape, 12))),
        "rmse": (("seed", "target", "component"), 1e-5 * (1.0 + level) + 1e-6 * parts),
        "status": (("seed", "target"), inconsistent),
        "status_rotation": (("seed", "target"), inconsistent),
        "status_translation": (("seed", "target"), zeros),
        "final_attitude_error": (("seed", "target"), 1.0 + level + offset * np.ones(shape)),
        "bound_ratio": (("seed", "target", "part"), np.ones((*shape, 4))),
        "bound_attitude": (("seed", "target"), np.ones(shape)),
        "information": (("seed", "epoch"), np.ones((SEEDS, 2))),
        "updates": (("seed", "target"), 1 + zeros.astype(int)),
        "assignment": (("seed", "epoch", "observer"), np.zeros((SEEDS, 2, 3), dtype=int)),
        "outcome": (("seed", "step", "target"), np.zeros((SEEDS, 5, TARGETS), dtype=int)),
    }
    for name in ("out_of_field", "undetectable_sigma_points", "cholesky_failures", "failed"):
        data[name] = (("seed", "target"), zeros)
    return xr.Dataset(data, {"family": ("target", ["DRO"] * TARGETS)})


LEVELS = {"": 0.0, "slope-10": 1.0, "slope-25": 2.0, "slope-less-25": 1.0, "torque-5": 3.0}


def summary_with(estimators):
    """Summary of some variants, the last one without the second estimator."""
    found = []
    for number, estimator in enumerate(estimators):
        for variant, level in LEVELS.items():
            if number == 0 or variant != "torque-5":
                cell = Cell("A", "published", estimator, 50, 60, variant)
                found.append((cell, cell_data(level * (1.0 - 0.5 * number), number)))
    return summary_dataset(found, {}, 1)


def test_errors_follow_from_the_configuration(task2):
    found = {error.variant: error for error in model_errors(task2)}
    expected = {
        "slope-less-25": ("material.rms_slope", -25.0, "%"),
        "albedo-50": ("material.diffuse_albedo", 50.0, "%"),
        "reflectance-10": ("material.normal_reflectance", 10.0, "%"),
        "stretch-20": ("body.axis_scale", 20.0, "%"),
        "noise-half": ("sensor.magnitude_noise", -50.0, "%"),
        "noise-double": ("sensor.magnitude_noise", 100.0, "%"),
        "inertia-5": ("body.inertia", 5.0, "%"),
    }
    for variant, (kind, size, unit) in expected.items():
        error = found[variant]
        assert (error.kind, error.unit, error.also) == (kind, unit, "")
        assert error.size == pytest.approx(size, abs=1e-6)
    assert found["torque-30"].unit == "degree"
    assert found["torque-30"].size == pytest.approx(30.0, rel=1e-3)
    assert "irradiance" not in found
    joint = found["slope-10-joint"]
    assert (joint.error, joint.kind) == ("slope-10", "material.rms_slope")
    assert "batch.estimated_parameters.log_slope = 0.25" in joint.also
    assert (found["joint"].kind, found["joint"].size, found["joint"].error) == (NONE, 0.0, "")
    everything = found["everything-joint-turning"]
    assert (everything.error, everything.kind) == ("everything", SEVERAL)
    named = [cell.variant for cell in variant_cells(task2)]
    assert all(error.variant in named for error in plotted_errors(task2))


def test_a_remedy_is_named_and_its_error_is_relative_to_the_assumed_model(task2):
    truth = {"sensor": {"magnitude_noise": 0.2}}
    task2["variants"]["cells"] = {
        "remedy": {"targets": [50], "change": {"truth": truth, "sensor": {"magnitude_noise": 0.2}}},
        "two": {"targets": [50], "change": {"truth": truth | {"material": {"rms_slope": 0.4}}}},
        "shape": {"targets": [50], "change": {"truth": {"body": {"shape": "other.obj"}}}},
        "inner": {"targets": [50], "change": {"truth": {"body": {"inertia": [1, 2, 2.5]}}}},
        "absent": {"targets": [], "change": {"truth": truth}},
        "torque": {"targets": [50], "change": {"truth": {"torque": {"random_deg_h2": 0.1}}}},
        "tails": {"targets": [50], "change": {"truth": {"parameter_freedom": 3}}},
    }
    remedied, two, shape, inner, absent, *without_size = model_errors(task2)
    assert [each.kind for each in without_size] == ["torque.random_deg_h2", "parameter_freedom"]
    assert np.isnan([each.size for each in without_size]).all()
    assert (remedied.size, remedied.also) == (0.0, "sensor.magnitude_noise = 0.2")
    assert two.kind == SEVERAL and np.isnan(two.size)
    assert np.isnan(shape.size)
    assert inner.size == pytest.approx(150.0)
    assert absent.size == pytest.approx(100.0)
    assert plotted_errors(task2) == [inner]


def test_table_compares_seed_by_seed(task2):
    summary = summary_with(["mukf"])
    table = model_error_rows(summary, {"task2": task2})
    assert list(table.columns) == ERROR_COLUMNS
    assert set(table["variant"]) == set(LEVELS)
    assert len(table) == len(LEVELS) * len(ERROR_QUANTITIES)
    row = table[(table.variant == "slope-25") & (table.quantity == "rmse_median")].iloc[0]
    usual, changed = (
        LENGTH_UNIT_KM * summary["rmse_median"].values[index, :, 2] for index in (0, 2)
    )
    own = t_interval(changed)
    assert (row["mean"], row["low"], row["high"]) == pytest.approx(own[:3])
    assert row["usual"] == pytest.approx(usual.mean())
    # realizations differ by the same offsets with and without the error: no scatter remains
    assert row["difference"] == pytest.approx(2e-5 * LENGTH_UNIT_KM)
    assert row["difference_high"] - row["difference_low"] < 1e-9
    assert row["high"] - row["low"] > 0.01
    none = table[table.kind == NONE]
    assert len(none) == len(ERROR_QUANTITIES)
    np.testing.assert_array_equal(none["difference"], 0.0)
    inconsistent = table[
        (table.variant == "torque-5") & (table.quantity == "inconsistent_rotation")
    ]
    assert inconsistent["difference"].item() == 3.0


def test_any_subset_of_estimators_may_be_present(task2):
    settings = {"task2": task2}
    both = model_error_rows(summary_with(["mukf", "batch"]), settings)
    assert set(both.estimator) == {"mukf", "batch"}
    assert set(both[both.estimator == "batch"].variant) == set(LEVELS) - {"torque-5"}
    alone = model_error_rows(summary_with(["batch"]), settings)
    assert set(alone.estimator) == {"batch"}
    nothing = model_error_rows(summary_with(["mukf"]).isel(cell=[1, 2]), settings)
    assert nothing.empty and list(nothing.columns) == ERROR_COLUMNS


def test_curves_start_from_no_error(task2, tmp_path):
    path = tmp_path / "table.csv"
    model_error_rows(summary_with(["mukf", "batch"]), {"task2": task2}).to_csv(path, index=False)
    table = pd.read_csv(path)
    slopes = curve(table, "material.rms_slope", "mukf", "coverage")
    assert slopes["size"].tolist() == [-25.0, 0.0, 10.0, 25.0]
    np.testing.assert_allclose(slopes["mean"], [0.75, 0.85, 0.75, 0.65])
    assert curve(table, "angular_acceleration_deg_h2", "batch", "coverage").empty
    figure = model_error_figure(table)
    assert len(figure.axes) == 2 * len(ROWS)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "paper's filter (MUKF)",
        "batch estimator",
    ]
    drawn = figure.axes[0].lines[0].get_ydata()
    np.testing.assert_allclose(drawn, 100.0 * slopes["mean"])


def test_remedies_have_curves_of_their_own(task2):
    """A remedied variant has the size of its error and a curve without the cell of no error."""
    cells = task2["variants"]["cells"]
    truth = {"truth": {"material": {"rms_slope": 0.375}}}
    cells["slope-25"]["change"] = truth
    cells["remedy"] = {"targets": [50], "change": truth | {"process_noise": {"attitude_deg": 1}}}
    found = [
        (Cell("A", "published", "mukf", 50, 60, name), cell_data(level, 0))
        for name, level in (("", 0.0), ("slope-25", 3.0), ("remedy", 1.0))
    ]
    table = model_error_rows(summary_dataset(found, {}, 1), {"task2": task2})
    plain = curve(table, "material.rms_slope", "mukf", "coverage")
    remedied = curve(table, "material.rms_slope", "mukf", "coverage", remedied=True)
    assert (plain["size"].tolist(), remedied["size"].tolist()) == ([0.0, 25.0], [25.0])
    assert remedied["mean"].item() == pytest.approx(0.75)
    assert remedied["also"].item() == "process_noise.attitude_deg = 1"
    legend = model_error_figure(table).legends[0]
    name = "paper's filter (MUKF)"
    assert [text.get_text() for text in legend.get_texts()] == [name, f"{name}, adapted settings"]


def test_a_table_without_sizes_is_refused(task2):
    table = model_error_rows(summary_with(["mukf"]), {"task2": task2})
    with pytest.raises(InputFileError, match=r"model_error\.csv.*task2\.variants\.families"):
        model_error_figure(table[table.kind == NONE])


def test_no_text_of_the_figure_covers_another(task2):
    found = [
        (Cell("A", "published", "mukf", 50, 60, name), cell_data(1.0, 0))
        for name in ("", *(error.variant for error in model_errors(task2)))
    ]
    figure = model_error_figure(model_error_rows(summary_dataset(found, {}, 1), {"task2": task2}))
    renderer = figure.canvas.get_renderer()
    figure.draw(renderer)
    texts = [*figure.texts, *(axes._left_title for axes in figure.axes)]
    texts += [label for axes in figure.axes for label in (axes.xaxis.label, axes.yaxis.label)]
    boxes = [text.get_window_extent(renderer) for text in texts if text.get_text()]
    boxes.append(figure.legends[0].get_window_extent(renderer))
    page = figure.bbox.padded(0.5)
    for index, box in enumerate(boxes):
        assert box.x0 >= page.x0 and box.x1 <= page.x1 and box.y0 >= page.y0 and box.y1 <= page.y1
        assert not any(box.padded(-0.5).overlaps(other) for other in boxes[:index])
