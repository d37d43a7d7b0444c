"""Cells of the tracking campaign: refusals, data sets, summaries."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from campaign_folder import read_campaign

from cislunar.campaign.settings.cell_settings import cell_files, cell_settings
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.cells import (
    Cell,
)
from cislunar.campaign.settings.library import (
    loop_settings,
    nominal_surfaces,
    truth_model,
)
from cislunar.campaign.settings.reading import merged
from cislunar.campaign.settings.scenarios import scenario_settings
from cislunar.campaign.tracking.cell import CellInputs
from cislunar.campaign.tracking.dataset import cell_dataset, write_cell
from cislunar.campaign.tracking.summary import (
    BRIGHT_ROWS,
    read_cell_metrics,
    seed_statistics,
    summary_dataset,
)
from cislunar.campaign.tracking.tables import pooled_rows, reading_rows, tracking_rows
from cislunar.campaign.tracking.tasking_comparison import compared_dataset, concatenate_comparisons
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.observation.body_factory import body_from_spec
from cislunar.observation.body_spec import BodySpec
from cislunar.observation.target_surfaces import body_of
from cislunar.photometry.materials import Material
from cislunar.runtime.netcdf import read_dataset, write_dataset
from cislunar.tasking.detection_outcomes import OBSERVATION_OUTCOMES

ROOT = Path(__file__).resolve().parents[2]
ORBITS = np.array(
    [
        [0.920026, 0.0, 0.501040, 0.898841],
        [0.817843, 0.0, 0.505839, 2.962608],
        [1.145831, 0.154015, -0.220793, 3.159410],
        [1.125424, -0.181700, -0.225458, 2.960571],
        [0.847229, 0.171882, 0.263971, 2.598230],
    ]
)


def _orbits(rows, dim):
    state = np.zeros((len(rows), 6))
    state[:, 0], state[:, 2], state[:, 4] = rows[:, 0], rows[:, 1], rows[:, 2]
    return xr.Dataset(
        {
            "state": ((dim, "component"), state),
            "period": (dim, rows[:, 3]),
            "family": (dim, [f"Orbit_{k}" for k in range(len(rows))]),
        }
    )


@pytest.fixture(scope="module")
def sources():
    elapsed = np.arange(0.0, 86_401.0, 600.0)
    angle = -elapsed / TIME_UNIT_S + 3.0
    sun = 389.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    return {
        "architecture": xr.Dataset(
            {"orbit": ("slot", [2, 3]), "satellites": ("slot", [2, 1])},
        ),
        "orbits": _orbits(ORBITS, "orbit"),
        "tracked": _orbits(ORBITS, "target"),
        "sun": xr.Dataset(
            {"sun_position": (("time", "axis"), sun), "et": ("time", elapsed)},
            attrs={"time_unit_s": TIME_UNIT_S},
        ),
    }


def _small(**changes):
    config = read_campaign(ROOT / "config")
    settings = cell_settings(scenario_settings(config, "A")["task2"])
    base = {"seeds": 2, "duration_hours": 3, "sensor": {"limiting_magnitude": 22}}
    return merged(merged(settings, base), changes)


def _cell(sources, targets=4, minutes=60, variant="", **changes):
    cell = Cell("A", "tpe", "mukf", targets, minutes, variant)
    inputs = CellInputs(**sources)
    return cell_dataset(cell, inputs, _small(**changes), propagator="dop853", seed=3)


@pytest.fixture(scope="module")
def tracked_cell(sources):
    return _cell(sources)


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
    return _cell(sources, record_minutes=1)


def test_metrics_agree_with_the_stored_histories(sources, full_cell):
    error, sigma = full_cell["error"].values.astype(float), full_cell["sigma"].values.astype(float)
    np.testing.assert_allclose(
        full_cell["coverage"], (np.abs(error) <= 3.0 * sigma).mean(axis=1), atol=1e-6
    )
    np.testing.assert_allclose(full_cell["rmse"], np.sqrt((error**2).mean(axis=1)), rtol=1e-5)
    away = np.linalg.norm(error[:, -1, :, 6:9], axis=-1)
    limit = np.sort(away.ravel())[3:5].mean()
    within = {"position_km": LENGTH_UNIT_KM * limit, "attitude_deg": 180}
    found = _cell(sources, custody=within)
    np.testing.assert_array_equal(found["custody"], away <= limit)
    held = seed_statistics(found)["custody_share"]
    np.testing.assert_allclose(held, (away <= limit).mean(axis=1))
    shares = seed_statistics(found)
    np.testing.assert_allclose(shares["position_custody_share"], (away <= limit).mean(axis=1))
    assert np.all(shares["attitude_custody_share"] == 1.0)


def test_a_rerun_writes_the_same_bytes(sources, tracked_cell, tmp_path):
    for name, data in (("first", tracked_cell), ("second", _cell(sources))):
        write_dataset(data, tmp_path / f"{name}.nc")
    first, second = (tmp_path / f"{name}.nc" for name in ("first", "second"))
    assert first.read_bytes() == second.read_bytes()


def test_cells_share_targets_truth_and_noise(sources, tracked_cell, full_cell):
    """A larger set holds the smaller one; before the first update their errors are the same."""
    fine, larger = full_cell, _cell(sources, targets=5, record_minutes=1)
    np.testing.assert_array_equal(larger["target_id"][:4], tracked_cell["target_id"])
    unseen = (fine["outcome"].values[:, 0] < 5) & (larger["outcome"].values[:, 0, :4] < 5)
    assert unseen.any()
    np.testing.assert_array_equal(
        fine["error"].values[:, 0][unseen], larger["error"].values[:, 0, :4][unseen]
    )


def test_a_cell_tracks_a_truth_unknown_to_its_estimator(sources, tracked_cell):
    """Same tasking at the start, other errors; the file tells the truth."""
    told = {"sensor": {"magnitude_noise": 0.3}, "material": {"rms_slope": 0.4}}
    other = _cell(sources, truth=told)
    np.testing.assert_array_equal(other["assignment"][:, 0], tracked_cell["assignment"][:, 0])
    assert (other["error"].values != tracked_cell["error"].values).any()
    settings = json.loads(other.attrs["settings"])
    assert settings["truth"] == told
    assert settings["material"]["rms_slope"] == 0.3
    turned = _cell(sources, truth={"body": {"inertia": [1, 1, 1.2]}})
    moved = turned["error"].values[..., :6] != tracked_cell["error"].values[..., :6]
    assert moved.any(axis=(1, 3)).all()


def test_surplus_observers_stay_idle(sources):
    crowded = _cell(sources, targets=1)
    assert ((crowded["assignment"].values >= 0).sum(axis=-1) <= 1).all()
    assert set(np.unique(crowded["assignment"])) <= {-1, 0}


def test_an_architecture_without_observers_is_refused(sources):
    empty = sources["architecture"].assign(satellites=("slot", [0, 0]))
    with pytest.raises(ConfigurationError, match=r"architecture/A/tpe\.nc has no observers"):
        _cell(sources | {"architecture": empty})
    foreign = sources["architecture"].assign(orbit=("slot", [0, 9]))
    with pytest.raises(ConfigurationError, match=r"architecture/A/tpe\.nc .*orbit 9"):
        _cell(sources | {"architecture": foreign})


def test_a_missing_architecture_names_the_file(tmp_path):
    with pytest.raises(InputFileError, match=r"nowhere\.nc: no such file"):
        read_dataset(tmp_path / "nowhere.nc")


def test_impossible_cells_are_refused(sources):
    with pytest.raises(ConfigurationError, match="n_T = 203"):
        _cell(sources, targets=203)
    with pytest.raises(ConfigurationError, match=r"n_T = 6 .*there are 5 targets"):
        _cell(sources, targets=6)
    with pytest.raises(ConfigurationError, match="dt7"):
        _cell(sources, minutes=7, step_s=50)


def _facets(body):
    return body_from_spec(BodySpec(**body), Material()).facets


def test_body_from_a_mesh_file_sets_the_tasking_sphere(tmp_path):
    corners = ["1 1 1", "1 -1 -1", "-1 1 -1", "-1 -1 1"]
    faces = ["1 2 3", "1 4 2", "1 3 4", "2 4 3"]
    lines = [f"v {c}" for c in corners] + [f"f {f}" for f in faces]
    path = tmp_path / "tetrahedron.obj"
    path.write_text("\n".join(lines))
    body = {"shape": str(path), "radius_m": None, "meters_per_unit": 0.5, "axis_scale": [1, 1, 1]}
    area = 4.0 * np.sqrt(3.0) / 4.0 * (0.5 * np.sqrt(8.0)) ** 2
    assert _facets(body).total_area == pytest.approx(area)
    settings = _small(body=body)
    radius = loop_settings(CellSettings(**settings), 60).tasking.radius_m
    assert radius == pytest.approx(np.sqrt(area / (4.0 * np.pi)))
    assert cell_files(settings) == [str(path)]
    assert cell_files(_small()) == []
    assert cell_files(_small(truth={"body": body})) == [str(path)]
    assert cell_files(_small(body=body, truth={"body": body})) == [str(path)]
    larger = _facets(body | {"axis_scale": [2, 2, 2]})
    assert larger.total_area == pytest.approx(4.0 * area)


def test_table_of_bodies_is_of_the_targets_it_names(tmp_path):
    """By number or name; the others, and tasking's sphere, keep the body of the settings."""
    table = tmp_path / "bodies.csv"
    header = "target,shape,radius_m,materials,inertia_x,inertia_y,inertia_z"
    rows = [header, "1,box-with-wings,2,,3,2,2"]
    rows.append("GATEWAY,icosahedron,3,=0.2 0.1 0.3 0.2 0.4,,,")
    table.write_text("\n".join(rows))
    truth = {"body": {"table": str(table), "inertia": [1.0, 1.2, 0.9]}}
    settings = CellSettings(**_small(truth=truth))
    names = [["1"], ["7", "GATEWAY"], ["3", "X"]]
    assumed, true = nominal_surfaces(settings, names), truth_model(settings, names).surfaces
    np.testing.assert_array_equal(true.composite, [True, False, False])
    sizes = np.add.reduceat(true.areas, true.first[:-1]) / (4.0 * np.pi)
    np.testing.assert_allclose(sizes, [4.0, 9.0, 1.0])
    assert body_of(true, 1).materials.tolist() == [[0.2, 0.1, 0.3, 0.2, 0.4]]
    np.testing.assert_array_equal(body_of(true, 2).areas, body_of(assumed, 2).areas)
    assert not assumed.composite.any()
    moments = np.diagonal(true.inertia, axis1=1, axis2=2)
    np.testing.assert_array_equal(moments, [[3, 2, 2], [1, 1.2, 0.9], [1, 1.2, 0.9]])
    np.testing.assert_array_equal(assumed.inertia, [np.eye(3)] * 3)
    assert (
        loop_settings(settings, 60).tasking == loop_settings(CellSettings(**_small()), 60).tasking
    )
    assert cell_files(settings.model_dump()) == [str(table)]


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


