"""Figures of tracking: what is drawn and marked, units on the axes, the same bytes."""

import re

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import QuadMesh
from tracking_cell_data import cell_data, cells

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.summary import summary_dataset
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.evaluation.intervals import log_interval, t_interval
from cislunar.evaluation.metrics import NEVER_OBSERVED
from cislunar.figures import style
from cislunar.figures.axes import Grid, nice_ticks, spaced, tick_names
from cislunar.figures.labels import family_text, interval_text
from cislunar.figures.panels import Row, draw_rows
from cislunar.figures.tracking.errors import (
    components_figure,
    selected_targets,
    selected_targets_figure,
)
from cislunar.figures.tracking.heatmap_colors import scales
from cislunar.figures.tracking.heatmaps import (
    block_rows,
    intervals_figure,
    target_counts_figure,
)
from cislunar.figures.tracking.representative import representative_target_figure
from cislunar.figures.tracking.tasking import running_best, tasking_figure
from cislunar.figures.tracking.trends import (
    EFFICIENT,
    against_interval_figure,
    against_targets_figure,
)


def summary_of_cells():
    found = cells("A", (6, 12), (30, 60, 240)) | cells("B", (9,), (30, 60), "published")
    found |= cells("A", (6, 12), (30, 60, 240), "published")
    for method in ("tpe", "greedy"):
        cell = Cell("A", "published", "mukf", 6, 60, method)
        found[cell] = cell_data(6, 7)
    return summary_dataset(list(found.items()), {}, 1)


@pytest.fixture(scope="module")
def summary():
    return summary_of_cells()


@pytest.fixture(scope="module")
def compared():
    rng = np.random.default_rng(5)
    history = np.maximum.accumulate(rng.uniform(1.0, 8.0, (2, 2, 2, 2, 50)), axis=-1)
    history[:, 0, ..., 20:] = np.nan
    information = np.stack([history[..., 9], history[..., 49]], axis=-1)
    dims = ("cell", "search", "epoch", "run")
    return xr.Dataset(
        {
            "history": ((*dims, "evaluation"), history),
            "information": ((*dims, "budget"), information),
            "elapsed": ((*dims, "budget"), rng.uniform(1e-3, 1e-1, information.shape)),
            "direct_information": (("cell", "direct", "epoch"), np.full((2, 2, 2), 9.0)),
            "direct_elapsed": (("cell", "direct", "epoch"), np.full((2, 2, 2), 1e-4)),
        },
        {
            "search": ["tpe", "random"],
            "direct": ["exact", "greedy"],
            "epoch": [0, 12],
            "budget": [10, 50],
            "targets": ("cell", [6, 12]),
            "observers": 4,
        },
    )


VARIANTS = {"": "exact", "tpe": "tpe", "greedy": "greedy"}
DRAW = {
    "counts": lambda: target_counts_figure([*cells("A", (6, 9, 12, 30)).items()]),
    "representative": lambda: representative_target_figure(cells("A", (12,), (30, 240))),
    "interval": lambda: against_interval_figure(summary_of_cells()),
}
"""Figures drawn a second time."""


def one_scenario(summary):
    """Its cells of scenario A, which leave a single column of panels."""
    return summary.isel(cell=np.flatnonzero(summary["scenario"].values == "A"))


@pytest.fixture(scope="module")
def figures(summary, compared):
    return {
        "counts": DRAW["counts"](),
        "selected": selected_targets_figure(*next(iter(cells("A", (6,)).items()))),
        "intervals": intervals_figure(
            [*(cells("A", (6,), (30, 60, 240)) | cells("B", (9,), (30,))).items()]
        ),
        "components": components_figure(*next(iter(cells("A", (6,)).items()))),
        "load": intervals_figure([*cells("A", (12,), (30, 60, 240)).items()], ["anees", "rmse"]),
        "representative": DRAW["representative"](),
        "targets": against_targets_figure(summary),
        "interval": DRAW["interval"](),
        "targets of one": against_targets_figure(one_scenario(summary)),
        "interval of one": against_interval_figure(one_scenario(summary_of_cells())),
        "estimators of one": against_targets_figure(one_scenario(summary), by="estimator"),
        "tasking": tasking_figure(compared, summary, VARIANTS),
    }


