"""Cells among Earth, Moon and Sun as they are."""

import numpy as np
import pytest
import spiceypy
import xarray as xr
from campaign_folder import ROOT, read_campaign

from cislunar.campaign.data.inputs import bodies_dataset, body_table, sun_dataset
from cislunar.campaign.data.refined_orbits import (
    forces_on_observers,
    observer_states,
    refined_dataset,
    refined_rows,
)
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.cells import Cell, cell_settings
from cislunar.campaign.settings.library import loop_settings
from cislunar.campaign.settings.reading import checked, merged, typed
from cislunar.campaign.tracking.cell import CellInputs, tracking_problem
from cislunar.campaign.tracking.dataset import cell_dataset
from cislunar.constants import EPOCH_JD, LENGTH_UNIT_KM, MU
from cislunar.dynamics.ephemeris import UNITS, propagate_utc
from cislunar.dynamics.frames import from_inertial, pulsating_frame
from cislunar.dynamics.propagation import propagate_periodic
from cislunar.ephemeris.kernel import EARTH_MOON_BARYCENTER, kernel_path, loaded
from cislunar.errors import ConfigurationError
from cislunar.orbits.among_bodies.refinement import RefinedPath, path_states
from cislunar.orbits.families import observer_library

REAL = {"truth": "ephemeris", "filter": "ephemeris"}
CELL = Cell("A", "tpe", "mukf", 3, 60)


@pytest.fixture(scope="module")
def inputs():
    halo = observer_library({"Halo_L2_S": 3})
    orbits = xr.Dataset(
        {
            "state": (("row", "component"), halo.state),
            "period": ("row", halo.period),
            "family": ("row", list(halo.family)),
        }
    )
    settings = {
        "epoch_jd": EPOCH_JD,
        "ephemeris": {"kernel": "de421", "step_minutes": 60},
        "visibility": {"duration_days": 3},
    }
    return CellInputs(
        architecture=xr.Dataset({"orbit": ("slot", [0, 2]), "satellites": ("slot", [2, 1])}),
        orbits=orbits.rename(row="orbit"),
        tracked=orbits.rename(row="target"),
        sun=sun_dataset(settings),
        bodies=bodies_dataset(settings),
    )


def settings_of(**changes):
    base = {"seeds": 1, "duration_hours": 2, "record_minutes": 20, "record": ["truth"]}
    usual = read_campaign(ROOT / "config")["task2"] | base
    settings = merged(cell_settings(usual), {"sensor": {"limiting_magnitude": 25}})
    return merged(settings, {"dynamics": REAL, **changes})


def test_bodies_and_observers_are_where_spice_and_the_frames_have_them(inputs):
    settings = typed(settings_of(start_day=1.0), CellSettings)
    loop = loop_settings(settings, 60)
    problem = tracking_problem(CELL, inputs, settings, "dop853", loop)
    scene, epoch, k = problem.scene, float(inputs.bodies["epoch_et"]), 77
    time = epoch + 86_400.0 + scene.step_s * k
    with loaded(kernel_path("de421")):
        for place, body in (
            (scene.primaries[k, 0], 399),
            (scene.primaries[k, 1], 301),
            (scene.sun_position[k], 10),
        ):
            wanted = spiceypy.spkgps(body, time, "J2000", EARTH_MOON_BARYCENTER)[0]
            np.testing.assert_allclose(place * LENGTH_UNIT_KM, wanted, rtol=0, atol=1e-6)
    # an observer is a point of its periodic orbit in the instantaneous frame
    table = body_table(inputs.bodies)
    nodes = np.linspace(epoch, time, 100_001)
    rate = 1.0 / pulsating_frame(table, nodes).time
    passed = np.trapezoid(rate, nodes)
    states, periods = inputs.orbits["state"].values, inputs.orbits["period"].values
    assert problem.observer_slot.tolist() == [0, 0, 1]
    here = np.concatenate([scene.observer_position[:, k] * LENGTH_UNIT_KM, np.zeros((3, 3))], 1)
    found = from_inertial(here, pulsating_frame(table, time))[:, :3]
    for row, (orbit, phase) in enumerate(((0, 0.0), (0, 0.5), (2, 0.0))):
        wanted = propagate_periodic(
            states[orbit], periods[orbit], [passed + phase * periods[orbit]], method="dop853"
        )[0, :3]
        np.testing.assert_allclose(found[row], wanted, rtol=0, atol=1e-7)