def test_a_cell_tells_the_outcomes_of_its_observations(sources, caplog):
    caplog.set_level("INFO", logger="cislunar")
    cell = _cell(sources, sensor={"limiting_magnitude": 16})
    shares = {
        name: of for name, of in seed_statistics(cell).items() if name in OBSERVATION_OUTCOMES
    }
    np.testing.assert_allclose(sum(shares.values()), 1.0)
    names = cell["outcome"].attrs["flag_meanings"].split()
    observations = cell["outcome"].values[1][cell["outcome"].values[1] != names.index("not_tasked")]
    assert shares["faint_share"][1] == np.mean(observations == names.index("faint")) > 0.3
    assert "of the observations faint; raise task2.sensor.limiting_magnitude = 16" in caplog.text
    assert "task2.photometry.irradiance = 4pi" in caplog.text


def test_a_cell_where_nothing_is_seen_has_no_averages(sources, caplog):
    blind = _cell(sources, sensor={"limiting_magnitude": 5})
    found = seed_statistics(blind)
    assert np.isnan(found["rmse_median"]).all()
    assert np.isnan(found["used_share"]).all()
    assert "warning: no target was ever tasked" in caplog.text
    np.testing.assert_array_equal(found["never_observed"], [4, 4])
    np.testing.assert_array_equal(found["inconsistent_rotation_share"], [0, 0])


