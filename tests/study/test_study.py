"""A study gives what the closed loop gives, and keeps names, order, units and dates."""

import re

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from example_study import EPOCH, OBSERVERS, SETTINGS, TARGETS

import cislunar as cs
from cislunar.campaign.tracking.cell import realization_seeds
from cislunar.command.main import cislunar
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.errors import ConfigurationError
from cislunar.exchange.aem import read_aem
from cislunar.exchange.arcs import rotating_arc
from cislunar.exchange.inertial import epoch_at
from cislunar.exchange.oem import read_oem
from cislunar.exchange.state_tables import read_segments
from cislunar.exchange.tdm import read_tdm
from cislunar.figures.replay import cell_replay
from cislunar.photometry.materials import Material
from cislunar.study.results import StudyResult
from cislunar.study.study_file import read_study, write_study
from cislunar.tasking.planning.information import TaskingModel
from cislunar.tasking.settings import LoopSettings


@pytest.fixture(scope="module")
def result():
    return cs.Study(OBSERVERS, TARGETS, EPOCH, **SETTINGS).run(seeds=2)


def test_errors_are_those_of_the_loop_assembled_by_hand(result):
    """Observers, Sun and settings are passed to the loop as arrays, without the study's code."""
    days = TIME_UNIT_S / 86_400.0
    halo, second = (
        cs.periodic_orbits(family, period=period / days)
        for family, period in (("Halo_L1_N", 9.5), ("Halo_L2_S", 6.56))
    )
    target = cs.periodic_orbits("Halo_L2_S", jacobi=3.05)
    lyapunov = cs.periodic_orbits("Lyap_L2", period=15 / days)
    states = [
        cs.propagate(target.state[0], [0.3 * target.period[0]], method="dop853")[0],
        lyapunov.state[0],
        np.array([400e3, 1e3, -60e3, 0.01 * TIME_UNIT_S, 0.1 * TIME_UNIT_S, 0.0]) / LENGTH_UNIT_KM,
    ]
    own = result.study.settings
    settings = LoopSettings(
        duration_hours=1.5,
        interval_minutes=30,
        method="exact",
        sensor=cs.Sensor(limiting_magnitude=22),
        tasking=TaskingModel(
            diffuse_reflection_coefficient=result_sphere(own), radius_m=1.0, states="translation"
        ),
        record_every=5,
    )
    times = settings.elapsed_s / TIME_UNIT_S
    tracks = np.stack(
        [
            cs.propagate_periodic(each.state[0], each.period[0], times, method="dop853")[:, :3]
            for each in (halo, second)
        ]
    )
    sky = cs.sample_ephemeris(EPOCH, 1.5 / 24.0, 1.0)
    found = cs.run_closed_loop(
        cs.make_scene(tracks, sky.sun_position, 60.0),
        cs.target_surfaces(cs.icosahedron(), Material(), 3),
        states,
        np.arange(3),
        realization_seeds(1, 2),
        settings,
    )
    assert np.array_equal(found.assignment, result.cell["assignment"].values)
    km = LENGTH_UNIT_KM * np.abs(found.error - result.cell["error"].values)[..., 6:9]
    assert km.max() < 1e-3


def result_sphere(settings):
    from cislunar.observation.body_factory import body_from_spec, equal_sphere_of
    from cislunar.photometry.materials import PhotometryModel

    return equal_sphere_of(body_from_spec(settings.body, settings.material), PhotometryModel())[1]


def test_names_and_their_order_stay(result, tmp_path):
    names = list(TARGETS)
    assert result.summary().index.tolist() == names
    assert result.to_xarray()["target"].values.tolist() == names
    result.to_oem(tmp_path / "all.oem")
    assert [each.name for each in read_oem(tmp_path / "all.oem")] == names
    result.to_csv(tmp_path / "all.csv", "true", seed=1)
    assert [each.name for each in read_segments(tmp_path / "all.csv")] == names
    drawn = result.plot("schedule").axes[0]
    assert [text.get_text() for text in drawn.get_yticklabels()] == names