NAMES = (
    *("counts", "selected", "components", "intervals", "load", "representative", "targets"),
    *("interval", "targets of one", "interval of one", "estimators of one"),
    "tasking",
)


def test_a_panel_without_values_is_labeled():
    drawn = [np.array([np.nan]), np.array([1.0])]
    (panels,) = draw_rows(
        style.new_figure(3.0),
        Grid(1, 2, 1.5, 1.0, 0.5, 0.5, 0.2, 0.2),
        [Row("attitude RMSE,\ndegree", (), log=True)],
        ["nobody", "somebody"],
        lambda axes, row, column: drawn[column],
    )
    said = [[text.get_text() for text in axes.texts] for axes in panels]
    assert ["nothing was observed" in "".join(texts) for texts in said] == [True, False]


def test_heat_map_shows_the_data(figures):
    """Time outside 3 sigma of the last block, in percent."""
    axes = next(a for a in figures["counts"].axes if a.get_title() == "30")
    mesh = next(each for each in axes.collections if isinstance(each, QuadMesh))
    expected = 100.0 * (1.0 - cell_data(30, 60)["coverage"].values[0])
    drawn = mesh.get_array()
    np.testing.assert_array_equal(drawn.mask.all(axis=1), np.arange(30) == 0)
    np.testing.assert_allclose(drawn[1:], expected[1:])


def test_colors_of_the_parts_hold_their_decades():
    rows = block_rows(cell_data(30), "rmse", range(40, 70))
    colors = scales("rmse", rows.values)
    wanted = []
    for scale in colors:
        values = rows.values[1:, scale.columns]
        low, high = np.percentile(values, (1.0, 99.0))
        assert low / 11.0 < scale.norm.vmin <= low and high <= scale.norm.vmax
        wanted.append(max(3.4 * high, 3.4 * scale.norm.vmin) / scale.norm.vmin)
        for end in (scale.norm.vmin, scale.norm.vmax):
            assert f"{end:.6e}"[0] in "13" and set(f"{end:.6e}"[2:8]) == {"0"}
        outside = values.min() < scale.norm.vmin, values.max() > scale.norm.vmax
        ends = {"neither": (0, 0), "min": (1, 0), "max": (0, 1), "both": (1, 1)}
        assert ends[scale.extend] == outside
    spans = [scale.norm.vmax / scale.norm.vmin for scale in colors]
    for first in (0, 2):
        # a pair of parts shares a color bar, with no more decades than one of them needs
        assert spans[first] == pytest.approx(spans[first + 1])
        assert spans[first] < max(wanted[first : first + 2])
    (balanced,) = scales("anees", block_rows(cell_data(30), "anees", range(40, 70)).values)
    assert balanced.norm.vmin * balanced.norm.vmax == pytest.approx(1.0)


def test_colors_without_any_observed_target():
    cell = cell_data(3)
    cell["status"][:] = NEVER_OBSERVED
    for measure in ("outside", "anees", "rmse"):
        assert scales(measure, block_rows(cell, measure, range(40, 43)).values)


def test_selected_targets_are_drawn_with_the_bound_where_there_is_one(figures):
    cell, data = next(iter(cells("A", (6,)).items()))
    figures = figures["components"], components_figure(cell, data.drop_vars("bound"))
    names = [[text.get_text() for text in each.legends[0].get_texts()] for each in figures]
    assert names[0][2].endswith("Cramér-Rao bound") and len(names[0]) == len(names[1]) + 1
    panels = [figure.axes[0].lines for figure in figures]
    assert len(panels[0]) == len(panels[1]) + 2
    target = next(iter(selected_targets(data)))
    drawn = [line.get_ydata() for line in panels[0]]
    least = 3.0 * np.rad2deg(data["bound"].values[0, :, target, 0])
    assert any(np.allclose(each, least) for each in drawn)


