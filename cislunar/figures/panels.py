"""Panels of statistics against a value, with confidence intervals over seeds."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from cislunar.figures.axes import (
    Array,
    Grid,
    note_empty,
    panel_title,
    reach,
    set_vertical,
    whole_numbers,
    widened,
)
from cislunar.figures.style import SeriesStyle

COUNT, PERCENT = (0.0, np.inf), (0.0, 100.0)
"""What numbers of targets and percentages can be."""


class Row(NamedTuple):
    """A row of panels, which share the vertical axis.

    `curves` is what is drawn, as the figure reads it; `factor` leads from the unit of the data to
    that of `label`; with `log`, intervals are those of the logarithm. `second` is the label of the
    axis on the right and the factor from the left one to it, `reference` a value to compare with,
    or the ends of a band. Nothing lies outside `within`, so that intervals end there.
    """

    label: str
    curves: tuple
    factor: float = 1.0
    log: bool = False
    second: tuple[str, float] | None = None
    reference: float | tuple[float, float] | None = None
    within: tuple[float, float] = (-np.inf, np.inf)


def draw_means(
    axes: Axes,
    at: ArrayLike,
    bounds: tuple[ArrayLike, ArrayLike, ArrayLike],
    look: SeriesStyle,
    within: tuple[float, float] = (-np.inf, np.inf),
    **more: Any,
) -> None:
    """Means with their intervals, joined by the line of the series.

    `bounds` are means, lower and upper ends, which are cut at what is possible, `within`; an end
    that is not a number is not drawn. `more` goes to ``errorbar``.
    """
    mean, low, high = (np.atleast_1d(each) for each in bounds)
    low, high = (np.clip(end, *within) for end in (low, high))
    usual = {
        "color": look.color, "linestyle": look.line, "linewidth": 0.9, "elinewidth": 0.7,
        "capsize": 1.4, "capthick": 0.7, "ecolor": (look.color, 0.55), **look.marker_kwargs(3.2),
    }  # fmt: skip
    axes.errorbar(at, mean, yerr=np.nan_to_num([mean - low, high - mean]), **usual | more)


def draw_rows(
    figure: Figure,
    grid: Grid,
    rows: Sequence[Row],
    titles: Sequence[str],
    draw: Callable[[Axes, Row, int], Array],
    **title_look: Any,
) -> list[list[Axes]]:
    """Rows of panels: vertical axes shared in a row, labels at the left and below alone.

    `draw` takes axes, row and number of the column, and gives the values that the vertical axis
    holds. The axes come back by row and column.
    """
    panels = []
    for number, row in enumerate(rows):
        drawn, values = [], [np.empty(0)]
        for column, title in enumerate(titles):
            axes = grid.place(figure, number, column)
            values.append(np.ravel(draw(axes, row, column)))
            if not np.any(np.isfinite(values[-1])):
                note_empty(axes, "no value:\nnothing was observed")
            axes.tick_params(labelbottom=number == len(rows) - 1, labelleft=column == 0)
            if number == 0:
                panel_title(axes, column, title, **title_look)
            drawn.append(axes)
        limits = reach(np.concatenate(values), log=row.log)
        for axes in drawn:
            if row.within == COUNT:
                set_vertical(axes, widened(*limits), log=False)
                whole_numbers(axes.yaxis)
            else:
                set_vertical(axes, limits, log=row.log)
        if drawn:
            drawn[0].set_ylabel(row.label, fontsize=7.5)
        panels.append(drawn)
    return panels


def draw_best(axes: Axes, at: Array, best: Array, look: SeriesStyle, zorder: float) -> None:
    """Median and range over runs of the best value so far, shape (run, evaluation)."""
    ends = best.min(axis=0), best.max(axis=0)
    axes.fill_between(at, *ends, color=look.color, alpha=0.2, linewidth=0, step="post")
    stepped = {"color": look.color, "linestyle": look.line, "drawstyle": "steps-post"}
    axes.plot(at, np.median(best, axis=0), zorder=zorder, **stepped)
