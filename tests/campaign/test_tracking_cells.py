"""Data sets of tracking cells, statistics over their seeds, summaries and tables."""

import json

import numpy as np
import pytest
from small_cell_datasets import small_cell

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.summary import read_cell_metrics, seed_statistics, summary_dataset
from cislunar.campaign.tracking.tables import reading_rows, tracking_rows
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.errors import InputFileError
from cislunar.runtime.netcdf import write_dataset


@pytest.fixture(scope="module")
def tracked_cell(sources):
    return small_cell(sources)


def test_a_cell_has_the_documented_content(tracked_cell):
    sizes = {"seed": 2, "epoch": 3, "observer": 3, "time": 18, "step": 180, "target": 4}
    assert dict(tracked_cell.sizes) == sizes | {"component": 12, "part": 4}
    dims = {
        "assignment": ("seed", "epoch", "observer"),
        "information": ("seed", "epoch"),
        "valid": ("seed", "time", "target"),
        "error": ("seed", "time", "target", "component"),
        "sigma": ("seed", "time", "target", "component"),
        "coverage": ("seed", "target", "component"),
        "final_coverage": ("seed", "target", "component"),
        "custody": ("seed", "target"),
        "custody_position": ("seed", "target"),
        "custody_attitude": ("seed", "target"),
        "accurate_attitude": ("seed", "target"),
        "anees": ("seed", "target", "component"),
        "rmse": ("seed", "target", "component"),
        "bound": ("seed", "time", "target", "component"),
        "bound_ratio": ("seed", "target", "part"),
        "bound_attitude": ("seed", "target"),
        "status": ("seed", "target"),
    }
    for name, wanted in dims.items():
        assert tracked_cell[name].dims == wanted, name
    assert tracked_cell["error"].dtype == np.float32
    meanings = tracked_cell["status"].attrs["flag_meanings"].split()
    assert meanings == ["tracked", "never_observed", "inconsistent"]
    assert tracked_cell["time"].values[-1] == 3 * 3600.0
    np.testing.assert_array_equal(tracked_cell["epoch"], [0.0, 3600.0, 7200.0])
    np.testing.assert_array_equal(tracked_cell["observer_slot"], [0, 0, 1])
    used = tracked_cell["outcome"].attrs["flag_meanings"].split().index("used")
    updates = (tracked_cell["outcome"].values == used).sum(axis=1)
    np.testing.assert_array_equal(tracked_cell["updates"], updates)
    at = np.searchsorted(tracked_cell["step"].values, tracked_cell["time"].values)
    np.testing.assert_array_equal(
        tracked_cell["valid"], tracked_cell["outcome"].values[:, at] == used
    )


@pytest.fixture(scope="module")
def full_cell(sources):
    """The cell with a record of every minute."""
    return small_cell(sources, record_minutes=1)


def test_metrics_agree_with_the_stored_histories(sources, full_cell):
    error, sigma = full_cell["error"].values.astype(float), full_cell["sigma"].values.astype(float)
    np.testing.assert_allclose(
        full_cell["coverage"], (np.abs(error) <= 3.0 * sigma).mean(axis=1), atol=1e-6
    )
    np.testing.assert_allclose(full_cell["rmse"], np.sqrt((error**2).mean(axis=1)), rtol=1e-5)
    away = np.linalg.norm(error[:, -1, :, 6:9], axis=-1)
    limit = np.sort(away.ravel())[3:5].mean()
    within = {"position_km": LENGTH_UNIT_KM * limit, "attitude_deg": 180}
    found = small_cell(sources, custody=within)
    np.testing.assert_array_equal(found["custody"], away <= limit)
    held = seed_statistics(found)["custody_share"]
    np.testing.assert_allclose(held, (away <= limit).mean(axis=1))
    shares = seed_statistics(found)
    np.testing.assert_allclose(shares["position_custody_share"], (away <= limit).mean(axis=1))
    assert np.all(shares["attitude_custody_share"] == 1.0)
    assert np.all(shares["accurate_attitude_share"] == 1.0)


def test_a_rerun_writes_the_same_bytes(sources, tracked_cell, tmp_path):
    for name, data in (("first", tracked_cell), ("second", small_cell(sources))):
        write_dataset(data, tmp_path / f"{name}.nc")
    first, second = (tmp_path / f"{name}.nc" for name in ("first", "second"))
    assert first.read_bytes() == second.read_bytes()


