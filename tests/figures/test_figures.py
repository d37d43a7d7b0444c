"""Figures: their labels carry units, their content the data, their files the same bytes."""

import re

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.colors import to_rgb

from cislunar.architecture.published import PUBLISHED_COST
from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.figures import style
from cislunar.figures.search.optimizers import (
    best_so_far,
    convergence_figure,
    satellite_front_figure,
)
from cislunar.figures.space.architectures import selected_orbits_figure
from cislunar.figures.space.earth_moon import bodies
from cislunar.figures.space.facet import arc_between, direction, facet_geometry_figure, half_vector
from cislunar.figures.space.library import family_map_figure, orbit_library_figure
from cislunar.figures.space.orbit_tracks import orbit_curve, satellite_tracks
from cislunar.orbits.families import FAMILIES

LENGTH_AXIS = re.compile(r"^[xyz], 1000 km$")


def orbit_rows(rows):
    """A small library; the states need not close, one period of each is drawn."""
    family, state, period = zip(*rows, strict=True)
    count = len(rows)
    return xr.Dataset(
        {
            "family": ("orbit", list(family)),
            "state": (("orbit", "component"), np.array(state)),
            "period": ("orbit", np.array(period)),
            "jacobi": ("orbit", np.linspace(2.6, 3.1, count)),
            "stability_index": ("orbit", np.geomspace(1.0, 500.0, count)),
        },
        attrs={"mu": MU, "length_unit_km": LENGTH_UNIT_KM, "time_unit_s": TIME_UNIT_S},
    )


@pytest.fixture(scope="module")
def orbits():
    near_moon = (1.0118, 0.0, 0.1739, 0.0, -0.0799, 0.0)
    near_earth = (0.3, 0.0, 0.0, 0.0, 1.5, 0.0)
    return orbit_rows(
        [
            ("Halo_L2_N", near_moon, 1.37),
            ("Halo_L2_S", near_moon, 1.38),
            ("Lyap_L3", near_earth, 1.0),
            ("Butterfly_N", near_moon, 1.5),
        ]
    )


@pytest.fixture(scope="module")
def targets():
    points = np.random.default_rng(3).normal(size=(30, 3)) * 0.3
    return xr.Dataset({"position": (("target", "axis"), points)})


def architecture(value, satellites, runs=0, history=(), **more):
    """A stand-in for a data set of an optimizer."""
    data = {
        "orbit": ("slot", [0, 2]),
        "satellites": ("slot", satellites),
        "J": value,
        "J_history": ("evaluation", np.asarray(history, dtype=float)),
        **more,
    }
    if runs:
        data["run_J"] = ("run", value * np.linspace(0.5, 1.0, runs))
        data["run_satellites"] = ("run", np.arange(5, 5 + runs))
        data["run_evaluations"] = ("run", np.full(runs, len(history)))
    return xr.Dataset(data)


@pytest.fixture(scope="module")
def searched():
    """Fronts, architectures, runs and coverage of a paper's scenario and another one."""
    scenarios = ("A", "Extra")
    history = [0.0, 1e-6, 5e-7, 4e-6]
    architectures = {
        s: {
            "tpe": architecture(2e-5, [2, 3], runs=2, history=history),
            "exact": architecture(1e-3, [1, 1], history=[1e-5, 1e-3], bound=1e-3),
            "published": architecture(2e-4, [7, 3], history=[2e-4]),
        }
        for s in scenarios
    }
    del architectures["Extra"]["published"]
    fronts = {
        s: xr.Dataset(
            {
                "J": ("total", [1e-3, 5e-4, 2e-4]),
                "union_coverage": ("total", [0.4, 0.5, 0.55]),
                "target_days": ("total", [0.5, 0.6, 0.65]),
            },
            coords={"total": [10, 11, 12]},
        )
        for s in scenarios
    }
    run = architecture(1e-6, [2, 3], history=history)
    runs = {s: {"tpe": {"index_0": run, "index_1": run}} for s in scenarios}
    coverage = pd.DataFrame(
        [("A", "tpe", 0.3), ("A", "tpe", 0.3), ("A", "exact", 0.4), ("Extra", "tpe", 0.2)],
        columns=["scenario", "optimizer", "union_coverage"],
    )
    return fronts, architectures, runs, coverage