def test_truth_moves_among_the_bodies_and_the_filter_follows(inputs):
    cell = cell_dataset(CELL, inputs, settings_of(), propagator="dop853", seed=3)
    assert "J2000" in cell["true_translation"].attrs["long_name"]
    truth, times = cell["true_translation"].values[0], cell["time"].values
    ends = [EPOCH_JD + t / 86_400.0 for t in times]
    for j in range(3):
        wanted = propagate_utc(truth[0, j] * UNITS, ends[0], ends[-1:])[0]
        # radiation moves a state by a metre in two hours, a Julian date is good to 40 us
        assert np.linalg.norm((truth[-1, j] * UNITS - wanted)[:3]) < 2e-3
    used = cell["updates"].values > 0
    assert used.any()
    miss = np.abs(cell["error"].values[..., 6:]) / cell["sigma"].values[..., 6:]
    assert np.mean(miss[:, :, used[0]] < 3.0) > 0.95
    assert np.all(np.isfinite(cell["bound"].values[:, -1][:, used[0]]))


def test_observers_fly_refined_paths(inputs, caplog):
    """Those of the data set; one that has none is named and held, or refused."""
    dynamics = {**REAL, "observers": "refined"}
    settings = typed(settings_of(dynamics=dynamics, start_day=1.0), CellSettings)
    loop = loop_settings(settings, 60)
    chosen = {"dynamics": settings.dynamics.model_dump()}
    refined = refined_dataset(inputs.orbits, inputs.bodies, chosen)
    own = refined["node_orbit"].values == 2
    assert np.all(refined["position_miss"].values < 1.0)
    assert np.all(refined["velocity_miss"].values < 1.0)
    assert refined_rows({"observers": refined})["refined"].tolist() == [3, 3]
    scene = tracking_problem(CELL, inputs, settings, "dop853", loop).scene
    epoch = float(inputs.bodies["epoch_et"])
    path = RefinedPath(refined["node_time"].values[own], refined["node_state"].values[own], 0, 0)
    forces = forces_on_observers(inputs.bodies, chosen["dynamics"])
    assert forces.epoch == epoch
    time = 86_400.0 + scene.step_s * np.arange(scene.observer_position.shape[1])
    wanted = path_states(forces, path, time)[:, :3]
    np.testing.assert_allclose(scene.observer_position[2], wanted, rtol=0, atol=1e-9)
    lost = [1.0 - MU + 0.02, 0.0, 0.0, 0.0, 0.0, 0.0]  # falls into the Moon
    held = observer_states(forces, settings.dynamics, np.array(lost), 0.0, 0.0, [0.0], "it")
    assert held.shape == (1, 6) and "it, 0 of a period ahead, is not refined" in caplog.text
    refuses = settings.dynamics.model_copy(update={"unrefined": "refused"})
    with pytest.raises(ConfigurationError, match=r"set task2\.dynamics\.unrefined to 'held'"):
        observer_states(forces, refuses, np.array(lost), 0.0, 0.0, [0.0], "it")


def test_what_cannot_be_is_refused(inputs):
    settings = typed(settings_of(), CellSettings)
    loop = loop_settings(settings, 60)
    with pytest.raises(ConfigurationError, match=r"ephemeris/bodies\.nc"):
        tracking_problem(CELL, inputs._replace(bodies=None), settings, "dop853", loop)
    late = typed(settings_of(start_day=2.99), CellSettings)
    with pytest.raises(ConfigurationError, match="table of Earth, Moon and Sun"):
        tracking_problem(CELL, inputs, late, "dop853", loop)
    mixed = settings_of(dynamics={"truth": "cr3bp", "filter": "ephemeris"})
    with pytest.raises(ConfigurationError, match="set truth to 'ephemeris'"):
        checked(mixed, CellSettings)