def test_replay_has_the_names_and_the_realization(result, tmp_path):
    page = result.to_replay(tmp_path / "replay.html", seed=1)
    assert (tmp_path / "replay.html").read_text("utf-8") == page != result.to_replay()
    found = cell_replay(result.cell, result.sun, seed=1)
    assert found.objects == list(TARGETS) and list(found.observers) == list(OBSERVERS)
    # over a month of steps of a minute, times are left out
    many = cell_replay(result.cell, result.sun, most_states=20)
    assert len(many.time_s) == 6 and many.time_s[-1] == found.time_s[-1]
    with pytest.raises(ConfigurationError, match=r"seed = 2: the realizations are 0 .. 1"):
        result.to_replay(seed=2)


def test_labels_units_and_dates(result, tmp_path):
    data = result.to_xarray()
    assert data["time"].values[0] == np.datetime64("2027-03-01T06:05:00")
    assert data["observer"].values.tolist() == list(OBSERVERS)
    first = data["true_position"].sel(target="mike").values[0, 0]
    assert np.linalg.norm(first - [400_003.0, 1_030.0, -60_000.0]) < 300.0
    away = data["true_position"] - data["estimated_position"]
    assert np.abs(away - data["position_error"]).max() < 0.1
    result.to_oem(tmp_path / "true.oem", "true")
    epoch = epoch_at(cs.Study(OBSERVERS, TARGETS, EPOCH, **SETTINGS).settings.epoch)
    elapsed, state = rotating_arc(read_oem(tmp_path / "true.oem")[2], epoch)
    assert elapsed[0] == pytest.approx(300.0, abs=1e-5)
    assert state[0, :3] * LENGTH_UNIT_KM == pytest.approx(first, abs=1e-5)
    table = result.observations()
    mine = np.isfinite(data["observation_magnitude"].values) & (data["observation_seed"] == 0)
    for name, column in (("right_ascension", "ra"), ("declination", "dec"), ("magnitude", "mag")):
        given = np.sort(data[f"observation_{name}"].values[mine])
        np.testing.assert_array_equal(given, np.sort(table[column]))
    assert {*data["observation_target"].values.tolist()} <= {*TARGETS}


def test_summary_is_of_the_last_time(result):
    row = result.summary().loc["alpha"]
    last = result.to_xarray()["position_error"].sel(target="alpha").values[:, -1]
    assert row["position_error_km"] == pytest.approx(np.sqrt(np.mean(np.sum(last**2, axis=1))))


@pytest.mark.parametrize("kind", ["errors", "schedule", "light_curve", "geometry"])
def test_each_figure_is_drawn(result, kind):
    assert result.plot(kind).axes
    if kind in ("errors", "light_curve"):
        titles = [axes.get_title(loc="left") for axes in result.plot(kind, "mike").axes]
        assert any("mike" in title for title in titles)


def test_a_file_gives_the_same_results(result, tmp_path):
    path = tmp_path / "study.yaml"
    given = {"observers": OBSERVERS, "targets": TARGETS, "epoch": EPOCH, **SETTINGS}
    path.write_text(yaml.safe_dump(given, sort_keys=False))
    found = read_study(path).run(seeds=2)
    write_study(found, tmp_path / "out")
    assert found.cell.identical(result.cell)
    written = {each.name for each in (tmp_path / "out").iterdir()}
    assert {"study.nc", "summary.csv", "estimates.oem", "errors.png", "geometry.pdf"} <= written
    assert result.cell.attrs["epoch"] == f"{EPOCH}.000000 UTC"
    # the data set has its own epoch, also in a folder with that of a campaign
    aem, cell = tmp_path / "out.aem", tmp_path / "out/study.nc"
    done = CliRunner().invoke(cislunar, ["export", str(cell), "--output", str(aem)])
    assert done.exit_code == 0, done.output
    result.to_aem(tmp_path / "own.aem")
    for found, own in zip(read_aem(aem), read_aem(tmp_path / "own.aem"), strict=True):
        assert (found.name, found.object_id) == (own.name, own.object_id)
        np.testing.assert_array_equal(found.quaternion, own.quaternion)
        np.testing.assert_array_equal(found.tdb_s, own.tdb_s)


