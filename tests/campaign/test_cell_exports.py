"""Observations, attitudes and orbits of cells in the ICRF, in both kinds of dynamics."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import spiceypy
import xarray as xr
from astropy.coordinates import CartesianRepresentation, SphericalRepresentation
from click.testing import CliRunner
from small_cells import cell_inputs, settings_of_cell

from cislunar.attitude.quaternion import to_body
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.settings.library import loop_settings
from cislunar.campaign.settings.reading import typed
from cislunar.campaign.tracking.cell import _observer_names, cell_problem
from cislunar.campaign.tracking.dataset import cell_dataset
from cislunar.campaign.tracking.records import (
    cell_arcs,
    cell_attitudes,
    cell_observations,
    cell_observer_arcs,
    frame_epoch,
)
from cislunar.command.base import FAILED
from cislunar.command.main import cislunar
from cislunar.constants import LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics.propagation import propagate_periodic
from cislunar.ephemeris.kernel import EARTH_MOON_BARYCENTER, kernel_path, loaded
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.errors import ConfigurationError
from cislunar.exchange import (
    GEOMETRIC_DIRECTIONS,
    ades_text,
    aem_text,
    oem_text,
    read_ades,
    read_aem,
    read_ocm,
    read_oem,
    read_segments,
)
from cislunar.exchange.inertial import inertial_states
from cislunar.exchange.tdm import read_tdm, tdm_text
from cislunar.figures.replay import cell_replay, replay_page
from cislunar.runtime.netcdf import write_dataset
from cislunar.study.messages import _with_codes, cell_messages
from cislunar.tasking.settings import RECORDABLE

CREATED = "2030-01-01T00:00:00"
CELL = Cell("A", "tpe", "mukf", 3, 60)
RECORDS = [name for name in RECORDABLE if name != "visibility"]
START_DAYS = 0.75


@pytest.fixture(scope="module")
def inputs():
    return cell_inputs(duration_days=3, bodies=True)


@pytest.fixture(scope="module", params=["cr3bp", "ephemeris"])
def settings(request):
    dynamics = {"truth": "ephemeris", "filter": "ephemeris"}
    given = {"dynamics": dynamics} if request.param == "ephemeris" else {}
    few = {"seeds": 1, "record": RECORDS, "start_day": START_DAYS}
    return settings_of_cell(few, **given)


@pytest.fixture(scope="module")
def cell(inputs, settings):
    return cell_dataset(CELL, inputs, settings, propagator="dop853", seed=3)


@pytest.fixture(scope="module")
def scene(inputs, settings):
    chosen = typed(settings, CellSettings)
    problem = cell_problem(CELL, inputs, chosen, "dop853", loop_settings(chosen, 60))
    return problem.scene


def recorded_steps(cell):
    """Indices of the recorded times among the measurement times."""
    return np.searchsorted(cell["step"].values, cell["time"].values)


def test_observations_point_from_the_observers_to_the_targets(cell, inputs):
    """By truth and observers in messages, and astropy."""
    table = cell_observations(cell, inputs.sun)
    assert len(table) > 100 and set(table["stn"]) <= {"O001", "O002", "O003"}
    truth = {each.name: each for each in cell_arcs(cell, inputs.sun, "true")}
    seen = 0
    observers = {each.name: each for each in cell_observer_arcs(cell, inputs.sun)}
    for row in table.to_dict("records"):
        tdb = tdb_seconds(row["obsTime"])
        target, observer = truth[row["artSat"]], observers[row["stn"]]
        place = np.array([row["pos1"], row["pos2"], row["pos3"]])
        at = np.argmin(np.abs(observer.tdb_s - tdb))
        assert observer.tdb_s[at] == pytest.approx(tdb, abs=2e-6)
        np.testing.assert_allclose(observer.state[at, :3], place, rtol=0.0, atol=1e-6)
        near = np.argmin(np.abs(target.tdb_s - tdb))
        if abs(target.tdb_s[near] - tdb) > 1e-3:
            continue
        seen += 1
        way = CartesianRepresentation(target.state[near, :3] - place)
        sky = way.represent_as(SphericalRepresentation)
        off = np.array([row["ra"] - sky.lon.deg, row["dec"] - sky.lat.deg]) * 3600.0
        off[0] = (off[0] + 648_000.0) % 1_296_000.0 - 648_000.0
        off[0] *= np.cos(sky.lat.rad)
        assert np.all(np.abs(off) < 6.0 * np.array([row["rmsRA"], row["rmsDec"]]))
    assert seen > 5


def test_names_of_observers_are_those_of_their_table(inputs, tmp_path):
    """Two of them share an orbit. ADES has codes only, and the names as remarks."""
    settings = settings_of_cell({"seeds": 1, "record": ["measurements"]})
    table = inputs.orbits.assign(name=("orbit", ["my eye", "spare", "F51"]))
    cell = cell_dataset(CELL, inputs._replace(orbits=table), settings, propagator="dop853", seed=3)
    names = ["my eye 1", "my eye 2", "F51"]
    assert cell["observer_name"].values.tolist() == names
    assert set(cell_observations(cell, inputs.sun)["stn"]) == set(names)
    assert [each.name for each in cell_observer_arcs(cell, inputs.sun)] == names
    paths = {ending: tmp_path / f"own{ending}" for ending in (".tdm", ".psv")}
    for ending, path in paths.items():
        path.write_text(cell_messages(cell, inputs.sun, ending)[""])
    assert set(read_tdm(paths[".tdm"])["stn"]) == set(names)
    found = read_ades(paths[".psv"])
    assert set(found["stn"]) == {"O001", "O002", "F51"}
    remarks = found["remarks"][found["stn"] == "O002"]
    assert set(remarks) == {f"observer my eye 2; {GEOMETRIC_DIRECTIONS}"}
    assert set(found["remarks"][found["stn"] == "F51"]) == {GEOMETRIC_DIRECTIONS}


def test_numbers_of_observers_on_one_orbit_are_in_no_other_name():
    orbits = xr.Dataset({"name": ("orbit", ["eye", "eye 2"])})
    names = _observer_names(orbits, np.array([0, 0, 1]), SimpleNamespace(stations=["eye 1"]))
    assert names == ["eye 3", "eye 4", "eye 2", "eye 1"]


def test_observations_without_a_remark_have_the_name_of_their_observer():
    table = pd.DataFrame({"stn": ["my eye", "F51"], "remarks": [np.nan, "bright|near"]})
    found = _with_codes(table, ["my eye", "F51"])
    assert found["stn"].tolist() == ["O001", "F51"]
    assert found["remarks"].tolist() == ["observer my eye", "bright/near"]
    assert _with_codes(table[["stn"]], ["my eye"])["remarks"].tolist() == ["observer my eye", ""]


def test_attitudes_relative_to_the_icrf_agree_with_the_scene(cell, inputs, scene):
    """Components of the line of sight in the body frame, from the propagation frame by the scene,
    and from the ICRF by the messages."""
    targets = cell_arcs(cell, inputs.sun, "true")
    observer = cell_observer_arcs(cell, inputs.sun)[0]
    steps = recorded_steps(cell)
    for j, found in enumerate(cell_attitudes(cell, inputs.sun, "true")):
        assert found.name == targets[j].name
        np.testing.assert_array_equal(found.tdb_s, targets[j].tdb_s)
        way = (targets[j].state - observer.state[steps])[:, :3] / LENGTH_UNIT_KM
        own = cell["true_translation"].values[0, :, j, :3]
        own = own - scene.observer_position[0, steps + 1]
        inertial = np.einsum("tij,tj->ti", scene.frame_axes[steps + 1], own)
        wanted = to_body(cell["true_quaternion"].values[0, :, j], inertial)
        np.testing.assert_allclose(to_body(found.quaternion, way), wanted, rtol=0.0, atol=1e-9)
        rate = np.deg2rad(found.angular_velocity_deg_s)
        np.testing.assert_allclose(rate, cell["true_angular_velocity"].values[0, :, j], rtol=1e-14)


def test_messages_of_a_cell_read_back(cell, inputs, tmp_path):
    table = cell_observations(cell, inputs.sun)
    arcs = cell_arcs(cell, inputs.sun)
    paths = {kind: tmp_path / f"cell.{kind}" for kind in ("oem", "aem", "tdm", "psv")}
    paths["oem"].write_text(oem_text(arcs, created=CREATED))
    paths["aem"].write_text(aem_text(cell_attitudes(cell, inputs.sun), created=CREATED))
    paths["tdm"].write_text(tdm_text(table, created=CREATED))
    paths["psv"].write_text(ades_text(table))
    names = cell["target_name"].values.tolist()
    assert [each.name for each in read_oem(paths["oem"])] == names
    assert [each.name for each in read_aem(paths["aem"])] == names
    for found, given in zip(read_oem(paths["oem"]), arcs, strict=True):
        np.testing.assert_array_equal(found.state, given.state)
        np.testing.assert_array_equal(found.covariance, given.covariance)
    back = read_tdm(paths["tdm"]).sort_values(["obsTime", "stn", "artSat"])
    wanted = table.sort_values(["obsTime", "stn", "artSat"])
    np.testing.assert_array_equal(back[["ra", "dec", "mag"]], wanted[["ra", "dec", "mag"]])
    assert read_ades(paths["psv"])["obsID"].tolist() == table["obsID"].tolist()


def test_states_of_ephemeris_dynamics_have_the_ephemeris_as_center(cell, inputs):
    """Against SPICE; the barycenter is the origin of the cell."""
    if '"truth": "ephemeris"' not in cell.attrs["settings"]:
        pytest.skip("states of the circular problem are tested in test_cell_records.py")
    own = cell["true_translation"].values[0]
    units = np.repeat([LENGTH_UNIT_KM, LENGTH_UNIT_KM / TIME_UNIT_S], 3)
    start = float(inputs.bodies["epoch_et"]) + START_DAYS * SECONDS_PER_DAY
    for center, body in (("EARTH BARYCENTER", None), ("EARTH", 399), ("MOON", 301)):
        for j, found in enumerate(cell_arcs(cell, inputs.sun, "true", center=center)):
            np.testing.assert_array_equal(found.tdb_s, start + cell["time"].values)
            origin = np.zeros((found.tdb_s.size, 6))
            if body:
                with loaded(kernel_path()):
                    pairs = [(body, t, "J2000", EARTH_MOON_BARYCENTER) for t in found.tdb_s]
                    origin = np.array([spiceypy.spkgeo(*each)[0] for each in pairs])
            wanted = own[:, j] * units - origin
            np.testing.assert_allclose(found.state[:, :3], wanted[:, :3], rtol=0.0, atol=1e-6)
            np.testing.assert_allclose(found.state[:, 3:], wanted[:, 3:], rtol=0.0, atol=1e-8)
    estimate, moved = (
        cell_arcs(cell, inputs.sun, center=center)[0] for center in ("EARTH", "EARTH BARYCENTER")
    )
    scaled = cell["covariance"].values[0, :, 0] * np.outer(units, units)
    np.testing.assert_allclose(estimate.covariance, scaled, rtol=1e-12)
    np.testing.assert_array_equal(estimate.covariance, moved.covariance)
    with pytest.raises(ConfigurationError, match="center = 'MARS' must be one of"):
        cell_arcs(cell, inputs.sun, center="MARS")


def test_velocities_of_observers_are_those_of_their_orbits(cell, inputs):
    if '"truth": "ephemeris"' in cell.attrs["settings"]:
        pytest.skip("the observers of the circular problem are on periodic orbits")
    state, period = inputs.orbits["state"].values[0], inputs.orbits["period"].values[0]
    times = (START_DAYS * SECONDS_PER_DAY + cell["step"].values) / TIME_UNIT_S
    path = propagate_periodic(state, period, times, method="dop853")
    speed = cell_observer_arcs(cell, inputs.sun, center="EARTH BARYCENTER")[0].state[:, 3:]
    elapsed = START_DAYS * SECONDS_PER_DAY + cell["step"].values
    wanted = inertial_states(path, elapsed, frame_epoch(inputs.sun), "EARTH BARYCENTER")
    np.testing.assert_allclose(speed, wanted[:, 3:], rtol=0.0, atol=1e-9)


@pytest.fixture
def results(cell, inputs, tmp_path):
    """A folder of results, and the path of the cell in it."""
    path = tmp_path / "results/task2/A/tpe/mukf/nt3_dt60.nc"
    write_dataset(cell, path)
    write_dataset(inputs.sun, tmp_path / "results/ephemeris/sun.nc")
    return path


def export(*arguments):
    return CliRunner().invoke(cislunar, ["export", *map(str, arguments)])


def test_the_command_writes_a_replay(cell, inputs, results, tmp_path):
    done = export(results, "--output", tmp_path / "replay.html")
    assert done.exit_code == 0, done.stderr
    page = (tmp_path / "replay.html").read_text("utf-8")
    assert page == replay_page(cell_replay(cell, inputs.sun))


def test_the_command_writes_every_format(cell, inputs, results, tmp_path):
    arcs = {
        data: cell_arcs(cell, inputs.sun, data, center="MOON") for data in ("true", "estimated")
    }
    states = ("--center", "MOON", "--time-system", "TAI", "--output")
    for data, wanted in (("truth", arcs["true"]), ("estimates", arcs["estimated"])):
        for read, name in ((read_oem, "a.oem"), (read_segments, "a.csv")):
            done = export(results, "--data", data, *states, tmp_path / name)
            assert done.exit_code == 0, done.stderr
            for found, given in zip(read(tmp_path / name), wanted, strict=True):
                assert found[:3] == given[:3]
                np.testing.assert_array_equal(found.state, given.state)
    assert export(results, "--output", tmp_path / "b.ocm").exit_code == 0
    assert export(results, "--output", tmp_path / "b.aem").exit_code == 0
    assert export(results, "--output", tmp_path / "b.tdm").exit_code == 0
    assert export(results, "--output", tmp_path / "b.psv").exit_code == 0
    assert export(results, "--data", "observers", "--output", tmp_path / "o.oem").exit_code == 0
    kept = [read_ocm(path).arc.name for path in sorted(tmp_path.glob("b_*.ocm"))]
    names = cell["target_name"].values.tolist()
    assert kept == sorted(names) and [each.name for each in read_aem(tmp_path / "b.aem")] == names
    table = cell_observations(cell, inputs.sun)
    assert sorted(read_tdm(tmp_path / "b.tdm")["ra"]) == sorted(table["ra"])
    assert read_ades(tmp_path / "b.psv")["obsID"].tolist() == table["obsID"].tolist()
    text = (tmp_path / "b.tdm").read_text()
    assert "COMMENT Simulated directions, without light time and aberration" in text
    circular = "circular restricted three-body problem" in text
    assert circular != ("with Earth, Moon and Sun from an ephemeris" in text)
    assert [each.name for each in read_oem(tmp_path / "o.oem")] == ["O001", "O002", "O003"]


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--output", "a.xyz"], "--output a.xyz: the ending must be one of .oem, .csv, .ocm"),
        (["--output", "a.aem", "--data", "observers"], "--data observers: .aem has no states"),
        (["--output", "a.tdm", "--data", "truth"], "--data truth: .tdm has no choice of states"),
        (["--output", "a.aem", "--center", "MOON"], "--center MOON: .aem has no states; choose"),
        (["--output", "a.oem", "--realization", "4"], "--realization 4: the cell has 1, counted"),
        (["--output", "a.oem", "--ephemeris", "no.nc"], "no.nc: no such file"),
    ],
)
def test_the_command_refuses_in_a_line(results, arguments, message):
    done = export(results, *arguments)
    assert done.exit_code == FAILED and message in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_the_command_names_what_is_missing(results, tmp_path):
    lone = tmp_path / "cell.nc"
    lone.write_bytes(results.read_bytes())
    done = export(lone, "--output", tmp_path / "a.oem")
    assert "no ephemeris/sun.nc in the folders above it; give --ephemeris FILE" in done.stderr
    sun = results.parents[4] / "ephemeris/sun.nc"
    done = export(sun, "--output", tmp_path / "a.oem")
    assert (
        done.exit_code == FAILED
        and "is no tracking cell, study or record of a survey" in done.stderr
    )
    assert export(lone, "--ephemeris", sun, "--output", tmp_path / "a.oem").exit_code == 0
    done = export(lone, "--ephemeris", lone, "--output", tmp_path / "a.oem")
    assert done.exit_code == FAILED
    words = "has no epoch and axes; give its ephemeris/sun.nc (--ephemeris)"
    assert done.stderr == f"error: {lone}: {words}\n"


def test_a_cell_without_measurements_has_no_observations(inputs):
    bare = cell_dataset(CELL, inputs, settings_of_cell({"seeds": 1}), propagator="dop853", seed=3)
    for of_cell in (cell_observations, cell_observer_arcs):
        with pytest.raises(ConfigurationError, match=r"add measurements to 'task2\.record'"):
            of_cell(bare, inputs.sun)
    with pytest.raises(ConfigurationError, match="no estimated_translation: add estimates"):
        cell_attitudes(bare, inputs.sun)
