"""Statistics over realizations: intervals of many, points of few; axes of errors about zero."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_rgba

from cislunar.evaluation.intervals import t_interval
from cislunar.figures import style
from cislunar.figures.axes import place
from cislunar.figures.panels import (
    FEWEST,
    draw_estimates,
    estimates,
    realizations_note,
    table_estimates,
    table_note,
)
from cislunar.figures.style import BLUE, SOLID, SeriesStyle
from cislunar.figures.tracking.errors import Scale

STYLE = SeriesStyle("a series", BLUE, SOLID, "o")


def drawn(found, **more):
    """Points and segments of intervals, and the values that the axis must hold."""
    axes = place(style.new_figure(2.0, 2.0), 0.5, 0.5, 1.0, 1.0)
    kept = draw_estimates(axes, [1.0, 2.0], found, STYLE, **more)
    (points,) = (each for each in axes.collections if isinstance(each, PathCollection))
    shown = np.ma.getdata(points.get_offsets())
    lines = (each for each in axes.collections if isinstance(each, LineCollection))
    segments = [each for one in lines for each in one.get_segments() if np.isfinite(each).all()]
    return shown[np.isfinite(shown).all(axis=1)], [each for each in segments if len(each)], kept


@pytest.mark.parametrize("number", [1, 2, FEWEST - 1, FEWEST, 12])
def test_few_realizations_are_points_and_many_an_interval(number):
    values = np.arange(2.0 * number).reshape(2, number)
    intervals = [t_interval(each) for each in values]
    shown, segments, kept = drawn(estimates(values, intervals))
    if number < FEWEST:
        assert not segments
        expected = values.ravel() if number > 1 else []
        np.testing.assert_allclose(shown[:, 1], expected)
    else:
        assert not len(shown)
        ends = [[each.low, each.high] for each in intervals]
        np.testing.assert_allclose([each[:, 1] for each in segments], ends)
        assert np.nanmin(kept) == min(low for low, _ in ends)
    assert {each.mean for each in intervals} <= set(kept)


def test_values_may_lie_along_the_horizontal_axis():
    values = np.array([[1.0, 2.0, 4.0], [3.0, 5.0, 6.0]])
    found = estimates(values, [t_interval(each) for each in values])
    shown, _, _ = drawn(found, horizontal=True)
    np.testing.assert_allclose(shown[:, 0], values.ravel())


def test_intervals_are_cut_at_what_is_possible():
    rows = pd.DataFrame({"mean": [99.0, 1.0], "low": [90.0, -3.0], "high": [108.0, 5.0]})
    shown, segments, kept = drawn(table_estimates(rows.assign(seeds=9)), within=(0.0, 100.0))
    assert not len(shown) and len(segments) == 2
    assert np.nanmin(kept) == 0.0 and np.nanmax(kept) == 100.0


def test_a_table_gives_the_extremes_of_few_realizations():
    rows = pd.DataFrame({"mean": [2.0, 4.0], "low": [0.0, 3.0], "high": [4.0, 5.0]})
    rows = rows.assign(smallest=[1.0, 2.5], largest=[3.0, 5.5], seeds=[2, 8])
    shown, segments, _ = drawn(table_estimates(rows))
    np.testing.assert_allclose(shown[:, 1], [1.0, 3.0])
    np.testing.assert_allclose(segments[0][:, 1], [3.0, 5.0])
    assert len(segments) == 1
    assert "least and greatest value of fewer than 5" in table_note(rows)
    assert table_note(rows.drop(columns="seeds")) == ""
    few = table_estimates(rows.drop(columns=["smallest", "largest"]))
    shown, segments, _ = drawn(few)
    assert not len(shown) and len(segments) == 1


def test_notes_say_how_many_realizations_and_what_is_drawn():
    assert realizations_note([]) == ""
    assert realizations_note([1]) == "Markers: mean over 1 realization"
    both = realizations_note([3, 10], geometric="on logarithmic axes")
    assert both.startswith("Markers: mean (geometric on logarithmic axes) over 3 to 10 realiz")
    assert "95 % confidence interval" in both and "single values of fewer than 5" in both
    assert "small points" not in realizations_note([10, 12])


def test_series_of_one_look_get_markers_of_their_own():
    names = ("information-20", "information-33", "information-43", "tpe")
    found = style.distinct({name: style.optimizer_style(name) for name in names})
    looks = {(to_rgba(each.color), each.marker) for each in found.values()}
    assert len(looks) == 4


@pytest.mark.parametrize(("linear", "reach"), [(1.0, 80.0), (0.01, 5.0), (0.1, 213.0), (1.0, 2.0)])
def test_axes_of_errors_have_plain_numbers_apart_from_each_other(linear, reach):
    figure = style.new_figure(1.6, 2.0)
    axes = place(figure, 0.6, 0.4, 1.2, 0.6)
    Scale(linear, reach).apply(axes)
    figure.draw(figure.canvas.get_renderer())
    ticks, names = axes.get_yticks(), [each.get_text() for each in axes.get_yticklabels()]
    assert names == [f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks]
    assert len(ticks) >= 3 and 0.0 in ticks and np.array_equal(ticks, -ticks[::-1])
    heights = axes.transData.transform([(0.0, tick) for tick in ticks])[:, 1] / figure.dpi
    assert np.diff(heights).min() > 0.07