def test_cells_share_targets_truth_and_noise(sources, tracked_cell, full_cell):
    """A larger set holds the smaller one; before the first update their errors are the same."""
    fine, larger = full_cell, small_cell(sources, targets=5, record_minutes=1)
    np.testing.assert_array_equal(larger["target_id"][:4], tracked_cell["target_id"])
    unseen = (fine["outcome"].values[:, 0] < 5) & (larger["outcome"].values[:, 0, :4] < 5)
    assert unseen.any()
    np.testing.assert_array_equal(
        fine["error"].values[:, 0][unseen], larger["error"].values[:, 0, :4][unseen]
    )


def test_a_cell_tracks_a_truth_unknown_to_its_estimator(sources, tracked_cell):
    """Same tasking at the start, other errors; the file tells the truth."""
    told = {"sensor": {"magnitude_noise": 0.3}, "material": {"rms_slope": 0.4}}
    other = small_cell(sources, truth=told)
    np.testing.assert_array_equal(other["assignment"][:, 0], tracked_cell["assignment"][:, 0])
    assert (other["error"].values != tracked_cell["error"].values).any()
    settings = json.loads(other.attrs["settings"])
    assert settings["truth"] == told
    assert settings["material"]["rms_slope"] == 0.3
    turned = small_cell(sources, truth={"body": {"inertia": [1, 1, 1.2]}})
    moved = turned["error"].values[..., :6] != tracked_cell["error"].values[..., :6]
    assert moved.any(axis=(1, 3)).all()


def test_statistics_are_over_the_observed_targets(tracked_cell):
    doctored = tracked_cell.copy(deep=True)
    doctored["status"].values[:] = [[0, 1, 2, 0], [0, 0, 2, 2]]
    doctored["status_rotation"].values[:] = doctored["status"].values
    doctored["status_translation"].values[:] = [[0, 1, 0, 0], [0, 0, 2, 0]]
    found = seed_statistics(doctored)
    seen = doctored["coverage"].values[0, [0, 2, 3], 6:9]
    assert found["coverage"][0, 2] == pytest.approx(seen.mean())
    assert found["rmse_median"][1, 3] == pytest.approx(np.median(doctored["rmse"].values[1, :, 9:]))
    np.testing.assert_array_equal(found["never_observed"], [1, 0])
    families = doctored["family"].values.astype("U20")
    families[2] = "Polar_mission"
    lunar = seed_statistics(doctored.assign_coords(family=("target", families)))
    kept = doctored["anees"].values[0, [0, 3], 6:9]
    assert lunar["anees_mean_periodic"][0, 2] == pytest.approx(kept.mean())
    assert found["anees_mean_periodic"][0, 2] != pytest.approx(kept.mean())
    np.testing.assert_array_equal(lunar["inconsistent_translation_lunar"], [0, 1])
    np.testing.assert_array_equal(found["inconsistent_translation_lunar"], [0, 0])
    np.testing.assert_array_equal(found["inconsistent_rotation"], [1, 2])
    np.testing.assert_array_equal(found["inconsistent_rotation_only"], [1, 1])
    np.testing.assert_allclose(found["inconsistent_rotation_share"], [1 / 3, 1 / 2])
    np.testing.assert_allclose(found["tracked_share"], [0.5, 0.5])
    np.testing.assert_allclose(
        found["valid_fraction"], tracked_cell["updates"].values.mean(axis=1) / 180
    )


@pytest.fixture(scope="module")
def summary(sources, tracked_cell, tmp_path_factory):
    path = tmp_path_factory.mktemp("cells")
    cells = [
        (Cell("A", "tpe", "mukf", 4, 60), tracked_cell),
        (Cell("A", "tpe", "mukf", 4, 60, "one-seed"), small_cell(sources, seeds=1, minutes=60)),
    ]
    read = []
    for k, (cell, data) in enumerate(cells):
        write_dataset(data, path / f"{k}.nc")
        read.append((cell, read_cell_metrics(path / f"{k}.nc")))
    return summary_dataset(read, {"task2": {}}, seed=3)


