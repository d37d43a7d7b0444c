"""Estimation errors of single targets as norms in degrees and kilometers, over time."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cislunar.campaign.settings.cells import Cell
from cislunar.evaluation.metrics import BOUND_SIGMAS
from cislunar.figures.axes import Array, Grid, reach, set_vertical, title_above
from cislunar.figures.labels import PARTS
from cislunar.figures.style import BLACK, PAGE_WIDTH_IN, SKY, house_style, new_figure
from cislunar.figures.tracking import errors

_LEFT, _RIGHT, _GAP, _BETWEEN = 0.78, 0.12, 0.14, 0.12
_PANEL_IN, _HEAD, _FOOT = 1.15, 0.8, 0.66


def selected_targets_figure(cell: Cell, data: xr.Dataset) -> Figure:
    """Draw error norms of a few targets: a column for each, a row for each part of the state."""
    return error_norms_figure(errors.cell_title(cell, data), data, errors.selected_targets(data))


@house_style()
def error_norms_figure(title: str, data: xr.Dataset, chosen: Mapping[int, str]) -> Figure:
    """Draw error norms of targets, given by their indices with a reason for each."""
    width_in = (PAGE_WIDTH_IN - _LEFT - _RIGHT - _GAP * (errors.SELECTED - 1)) / errors.SELECTED
    grid = Grid(len(PARTS), errors.SELECTED, width_in, _PANEL_IN, _LEFT, _FOOT, _GAP, _BETWEEN)
    figure = new_figure(_HEAD + grid.size[1] + _FOOT)
    title_above(figure, title)
    for row, part in enumerate(PARTS):
        drawn, shown_values = [], [np.empty(0)]
        for column, (target, why) in enumerate(chosen.items()):
            axes = grid.place(figure, row, column)
            hours, error, sigma = errors.histories(data, target)
            bounds = (BOUND_SIGMAS * each for each in (sigma, errors.least_errors(data, target)))
            norms = (np.linalg.norm(each[:, part.columns], axis=1) for each in (error, *bounds))
            shown_values += _draw(axes, hours, *norms)
            errors.mark_measurements(axes, data, target)
            errors.time_axis(axes, labeled=row == len(PARTS) - 1)
            axes.tick_params(labelleft=column == 0)
            if row == 0:
                text = errors.heading(data, target, column, why)
                axes.set_title(text, fontsize=7.0, loc="left", linespacing=1.3)
            if column == 0:
                errors.label_errors(axes, part, -0.27)
            drawn.append(axes)
        limits = reach(np.concatenate(shown_values), log=True, share=0.12)
        for axes in drawn:
            set_vertical(axes, limits, log=True)
            axes.grid(True, axis="y")
    within = "3\N{GREEK SMALL LETTER SIGMA} bound, root sum of squares"
    errors.targets_legend(figure, "norm of the error", within, bound="bound" in data)
    return figure


def _draw(axes: Axes, hours: Array, error: Array, deviation: Array, least: Array) -> list[Array]:
    """Draw the norm of the error and its bounds; all values are returned."""
    axes.fill_between(hours, 1e-30, deviation, color=SKY, alpha=0.4, linewidth=0, zorder=2)
    axes.plot(hours, deviation, color=BLACK, linewidth=0.6, zorder=3)
    axes.plot(hours, error, color=BLACK, linewidth=0.9, zorder=4)
    if least.size:
        axes.plot(hours, least, **errors.LEAST, zorder=3.5)
    return [error, deviation, least]
