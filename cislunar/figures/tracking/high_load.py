"""Tracking with more targets than observers, by tasking interval (Paul & Fan, figure 8)."""

from collections.abc import Mapping

import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cislunar.campaign.settings.cells import Cell
from cislunar.figures.axes import legend_below, title_above
from cislunar.figures.labels import (
    architecture_text,
    capitalized,
    family_text,
    interval_text,
    observers_text,
    realization_text,
)
from cislunar.figures.style import BLUE, SKY, VERMILION, house_style, new_figure
from cislunar.figures.tracking.errors import (
    Compared,
    Look,
    draw_comparison,
    representative_target,
)
from cislunar.figures.tracking.heatmaps import draw_measure, marks_legend

_SHORT, _LONG = Look(BLUE, SKY), Look(VERMILION, None, (0, (3.0, 1.2)))
_MAP_IN, _MAP_WIDTH_IN = 2.75, 2.05
_HEIGHT_IN = 9.3


@house_style()
def high_load_figure(cells: Mapping[Cell, xr.Dataset]) -> Figure:
    """ANEES and RMSE of every target by tasking interval, and the errors of one target.

    The cells rise in their tasking interval; the first and the last one have time histories.
    """
    figure = new_figure(_HEIGHT_IN)
    width, height = figure.get_size_inches()
    (first, first_data), *_, (last, last_data) = cells.items()
    title = (
        f"{capitalized(observers_text(first, first_data))} ({architecture_text(first)}),\n$n_T$ = "
        f"{first.targets}; {realization_text(first_data)}"
    )
    title_above(figure, title)
    _maps(figure, cells)
    target = representative_target(first_data, last_data)
    ends = " against ".join(interval_text(cell.interval_minutes) for cell in (first, last))
    if target is None:
        text = f"(c) no target is tracked throughout with both {ends}"
        figure.text(0.14 / width, 4.9 / height, text, fontsize=8.0)
        return figure
    family = family_text(str(first_data["family"].values[target]))
    identity = int(first_data["target_id"].values[target])
    heading = f"(c) target {identity} ({family}), tracked with both: $T_{{ST}}$ = {ends}"
    figure.text(0.14 / width, 5.0 / height, heading, fontsize=8.0)
    compared = [
        Compared(interval_text(cell.interval_minutes), data, look)
        for cell, data, look in ((first, first_data, _SHORT), (last, last_data, _LONG))
    ]
    box = {"left": 0.78, "bottom": 0.68, "width": 6.3, "height": 4.08}
    draw_comparison(figure, compared, target, box)
    _legend(figure, compared)
    return figure


def _maps(figure: Figure, cells: Mapping[Cell, xr.Dataset]) -> None:
    """Panels (a) and (b), each with its color bars."""
    bottom = figure.get_size_inches()[1] - 0.62 - _MAP_IN
    maps = []
    for number, (measure, name, left) in enumerate(
        (("anees", "component-wise ANEES", 0.58), ("rmse", "RMSE", 3.8))
    ):
        maps += draw_measure(
            figure,
            measure,
            [cells],
            {left: (number, name)},
            (bottom, _MAP_WIDTH_IN, _MAP_IN, 0.24),
            lambda cell: interval_text(cell.interval_minutes),
        )
    marks_legend(figure, maps, bottom_in=bottom - 0.66)


def _legend(figure: Figure, compared: list[Compared]) -> None:
    handles = []
    for item in compared:
        dashes = {"color": item.look.line, "linestyle": item.look.dashes}
        handles.append(Line2D([], [], label=f"error, {item.label}", linewidth=0.9, **dashes))
        bounds = f"\N{PLUS-MINUS SIGN}3\N{GREEK SMALL LETTER SIGMA}, {item.label}"
        if item.look.band is None:
            handles.append(Line2D([], [], label=bounds, linewidth=0.6, **dashes))
        else:
            edge = {"edgecolor": item.look.line, "linewidth": 0.6}
            handles.append(Patch(facecolor=item.look.band, alpha=0.4, label=bounds, **edge))
    legend_below(figure, handles, 0.07)
