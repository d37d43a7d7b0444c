"""Characterization of the targets of a cell whose estimator chooses body models."""

import numpy as np
import pytest
from small_cell_datasets import small_settings

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.cell import CellInputs
from cislunar.campaign.tracking.dataset import cell_dataset, write_cell
from cislunar.campaign.tracking.summary import BRIGHT_ROWS, read_cell_metrics, summary_dataset
from cislunar.campaign.tracking.tables import pooled_rows, tracking_rows


def test_a_cell_that_chooses_models_has_a_characterization(sources, tmp_path):
    """In the file that is written piece by piece and in the one of a run in memory."""
    cell, inputs = Cell("A", "tpe", "batch", 4, 60), CellInputs(**sources)
    changes = {"seeds": 1, "batch": {"noise_freedom": 4, "model_selection": {"effort": 1}}}
    given = cell, inputs, small_settings(**changes)
    whole = cell_dataset(*given, propagator="dop853", seed=3)
    write_cell(*given, tmp_path / "cell.nc", propagator="dop853", seed=3)
    read = read_cell_metrics(tmp_path / "cell.nc")
    assert whole["spin_period"].dims == ("seed", "target", "interval_part")
    assert list(whole["interval_part"].values) == ["estimate", "low", "high"]
    units = {"spin_period": "h", "amplitude": "mag", "area_albedo": "m2"}
    for name, unit in (units | {"spin_axis_radius": "degree"}).items():
        assert whole[name].attrs["units"] == unit
        np.testing.assert_array_equal(whole[name], read[name])
    seen = whole["updates"].values > 0
    assert seen.any() and np.isfinite(whole["spin_period"].values[seen]).all()
    summary = summary_dataset([(cell, read)], {"task2": {}}, seed=3)
    table = tracking_rows(summary).set_index("quantity")
    assert table.loc["bright", "mean"] == (whole["updates"].values >= BRIGHT_ROWS).sum()
    statuses = [f"{name}_attitude_share" for name in ("unique", "ambiguous", "unknown")]
    assert table.loc[statuses, "mean"].sum() == pytest.approx(1.0)
    pooled = pooled_rows(summary, [])
    assert set(statuses) <= set(pooled["quantity"])
