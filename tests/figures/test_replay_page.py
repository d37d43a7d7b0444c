"""The replay: arrays of cells, their encoding, the page in a browser, and its size."""

import json

import numpy as np
import pytest
from browser import CHROMIUM, probe
from scipy.spatial.transform import Rotation
from small_cells import cell_inputs, settings_of_cell

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.dataset import cell_dataset
from cislunar.campaign.tracking.records import cell_arcs, cell_observations, cell_observer_arcs
from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.errors import ConfigurationError
from cislunar.figures.replay import (
    Replay,
    ReplayDetections,
    ReplayFact,
    ReplayManeuver,
    cell_replay,
    replay_page,
)
from cislunar.figures.replay.tracking_cell import RECORD
from cislunar.figures.space.page import packed_arrays

CELL = Cell("A", "tpe", "mukf", 3, 60)


def unpacked(content):
    """Arrays of `packed_arrays`, read number by number."""
    length = int.from_bytes(content[:4], "little")
    header, content = json.loads(content[4 : 4 + length]), content[4 + length :]
    found = {}
    for name, own in header["arrays"].items():
        shape = own["shape"]
        flat = int(np.prod(shape[1:])), shape[0]
        size = int(np.prod(shape))
        planes, content = content[: 4 * size], content[4 * size :]
        numbers = [
            int.from_bytes(bytes(planes[k + size * b] for b in range(4)), "little", signed=True)
            for k in range(size)
        ]
        series = np.array(numbers, dtype=np.int64).reshape(flat)
        values = np.cumsum(np.cumsum(series, axis=1), axis=1).T.reshape(shape)
        values = (values + 2**31) % 2**32 - 2**31
        found[name] = values * own["resolution"]
        if own["flagged"]:
            flags = np.frombuffer(content[:size], np.uint8).reshape(flat).T.reshape(shape)
            content = content[size:]
            found[name] = np.where(flags > 0, np.nan, found[name])
    assert content == b""
    return found


def test_arrays_are_kept_to_their_resolution():
    draw = np.random.default_rng(5)
    smooth = 4e5 * np.sin(np.linspace(0.0, 3.0, 50))[:, None] * draw.normal(size=(1, 6))
    holes = draw.normal(scale=1e7, size=(50, 2, 3))
    holes[:4, 0] = holes[20:30, 1, 2] = np.nan
    given = {"smooth": (smooth, 0.0625), "holes": (holes, 0.1), "none": (np.empty((0, 3)), 1.0)}
    found = unpacked(packed_arrays(given))
    assert np.array_equal(np.isnan(found["holes"]), np.isnan(holes))
    for name, (values, resolution) in given.items():
        assert found[name].shape == values.shape
        assert np.nanmax(np.abs(found[name] - values), initial=0.0) <= 0.5001 * resolution


@pytest.fixture(scope="module", params=["cr3bp", "ephemeris"])
def cell_and_sun(request):
    inputs = cell_inputs(duration_days=3, bodies=True)
    change = {"truth": "ephemeris", "filter": "ephemeris"}
    given = {"dynamics": change} if request.param == "ephemeris" else {}
    record = ["truth", *RECORD, "pointing"]
    settings = settings_of_cell({"seeds": 2, "record": record, "start_day": 0.75}, **given)
    return cell_dataset(CELL, inputs, settings, propagator="dop853", seed=3), inputs.sun


def test_replay_of_a_cell_has_the_states_that_are_exported(cell_and_sun):
    """In the ICRF, relative to the Earth, which the exports reach by other functions."""
    cell, sun = cell_and_sun
    replay = cell_replay(cell, sun, seed=1)

    def exported(which):
        return np.stack([each.state[:, :3] for each in cell_arcs(cell, sun, which, seed=1)], axis=1)

    def in_icrf(positions):
        return np.einsum("tij,tkj->tki", replay.axes, positions - replay.earth_km[:, None])

    assert in_icrf(replay.estimate_km) == pytest.approx(exported("estimated"), abs=1e-3)
    truth = replay.estimate_km + replay.error_km
    assert in_icrf(truth) == pytest.approx(exported("true"), abs=1e-3)
    covariance = np.stack([each.covariance for each in cell_arcs(cell, sun, seed=1)], axis=1)
    turned = replay.axes[:, None] @ replay.covariance_km2 @ replay.axes[:, None].swapaxes(-1, -2)
    assert turned == pytest.approx(covariance[..., :3, :3], rel=1e-6, abs=1e-9)
    steps = np.searchsorted(cell["step"].values, replay.time_s)
    arcs = cell_observer_arcs(cell, sun)
    observers = np.stack([each.state[steps, :3] for each in arcs], axis=1)
    assert in_icrf(replay.observer_km) == pytest.approx(observers, abs=1e-3)
    # the Moon is on the x axis of the rotating frame
    assert np.abs(replay.moon_km[:, 1:]).max() < 1e-6
    assert replay.moon_km[:, 0] == pytest.approx((1.0 - MU) * LENGTH_UNIT_KM, rel=0.07)
    assert len(replay.utc) == len(replay.time_s) == cell.sizes["time"]


