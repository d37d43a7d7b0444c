"""Errors of one target by tasking interval, with more targets than observers (figure 8)."""

from collections.abc import Mapping

import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cislunar.campaign.settings.cells import Cell
from cislunar.figures import labels
from cislunar.figures.axes import Grid, legend_below, note_below, title_above
from cislunar.figures.labels import PARTS
from cislunar.figures.style import BLUE, SKY, VERMILION, house_style, new_figure
from cislunar.figures.tracking import errors

_SERIES = errors.ErrorStyle(BLUE, SKY), errors.ErrorStyle(VERMILION, None, (0, (3.0, 1.2)))
"""Styles of the shortest and the longest tasking interval."""
_HEAD, _FOOT, _PANELS_IN = 0.66, 0.8, 4.4
_GRID = Grid(4, 3, (6.3 - 2 * 0.2) / 3, (_PANELS_IN - 3 * 0.1) / 4, 0.78, _FOOT, 0.2, 0.1)


@house_style()
def representative_target_figure(cells: Mapping[Cell, xr.Dataset]) -> Figure:
    """Draw the errors of one target with the shortest and the longest tasking interval.

    The cells rise in their tasking interval; the first and the last one have time histories.
    """
    (first, first_data), *_, (last, last_data) = dict(cells).items()
    figure = new_figure(_HEAD + _PANELS_IN + _FOOT)
    target = errors.representative_target(first_data, last_data)
    ends = " and ".join(labels.interval_text(cell.interval_minutes) for cell in (first, last))
    if target is None:
        shown = f"no target is tracked throughout with tasking every {ends}"
    else:
        shown = (
            f"target {labels.target_text(first_data, target)}, tracked with tasking every {ends}"
        )
    text = f"{labels.observers_text(first, first_data)}, {first.targets} targets"
    title_above(figure, f"{text}; {labels.realization_text(first_data)};\n{shown}")
    if target is None:
        return figure
    found = [errors.histories(data, target) for data in (first_data, last_data)]
    columns = [part.columns for part in PARTS]
    scales = [errors.part_scale(*([each[k][:, own] for each in found] for k in (1, 2)))
              for own in columns]  # fmt: skip
    for component in range(12):
        row, axis = divmod(component, 3)
        axes = _GRID.place(figure, row, axis)
        for series, (hours, error, sigma) in zip(_SERIES, found, strict=True):
            errors.draw_error(axes, hours, error[:, component], sigma[:, component], series)
            axes.set_xlim(0.0, hours[-1])
        scales[row].apply(axes)
        errors.time_axis(axes, labeled=row == 3)
        axes.tick_params(labelleft=axis == 0)
        if row == 0:
            axes.set_title(labels.AXES[axis], fontsize=7.5, pad=2.5)
        if axis == 0:
            errors.label_errors(axes, PARTS[row], -0.2, fontsize=6.5)
    handles: list = []
    for cell, series in zip((first, last), _SERIES, strict=True):
        text = f"every {labels.interval_text(cell.interval_minutes)}"
        dashes = {"color": series.line, "linestyle": series.dashes}
        handles.append(Line2D([], [], label=f"error, {text}", linewidth=0.9, **dashes))
        bounds = f"\N{PLUS-MINUS SIGN}3\N{GREEK SMALL LETTER SIGMA}, {text}"
        if series.band is None:
            handles.append(Line2D([], [], label=bounds, linewidth=0.6, **dashes))
        else:
            edge = {"edgecolor": series.line, "linewidth": 0.6}
            handles.append(Patch(facecolor=series.band, alpha=0.4, label=bounds, **edge))
    legend_below(figure, handles, note_below(figure, errors.SCALE_NOTE))
    return figure