def test_norms_are_those_of_the_errors_in_practical_units(figures):
    """Degrees of the rotation, and kilometers; the region ends at three deviations."""
    data = cell_data(6, 60)
    target = next(iter(selected_targets(data)))
    error, sigma = (data[name].values[0, :, target] for name in ("error", "sigma"))
    panels = {axes.get_ylabel().split(",")[0]: axes for axes in figures["selected"].axes}
    angle = np.rad2deg(np.linalg.norm(error[:, :3], axis=1))
    (bound, drawn, *_) = panels["attitude error"].lines
    # a GRP is the angle in radians up to its third power
    np.testing.assert_allclose(drawn.get_ydata(), angle, rtol=0.02)
    assert np.all(bound.get_ydata() > 0.0)
    (bound, drawn, *_) = panels["position error"].lines
    np.testing.assert_allclose(
        drawn.get_ydata(), LENGTH_UNIT_KM * np.linalg.norm(error[:, 6:9], axis=1)
    )
    np.testing.assert_allclose(
        bound.get_ydata(), 3.0 * LENGTH_UNIT_KM * np.linalg.norm(sigma[:, 6:9], axis=1)
    )


def test_sweep_shows_means_over_the_seeds(figures, summary):
    """TPE in scenario A at 6 targets: coverage of attitude, and geometric mean of its RMSE."""
    index = int(
        np.flatnonzero(
            (summary["scenario"] == "A")
            & (summary["architecture"] == "tpe")
            & (summary["targets"] == 6)
            & (summary["interval_minutes"] == 60)
        )[0]
    )
    coverage = t_interval(100.0 * summary["coverage"].values[index, :, 0])
    rmse = log_interval(np.rad2deg(1.0) * summary["rmse_median"].values[index, :, 0])
    for label, expected in (("within", coverage), ("attitude RMSE", rmse)):
        axes = next(a for a in figures["targets"].axes if a.get_ylabel().startswith(label))
        heights = [line.get_ydata()[0] for line in axes.lines if len(line.get_ydata())]
        assert np.isclose(heights, expected.mean, rtol=1e-12).any()
        ends = [
            segment[:, 1]
            for each in axes.collections
            for segment in getattr(each, "get_segments", list)()
        ]
        assert any(np.allclose(e, [expected.low, expected.high], rtol=1e-9) for e in ends)


def test_intervals_end_at_what_is_possible(figures):
    """Shares between nothing and everything, though Student's intervals of few seeds go on."""
    (axes, *_) = (a for a in figures["targets"].axes if a.get_ylabel().startswith("within"))
    ends = [
        height
        for each in axes.collections
        for segment in getattr(each, "get_segments", list)()
        for height in segment[:, 1]
    ]
    assert ends and min(ends) >= 0.0 and max(ends) <= 100.0


def test_counts_have_whole_ticks(figures):
    for axes in figures["targets of one"].axes:
        if axes.get_ylabel().startswith("never observed"):
            low, high = axes.get_ylim()
            ticks = [tick for tick in axes.get_yticks() if low <= tick <= high]
            assert len(ticks) >= 2 and all(tick == round(tick) for tick in ticks)


def test_median_of_an_efficient_estimator():
    """Lengths of Gaussian vectors of any covariance, drawn, lie between the ends of the band."""
    draws = np.random.default_rng(8).normal(size=(200_000, 3)) ** 2
    for shares in ((1.0, 0.0, 0.0), (0.7, 0.2, 0.1), (0.5, 0.5, 0.0), (1 / 3, 1 / 3, 1 / 3)):
        median = np.sqrt(np.median(draws @ shares))
        assert EFFICIENT[0] - 0.004 < median < EFFICIENT[1] + 0.004


def test_intervals_of_odd_lengths_are_in_minutes(summary):
    odd = summary.isel(cell=np.flatnonzero(summary["interval_minutes"].values != 30))
    odd["interval_minutes"] = odd["interval_minutes"] // 3
    axes = against_interval_figure(odd).axes[-1]
    assert axes.get_xlabel().endswith(", min")
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["20", "80"]


def test_interval_figure_has_the_cells_that_were_swept(figures):
    titles = [a.get_title(loc="left") for a in figures["interval"].axes]
    assert [title for title in titles if title] == [
        "(a) scenario A, 6 targets",
        "(b) scenario A, 12 targets",
        "(c) scenario B, 9 targets",
    ]


def test_tasking_levels_and_methods(figures):
    first = figures["tasking"].axes[0]
    levels = [line.get_ydata() for line in first.lines if len(line.get_xdata()) == 2]
    assert sum(np.array_equal(level, [100.0, 100.0]) for level in levels) == 2
    first = figures["tasking"].axes[-3]
    names = ["exact assignment", "greedy assignment", "TPE"]
    assert [tick.get_text() for tick in first.get_yticklabels()] == names


