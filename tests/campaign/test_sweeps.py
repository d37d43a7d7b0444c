"""Sweeps over settings: their cells, table and figure."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaign_folder import read_settings, with_change

from cislunar.campaign.kernels import kernel_set, tracking_kernels
from cislunar.campaign.settings.cell_settings import RECOMMENDED, cell_settings, in_mode
from cislunar.campaign.settings.cells import campaign_cells
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.families import sweep_points, swept_cells, with_families
from cislunar.campaign.settings.reading import merged
from cislunar.campaign.settings.scenarios import (
    in_study,
    scenario_settings,
    shared_dataset,
)
from cislunar.campaign.tracking.summary import PER_CELL, PER_PART
from cislunar.campaign.tracking.sweep_table import SWEEP_COLUMNS, plotted_values, sweep_rows
from cislunar.figures.search.sweep import sweep_figure


def test_a_sweep_of_the_tracking_makes_variants(study):
    points = sweep_points(study, "noise")
    assert [point.variant for point in points] == [f"noise-{v}" for v in (0.02, 0.05, 0.2)]
    assert {point.scenario for point in points} == {"D"}
    whole = with_families(in_study(study))
    own = scenario_settings(whole, "D")["task2"]
    changed = cell_settings(own, "noise-0.2")
    assert changed["sensor"] == cell_settings(own)["sensor"] | {"magnitude_noise": 0.2}
    without = with_families(in_study(study | {"sweeps": {}}))
    assert campaign_cells(whole["task2"]) == campaign_cells(without["task2"])
    estimators = study["task2"]["estimators"]
    paths = [cell.path for cell in swept_cells(study, "noise")]
    assert paths[0] == f"task2/D/exact/{estimators[0]}/nt12_dt60_noise-0.02.nc"
    assert len(set(paths)) == 3 * len(estimators)


def test_a_sweep_of_the_optimization_makes_scenarios(study):
    whole = with_families(in_study(study))
    names = [f"D-limit-{value}" for value in (17, 18.5, 20)]
    assert list(whole["scenarios"]) == ["D", *names]
    for value, name in zip((17, 18.5, 20), names, strict=True):
        own = scenario_settings(whole, name)
        assert own["visibility"]["limiting_magnitude"] == value
        del own["visibility"]["limiting_magnitude"]
        usual = scenario_settings(whole, "D")
        del usual["visibility"]["limiting_magnitude"]
        assert own == usual
    assert swept_cells(study, "limit") == []
    tracking = with_change(study, "sweeps.limit.targets", [12])
    assert swept_cells(tracking, "limit")[0].path.startswith("task2/D-limit-17/exact/")


def test_values_of_a_sweep_have_different_names(study):
    values = [-1, 1, 1e-5, 0.5, True, "config/some missions.csv"]
    changed = with_change(study, "sweeps.noise.values", values)
    assert [point.variant.removeprefix("noise-") for point in sweep_points(changed, "noise")] == [
        *("m1", "1", "1em05", "0.5", "true", "config-some-missions.csv")
    ]


def _summary(cells, quantity="coverage"):
    """Statistics of some cells with two seeds, every value an eighth of the cell's number."""
    shape = (len(cells), 2)
    data = {name: (("cell", "seed", "part"), np.ones((*shape, 4))) for name in PER_PART}
    data |= {name: (("cell", "seed"), np.ones(shape)) for name in PER_CELL}
    whole = np.broadcast_to(np.arange(len(cells))[:, None, None] / 8.0, (*shape, 4))
    data[quantity] = (("cell", "seed", "part"), whole)
    fields = ("scenario", "architecture", "estimator", "variant", "targets", "interval_minutes")
    coords = {field: ("cell", [getattr(cell, field) for cell in cells]) for field in fields}
    coords["observers"] = ("cell", [7] * len(cells))
    coords["part_unit"] = ("part", ["1", "rad s-1", "1", "1"])
    return xr.Dataset(data, coords=coords)


def test_the_table_of_a_sweep_has_every_value(study, tmp_path):
    cells, points = swept_cells(study, "noise"), sweep_points(study, "noise")
    table = sweep_rows("noise", study["sweeps"]["noise"], points, [], _summary(cells))
    assert tuple(table.columns) == SWEEP_COLUMNS
    covered = table[(table["quantity"] == "coverage") & (table["part"] == "attitude")]
    assert [*zip(covered["estimator"], covered["value"], covered["mean"], strict=True)] == [
        (cell.estimator, value, k / 8.0)
        for k, (cell, value) in enumerate(zip(cells, [0.02, 0.05, 0.2] * 2, strict=False))
    ]
    assert set(table["key"]) == {"settings.task2.sensor.magnitude_noise"}


def test_values_of_several_keys_are_shown_by_their_names(paper, tmp_path):
    """Tested with the study of tasking."""
    tasking = merged(paper, read_settings("tasking.yaml") | {"results": str(tmp_path)})
    study = in_study(check_campaign(tasking))
    points = sweep_points(study, "tasking")
    cells = swept_cells(study, "tasking")[: len(points)]
    own = scenario_settings(with_families(study), "A")["task2"]
    changed = cell_settings(own, "recommended")["tasking"]
    usual = cell_settings(own, "as-in-the-paper")
    longer = {**RECOMMENDED, "slot_minutes": 30}
    assert in_mode({"mode": "recommended", "slot_minutes": 30}) == longer
    assert usual == cell_settings(own) and changed != usual["tasking"]
    assert changed["slot_minutes"] == changed["expected_measurements"] == 20
    table = sweep_rows("tasking", study["sweeps"]["tasking"], points, [], _summary(cells))
    assert list(table["value"].unique()) == [point.variant for point in points]
    assert sweep_figure(table).axes
    gap = np.full((len(cells), 2), np.nan)
    gap[-1] = 0.02
    known = _summary(cells).assign(planning_gap=(("cell", "seed"), gap))
    rows = sweep_rows("tasking", study["sweeps"]["tasking"], points, [], known)
    rows = rows[rows["quantity"] == "planning_gap"]
    assert rows["mean"].dropna().tolist() == [0.02]
    assert "planning_gap" not in set(table["quantity"])


