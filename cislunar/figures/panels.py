"""Panels of statistics over realizations: means with confidence intervals, or single values."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from cislunar.evaluation.intervals import Interval
from cislunar.figures import axes as layout
from cislunar.figures.style import SeriesStyle

COUNT, PERCENT = (0.0, np.inf), (0.0, 100.0)
"""Possible values of numbers of targets and of percentages."""

FEWEST = 5
"""Least number of realizations for which a confidence interval is drawn."""


class Row(NamedTuple):
    """A quantity of a figure: a row of panels, which share the vertical axis, or a single panel.

    `curves` names the data in the form that the figure reads; `factor` converts their unit to that
    of `label`; with `log`, intervals are those of the logarithm. `reference` is a value to compare
    with, or the ends of a band. Nothing can lie outside `within`.
    """

    label: str
    curves: tuple
    factor: float = 1.0
    log: bool = False
    reference: float | tuple[float, float] | None = None
    within: tuple[float, float] = (-np.inf, np.inf)


class PlottedValues(NamedTuple):
    """A quantity at some places: means, ends of intervals, and single values, shape (place, value).

    A place has either an interval or, with fewer than `FEWEST` realizations, single values; what it
    does not have is NaN.
    """

    mean: layout.Array
    low: layout.Array
    high: layout.Array
    single: layout.Array

    def scaled(self, factor: float) -> "PlottedValues":
        """In another unit."""
        return PlottedValues(*(factor * each for each in self))


def _estimates(
    mean: layout.Array,
    low: layout.Array,
    high: layout.Array,
    single: layout.Array,
    counts: layout.Array,
) -> PlottedValues:
    few = np.asarray(counts) < FEWEST
    low, high = (np.where(few, np.nan, end) for end in (low, high))
    # the only realization is the mean itself
    shown = few & (np.asarray(counts) > 1)
    return PlottedValues(mean, low, high, np.where(shown[:, None], single, np.nan))


def rows_of(table: pd.DataFrame, row: Row) -> pd.DataFrame:
    """Rows of a table with the quantity, part and unit in `curves`; an empty one is any."""
    chosen = np.ones(len(table), dtype=bool)
    for key, own in zip(("quantity", "part", "unit"), row.curves, strict=True):
        if own:
            chosen &= (table[key] == own).to_numpy()
    return table[chosen]


def set_values(
    axes: Axes, which: str, values: Sequence[ArrayLike], row: Row, steps: int | None = None
) -> None:
    """Set limits and ticks of the axis ``x`` or ``y`` along which the values drawn of a row lie.

    A linear axis has about `steps` ticks; by default those of matplotlib.
    """
    axis = getattr(axes, f"{which}axis")
    limits = layout.reach(np.concatenate([np.empty(0), *map(np.ravel, values)]), log=row.log)
    limits = layout.widened(*limits) if row.within == COUNT else limits
    axes.set(**{f"{which}scale": "log"} if row.log else {}, **{f"{which}lim": limits})
    if row.log:
        layout.log_ticks(axis, *limits)
    elif row.within == COUNT:
        layout.whole_numbers(axis)
    elif steps:
        axis.set_major_locator(MaxNLocator(steps, min_n_ticks=1))


def estimates(values: ArrayLike, intervals: Sequence[Interval]) -> PlottedValues:
    """From the values of the realizations, shape (place, realization), and their intervals."""
    mean, low, high = (np.array([each[k] for each in intervals], dtype=float) for k in range(3))
    values = np.asarray(values, dtype=float).reshape(len(intervals), -1)
    return _estimates(mean, low, high, values, np.array([each.count for each in intervals]))


def table_estimates(rows: pd.DataFrame) -> PlottedValues:
    """From rows of a table: columns mean, low and high; seeds, smallest and largest if there."""
    mean, low, high, smallest, largest = (
        rows[key].to_numpy(float) if key in rows else np.full(len(rows), np.nan)
        for key in ("mean", "low", "high", "smallest", "largest")
    )
    counts = rows["seeds"].fillna(1).to_numpy(float) if "seeds" in rows else np.full(len(rows), 9)
    return _estimates(mean, low, high, np.column_stack((smallest, largest)), counts)


def draw_estimates(
    axes: Axes,
    at: ArrayLike,
    found: PlottedValues,
    series: SeriesStyle,
    within: tuple[float, float] = (-np.inf, np.inf),
    *,
    horizontal: bool = False,
    **more: Any,
) -> layout.Array:
    """Draw means, joined by the line of the series, with their intervals or single values.

    Intervals are cut at what is possible, `within`. With `horizontal`, values lie along the
    horizontal axis. `more` goes to ``errorbar``. All numbers drawn are returned.
    """
    mean, low, high, single = found
    low, high = np.clip(low, *within), np.clip(high, *within)
    ends = [mean - low, high - mean]
    usual = {
        "color": series.color, "linestyle": series.line, "linewidth": 0.9, "elinewidth": 0.7,
        "capsize": 1.4, "capthick": 0.7, "ecolor": (series.color, 0.7), **series.marker_kwargs(3.2),
    }  # fmt: skip
    at = np.atleast_1d(np.asarray(at, dtype=float))
    places = np.repeat(at, single.shape[1]), single.ravel()
    points = {"s": 5.0, "color": series.color, "alpha": 0.75, "linewidths": 0.0, "zorder": 2.8}
    error = {"xerr" if horizontal else "yerr": np.maximum(ends, 0.0)}
    axes.scatter(*(places[::-1] if horizontal else places), **points)
    axes.errorbar(*((mean, at) if horizontal else (at, mean)), **error, **usual | more)
    return np.concatenate((mean, low, high, single.ravel()))


def realizations_note(
    counts: Iterable[float], *, geometric: str = "", points: str = "single values"
) -> str:
    """What markers, bars and points are, from the numbers of realizations of what is drawn.

    `geometric` says which means are geometric. `points` describes the points that are drawn for
    fewer than `FEWEST` realizations; it is empty if there are none.
    """
    counts = sorted({int(count) for count in counts if np.isfinite(count) and count > 0})
    if not counts:
        return ""
    span = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    mean = f"mean (geometric {geometric})" if geometric else "mean"
    text = f"Markers: {mean} over {span} realization{'s' * (counts[-1] > 1)}"
    few = any(1 < count < FEWEST for count in counts)
    if counts[-1] >= FEWEST:
        text += "; bars: 95 % confidence interval"
        text += f" (from {FEWEST} realizations on)" * (few and not points)
    if few and points:
        text += f"; small points: {points} of fewer than {FEWEST} realizations"
    return text


def table_note(table: pd.DataFrame) -> str:
    """The note of `realizations_note` for rows of a table."""
    extremes = "least and greatest value" if "smallest" in table else ""
    return realizations_note(table["seeds"], points=extremes) if "seeds" in table else ""


def draw_rows(
    figure: Figure,
    grid: layout.Grid,
    rows: Sequence[Row],
    titles: Sequence[str],
    draw: Callable[[Axes, Row, int], layout.Array],
    **title_style: Any,
) -> list[list[Axes]]:
    """Draw rows of panels with shared vertical axes; labels stand at the left and below only.

    `draw` takes axes, row and number of the column, and returns the values that the vertical axis
    must hold. The axes are returned by row and column.
    """
    panels = []
    for number, row in enumerate(rows):
        drawn, values = [], []
        for column, title in enumerate(titles):
            axes = grid.place(figure, number, column)
            values.append(np.ravel(draw(axes, row, column)))
            if not np.any(np.isfinite(values[-1])):
                layout.note_empty(axes, "no value:\nnothing was observed")
            axes.tick_params(labelbottom=number == len(rows) - 1, labelleft=column == 0)
            if number == 0:
                layout.panel_title(axes, column, title, **title_style)
            drawn.append(axes)
        for axes in drawn:
            set_values(axes, "y", values, row)
        if drawn:
            drawn[0].set_ylabel(row.label, fontsize=7.5)
        panels.append(drawn)
    return panels


def draw_best(
    axes: Axes, at: layout.Array, best: layout.Array, series: SeriesStyle, zorder: float
) -> None:
    """Draw median and range over runs of the best value so far, shape (run, evaluation)."""
    ends = best.min(axis=0), best.max(axis=0)
    axes.fill_between(at, *ends, color=series.color, alpha=0.2, linewidth=0, step="post")
    median = np.median(best, axis=0)
    axes.plot(at, median, zorder=zorder, drawstyle="steps-post", **series.line_kwargs())