def test_tasking_figure_without_other_methods(compared, summary):
    figure = tasking_figure(compared, summary, {"": "exact"})
    assert len(figure.axes) == 2 * 2


def test_best_value_is_held_to_the_end():
    history = np.array([[1.0, 3.0, np.nan, np.nan], [2.0, 2.0, 4.0, 5.0]])
    np.testing.assert_array_equal(
        running_best(history), [[1.0, 3.0, 3.0, 3.0], [2.0, 2.0, 4.0, 5.0]]
    )


UNITS = re.compile(
    r"deg/h$|m/s$|, min$|% of time$|[, ]deg$|^deg$|(^|, )km$|targets$|, h$|dimensionless$|ratio$"
    r"|\N{GREEK SMALL LETTER SIGMA}, %$|consistent\)$|, nat$|evaluations$|% of exact$|, s$"
)


@pytest.mark.parametrize("name", NAMES)
def test_axes_carry_their_unit(figures, name):
    figure = figures[name]
    axes = [a for each in figure.axes for a in (each, *each.child_axes)]
    labels = [label for a in axes for label in (a.get_xlabel(), a.get_ylabel()) if label]
    assert len(labels) >= 3
    assert all(UNITS.search(label.split("\n")[-1]) for label in labels), labels


@pytest.mark.parametrize("name", NAMES)
def test_no_text_leaves_the_figure_or_covers_another(figures, name):
    figure = figures[name]
    renderer = figure.canvas.get_renderer()
    figure.draw(renderer)
    axes = [a for each in figure.axes for a in (each, *each.child_axes)]
    titles = [*figure.texts]
    labels = []
    for each in axes:
        titles += [each.title, each._left_title, *each.texts]
        labels += [each.xaxis.label, each.yaxis.label]
    boxes = [t.get_window_extent(renderer) for t in (*titles, *labels) if t.get_text()]
    boxes += [legend.get_window_extent(renderer) for legend in figure.legends]
    page = figure.bbox.padded(0.5)
    for box in boxes:
        assert box.x0 >= page.x0 and box.x1 <= page.x1 and box.y0 >= page.y0 and box.y1 <= page.y1
    for index, box in enumerate(boxes):
        assert not any(box.padded(-0.5).overlaps(other) for other in boxes[:index])


@pytest.mark.parametrize("name", ["counts", "representative", "interval"])
def test_drawing_and_saving_twice_gives_the_same_bytes(figures, name, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "RASTER_DPI", 40)
    for turn, figure in (("first", figures[name]), ("second", DRAW[name]())):
        style.save_figure(figure, *(tmp_path / f"{turn}.{kind}" for kind in ("png", "pdf")))
    for kind, head in (("png", b"\x89PNG"), ("pdf", b"%PDF")):
        written = (tmp_path / f"first.{kind}").read_bytes()
        assert written == (tmp_path / f"second.{kind}").read_bytes()
        assert written.startswith(head)


def test_ticks():
    np.testing.assert_array_equal(spaced(np.array([20.0, 100.0, 20.0])), [20.0, 100.0])
    counts = np.array([20, 25, 30, 50, 75, 100, 125, 150, 175, 202.0])
    shown = spaced(counts)
    assert set(shown) <= set(counts) and shown[0] == 20 and shown[-1] == 202
    assert np.all(np.diff(np.log(shown)) / np.log(202 / 20) >= 0.13)
    for low, high in ((0.02, 0.09), (1e-6, 3e-5), (0.5, 900.0), (1.1, 2.9)):
        ticks = nice_ticks(low, high)
        assert 2 <= ticks.size <= 5 and ticks.min() >= low and ticks.max() <= high
    assert tick_names(np.array([0.5, 20.0])) == ["0.5", "20"]
    names = ["$10^{-5}$", r"$1.5\times10^{-5}$", r"$3\times10^{-5}$"]
    assert tick_names(np.array([1e-5, 1.5e-5, 3e-5])) == names


def test_names():
    assert [interval_text(m) for m in (30, 60, 90, 240)] == ["30 min", "1 h", "90 min", "4 h"]
    assert family_text("Polar_Chandrayaan-1_first_maneuver") == "polar, Chandrayaan-1"
    assert family_text("Halo_L1_S") == "L1 halo S"
    assert family_text("Some_other") == "Some other"
