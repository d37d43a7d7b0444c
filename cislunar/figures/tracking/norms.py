"""Estimation errors of single targets as norms in degrees and kilometers, over time."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.realizations import PRACTICAL_UNITS
from cislunar.evaluation.metrics import BOUND_SIGMAS, attitude_angle_deg
from cislunar.figures.axes import Array, Grid, reach, set_vertical, title_above
from cislunar.figures.labels import PARTS
from cislunar.figures.style import BLACK, PAGE_WIDTH_IN, SKY, house_style, new_figure
from cislunar.figures.tracking.errors import (
    LEAST,
    SELECTED,
    cell_title,
    heading,
    histories,
    least_errors,
    mark_measurements,
    selected_targets,
    targets_legend,
    time_axis,
)

_LEFT, _RIGHT, _GAP, _BETWEEN = 0.78, 0.12, 0.14, 0.12
_PANEL_IN, _HEAD, _FOOT = 1.15, 0.8, 0.66
_UNITS = {"degree": "degree", "degree h-1": "degree/h", "km": "km", "m s-1": "m/s"}


class _Norms(NamedTuple):
    """A part's norms over time: error, three standard deviations, three times the bound."""

    error: Array
    deviation: Array
    least: Array


def _norms(number: int, error: Array, sigma: Array, least: Array) -> _Norms:
    """Norms of a part of the state, its deviations as their root sum of squares."""
    columns = PARTS[number].columns
    _, factor = list(PRACTICAL_UNITS.values())[number]

    def norm(values: Array) -> Array:
        return factor * np.sqrt(np.sum(values[:, columns] ** 2, axis=1))

    size: Callable[[Array], Array] = attitude_angle_deg if number == 0 else norm
    return _Norms(size(error), BOUND_SIGMAS * norm(sigma), BOUND_SIGMAS * norm(least))


@house_style()
def selected_targets_figure(cell: Cell, data: xr.Dataset) -> Figure:
    """Norms of the errors of a few targets: a column for each, a row for each part of the state."""
    chosen = selected_targets(data)
    width_in = (PAGE_WIDTH_IN - _LEFT - _RIGHT - _GAP * (SELECTED - 1)) / SELECTED
    grid = Grid(len(PARTS), SELECTED, width_in, _PANEL_IN, _LEFT, _FOOT, _GAP, _BETWEEN)
    figure = new_figure(_HEAD + grid.size[1] + _FOOT)
    title_above(figure, cell_title(cell, data))
    units = [_UNITS[unit] for unit, _ in PRACTICAL_UNITS.values()]
    for row, (part, unit) in enumerate(zip(PARTS, units, strict=True)):
        drawn, held = [], [np.empty(0)]
        for column, (target, why) in enumerate(chosen.items()):
            axes = grid.place(figure, row, column)
            hours, error, sigma = histories(data, target)
            found = _norms(row, error, sigma, least_errors(data, target))
            held += _draw(axes, hours, found)
            mark_measurements(axes, data, target)
            time_axis(axes, labeled=row == len(PARTS) - 1)
            axes.tick_params(labelleft=column == 0)
            if row == 0:
                text = heading(data, target, column, why)
                axes.set_title(text, fontsize=7.0, loc="left", linespacing=1.3)
            if column == 0:
                axes.set_ylabel(f"{part.name} error,\n{unit}", fontsize=7.0)
                axes.yaxis.set_label_coords(-0.27, 0.5)
            drawn.append(axes)
        limits = reach(np.concatenate(held), log=True, share=0.12)
        for axes in drawn:
            set_vertical(axes, limits, log=True)
            axes.grid(True, axis="y")
    within = "up to 3\N{GREEK SMALL LETTER SIGMA}, root of the sum of squares"
    targets_legend(figure, "norm of the error", within, bound="bound" in data)
    return figure


def _draw(axes: Axes, hours: Array, norms: _Norms) -> list[Array]:
    """Norm of the error over its bounds; what the axis holds."""
    axes.fill_between(hours, 1e-30, norms.deviation, color=SKY, alpha=0.4, linewidth=0, zorder=2)
    axes.plot(hours, norms.deviation, color=BLACK, linewidth=0.6, zorder=3)
    axes.plot(hours, norms.error, color=BLACK, linewidth=0.9, zorder=4)
    if norms.least.size:
        axes.plot(hours, norms.least, **LEAST, zorder=3.5)
    return [norms.error, norms.deviation, norms.least]
