"""Records of a cell on request: they agree with the run, and are exported and read back."""

import json
from functools import cache

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaign_folder import ROOT, read_campaign
from small_cells import cell_inputs, settings_of_cell

from cislunar.campaign.data.inputs import sun_at
from cislunar.campaign.data.own_targets import own_tracked_dataset
from cislunar.campaign.settings.cell_settings import cell_settings
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.library import loop_settings
from cislunar.campaign.settings.reading import merged, typed
from cislunar.campaign.tracking.cell import cell_problem
from cislunar.campaign.tracking.dataset import cell_dataset, write_cell
from cislunar.campaign.tracking.records import cell_arcs, frame_epoch
from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics.propagation import propagate, propagate_periodic
from cislunar.errors import ConfigurationError
from cislunar.evaluation.metrics import attitude_angle_deg
from cislunar.exchange.arcs import COMMENTS, rotating_arc
from cislunar.exchange.oem import oem_text, read_oem
from cislunar.exchange.state_tables import read_segments, segments_csv
from cislunar.figures.labels import target_text
from cislunar.figures.tracking.errors import selected_targets_figure
from cislunar.runtime.netcdf import read_dataset, write_dataset
from cislunar.tasking.settings import RECORDABLE


@pytest.fixture(scope="module")
def inputs():
    return cell_inputs(duration_days=1)


def cell_of(record, estimator="mukf"):
    """A small cell and its settings."""
    return Cell("A", "tpe", estimator, 3, 60), settings_of_cell({"seeds": 2, "record": record})


@pytest.fixture(scope="module")
def run(inputs):
    """Data sets of cells in memory, each computed once."""

    @cache
    def dataset(estimator, *record):
        cell, settings = cell_of(list(record), estimator)
        return cell_dataset(cell, inputs, settings, propagator="dop853", seed=3)

    return dataset


@pytest.fixture(scope="module", params=["mukf", "batch"])
def estimator(request):
    return request.param


@pytest.fixture(scope="module")
def recorded(run, estimator):
    return run(estimator, *RECORDABLE)


def written(inputs, path, cell, settings, **options):
    """The data set of a cell that was written to a file."""
    write_cell(cell, inputs, settings, path, propagator="dop853", seed=3, **options)
    return read_dataset(path)


def test_without_a_request_nothing_is_recorded(run, estimator, recorded):
    assert "record" not in cell_settings(read_campaign()["task2"])
    plain = run(estimator)
    assert '"record"' not in plain.attrs["settings"]
    assert set(plain.variables) < set(recorded.variables)
    for name in plain.variables:
        np.testing.assert_array_equal(plain[name], recorded[name])


def test_every_record_has_a_unit_and_a_description(recorded, tmp_path):
    write_dataset(recorded, tmp_path / "cell.nc")
    assert recorded["observation_magnitude"].attrs["units"] == "mag"


def test_the_file_of_a_cell_is_identical_to_the_data_set_in_memory(
    inputs, recorded, estimator, tmp_path
):
    """Variables, values, types and attributes, whatever the interval of checkpoints."""
    small = cell_of(list(RECORDABLE), estimator)
    for name, least_s in (("seldom.nc", 1e9), ("often.nc", 0.0)):
        found = written(inputs, tmp_path / name, *small, checkpoint_s=least_s)
        xr.testing.assert_identical(found, recorded)
        types = {name: each.dtype for name, each in found.variables.items()}
        assert types == {name: each.dtype for name, each in recorded.variables.items()}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["often.nc", "seldom.nc"]
    assert (tmp_path / "often.nc").read_bytes() == (tmp_path / "seldom.nc").read_bytes()


def test_histories_may_be_omitted_without_other_changes(inputs, recorded, estimator, tmp_path):
    cell, settings = cell_of([], estimator)
    some = written(inputs, tmp_path / "cell.nc", cell, settings | {"histories": []})
    assert {"error", "sigma", "bound"}.isdisjoint(some.variables)
    assert (
        '"histories"' in some.attrs["settings"] and '"histories"' not in recorded.attrs["settings"]
    )
    for name in some.variables:
        np.testing.assert_array_equal(some[name], recorded[name])
    with pytest.raises(ConfigurationError, match=r"no errors: add errors to 'task2\.histories'"):
        selected_targets_figure(cell, some)


def test_truth_less_estimate_is_the_error(recorded):
    difference = recorded["true_translation"].values - recorded["estimated_translation"].values
    np.testing.assert_array_equal(difference.astype(np.float32), recorded["error"][..., 6:])
    turned = recorded["true_angular_velocity"] - recorded["estimated_angular_velocity"]
    np.testing.assert_array_equal(turned.astype(np.float32), recorded["error"][..., 3:6])
    cosine = np.abs(
        (recorded["true_quaternion"] * recorded["estimated_quaternion"]).sum("quaternion")
    )
    angle = np.rad2deg(2.0 * np.arccos(np.minimum(cosine, 1.0)))
    wanted = attitude_angle_deg(recorded["error"].values.astype(float))
    np.testing.assert_allclose(angle, wanted, rtol=1e-4, atol=1e-4)