def test_replay_of_a_cell_has_its_detections_and_pointing(cell_and_sun):
    cell, sun = cell_and_sun
    replay, table = cell_replay(cell, sun), cell_observations(cell, sun)
    rows = replay.detections
    assert len(rows.time_s) == len(table)
    assert [f"O{o + 1:03d}" for o in rows.observer] == table["stn"].tolist()
    assert [replay.objects[j] for j in rows.object] == table["artSat"].tolist()
    at = np.searchsorted(replay.time_s, rows.time_s)
    same = replay.time_s[at] == rows.time_s
    icrf = np.einsum("nij,nj->ni", replay.axes[at[same]], rows.direction[same])
    ra, dec = np.deg2rad(table[["ra", "dec"]].to_numpy(dtype=float)[same]).T
    expected = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1)
    assert same.sum() > 5 and np.abs(icrf - expected).max() < 1e-8
    way = replay.aim_km - replay.observer_km
    aimed = np.isfinite(way).all(axis=-1)
    assert np.array_equal(aimed, np.isfinite(cell["pointing"].values[0]).all(axis=-1))
    way = way[at[same], rows.observer[same]]
    away = np.cross(way / np.linalg.norm(way, axis=1)[:, None], rows.direction[same])
    assert np.rad2deg(np.linalg.norm(away, axis=1)).max() < 1.5  # half of the field of view
    assert list(replay.observers.values()) == [3.0, 3.0, 3.0]


def test_a_cell_without_records_is_refused(cell_and_sun):
    cell, sun = cell_and_sun
    with pytest.raises(
        ConfigurationError, match=r"no covariance: add covariance to 'task2.record'"
    ):
        cell_replay(cell.drop_vars("covariance"), sun)
    assert cell_replay(cell.drop_vars("true_translation"), sun).error_km is None