@pytest.fixture(scope="module")
def summary(sources, tracked_cell, tmp_path_factory):
    path = tmp_path_factory.mktemp("cells")
    cells = [
        (Cell("A", "tpe", "mukf", 4, 60), tracked_cell),
        (Cell("A", "tpe", "mukf", 4, 60, "one-seed"), _cell(sources, seeds=1, minutes=60)),
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


def test_a_cell_that_chooses_models_has_a_characterization(sources, tmp_path):
    """In the file that is written piece by piece and in the one of a run in memory."""
    cell, inputs = Cell("A", "tpe", "batch", 4, 60), CellInputs(**sources)
    changes = {"seeds": 1, "batch": {"noise_freedom": 4, "model_selection": {"effort": 1}}}
    given = cell, inputs, _small(**changes)
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


def test_error_over_bound_is_that_of_the_histories(sources):
    """The final hours are here all three, every step of them recorded."""
    cell = _cell(sources, seeds=1, record_minutes=1)
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


def test_a_file_that_is_no_cell_is_refused(tmp_path):
    path = tmp_path / "other.nc"
    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(path)
    with pytest.raises(InputFileError, match=r"other\.nc lacks coverage"):
        read_cell_metrics(path)


def test_tasking_methods_are_compared_on_the_same_problems(sources):
    comparison = {
        "epochs": [0, 2],
        "runs": 2,
        "evaluations": [20, 5],
        "tpe_evaluations": 5,
        "sampler": "compiled",
        "early_stop": 100,
    }
    settings = _small()
    cells = [
        compared_dataset(
            Cell("A", "tpe", "mukf", n, 60),
            CellInputs(**sources),
            settings,
            comparison,
            propagator="dop853",
            seed=3,
        )
        for n in (4, 5)
    ]
    whole = concatenate_comparisons(cells)
    assert whole["information"].dims == ("cell", "search", "epoch", "run", "budget")
    best = whole["direct_information"].sel(direct="exact").values[:, None, :, None, None]
    assert np.nanmax(whole["information"].values - best) <= 1e-9
    random = whole.sel(search="random")
    np.testing.assert_array_equal(random["evaluations"].values[..., 1], 20)
    # a larger budget continues the smaller one
    np.testing.assert_allclose(
        random["information"].values[..., 0], random["history"].values[..., 4], rtol=1e-12
    )
    tpe = whole.sel(search="tpe")
    assert np.isnan(tpe["information"].values[..., 1]).all()
    assert np.isfinite(tpe["information"].values[..., 0]).all()
    assert (tpe["elapsed"].values[..., 0] > 0.0).all()