def test_covariances_have_the_deviations_on_their_diagonal(recorded):
    diagonal = np.sqrt(np.diagonal(recorded["covariance"].values, axis1=-2, axis2=-1))
    np.testing.assert_array_equal(diagonal.astype(np.float32), recorded["sigma"][..., 6:])


def test_observations_agree_with_outcomes_and_truth(recorded):
    own = {
        name: recorded[f"observation_{name}"].values
        for name in ("seed", "step", "target", "observer")
    }
    outcome = np.zeros(recorded["outcome"].shape, dtype=np.uint8)
    np.maximum.at(
        outcome, (own["seed"], own["step"], own["target"]), recorded["observation_outcome"].values
    )
    np.testing.assert_array_equal(outcome, recorded["outcome"])
    seen = np.isfinite(recorded["observation_magnitude"].values)
    assert seen.sum() > 100
    # at a recorded time the measured direction is the true one, within the noise
    times = recorded["step"].values[own["step"]]
    at = np.searchsorted(recorded["time"].values, times)
    chosen = seen & (recorded["time"].values[np.minimum(at, recorded.sizes["time"] - 1)] == times)
    rows = np.flatnonzero(chosen)
    place = recorded["true_translation"].values[
        own["seed"][rows], at[rows], own["target"][rows], :3
    ]
    observer = recorded["observer_position"].values[own["observer"][rows], own["step"][rows]]
    axes = recorded["observer_axes"].values[own["step"][rows]]
    x, y, z = np.einsum("rij,rj->ir", axes, place - observer)
    variance = recorded["observation_angle_variance"].values[rows]
    off = recorded["observation_declination"].values[rows] - np.arctan2(z, np.hypot(x, y))
    assert np.all(np.abs(off) < 6.0 * np.sqrt(variance))
    off = np.angle(
        np.exp(1j * (recorded["observation_right_ascension"].values[rows] - np.arctan2(y, x)))
    )
    assert np.all(np.abs(off) < 6.0 * np.sqrt(variance))
    # and the telescope points in this direction, within its field of view
    pointing = recorded["pointing"].values[own["seed"][rows], at[rows], own["observer"][rows]]
    assert np.all(np.abs(pointing[:, 1] - np.arctan2(z, np.hypot(x, y))) < np.deg2rad(1.5))


def test_a_later_day_and_free_phases_move_observers_sun_and_targets(inputs):
    cell, settings = cell_of([])
    assert "start_day" not in settings
    phased = inputs.architecture.assign(phase=("slot", [0.25, 0.5]))
    found = []
    for own, change in ((inputs.architecture, {}), (phased, {"start_day": 0.5})):
        chosen = typed(settings | change, CellSettings)
        given = chosen, "dopri5", loop_settings(chosen, 60)
        found.append(cell_problem(cell, inputs._replace(architecture=own), *given))
    first, later = found
    half_a_day = 0.5 * SECONDS_PER_DAY / TIME_UNIT_S
    times = half_a_day + 60.0 * np.arange(121) / TIME_UNIT_S
    state, period = inputs.orbits["state"].values, inputs.orbits["period"].values
    for observer, (orbit, ahead) in enumerate([(0, 0.25), (0, 0.75), (2, 0.5)]):
        path = propagate_periodic(state[orbit], period[orbit], times + ahead * period[orbit])
        np.testing.assert_allclose(later.scene.observer_position[observer], path[:, :3], atol=1e-9)
    np.testing.assert_array_equal(later.scene.sun_position, sun_at(inputs.sun, times))
    for before, after in zip(first.epoch_state, later.epoch_state, strict=True):
        flown = propagate(before, [half_a_day], method="dop853")[0]
        np.testing.assert_allclose(after, flown, atol=1e-8)
    wrong = inputs.architecture.assign(phase=("slot", [0.25, 1.5]))
    with pytest.raises(ConfigurationError, match=r"phase = \[0\.25, 1\.5\] must be shares"):
        cell_problem(cell, inputs._replace(architecture=wrong), *given)


def test_arcs_of_a_later_day_have_its_dates(inputs, recorded):
    settings = json.loads(recorded.attrs["settings"]) | {"start_day": 0.5}
    later = recorded.assign_attrs(settings=json.dumps(settings))
    for one, two in zip(cell_arcs(recorded, inputs.sun), cell_arcs(later, inputs.sun), strict=True):
        frame = frame_epoch(inputs.sun)
        elapsed = [rotating_arc(each, frame)[0] for each in (one, two)]
        np.testing.assert_allclose(elapsed[1] - elapsed[0], 0.5 * SECONDS_PER_DAY, atol=1e-5)