def labels_of(figure):
    """Axis labels of all axes, in space and plane; a shared axis has none of its own."""
    found = []
    for axes in figure.axes:
        for name in ("x", "y", "z"):
            if hasattr(axes, f"get_{name}label"):
                found.append(getattr(axes, f"get_{name}label")())
    return found


@pytest.fixture(scope="module")
def figures(orbits, targets, searched):
    fronts, architectures, runs, coverage = searched
    chosen = {s: found["tpe"] for s, found in architectures.items()}

    def only(of_scenarios):
        return {"Extra": of_scenarios["Extra"]}

    return {
        "library": orbit_library_figure(orbits, targets),
        "facet": facet_geometry_figure(),
        "orbits": selected_orbits_figure(orbits, chosen, dict.fromkeys(chosen, targets)),
        "front": satellite_front_figure(fronts, architectures, coverage),
        "convergence": convergence_figure(runs, architectures),
        "map": family_map_figure(orbits),
        "front of one": satellite_front_figure(only(fronts), only(architectures), coverage),
        "convergence of one": convergence_figure(only(runs), only(architectures)),
        "orbits of one": selected_orbits_figure(orbits, only(chosen), {"Extra": targets}),
    }


def test_axes_of_length_carry_their_unit(figures):
    labels = [label for label in labels_of(figures["library"]) if label]
    assert len(labels) == 6
    assert all(LENGTH_AXIS.match(label) for label in labels)
    for axes in figures["library"].axes:
        if axes.name == "3d":
            names = [tick.get_text() for tick in axes.xaxis.get_ticklabels()]
            km = [1000.0 * float(name.replace("\N{MINUS SIGN}", "-")) for name in names]
            np.testing.assert_allclose(km, axes.xaxis.get_ticklocs() * LENGTH_UNIT_KM)


def test_halves_of_a_family_share_an_entry_of_the_map(figures):
    names = [text.get_text() for text in figures["map"].legends[0].get_texts()]
    assert names == ["Butterfly N", "L2 halo N and S", "L3 Lyapunov", "linearly stable orbit"]


def test_every_tile_has_a_bar_as_long_as_it_says(figures):
    """A bar's label is its length, and the orbit and the Moon lie within the tile."""
    for name in ("library", "orbits"):
        tiles = [axes for axes in figures[name].axes if axes.name != "3d"]
        assert tiles
        for axes in tiles:
            (label,) = axes.texts
            length_km = float(label.get_text().removesuffix(" km").replace("\N{THIN SPACE}", ""))
            ends = axes.lines[-1].get_xdata()
            assert np.ptp(ends) * LENGTH_UNIT_KM == pytest.approx(length_km)
            assert f"{length_km:.0f}"[0] in "125" and set(f"{length_km:.0f}"[1:]) == {"0"}
            low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
            for line in axes.lines:
                points = np.asarray(line.get_xydata(), dtype=float).reshape(-1, 2)
                assert np.all(points >= low) and np.all(points <= high)


def test_halves_of_a_family_have_tones_of_one_hue():
    for root in ("Butterfly", "Dragonfly", "Halo_L1", "Halo_L2", "Halo_L3"):
        north, south = (to_rgb(style.FAMILY_STYLE[f"{root}_{half}"].color) for half in "NS")
        np.testing.assert_allclose(south, 0.5 * np.array(north), atol=0.01)


def test_other_axes_carry_their_unit(figures):
    for name in ("map", "front", "convergence"):
        labels = [label for label in labels_of(figures[name]) if label]
        assert len(labels) >= 2
        pattern = (
            r"dimensionless( \(.*\))?$|nondimensional$|, days$|, %$|satellites$|evaluations of J$"
        )
        assert all(re.search(pattern, label) for label in labels), labels