def test_summary_and_tables(summary, tracked_cell):
    assert summary.sizes == {"cell": 2, "seed": 2, "part": 4}
    assert np.isnan(summary["coverage"].values[1, 1]).all()
    table = tracking_rows(summary)
    row = table[
        (table.quantity == "rmse_median") & (table.part == "position") & (table.unit == "km")
        & (table.variant == "")
    ].iloc[0]  # fmt: skip
    km = LENGTH_UNIT_KM * seed_statistics(tracked_cell)["rmse_median"][:, 2]
    assert row["mean"] == pytest.approx(km.mean())
    # two values: the interval is their half-distance times t(0.975, 1) = 12.7062
    assert row["high"] - row["mean"] == pytest.approx(12.7062 * np.ptp(km) / 2, rel=1e-4)
    assert (row["smallest"], row["largest"]) == pytest.approx((km.min(), km.max()))
    assert set(table[table.variant == "one-seed"]["seeds"]) == {1}
    # of two values an interval is wide; it keeps to what is possible
    assert (table["low"].dropna() >= 0.0).all()
    assert table.loc[table.quantity == "coverage", "high"].max() == 1.0


def test_error_over_bound_is_that_of_the_histories(sources):
    """The final hours are here all three, every step of them recorded."""
    cell = small_cell(sources, seeds=1, record_minutes=1)
    error, least = (cell[name].values.astype(float) for name in ("error", "bound"))
    observed = cell["updates"].values > 0
    for p in range(4):
        part = slice(3 * p, 3 * p + 3)
        squared = [(each[..., part] ** 2).sum(axis=(1, 3)) for each in (error, least)]
        expected = np.where(observed, np.sqrt(squared[0] / squared[1]), np.nan)
        np.testing.assert_allclose(cell["bound_ratio"].values[..., p], expected, rtol=1e-5)


def test_the_error_at_the_end_counts_every_target(summary, tracked_cell):
    """The final hours are here all of the run."""
    km = LENGTH_UNIT_KM * tracked_cell["error"].values[0, :, :, 6:9].astype(float)
    each = np.sqrt((km**2).sum(axis=-1).mean(axis=0))
    assert each.size == 4 and (tracked_cell["updates"].values[0] == 0).any()
    row = (
        tracking_rows(summary)
        .query("quantity == 'final_error_geometric_all' and part == 'position' and unit == 'km'")
        .iloc[1]
    )
    assert row["variant"] == "one-seed"
    assert row["mean"] == pytest.approx(np.prod(each) ** 0.25)


def test_tables_contain_the_ratio_of_error_to_bound(summary, tracked_cell):
    table = tracking_rows(summary)
    own = table[(table.variant == "") & table.quantity.isin(["bound_ratio_90", "anees_mean"])]
    assert len(own) == 8 and set(own.unit) == {"1"}
    assert np.all(tracked_cell["bound"].values > 0.0)
    ratio = tracked_cell["bound_ratio"].values
    observed = tracked_cell["updates"].values > 0
    np.testing.assert_array_equal(np.isfinite(ratio).all(axis=2), observed)
    medians = np.median(ratio[0][observed[0]], axis=0)
    np.testing.assert_allclose(summary["bound_ratio_median"].values[0, 0], medians)
    degrees = np.percentile(tracked_cell["bound_attitude"].values[1][observed[1]], 90.0)
    assert summary["bound_attitude_90"].values[0, 1] == pytest.approx(degrees)
    assert (table.quantity == "bound_attitude_median").sum() == 2


def test_a_cell_without_the_bound_is_refused(tracked_cell, tmp_path):
    write_dataset(tracked_cell.drop_vars(["bound_ratio", "bound_attitude"]), tmp_path / "old.nc")
    with pytest.raises(InputFileError, match=r"old\.nc lacks bound_ratio, .*earlier version"):
        read_cell_metrics(tmp_path / "old.nc")


def test_variants_are_compared_seed_by_seed(summary):
    readings = reading_rows(summary)
    assert set(readings.variant) == {"one-seed"}
    # the same settings and the same seed: no difference at all
    finite = readings.dropna(subset=["difference"])
    assert len(finite) > 20
    np.testing.assert_array_equal(finite["difference"], 0.0)