def test_a_study_in_which_nothing_is_seen_has_results(tmp_path):
    blind = SETTINGS | {"sensor": {"limiting_magnitude": 3}, "duration_hours": 1}
    given = {"observers": OBSERVERS, "targets": {"alpha": TARGETS["alpha"]}, "epoch": EPOCH}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(given | blind))
    (tmp_path / "own").mkdir()
    (tmp_path / "own/observations.tdm").touch()  # of an earlier run
    done = CliRunner().invoke(cislunar, ["study", str(tmp_path / "own.yaml")])
    assert done.exit_code == 0, done.output
    assert "observations.tdm is not written: nothing was measured" in done.output
    assert re.search(r"^alpha +Lyap_L2 .* 0\.0 ", done.output, flags=re.MULTILINE)
    written = {each.name for each in (tmp_path / "own").iterdir()}
    drawn = {f"{kind}.{end}" for kind in StudyResult.plots for end in ("png", "pdf")}
    tables = {"study.nc", "summary.csv", "estimates.oem", "estimates.csv", "ephemeris"}
    assert written == drawn | tables


def test_an_observer_has_its_own_sensor():
    near = {"family": "Halo_L1_N", "period_days": 9.5, "sensor": {"limiting_magnitude": 3.0}}
    study = cs.Study({"blind": near, "south": OBSERVERS["south"]}, TARGETS, EPOCH, **SETTINGS)
    found = study.run().to_xarray()
    by = found["observation_observer"].values[found["observation_outcome"].values == "used"]
    assert {*by.tolist()} == {"south"}


def test_states_of_a_message_are_those_of_the_study_that_wrote_it(result, tmp_path):
    """Targets and observers of an OEM are where the OEM has them."""
    path = tmp_path / "targets.oem"
    result.to_oem(path, "true")
    later = "2027-03-01T06:30:00"
    study = cs.Study(path, path, later, **SETTINGS | {"duration_hours": 0.5})
    _, states = rotating_arc(read_oem(path)[1], epoch_at(study.settings.epoch))
    placed = study._placement(study._inputs())
    assert placed.epoch_state[1] == pytest.approx(states[5], abs=1e-9)
    assert placed.tracks[1, ::5] == pytest.approx(states[5:12, :3], abs=1e-8)


def test_observations_are_written_as_a_message_and_read_back(result, tmp_path):
    path = tmp_path / "observations.tdm"
    result.to_tdm(path)
    read, written = read_tdm(path), result.observations()
    order = ["stn", "artSat", "obsTime"]
    read, written = (each.sort_values(order, ignore_index=True) for each in (read, written))
    assert len(read) == len(written) and set(read["stn"]) <= set(result.study.observer_names)
    for column in ("ra", "dec", "mag"):
        np.testing.assert_array_equal(read[column], written[column])
    assert "COMMENT Simulated directions, without light time" in path.read_text()


def test_observers_are_where_their_orbits_have_them(result, tmp_path):
    """By propagation over the period from the states of the catalog."""
    result.to_oem(tmp_path / "own.oem", "observers")
    arcs = read_oem(tmp_path / "own.oem")
    assert [each.name for each in arcs] == list(OBSERVERS)
    epoch = epoch_at(result.study.settings.epoch)
    for each, observer in zip(arcs, result.study.observers, strict=True):
        elapsed, states = rotating_arc(each, epoch)
        times = elapsed / TIME_UNIT_S
        path = cs.propagate_periodic(observer.state, observer.period, times, method="dop853")
        assert states[:, :3] == pytest.approx(path[:, :3], abs=1e-9)
        assert states[5:-5, 3:] == pytest.approx(path[5:-5, 3:], abs=1e-6)


