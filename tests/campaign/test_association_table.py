"""The table of a study of association, from small cells."""

import numpy as np
import pytest
from small_cells import cell_inputs, settings_of_cell

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.association_table import ASSOCIATION_COLUMNS, association_rows
from cislunar.campaign.tracking.dataset import cell_dataset
from cislunar.campaign.tracking.summary import read_cell_metrics
from cislunar.figures.tracking import association_figure
from cislunar.runtime.netcdf import write_dataset

CELL = Cell("A", "published", "mukf", 3, 60)
CLUTTER = {"detections": "all-in-field", "false_alarms_deg2": 1.0 / 9.0}


@pytest.fixture(scope="module")
def cells(tmp_path_factory):
    inputs, folder, found = cell_inputs(1), tmp_path_factory.mktemp("cells"), []
    for name, given in (
        ("tasked", {}),
        ("identity", {"detections": "all-in-field", "method": "known-identity"}),
        ("frames", CLUTTER | {"method": "multiple-frames"}),
        ("nearest", CLUTTER | {"method": "nearest-neighbor"}),
    ):
        cell = CELL._replace(variant=name)
        settings = settings_of_cell({"seeds": 5}, association=given)
        data = cell_dataset(cell, inputs, settings, propagator="dop853", seed=3)
        write_dataset(data, folder / f"{name}.nc")
        found.append((cell, read_cell_metrics(folder / f"{name}.nc")))
    return found


def test_histories_of_tracks_are_those_of_the_result(cells):
    data = dict(zip(("tasked", "identity", "frames", "nearest"), cells, strict=True))
    assert "gospa" not in data["tasked"][1]
    known = data["identity"][1]
    assert known["wrong_associations"].values.sum() == 0
    assert known["associations"].values.sum() > 0
    np.testing.assert_allclose(
        known["gospa"].values[..., 0] ** 2, known["gospa"].values[..., 1:].sum(axis=-1), rtol=1e-9
    )
    origin, taken = known["association_origin"].values, known["associations"].values
    own = np.broadcast_to(np.arange(3), origin.shape)
    np.testing.assert_array_equal(origin, np.where(taken > 0, own, -2))


def test_methods_are_compared_with_known_identities(cells):
    table = association_rows(cells, 10.0)
    assert list(table.columns) == list(ASSOCIATION_COLUMNS)
    frames = table[table["associator"] == "multiple-frames"].set_index("quantity")
    assert frames["clutter"].unique().tolist() == [1.0]
    gospa = {
        cell.variant: data["gospa"].values[:, :, 0].mean(axis=1)
        for cell, data in cells
        if "gospa" in data
    }
    ratio = (gospa["frames"] / gospa["identity"]).mean()
    assert frames.loc["gospa_ratio", "mean"] == pytest.approx(ratio, rel=1e-12)
    assert frames.loc["lost_tracks", "mean"] == 0.0
    known = table[table["associator"] == "known-identity"].set_index("quantity")
    assert known.loc["gospa_ratio", ["mean", "low", "high"]].tolist() == [1.0, 1.0, 1.0]
    alone = table[table["associator"] == "tasked target"]["quantity"].tolist()
    assert "gospa_ratio" not in alone and "position_ratio" in alone


def test_the_figure_has_the_methods(cells):
    table = association_rows(cells, 10.0).assign(targets=100)
    figure = association_figure(table)
    labels = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert labels == [
        "global nearest neighbor",
        "joint probabilistic data association",
        "assignment over several exposures",
    ]