def test_no_text_leaves_the_figure_or_covers_a_title(figures):
    for name, figure in figures.items():
        renderer = figure.canvas.get_renderer()
        figure.draw(renderer)
        page = figure.bbox
        titles = [*figure.texts, *(axes.title for axes in figure.axes)]
        labels = [
            getattr(axes, f"{axis}axis").label
            for axes in figure.axes
            for axis in ("x", "y", "z")
            if axes.axison and hasattr(axes, f"{axis}axis")
        ]
        boxes = [t.get_window_extent(renderer) for t in (*titles, *labels) if t.get_text()]
        for box in boxes:
            assert box.x0 >= page.x0 and box.x1 <= page.x1, name
            assert box.y0 >= page.y0 and box.y1 <= page.y1, name
        heads = [t.get_window_extent(renderer) for t in titles if t.get_text()]
        for head in heads:
            for label in labels:
                if label.get_text():
                    assert not head.overlaps(label.get_window_extent(renderer)), name


@pytest.mark.parametrize("name", ["library", "facet", "orbits", "front", "convergence", "map"])
def test_saving_twice_gives_the_same_bytes(figures, name, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "RASTER_DPI", 40)
    written = []
    for turn in ("first", "second"):
        paths = [tmp_path / turn / f"{name}.{kind}" for kind in ("png", "pdf")]
        style.save_figure(figures[name], *paths)
        written.append([path.read_bytes() for path in paths])
    assert written[0] == written[1]
    png, pdf = written[0]
    assert png.startswith(b"\x89PNG") and pdf.startswith(b"%PDF")
    assert b"CreationDate" not in pdf and b"Software" not in png
    assert sorted(path.name for path in (tmp_path / "first").iterdir()) == [
        f"{name}.pdf",
        f"{name}.png",
    ]


def test_drawing_twice_gives_the_same_bytes(orbits, targets, figures, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "RASTER_DPI", 40)
    for turn, figure in (("a", figures["library"]), ("b", orbit_library_figure(orbits, targets))):
        style.save_figure(figure, tmp_path / f"{turn}.png", tmp_path / f"{turn}.pdf")
    for kind in ("png", "pdf"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


def test_failed_save_leaves_the_old_file(figures, tmp_path, monkeypatch):
    path = tmp_path / "figure.png"
    path.write_bytes(b"old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(InputFileError, match=r"figure\.png: No space left"):
        style.save_figure(figures["facet"], path, tmp_path / "figure.pdf")
    assert path.read_bytes() == b"old"
    assert [each.name for each in tmp_path.iterdir()] == ["figure.png"]


def test_drawing_leaves_the_users_settings_alone(orbits):
    import matplotlib as mpl

    with mpl.rc_context({"font.size": 23.0}):
        family_map_figure(orbits)
        assert mpl.rcParams["font.size"] == 23.0


def test_every_family_looks_different_without_color():
    assert set(style.FAMILY_STYLE) == set(FAMILIES)
    looks = {(each.marker, each.filled, str(each.line)) for each in style.FAMILY_STYLE.values()}
    assert len(looks) == len(FAMILIES)
    with pytest.raises(ConfigurationError, match=r"Halo_L4.*Butterfly_N"):
        style.family_style("Halo_L4")


def test_earth_is_blue_and_moon_black_where_they_belong():
    places = bodies(MU)
    np.testing.assert_array_equal(places["Earth"][0], [-MU, 0.0, 0.0])
    np.testing.assert_array_equal(places["Moon"][0], [1.0 - MU, 0.0, 0.0])
    assert (places["Earth"][1], places["Moon"][1]) == (style.BLUE, style.BLACK)


def test_curve_of_a_two_body_circle():
    """With no Moon a circular orbit of the rotating frame is a circle, at equal steps of arc."""
    radius = 0.5
    speed = radius ** (-0.5) - radius
    orbits = orbit_rows([("Lyap_L1", (radius, 0.0, 0.0, 0.0, speed, 0.0), 1.0)])
    orbits.attrs["mu"] = 0.0
    orbits["period"] = ("orbit", [2.0 * np.pi / (radius ** (-1.5) - 1.0)])
    curve = orbit_curve(orbits, 0, samples=101)
    np.testing.assert_allclose(np.linalg.norm(curve, axis=1), radius, rtol=2e-6)
    np.testing.assert_array_equal(curve[0], curve[-1])
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    np.testing.assert_allclose(steps, 2.0 * radius * np.sin(np.pi / 100), rtol=1e-4)
    placed = satellite_tracks(orbits, 0, 4)
    np.testing.assert_allclose(
        placed, radius * np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]), atol=1e-8
    )