@pytest.mark.parametrize("which", ["estimated", "true"])
def test_an_exported_cell_is_read_back(inputs, recorded, tmp_path, which):
    arcs = cell_arcs(recorded, inputs.sun, which, seed=1)
    assert [each.name for each in arcs] == [f"Halo_L2_S {k}" for k in recorded["target_id"].values]
    path = tmp_path / "cell.oem"
    path.write_text(oem_text(arcs, created="2030-01-01T00:00:00", comments=COMMENTS))
    for j, back in enumerate(read_oem(path)):
        elapsed, state = rotating_arc(back, frame_epoch(inputs.sun))
        np.testing.assert_allclose(elapsed, recorded["time"], rtol=0.0, atol=1e-6)
        wanted = recorded[f"{which}_translation"].values[1, :, j]
        np.testing.assert_allclose(state, wanted, rtol=0.0, atol=1e-11)
        assert len(back.covariance) == (len(wanted) if which == "estimated" else 0)


def test_ids_of_a_users_table_reach_the_data_set_and_the_message(inputs, tmp_path):
    table = ROOT / "config/examples/targets.csv"
    cell, settings = cell_of(["estimates"])
    given = inputs._replace(tracked=own_tracked_dataset(table))
    found = cell_dataset(cell, given, settings, propagator="dop853", seed=3)
    names = pd.read_csv(table)["id"].to_numpy()[found["target_id"].values]
    assert found["target_name"].values.tolist() == names.tolist()
    path = tmp_path / "cell.oem"
    path.write_text(oem_text(cell_arcs(found, inputs.sun), created="2030-01-01T00:00:00"))
    assert [each.name for each in read_oem(path)] == names.tolist()
    states = tmp_path / "cell.csv"
    states.write_text(segments_csv(cell_arcs(found, inputs.sun)))
    assert [each.name for each in read_segments(states)] == names.tolist()
    assert [target_text(found, k) for k in range(names.size)] == names.tolist()


def test_targets_of_the_library_are_named_by_class_and_row(recorded):
    named = [f"Halo_L2_S {row}" for row in recorded["target_id"].values]
    assert recorded["target_name"].values.tolist() == named


def test_missing_records_are_refused(inputs, run):
    plain = run("mukf", "measurements")
    with pytest.raises(
        ConfigurationError, match=r"no true_translation: add truth to 'task2\.record'"
    ):
        cell_arcs(plain, inputs.sun, "true")
    assert "pointing" not in plain and "observation_step" in plain


@pytest.mark.parametrize("record", [["light"], "truth", ["truth", "truth"], [1]])
def test_impossible_records_name_the_key(tmp_path, record):
    config = read_campaign() | {"results": str(tmp_path)}
    with pytest.raises(ConfigurationError, match=r"'task2\.record"):
        check_campaign(merged(config, {"task2": {"record": record}}))


def test_the_file_has_the_schedule_of_slots(inputs, tmp_path):
    """Every observation is one that the schedule assigns."""
    cell, settings = cell_of(["measurements"])
    changed = {"slot_minutes": 40, "observers_per_target": 2, "detection": "learned"}
    kept = written(inputs, tmp_path / "cell.nc", cell, merged(settings, {"tasking": changed}))
    assert kept["assignment"].dims == ("seed", "epoch", "slot", "observer")
    step, seed, observer = (
        kept[f"observation_{key}"].values for key in ("step", "seed", "observer")
    )
    at = seed, step // 60, step % 60 // 40, observer
    np.testing.assert_array_equal(kept["assignment"].values[at], kept["observation_target"].values)
    first, second = (kept["assignment"][:, :, slot] >= 0 for slot in range(2))
    observations = 40 * first.sum() + 20 * second.sum()
    assert step.size == observations > 0
    assert np.all(kept["planning_gap"] < 1e-6) and kept["brightness_offset"].shape == (2, 2, 3)


def test_late_measurements_and_separate_observers(inputs, run, tmp_path):
    """Measurements that are pending at the end count as taken and cause no update."""
    cell, settings = cell_of([])
    kept = {"usual": run("mukf")}
    for name, changed in (
        ("late", {"communication": {"delay_minutes": 100, "contact": {"moon": True}}}),
        ("alone", {"fusion": "alone"}),
    ):
        kept[name] = written(inputs, tmp_path / f"{name}.nc", cell, merged(settings, changed))
    np.testing.assert_array_equal(kept["late"]["outcome"][:, :60], kept["usual"]["outcome"][:, :60])
    updates = [kept[name]["updates"].values.sum() for name in ("usual", "late", "alone")]
    assert 0 <= updates[1] < updates[0] and updates[2] > 0
    assert json.loads(kept["alone"].attrs["settings"])["fusion"] == "alone"
    assert "communication" not in json.loads(kept["alone"].attrs["settings"])
