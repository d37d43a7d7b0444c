"""One of more targets than observers, by tasking interval (Paul & Fan, figure 8)."""

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
    interval_text,
    observers_text,
    realization_text,
    target_text,
)
from cislunar.figures.style import BLUE, SKY, VERMILION, house_style, new_figure
from cislunar.figures.tracking.errors import (
    Compared,
    Look,
    draw_comparison,
    representative_target,
)

_SHORT, _LONG = Look(BLUE, SKY), Look(VERMILION, None, (0, (3.0, 1.2)))
_HEAD, _FOOT, _PANELS_IN = 0.82, 0.68, 4.4


@house_style()
def representative_target_figure(cells: Mapping[Cell, xr.Dataset]) -> Figure:
    """The errors of one target with the shortest and the longest tasking interval.

    The cells rise in their tasking interval; the first and the last one have time histories.
    """
    (first, first_data), *_, (last, last_data) = cells.items()
    figure = new_figure(_HEAD + _PANELS_IN + _FOOT)
    target = representative_target(first_data, last_data)
    ends = " against ".join(interval_text(cell.interval_minutes) for cell in (first, last))
    if target is None:
        shown = f"no target is tracked throughout with both, $T_{{ST}}$ = {ends}"
    else:
        shown = f"target {target_text(first_data, target)}, tracked with both, $T_{{ST}}$ = {ends}"
    title_above(
        figure,
        f"{capitalized(observers_text(first, first_data))} ({architecture_text(first)}),\n$n_T$ = "
        f"{first.targets}; {realization_text(first_data)};\n{shown}",
    )
    if target is None:
        return figure
    compared = [
        Compared(interval_text(cell.interval_minutes), data, look)
        for cell, data, look in ((first, first_data, _SHORT), (last, last_data, _LONG))
    ]
    box = {"left": 0.78, "bottom": _FOOT, "width": 6.3, "height": _PANELS_IN}
    draw_comparison(figure, compared, target, box)
    _legend(figure, compared)
    return figure


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