def test_panels_follow_the_scenarios(figures, orbits, searched):
    _, architectures, runs, _ = searched
    # the whole system, the orbits around the Moon, and two tiles, in each of two rows
    assert len(figures["orbits"].axes) == 2 * 4
    assert len(figures["front"].axes) == 2 * 2
    titles = [axes.get_title(loc="left") for axes in figures["convergence"].axes]
    assert titles == ["(a) Scenario A", "(b) Scenario Extra"]
    five = {f"S{i}": architectures["Extra"] for i in range(5)}
    figure = convergence_figure(dict.fromkeys(five, runs["Extra"]), five)
    boxes = [axes.get_position() for axes in figure.axes]
    assert len(boxes) == 5
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_every_orbit_has_a_tile_with_its_name(figures):
    texts = [axes.get_title() for axes in figures["orbits"].axes][:4]
    days = TIME_UNIT_S / 86_400.0
    assert texts[:2] == ["Earth-Moon system", "vicinity of the Moon"]
    assert texts[2:] == [
        f"1. L2 halo N\n2 sat., {1.37 * days:.1f} d",
        f"2. L3 Lyapunov\n3 sat., {days:.1f} d",
    ]


def test_axis_of_whole_numbers_is_wide_enough_for_two(searched):
    """A front of a single number of satellites, as of a small study."""
    fronts, architectures, _, coverage = searched
    single = {"Extra": fronts["Extra"].isel(total=[0])}
    alone = {
        "Extra": {"exact": architectures["Extra"]["exact"].assign(satellites=("slot", [4, 6]))}
    }
    low, high = satellite_front_figure(single, alone, coverage).axes[1].get_xlim()
    assert low <= 9.0 and high >= 11.0


def test_an_empty_front_is_stated(searched):
    """Where no target is ever seen, no logarithmic axis shows J."""
    fronts, architectures, _, coverage = searched
    dark = {"Extra": fronts["Extra"] * 0.0}
    nothing = {"Extra": {"exact": architectures["Extra"]["exact"] * 0.0}}
    for figure in (
        satellite_front_figure(dark, nothing, coverage),
        convergence_figure({}, nothing),
    ):
        assert [text.get_text() for text in figure.axes[0].texts][-1].startswith("J = 0: no")


def test_paper_marked_for_its_own_scenarios_alone(figures):
    first, second = figures["front"].axes[0], figures["front"].axes[2]
    drawn = [
        {(float(x), float(y)) for line in axes.lines for x, y in line.get_xydata()}
        for axes in (first, second)
    ]
    for value, count in PUBLISHED_COST["A"].values():
        assert (float(count), value) in drawn[0]
        assert (float(count), value) not in drawn[1]


def test_best_so_far():
    best = best_so_far([np.array([0.0, 2.0, 1.0, 3.0]), np.array([1.0, 0.5])])
    np.testing.assert_array_equal(best, [[np.nan, 2.0, 2.0, 3.0], [1.0, 1.0, 1.0, 1.0]])


def test_facet_vectors():
    light, view = direction(28.0, -52.0), direction(76.0, 128.0)
    half = half_vector(light, view)
    np.testing.assert_allclose(np.linalg.norm([light, view, half], axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(half @ light, half @ view, rtol=1e-14)
    arc = arc_between(light, view, 0.7)
    np.testing.assert_allclose(np.linalg.norm(arc, axis=1), 0.7, rtol=1e-14)
    np.testing.assert_allclose(arc[[0, -1]], 0.7 * np.array([light, view]), atol=1e-15)


def test_panel_letters():
    assert [style.panel_letter(i) for i in (0, 1, 25, 26)] == ["(a)", "(b)", "(z)", "(aa)"]
