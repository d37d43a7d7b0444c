"""The interactive page: what it holds, that it needs no network, and that a browser draws it."""

import base64
import gzip
import re

import numpy as np
import pytest
import xarray as xr
from browser import CHROMIUM, probe

from cislunar.campaign.data.inputs import orbit_set_dataset
from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.dynamics.propagation import propagate
from cislunar.figures.space.orbit_tracks import (
    evenly_seen,
    orbit_track_km,
    satellite_tracks,
    target_tracks_km,
)
from cislunar.figures.space.orbits_page import DIV_ID, FRAME_HOURS, orbits_page


@pytest.fixture(scope="module")
def orbits(library):
    return orbit_set_dataset(library, "orbit", "Candidate observer orbits", {})


@pytest.fixture(scope="module")
def tracked(orbits):
    """A few of the candidates, as if they were targets."""
    return orbits.isel(orbit=slice(0, 300, 30)).rename(orbit="target")


@pytest.fixture(scope="module")
def architectures():
    def chosen(orbit, satellites):
        return xr.Dataset({"orbit": ("slot", orbit), "satellites": ("slot", satellites)})

    return {
        "A": {"tpe": chosen([3, 120], [1, 4]), "exact": chosen([7, 8], [1, 1])},
        "D": {"random": chosen([200, 40], [10, 2])},
    }


@pytest.fixture(scope="module")
def targets():
    draw = np.random.default_rng(3)
    return {
        name: xr.Dataset({"position": (("target", "axis"), 0.3 * draw.normal(size=(count, 3)))})
        for name, count in (("A", 20), ("D", 1200))
    }


@pytest.fixture(scope="module")
def page(orbits, tracked, targets, architectures):
    return orbits_page(orbits, tracked, targets, architectures)


def test_samples_are_denser_where_a_curve_bends():
    """A straight mile and a tight half circle: each gets about half of the samples."""
    line = np.column_stack((np.linspace(-1000.0, 0.0, 500), np.ones(500), np.zeros(500)))
    angle = np.linspace(0.5 * np.pi, -0.5 * np.pi, 500)
    circle = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(500)))
    at = evenly_seen(np.vstack((line, circle[1:])), 100)
    assert at[0] == 0.0
    assert at[-1] == pytest.approx(998)
    assert np.all(np.diff(at) > 0.0)
    assert 45 <= np.count_nonzero(at < 499) <= 55


def test_track_closes_and_stays_out_of_the_moon(orbits):
    """Chords of the closest pass must not cut through the Moon that is drawn to scale."""
    index = int(np.argmin(orbits["perilune_km"].values))
    track = orbit_track_km(orbits, index, 97)
    assert np.array_equal(track[0], track[-1])
    moon = np.array([(1.0 - MU) * LENGTH_UNIT_KM, 0.0, 0.0])
    middles = 0.5 * (track[1:] + track[:-1])
    assert np.linalg.norm(middles - moon, axis=1).min() > MOON_RADIUS_KM


def test_satellites_and_targets_move_as_propagated(orbits, tracked):
    period_h = float(orbits["period"][50]) * float(orbits.attrs["time_unit_s"]) / 3600.0
    tracks = LENGTH_UNIT_KM * satellite_tracks(orbits, 50, 4, [0.0, period_h / 4.0])
    assert tracks[0, 0] == pytest.approx(orbits["state"].values[50, :3] * LENGTH_UNIT_KM)
    # A quarter of a period later each is where the next one was.
    assert tracks[1, :3] == pytest.approx(tracks[0, 1:], abs=0.5)
    moved = target_tracks_km(tracked, [0.0, 6.0])
    later = 6.0 * 3600.0 / float(orbits.attrs["time_unit_s"])
    direct = propagate(tracked["state"].values[2], [later], method="dop853")[0, :3]
    assert moved[1, 2] == pytest.approx(direct * LENGTH_UNIT_KM, abs=0.01)