def test_a_sweep_may_change_several_keys_of_the_tracking(paper, tmp_path):
    """Tested with the study of dynamics."""
    changed = merged(paper, read_settings("dynamics.yaml") | {"results": str(tmp_path)})
    study = in_study(check_campaign(changed))
    cells, points = swept_cells(study, "perigee"), sweep_points(study, "perigee")
    assert {point.scenario for point in points} == {"A"} and len(cells) == 2 * len(points)
    task2 = scenario_settings(with_families(study), "A")["task2"]
    chosen = cell_settings(task2, "perigee-real-cr3bp-noise")
    assert chosen["start_day"] == 15 and chosen["process_noise"]["acceleration_m2_s3"] == 3e-5
    assert chosen["dynamics"]["filter"] == "cr3bp"
    assert tracking_kernels(chosen, "mukf") == kernel_set("tracking-mukf-cr3bp")
    real = cell_settings(task2, "real")
    assert tracking_kernels(real, "batch") == kernel_set("tracking-batch-ephemeris")
    plain = cell_settings(task2, "cr3bp")
    assert tracking_kernels(plain, "mukf") == kernel_set("tracking-mukf")


def test_the_ephemeris_campaign_shares_refined_orbits_among_scenarios(paper, tmp_path):
    real = merged(paper, read_settings("ephemeris.yaml") | {"results": str(tmp_path)})
    again = {"settings": {"visibility": {"limiting_magnitude": 17}}}
    other = {"settings": {"task2": {"dynamics": {"observers": "reference"}}}}
    scenarios = {"D": {"targets": 10, **again}, "E": {"targets": 10, **other}}
    study = in_study(check_campaign(merged(real, {"scenarios": scenarios})))
    assert list(study["scenarios"]) == ["A", "D", "E"]
    for name, file in (("A", "paths"), ("D", "paths"), ("E", "paths_E")):
        own = scenario_settings(study, name)
        assert own["visibility"]["dynamics"] == own["task2"]["dynamics"]["truth"] == "ephemeris"
        assert shared_dataset(study, name, "orbits/paths") == f"orbits/{file}.nc"
    usual = check_campaign(merged(paper, {"results": str(tmp_path)}))
    assert "dynamics" not in usual["visibility"]


def test_the_table_of_a_sweep_of_architectures_has_their_values(study, tmp_path):
    points = sweep_points(study, "limit")
    reached = [{"J": 1e-3 * k, "satellites": 10.0 + k} for k in range(3)]
    table = sweep_rows("limit", study["sweeps"]["limit"], points, reached, None)
    table.to_csv(tmp_path / "table.csv", index=False)
    read = pd.read_csv(tmp_path / "table.csv")
    assert list(read[read["quantity"] == "J"]["mean"]) == [0.0, 1e-3, 2e-3]
    assert list(read[read["quantity"] == "J"]["observers"]) == [10, 11, 12]
    assert read["targets"].isna().all()
    names, numbers = plotted_values(read)
    assert names == ["17.0", "18.5", "20.0"]
    np.testing.assert_array_equal(numbers, [17.0, 18.5, 20.0])
    assert plotted_values(pd.DataFrame({"value": [True, False]}))[1] is None


REACHED = {"J": 1e-3, "satellites": 10.0, "union_coverage": 0.5, "static_never_seen": 2.0}


@pytest.mark.parametrize(
    ("values", "architectures", "log"),
    [
        ([0.02, 0.05, 0.2], [], True),
        ([17, 18.5, 20], [REACHED] * 3, False),
        (["config/missions.csv", "b.csv", "c.csv"], [REACHED] * 3, False),
    ],
)
def test_the_figure_of_a_sweep_shows_every_value(study, tmp_path, values, architectures, log):
    changed = with_change(study, "sweeps.noise.values", values)
    cells, points = swept_cells(changed, "noise"), sweep_points(changed, "noise")
    sweep = changed["sweeps"]["noise"]
    table = sweep_rows("noise", sweep, points, architectures, _summary(cells))
    table.to_csv(tmp_path / "table.csv", index=False)
    figure = sweep_figure(pd.read_csv(tmp_path / "table.csv"))
    assert len(figure.axes) == 4 * (2 + bool(architectures))
    tracked = figure.axes[-8]
    assert tracked.get_xscale() == ("log" if log else "linear")
    lines = [line for line in tracked.lines if len(line.get_xdata()) == len(values)]
    estimators = len(study["task2"]["estimators"])
    named = isinstance(values[0], str)
    drawn = np.array([line.get_xdata() if named else line.get_ydata()
                      for line in lines if line.get_marker() not in ("_", "|")])  # fmt: skip
    np.testing.assert_allclose(
        drawn[:estimators], 12.5 * np.arange(3 * estimators).reshape(estimators, 3)
    )
    written = " ".join(text.get_text() for text in figure.texts)
    assert "noise of the magnitudes, mag" in written
    labels = [tick.get_text() for tick in figure.axes[0].get_yticklabels()]
    assert ("config/missions.csv" in labels) == named