def test_observations_give_the_estimates_of_the_simulation(result):
    """The table alone, with directions in the ICRF, leads to the truth within its standard
    deviations, and to residuals as large as the noise; on another grid of times as well."""
    table = result.observations(seed=1)
    truth = result.to_xarray()["true_position"].values[1, -1]
    given = SETTINGS | {"dynamics": {"truth": "cr3bp"}, "light_time": False, "seeds": 1}
    found = []
    for step in (60, 50):
        study = cs.Study(OBSERVERS, TARGETS, EPOCH, observations=table, **given | {"step_s": step})
        estimated = study.run()
        data = estimated.to_xarray()
        apart = (truth - data["estimated_position"].values[0, -1]).ravel()
        sigma = data["position_sigma"].values[0, -1].ravel()
        assert np.all(np.abs(apart) < 4.0 * sigma)
        counts = estimated.summary()["observations"]
        assert counts.tolist() == [np.sum(table["artSat"] == name) for name in TARGETS]
        residuals = data["residual_declination"].values
        assert 0.7 * 3.0 < np.sqrt(np.mean(residuals**2)) < 1.3 * 3.0
        assert not {"position_error", "true_position"} & {*data}
        replayed = cell_replay(estimated.cell, estimated.sun)
        simulated = cell_replay(result.cell, result.sun, seed=1)
        assert list(replayed.observers) == list(OBSERVERS) and replayed.error_km is None
        assert np.isnan(replayed.aim_km).all()
        assert replayed.detections.time_s == pytest.approx(simulated.detections.time_s, abs=1e-4)
        away = replayed.detections.direction - simulated.detections.direction
        assert np.abs(away).max() < 1e-8
        if step == 60:
            assert np.abs(replayed.observer_km - simulated.observer_km).max() < 1e-6
        found.append(data["estimated_position"].values[0, -1])
    spread = np.linalg.norm(found[1] - found[0], axis=1)
    assert np.all(spread < 0.5 * np.linalg.norm(sigma.reshape(-1, 3), axis=1))


def test_a_file_with_observations_gives_the_same_estimates_in_each_format(result, tmp_path):
    """The Tracking Data Message has the numbers of the table, without standard deviations."""
    table = result.observations()
    table.drop(columns=["rmsRA", "rmsDec", "rmsMag"]).to_csv(tmp_path / "own.csv", index=False)
    result.to_tdm(tmp_path / "own.tdm")
    given = {"observers": OBSERVERS, "targets": TARGETS, "epoch": EPOCH, **SETTINGS}
    given |= {"dynamics": {"truth": "cr3bp"}, "light_time": False}
    found = {}
    for ending in ("csv", "tdm"):
        path = tmp_path / f"{ending}.yaml"
        path.write_text(yaml.safe_dump(given | {"observations": str(tmp_path / f"own.{ending}")}))
        found[ending] = read_study(path).run()
        write_study(found[ending], tmp_path / ending)
        written = read_tdm(tmp_path / ending / "observations.tdm")
        assert len(written) == len(table) and set(written["artSat"]) <= set(TARGETS)
    assert found["csv"].summary().equals(found["tdm"].summary())
    for ending in (".oem", ".aem"):
        done = exported(tmp_path / "csv" / "study.nc", tmp_path / f"again{ending}")
        assert done.exit_code == 0, done.output
    done = exported(tmp_path / "csv" / "study.nc", tmp_path / "again.tdm")
    assert done.exit_code == 2 and "those that were given; use their file" in done.output
    assert found["csv"].summary()["used"].sum() > 0


def exported(cell, output):
    return CliRunner().invoke(cislunar, ["export", str(cell), "--output", str(output)])