def test_page_is_one_small_file_that_loads_nothing(page):
    assert len(page) < 4e6
    assert not re.search(r"<(script|link|img|iframe)\b[^>]*\b(src|href)=", page)
    assert f'id="{DIV_ID}"' in page


def test_same_data_give_the_same_page(page, orbits, tracked, targets, architectures):
    assert orbits_page(orbits, tracked, targets, architectures) == page


def test_page_without_architectures_still_has_the_library(orbits, tracked):
    packed = re.findall(r'unpack\("(.*?)"\)', orbits_page(orbits, tracked, {}, {}))[1]
    assert "Orbit library" in gzip.decompress(base64.b64decode(packed)).decode()


LOOK = """
await unpacked;
const gd = document.getElementById("orbits");
const drawn = new Promise(done => gd.on ? done() : setInterval(() => gd.on && done(), 50));
await drawn;
const named = name => gd._fullData.find(trace => (trace.name || "").startsWith(name));
const shown = () => gd.data.filter(t => t.visible === true && t.name).map(t => t.name);
const first = shown();
const menu = gd.layout.updatemenus.find(each => each.name === "architecture");
await Plotly.restyle(gd, ...menu.buttons[2].args);
const before = Array.from(named("moving targets").x);
await Plotly.animate(gd, ["12.0"], {mode: "immediate", frame: {duration: 0, redraw: true}});
const view = gd.layout.updatemenus.find(each => each.name === "view");
const ratios = [];
for (const button of view.buttons) {
  await Plotly.relayout(gd, ...button.args);
  const scene = gd._fullLayout.scene;
  ratios.push(["x", "y", "z"].map(axis => {
    const [low, high] = scene[axis + "axis"].range;
    return (high - low) / scene.aspectratio[axis];
  }));
}
const canvas = gd.querySelector(".gl-container canvas, canvas");
const size = name => { const t = named(name); let r = [1e9, -1e9];
  for (const row of t.z) for (const v of row) r = [Math.min(r[0], v), Math.max(r[1], v)];
  return r[1] - r[0]; };
return {
  webgl: Boolean(canvas && (canvas.getContext("webgl") || canvas.getContext("webgl2"))),
  width: canvas ? canvas.width : 0,
  frames: gd._transitionData._frames.length,
  first, second: shown(), moved: before.some((x, k) => x !== named("moving targets").x[k]),
  ratios, earth: size("Earth"), moon: size("Moon"),
  axes: ["x", "y", "z"].map(axis => gd.layout.scene[axis + "axis"].title.text),
  colors: gd.data.filter(t => /\\(\\d+\\)$/.test(t.name || "") && t.line && t.mode === "lines")
    .map(t => t.line.color),
  foot: innerHeight - gd.querySelector(".slider-container").getBoundingClientRect().bottom,
};
"""


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (Debian: chromium)")
def test_browser_draws_the_page_without_complaint(page, tmp_path):
    found, troubles = probe(page, tmp_path, LOOK)
    assert troubles == []
    assert found["webgl"] and found["width"] > 300
    assert found["frames"] == len(FRAME_HOURS)
    assert "static targets of A (20)" in found["first"] and "satellites (5)" in found["first"]
    assert "static targets of D (1\N{THIN SPACE}200)" in found["second"]
    assert "satellites (12)" in found["second"] and "satellites (5)" not in found["second"]
    assert found["moved"]
    for ratio in found["ratios"]:
        assert ratio == pytest.approx([ratio[0]] * 3, rel=1e-6), "the axes have unequal scales"
    assert found["earth"] == pytest.approx(2 * EARTH_RADIUS_KM, rel=1e-3)
    assert found["moon"] == pytest.approx(2 * MOON_RADIUS_KM, rel=1e-3)
    assert len(found["colors"]) == len(set(found["colors"])) == 13, "families look alike"
    assert 0 <= found["foot"] < 12, "an empty band below the slider"
    assert found["axes"] == [f"{axis}, km, rotating frame" for axis in "xyz"]