def made_up(n_times, n_objects, n_observers, step_s):
    """Arrays of a replay: smooth paths, estimates that jump at updates, and noise."""
    draw = np.random.default_rng(11)
    time = step_s * np.arange(1.0, n_times + 1.0)
    phase = 2.0 * np.pi * draw.random((1, n_objects + n_observers, 3))
    period = 86_400.0 * draw.uniform(3.0, 15.0, size=(1, n_objects + n_observers, 1))
    size = draw.uniform(2e4, 9e4, size=(1, n_objects + n_observers, 3))
    path = size * np.sin(2.0 * np.pi * time[:, None, None] / period + phase)
    moon = [(1.0 - MU) * LENGTH_UNIT_KM, 0.0, 0.0]
    path += moon
    truth, observer = path[:, :n_objects], path[:, n_objects:]
    # an update each hour
    hour = (time // 3600.0).astype(int)
    sigma = 30.0 / (1.0 + hour[:, None]) * draw.uniform(0.5, 2.0, size=(1, n_objects))
    errors = draw.normal(size=(hour.max() + 1, n_objects, 3))[hour] * sigma[..., None]
    errors += 1e-3 * np.cumsum(draw.normal(size=errors.shape), axis=0)
    axes = draw.normal(size=(hour.max() + 1, n_objects, 3, 3))[hour]
    axes = axes * (1.0 + 1e-3 * draw.normal(size=(n_times, n_objects, 3, 3)))
    covariance = sigma[..., None, None] ** 2 * (axes @ axes.swapaxes(-1, -2))
    aimed = draw.integers(0, n_objects, size=(hour.max() + 1, n_observers))[hour]
    aim = (truth - errors)[np.arange(n_times)[:, None], aimed]
    rows = np.argwhere(draw.random((n_times, n_observers)) < 0.9)
    way = (aim - observer)[*rows.T]
    direction = way / np.linalg.norm(way, axis=1)[:, None] + 1e-5 * draw.normal(size=way.shape)
    seen = ReplayDetections(
        time[rows[:, 0]],
        rows[:, 1],
        aimed[*rows.T],
        direction / np.linalg.norm(direction, axis=1)[:, None],
        draw.normal(16.0, 1.0, size=len(rows)),
    )
    quaternion = Rotation.random(n_objects, random_state=1).as_quat()[None] + 1e-3 * draw.normal(
        size=(n_times, n_objects, 4)
    )
    facts = {
        "track": ReplayFact(np.minimum(hour[:, None], 1) + np.zeros((1, n_objects)),
                            names=["tentative", "confirmed"]),
        "attitude quaternion": ReplayFact(quaternion, resolution=1e-3),
        "attitude, standard deviation": ReplayFact(0.1 * sigma, "deg"),
        "attitude error": ReplayFact(0.1 * sigma, "deg", truth=True),
    }  # fmt: skip
    utc = [str(np.datetime64("2024-10-01T00:00:00") + int(t)) + "Z" for t in time]
    return Replay(
        title="Made-up run",
        utc=utc,
        time_s=time,
        earth_km=np.tile([-MU * LENGTH_UNIT_KM, 0.0, 0.0], (n_times, 1)),
        moon_km=np.tile(moon, (n_times, 1)),
        axes=Rotation.from_euler("z", time[:, None] / 375_000.0).as_matrix(),
        observers={f"eye {k}": 3.0 for k in range(n_observers)},
        observer_km=observer,
        aim_km=aim,
        objects=[f"object <{k}>" for k in range(n_objects)],
        estimate_km=truth - errors,
        covariance_km2=covariance,
        error_km=errors,
        detections=seen,
        maneuvers=[ReplayManeuver(5000.0, 1, 2.5, False), ReplayManeuver(4000.0, 1, 2.4, True)],
        facts=facts,
    )


def test_a_day_of_202_objects_is_a_small_file():
    page = replay_page(made_up(1440, 202, 20, 60.0))
    assert 5e6 < len(page) < 15e6
    assert page.count("src=") == page.count("href=") == 0


def test_wrong_arrays_are_refused():
    replay = made_up(20, 3, 2, 600.0)
    with pytest.raises(ConfigurationError, match=r"aim_km has shape \(20, 1, 3\); give numbers"):
        replay_page(replay._replace(aim_km=replay.aim_km[:, :1]))
    with pytest.raises(ConfigurationError, match="moon_km is not finite"):
        replay_page(replay._replace(moon_km=replay.moon_km * np.nan))
    with pytest.raises(ConfigurationError, match="give times that rise"):
        replay_page(replay._replace(time_s=replay.time_s[::-1]))


LOOK = """
await unpacked;
while (!window.replay) await new Promise(done => setTimeout(done, 20));
const page = await replay, gd = document.getElementById("scene");
const $ = id => document.getElementById(id), named = name => gd.data[page.number[name]];
const numbers = name => named(name).x.filter(v => v !== null).length;
const set = async (id, value) => {
  if (id === "truth") $(id).checked = value; else $(id).value = value;
  $(id).dispatchEvent(new Event(id === "time" ? "input" : "change"));
  await page.shown();
};
const text = () => $("panel").innerText;
const points = name => named(name).x.map((x, k) => [x, named(name).y[k], named(name).z[k]]);
const found = {date: $("date").textContent, unchosen: text().includes("detections")};
await set("time", "12");
await set("sigma", "1");
await set("factor", "10");
Object.assign(found, {
  later: $("date").textContent, tracks: points("tracks"), ellipsoids: points("ellipsoids"),
  scale: named("ellipsoids").name, cones: numbers("fields of view"), lines: points("detections"),
  arrays: Object.fromEntries(Object.entries(page.arrays).map(([n, a]) => [n, Array.from(a)])),
  hidden: ["truth", "errors", "true maneuvers"].map(numbers),
  maneuvers: numbers("maneuvers"),
  legend: gd.querySelector(".legend").textContent,
  marks: Array.from($("marks").children, mark => mark.hidden),
});
// a click with the mouse on the track of the second object
await set("view", "everything");
const scene = gd._fullLayout.scene._scene, {model, view, projection} = scene.glplot.cameraParams;
const four = [0, 1, 2, 3];
const times = (m, v) => four.map(r => four.reduce((sum, c) => sum + m[4 * c + r] * v[c], 0));
const place = points("tracks")[1].map((v, c) => v * scene.dataScale[c]);
const clip = times(projection, times(view, times(model, [...place, 1])));
const box = scene.container.getBoundingClientRect();
const canvas = gd.querySelector("canvas"), at = {bubbles: true,
  clientX: box.x + (clip[0] / clip[3] + 1) / 2 * canvas.clientWidth,
  clientY: box.y + (1 - clip[1] / clip[3]) / 2 * canvas.clientHeight};
const pause = () => new Promise(done => setTimeout(done, 300));
const target = document.elementFromPoint(at.clientX, at.clientY);
const mouse = [["mousemove", 0], ["mousemove", 0], ["mousedown", 1], ["mouseup", 0]];
for (const [kind, buttons] of mouse) {
  target.dispatchEvent(new MouseEvent(kind, {...at, buttons}));
  await pause();
}
await pause();
await page.shown();
found.clicked = $("object").value;
found.panel = text();
// the ellipsoid of the first object, and the track of the second
await page.choose(-1);
gd.emit("plotly_click", {points: [{curveNumber: page.number.ellipsoids, pointNumber: 3}]});
await pause();
await page.shown();
found.second = $("object").value;
gd.emit("plotly_click", {points: [{curveNumber: page.number.tracks, pointNumber: 1}]});
await pause();
await page.shown();
await set("truth", true);
found.shown = ["truth", "errors", "true maneuvers"].map(numbers);
found.truth = points("truth");
found.open = text();
await set("frame", "inertial");
found.turned = points("tracks");
await set("view", "object");
found.range = ["x", "y", "z"].map(axis => gd._fullLayout.scene[axis + "axis"].range);
$("play").click();
await new Promise(done => setTimeout(done, 1500));
$("play").click();
found.played = Number($("time").value);
return found;
"""


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (Debian: chromium)")
def test_browser_replays_the_run(tmp_path):
    replay = made_up(40, 3, 2, 600.0)
    estimate = replay.estimate_km.copy()
    estimate[:20, 2] = np.nan  # a track that begins later
    replay = replay._replace(estimate_km=estimate)
    found, troubles = probe(replay_page(replay), tmp_path, LOOK)
    assert troubles == []
    assert found["date"] == "2024-10-01 00:10:00 UTC, 0.17 h" and not found["unchosen"]
    assert found["later"] == "2024-10-01 02:10:00 UTC, 2.17 h"
    tracks = np.array(found["tracks"], dtype=float)
    assert tracks[:2] == pytest.approx(estimate[12, :2], abs=0.05)
    assert np.isnan(tracks[2]).all()
    # everything that a browser reads is what was written
    for name, values in (("estimate", estimate), ("error", replay.error_km), ("axes", replay.axes)):
        read = np.array(found["arrays"][name], dtype=float)
        assert read == pytest.approx(values.ravel(), abs=0.04, nan_ok=True)
    # ellipsoids of one standard deviation, ten times as large: 2 of 3 objects are known
    assert "1-sigma ellipsoids, enlarged 10 times" in found["scale"]
    surface = np.array(found["ellipsoids"]).reshape(2, -1, 3)
    for j in range(2):
        away = surface[j] - tracks[j]
        squared = np.einsum(
            "ni,ni->n", away, np.linalg.solve(replay.covariance_km2[12, j], away.T).T
        )
        assert np.sqrt(squared) == pytest.approx(10.0, rel=0.05)
    assert found["cones"] == 2 * 17
    seen, k = replay.detections, np.searchsorted(replay.time_s, replay.detections.time_s)
    assert len(found["lines"]) == 3 * np.count_nonzero(k == 12)
    # the truth only on request
    assert found["hidden"] == [0, 0, 0] and found["maneuvers"] == 1
    assert "truth" not in found["legend"] and found["marks"] == [False, True]
    assert found["shown"] == [2, 4, 1]
    truth = np.array(found["truth"], dtype=float)
    assert truth[:2] == pytest.approx((estimate + replay.error_km)[12, :2], abs=0.05)
    # the panel of the object that was clicked
    assert (found["clicked"], found["second"]) == ("1", "0")
    own = np.count_nonzero((seen.object == 1) & (k <= 12))
    panel = dict(row.split("\t") for row in found["panel"].splitlines() if "\t" in row)
    assert "object <1>" in found["panel"] and panel["detections"] == str(own)
    last = np.flatnonzero((seen.object == 1) & (k <= 12))[-1]
    assert (
        f"by eye {seen.observer[last]}, {seen.magnitude[last]:.1f} mag" in panel["last detection"]
    )
    sigma = np.sqrt(np.trace(replay.covariance_km2[12, 1]))
    assert float(panel["position, standard deviation"].split()[0]) == pytest.approx(sigma, rel=0.02)
    assert panel["position error"] == "shown with the truth" and "attitude error" not in panel
    assert panel["track"] == "confirmed"
    assert panel["maneuvers"] == "2.5 m/s on 2024-10-01 01:23 (estimated)"
    opened = dict(row.split("\t") for row in found["open"].splitlines() if "\t" in row)
    error = np.linalg.norm(replay.error_km[12, 1])
    assert float(opened["position error"].split()[0]) == pytest.approx(error, rel=0.02)
    assert "2.4 m/s" in opened["maneuvers"] and "attitude error" in opened
    turned = np.array(found["turned"], dtype=float)[:2]
    assert turned == pytest.approx(tracks[:2] @ replay.axes[12].T, abs=1.0)
    middle = np.mean(found["range"], axis=1)
    assert middle == pytest.approx(turned[1], abs=1.0)
    assert found["played"] > 12
