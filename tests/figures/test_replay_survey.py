"""The replay of a survey: a small survey, its record, the arrays and the page."""

import numpy as np
import pytest
from browser import CHROMIUM, probe
from click.testing import CliRunner
from small_cells import cell_inputs, settings_of_cell
from test_replay_page import made_up

from cislunar.campaign.survey import ORBIT_STATUSES, SurveyRecorder
from cislunar.campaign.tracking.cell import Problem
from cislunar.command.main import cislunar
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics import EARTH_MOON, propagate, propagate_bundle
from cislunar.figures.replay import ReplayDetections, cell_replay, replay_page
from cislunar.observation import Sensor
from cislunar.runtime import read_dataset, write_dataset
from cislunar.runtime.provenance import provenance
from cislunar.survey import (
    DensityPrior,
    ObjectDensity,
    PriorSources,
    SurveySettings,
    run_survey,
    sample_prior,
)
from cislunar.tasking import TruthModel, tracking_problem

HOURS, N = 6, 6
APPEARS = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 3.0])
PROBLEM = tracking_problem(n_observers=6, n_targets=N, duration_hours=HOURS)
SENSOR = Sensor(limiting_magnitude=20)


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory):
    """Result of a survey of six hours, its record as a file has it, and the Sun's data set."""
    rng = np.random.default_rng(1)
    other = propagate_bundle(PROBLEM.epoch, 0.05, 60)[:, rng.integers(60, size=60)].reshape(-1, 6)
    prior = DensityPrior(families=0, zero_velocity=0, table=0.8, uniform=0.2, particles=600)
    state, size = sample_prior(prior, PriorSources(table=other), rng)
    truth = TruthModel(PROBLEM.surfaces, SENSOR.noise, np.zeros(3))
    problem = Problem(
        PROBLEM.scene, PROBLEM.surfaces, truth, PROBLEM.epoch, PROBLEM.ids, np.arange(6),
        EARTH_MOON, SENSOR,
    )  # fmt: skip
    attributes = provenance("A survey", settings=settings_of_cell({}) | {"scenario": "A"}, seed=3)
    recorder = SurveyRecorder(problem, [f"object {k}" for k in range(N)], APPEARS, attributes)
    result = run_survey(
        PROBLEM.scene, truth, PROBLEM.epoch, PROBLEM.ids, 3, ObjectDensity(state, size, 10.0),
        SurveySettings(
            duration_days=HOURS / 24, link_hours=2, process={"false_alarms_deg2": 0.02}
        ),
        sensor=SENSOR, forces=EARTH_MOON, appears_hours=APPEARS, record=recorder,
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("survey")
    path, sun = folder / "0.nc", cell_inputs(3).sun
    write_dataset(recorder.dataset(), path)
    write_dataset(sun, folder / "ephemeris" / "sun.nc")
    return result, path, sun


def true_km():
    """True positions (time, object, 3) every five minutes, by another integrator."""
    times = 300.0 * np.arange(1, 12 * HOURS + 1) / TIME_UNIT_S
    paths = [propagate(each, times, method="dop853")[:, :3] for each in PROBLEM.epoch]
    return LENGTH_UNIT_KM * np.stack(paths, axis=1)


def test_replay_has_orbits_from_their_confirmation_and_the_truth(surveyed):
    result, path, sun = surveyed
    replay = cell_replay(read_dataset(path), sun)
    assert replay.time_s.tolist() == [300.0 * k for k in range(1, 12 * HOURS + 1)]
    known = np.isfinite(replay.estimate_km).all(axis=-1)
    assert np.array_equal(np.isfinite(replay.covariance_km2).all(axis=(-1, -2)), known)
    # the orbits of a link are shown until the next one
    tables = {round(24 * day): own for day, own in result.orbits.groupby("day")}
    for link in (0, 2, 4):
        shown = (replay.time_s > 3600.0 * link) & (replay.time_s <= 3600.0 * (link + 2))
        count = tables[link]["confirmed"].sum() if link else 0
        assert shown.sum() == 24 and np.all(known[shown].sum(axis=1) == count)
    assert known[-1, :N].sum() >= 2
    exists = replay.time_s[:, None] >= 3600.0 * APPEARS
    shown = np.where(known[..., None], replay.estimate_km + replay.error_km, replay.untracked_km)
    assert np.array_equal(np.isfinite(shown[:, :N]).all(axis=-1), exists)
    assert shown[:, :N][exists] == pytest.approx(true_km()[exists], abs=1e-2)
    right = known[:, :N]
    error, covariance = replay.error_km[:, :N][right], replay.covariance_km2[:, :N][right]
    squared = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    assert 0.5 < squared.mean() < 12.0  # three if consistent
    status = replay.facts["track"]
    assert list(status.names) == list(ORBIT_STATUSES)
    assert np.isnan(status.values[replay.time_s < 7200.0]).all()
    assert np.array_equal(status.values[-2] == 2, known[-2])


def test_replay_has_fields_and_detections(surveyed):
    result, path, sun = surveyed
    replay = cell_replay(read_dataset(path), sun)
    seen = replay.detections
    assert seen.time_s.size == result.states["detections"].iloc[-1]
    # the detections that confirmed orbits have in the end
    last = result.orbits[result.orbits["day"] == result.orbits["day"].max()]
    assert np.count_nonzero(seen.object >= 0) == last.loc[last["confirmed"], "detections"].sum()
    k = np.searchsorted(replay.time_s, seen.time_s)
    now = (replay.time_s[k] == seen.time_s) & (seen.object >= 0) & (seen.object < N)
    way = true_km()[k[now], seen.object[now]] - replay.observer_km[k[now], seen.observer[now]]
    way /= np.linalg.norm(way, axis=1)[:, None]
    away = np.linalg.norm(way - seen.direction[now], axis=1)
    assert now.sum() > 3 and np.rad2deg(away).max() < 0.01
    # at a recorded time, an observer looks at the field of that time
    field = (replay.aim_km - replay.observer_km)[k[now], seen.observer[now]]
    field /= np.linalg.norm(field, axis=1)[:, None]
    assert np.rad2deg(np.arccos(np.sum(field * seen.direction[now], axis=1))).max() < 2.2
    aimed = np.isfinite(replay.aim_km).all(axis=-1)
    assert aimed.mean() > 0.5


def test_a_survey_is_exported_as_a_cell_is(surveyed, tmp_path):
    _, path, sun = surveyed
    page = tmp_path / "replay.html"
    done = CliRunner().invoke(cislunar, ["export", str(path), "--output", str(page)])
    assert done.exit_code == 0, done.output
    assert page.read_text("utf-8") == replay_page(cell_replay(read_dataset(path), sun))
    assert page.stat().st_size < 6e6


def test_a_day_of_202_objects_is_a_small_file():
    """With 10 further orbits, 120,000 detections, and objects that are cataloged at some time."""
    replay, rng, count = made_up(288, 212, 20, 300.0), np.random.default_rng(2), 120_000
    direction = rng.normal(size=(count, 3))
    seen = ReplayDetections(
        np.sort(rng.uniform(0.0, 86_400.0, count)), rng.integers(20, size=count),
        rng.integers(-1, 212, size=count),
        direction / np.linalg.norm(direction, axis=1)[:, None], rng.normal(16.0, 1.0, count),
    )  # fmt: skip
    late = (np.arange(288)[:, None] < rng.integers(288, size=212))[..., None]
    page = replay_page(
        replay._replace(
            detections=seen,
            estimate_km=np.where(late, np.nan, replay.estimate_km),
            error_km=np.where(late, np.nan, replay.error_km),
            untracked_km=np.where(late, replay.estimate_km + replay.error_km, np.nan),
            covariance_km2=np.where(late[..., None], np.nan, replay.covariance_km2),
        )
    )
    assert 3e6 < len(page) < 15e6


LOOK = """
await unpacked;
while (!window.replay) await new Promise(done => setTimeout(done, 20));
const page = await replay, gd = document.getElementById("scene");
const $ = id => document.getElementById(id), named = name => gd.data[page.number[name]];
const places = name => named(name).x.map((x, k) => [x, named(name).y[k], named(name).z[k]]);
const found = {tracks: places("tracks"), hidden: named("truth").x.length};
$("truth").checked = true;
$("truth").dispatchEvent(new Event("change"));
await page.shown();
found.truth = places("truth");
await page.choose(0);
found.panel = $("panel").innerText;
return found;
"""


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (Debian: chromium)")
def test_browser_shows_objects_that_are_not_cataloged_on_request(surveyed, tmp_path):
    _, path, sun = surveyed
    found, troubles = probe(replay_page(cell_replay(read_dataset(path), sun)), tmp_path, LOOK)
    assert troubles == []
    assert all(place == [None] * 3 for place in found["tracks"]) and found["hidden"] == 1
    shown = np.array(found["truth"], dtype=float)
    assert shown[: N - 1] == pytest.approx(true_km()[0, : N - 1], abs=0.05)
    assert np.isnan(shown[N - 1 :]).all()
    assert "no track" in found["panel"]
