"""What sets both estimators side by side, tables to figures, from made-up realizations."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from made_up_summaries import make_summary

from cislunar.campaign.tracking.tables import (
    estimator_rows,
    pooled_rows,
    reading_rows,
    tracking_rows,
)
from cislunar.evaluation.intervals import t_interval
from cislunar.figures.tracking.pooled import pooled_figure
from cislunar.figures.tracking.trends import against_interval_figure, against_targets_figure
from workflow.documents.blocks import BLOCKS, NOT_RUN
from workflow.documents.real_block import REAL_BLOCKS, study_table


def _labeled(summary, **labels):
    every = {key: ("cell", [value] * summary.sizes["cell"]) for key, value in labels.items()}
    return summary.assign_coords(every)


@pytest.fixture(scope="module")
def summary():
    """The filter loses ten targets in every cell, the batch estimator one."""
    bound = {"bound_ratio_median": (1.0,) * 4, "bound_attitude_median": 0.4,
             "bound_attitude_90": 2.0, "final_attitude_error_90": 3.0}  # fmt: skip
    filtered = make_summary(lambda *cell: bound | {"inconsistent_rotation": 10.0})
    fitted = make_summary(lambda *cell: bound | {"inconsistent_rotation": 1.0})
    aware = make_summary(lambda *cell: bound | {"inconsistent_rotation": 3.0})
    return xr.concat(
        [
            filtered,
            _labeled(fitted, estimator="batch"),
            _labeled(aware, estimator="batch", variant="full-information"),
            _labeled(aware, estimator="batch", variant="accurate"),
        ],
        "cell",
    )


@pytest.fixture(scope="module")
def tables(summary):
    return {"tracking": tracking_rows(summary), "readings_tracking": reading_rows(summary)}


def test_the_difference_is_the_other_less_the_first(summary):
    rows = estimator_rows(summary)
    lost = rows[(rows["quantity"] == "inconsistent_rotation") & (rows["variant"] == "")]
    assert set(lost["first_estimator"]) == {"mukf"} and set(lost["other_estimator"]) == {"batch"}
    np.testing.assert_allclose(lost["difference"], -9.0)
    np.testing.assert_allclose(lost["first_largest"], 10.1)
    assert rows[rows["variant"] != ""].empty  # the filter has no such cells


def test_blocks_have_both_estimators_and_omit_missing_cells(tables):
    lines = BLOCKS["estimators"](tables).splitlines()
    assert any(line.startswith("| 50 | paper's filter (MUKF) |") and "10.0 (10)" in line
               for line in lines)  # fmt: skip
    assert any(line.startswith("| 50 | batch estimator |") and "1.0 (1)" in line for line in lines)
    assert not any(line.startswith("| 202 |") for line in lines)
    assert "| 50 | 10.0 | 1.0 |" in BLOCKS["estimators-headline"](tables)
    settings = BLOCKS["batch-settings"](tables)
    assert "(`accurate`) | 50 |" in settings and "single-start" not in settings


def test_attitude_in_the_tasking_is_shown_as_a_difference(tables):
    block = BLOCKS["aware-tasking"](tables)
    line = next(part for part in block.splitlines() if "| 50 | batch estimator |" in part)
    assert "(`full-information`) |" in line and "+2.0 [" in line


def test_model_errors_stand_beside_their_remedies():
    common = {"scenario": "A", "architecture": "published", "targets": 50, "interval_minutes": 60,
              "kind": "material.rms_slope", "size": 25.0, "size_unit": "%", "part": "",
              "error": "slope-25"}  # fmt: skip
    cells = [("mukf", "slope-25", "", 0.4), ("batch", "slope-25", "", 0.6),
             ("batch", "slope-25-wide", "batch.magnitude_noise_factor = 4", 0.9)]  # fmt: skip
    rows = [
        common | {"estimator": estimator, "variant": variant, "also": also,
                  "quantity": quantity, "mean": coverage if quantity == "coverage" else 2.0}
        for estimator, variant, also, coverage in cells
        for quantity in ("coverage", "inconsistent_rotation", "final_attitude_error_median")
    ]  # fmt: skip
    block = BLOCKS["model-errors"]({"model_error": pd.DataFrame(rows)})
    line = block.splitlines()[-1]
    assert "0.400, 2.0, 2.0°" in line and "0.600, 2.0, 2.0°" in line
    assert "0.900, 2.0, 2.0° (`slope-25-wide`)" in line


@pytest.mark.parametrize("draw", [against_targets_figure, against_interval_figure])
def test_figures_hold_both_estimators_and_the_bound(summary, draw):
    figure = draw(summary, "estimator")
    texts = {text.get_text() for text in figure.legends[0].get_texts()}
    assert texts == {
        "paper's filter (MUKF)",
        "batch estimator",
        "Cramér-Rao bound",
        "median expected of an estimator at the bound",
        "99.7 % (Gaussian errors)",
    }
    lost = next(axes for axes in figure.axes if "inconsistent" in axes.get_ylabel())
    heights = {round(float(np.mean(line.get_ydata())), 3)
               for line in lost.lines if len(line.get_xdata()) > 1}  # fmt: skip
    assert {10.0, 1.0} <= heights
    assert draw(summary.isel(cell=summary["estimator"].values == "mukf"), "estimator") is not None


@pytest.fixture(scope="module")
def pooled():
    """Two pipelines of 20 and 43 satellites; ours on two days, of which the second is worse."""
    parts = [
        ("information", "batch", "", 0.9),
        ("information", "batch", "day10", 0.7),
        ("published", "mukf", "paper-ephemeris", 0.4),
        ("published", "mukf", "paper-ephemeris-day10", 0.4),
        ("published", "mukf", "paper", 0.0),
    ]
    cells = []
    for name, estimator, variant, custody in parts:
        known = {"custody_share": custody, "final_error_geometric_all": (0.1, 1e-5, 1e-5, 1e-5)}
        made = make_summary(lambda *cell, known=known: known)
        made = made.isel(cell=np.flatnonzero(made["interval_minutes"].values == 60))
        none = xr.zeros_like(made["never_observed"])
        made = made.assign(never_visible=none, missed=none)
        made = made.assign(
            position_custody_share=none + 1.0, attitude_custody_share=made["custody_share"]
        )
        for observers in (20, 43):
            stem = f"{name}-{observers}" if name == "information" else name
            own = _labeled(made, architecture=stem, estimator=estimator, variant=variant)
            cells.append(_labeled(own, observers=observers))
    return pooled_rows(xr.concat(cells, "cell"), ["day10"])


def _custody(table, **labels):
    own = table[table["quantity"] == "custody_share"]
    for key, value in labels.items():
        own = own[own[key] == value]
    assert len(own) == 1
    return own.iloc[0]


def test_realizations_of_days_count_together(pooled):
    cell = {"scenario": "A", "targets": 100, "observers": 20}
    both = _custody(pooled, estimator="batch", **cell)
    assert both["variant"] == "" and both["seeds"] == 16
    np.testing.assert_allclose(both["mean"], 0.8)
    days = [float(each) for each in both["by_day"].split()]
    np.testing.assert_allclose(days, [0.9, 0.7], rtol=1e-5)
    # two means with one degree of freedom, limited to shares
    assert both["days"] == 2 and t_interval(days).high > 1.0
    assert (both["low"], both["high"], both["average"]) == (0.0, 1.0, "arithmetic")
    assert both["smallest"] < 0.7 < 0.9 < both["largest"]
    single = _custody(pooled, variant="paper", **cell)
    assert single["days"] == 1 and single["by_day"].endswith(" nan")
    assert _custody(pooled, variant="paper-ephemeris", **cell)["seeds"] == 16
    assert _custody(pooled, variant="paper", **cell)["seeds"] == 8


def test_the_pipelines_are_compared_once_the_study_was_run(pooled, tmp_path):
    headline, number = BLOCKS["real-headline"], BLOCKS["real-number"]
    assert headline({}) == "" and number({}) == NOT_RUN
    (tmp_path / "tables").mkdir()
    pooled.to_csv(tmp_path / "tables/pooled.csv", index=False)
    table = study_table(tmp_path)
    head = headline({"real": table[table["targets"] == 100]})
    assert "| recommended pipeline, 20 satellites | 80 [" in head
    assert "| paper's pipeline, ephemeris filter, 43 satellites | 40 [" in head
    assert number({"real": table}).count("\n| ") > 6
    assert all(BLOCKS[name]({"real": table}) for name in REAL_BLOCKS)
    assert "| 80 [" in BLOCKS["real-verdict"]({"real": table})


def test_a_curve_for_each_pipeline(pooled):
    figure = pooled_figure(pooled[pooled["scenario"] == "A"])
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == [
        "recommended pipeline",
        "paper's pipeline, ephemeris filter",
        "paper's pipeline, CR3BP filter",
    ]
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert sum(title.endswith(" targets") for title in titles) == 3
    drawn = {round(float(np.mean(line.get_ydata())), 3)
             for line in figure.axes[2].lines if len(line.get_xdata()) == 2}  # fmt: skip
    assert drawn >= {80.0, 40.0, 0.0}
