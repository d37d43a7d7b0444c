"""Panels of statistics against a swept value, with confidence intervals over seeds."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter

from cislunar.campaign.tracking.statistics import Interval, log_interval, t_interval
from cislunar.campaign.tracking.summary import seed_values
from cislunar.figures.axes import log_ticks, place, spaced
from cislunar.figures.space.scene import Array
from cislunar.figures.style import GRAY, SeriesStyle, new_figure, panel_letter

_LEFT, _RIGHT, _GAP = 1.0, 0.58, 0.14
_ROW_IN, _BETWEEN_IN = 1.02, 0.16
_HEAD, _FOOT = 0.48, 1.02
_COLUMN_IN = 1.78


class Curve(NamedTuple):
    """A quantity of `task2/summary.nc`.

    Attributes
    ----------
    quantity : str
    part : str or None
        Part of the state, for the quantities that have them.
    filled : bool
        Drawn with filled markers, or with hollow ones where a panel has two quantities.
    only : str or None
        The one series it is drawn for; None for all.
    style : SeriesStyle or None
        Its own look, instead of the series'.
    """

    quantity: str
    part: str | None = None
    filled: bool = True
    only: str | None = None
    style: SeriesStyle | None = None


class Row(NamedTuple):
    """A row of panels.

    Attributes
    ----------
    label : str
        Axis label, with the unit.
    curves : tuple of Curve
    factor : float
        From the unit of the summary to that of the axis.
    log : bool
        Logarithmic axis; intervals are then those of the logarithm.
    second : tuple of (str, float) or None
        Label of the axis on the right, and the factor from the left one to it.
    reference : float or None
        Value to compare with.
    """

    label: str
    curves: tuple[Curve, ...]
    factor: float = 1.0
    log: bool = False
    second: tuple[str, float] | None = None
    reference: float | None = None


class Panel(NamedTuple):
    """A column of panels: cells of the summary by series.

    Attributes
    ----------
    title : str
    cells : dict of str to ndarray of int
        Indices into the summary, in rising order, for every series.
    note : str
        Small print under the title.
    """

    title: str
    cells: dict[str, Array]
    note: str = ""


def sweep_figure(
    summary: xr.Dataset,
    panels: Sequence[Panel],
    rows: Sequence[Row],
    styles: Mapping[str, SeriesStyle],
    x_of: Callable[[Array], Array],
    x_label: str,
) -> Figure:
    """All rows by all columns; a row shares its vertical axis.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.
    panels : sequence of Panel
        Columns.
    rows : sequence of Row
    styles : mapping of str to SeriesStyle
        Of the series, in the order in which they are drawn.
    x_of : callable
        Place on the horizontal axis of cells of the summary.
    x_label : str
        With the unit.

    Returns
    -------
    matplotlib.figure.Figure
        Without legend.
    """
    columns = max(len(panels), 1)
    width_in = _LEFT + columns * _COLUMN_IN + (columns - 1) * _GAP + _RIGHT
    rows_in = len(rows) * _ROW_IN + (len(rows) - 1) * _BETWEEN_IN
    figure = new_figure(_HEAD + rows_in + _FOOT, width_in)
    for number, row in enumerate(rows):
        bottom = _FOOT + rows_in - (number + 1) * _ROW_IN - number * _BETWEEN_IN
        drawn = []
        for column, panel in enumerate(panels):
            left = _LEFT + column * (_COLUMN_IN + _GAP)
            axes = place(figure, left, bottom, _COLUMN_IN, _ROW_IN)
            for index, (name, look) in enumerate(styles.items()):
                if name in panel.cells:
                    at = x_of(panel.cells[name]) * 1.018 ** (index - 0.5 * (len(styles) - 1))
                    _draw(axes, summary, panel.cells[name], at, row, name, look)
            if row.reference is not None:
                axes.axhline(row.reference, color=GRAY, linewidth=0.8, zorder=1)
            _x_axis(axes, np.concatenate([x_of(index) for index in panel.cells.values()]))
            axes.tick_params(labelbottom=number == len(rows) - 1, labelleft=column == 0)
            if number == 0:
                axes.set_title(f"{panel_letter(column)} {panel.title}", loc="left", pad=14)
                axes.annotate(panel.note, (0.0, 1.0), xytext=(0, 4), fontsize=5.6,
                              xycoords="axes fraction", textcoords="offset points")  # fmt: skip
            if number == len(rows) - 1:
                axes.set_xlabel(x_label)
            drawn.append(axes)
        _share_y(drawn, row, _values(summary, panels, row))
    return figure


def _draw(
    axes: Axes,
    summary: xr.Dataset,
    cells: Array,
    at: Array,
    row: Row,
    name: str,
    look: SeriesStyle,
) -> None:
    """Means with intervals of one series."""
    for curve in row.curves:
        if curve.only is not None and name != curve.only:
            continue
        found = [_interval(summary, cell, curve, row) for cell in cells]
        middle = np.array([each.mean for each in found])
        low = np.array([each.low for each in found])
        high = np.array([each.high for each in found])
        axes.errorbar(
            at,
            middle,
            yerr=np.nan_to_num([middle - low, high - middle]),
            color=look.color if curve.style is None else curve.style.color,
            linestyle=look.line if curve.style is None else curve.style.line,
            linewidth=0.9,
            elinewidth=0.7,
            capsize=1.4,
            capthick=0.7,
            zorder=3,
            **(curve.style or look._replace(filled=curve.filled)).marker_kwargs(3.2),
        )


def _interval(summary: xr.Dataset, cell: int, curve: Curve, row: Row) -> Interval:
    values = row.factor * seed_values(summary, cell, curve.quantity, curve.part)
    return (log_interval if row.log else t_interval)(values)


def _values(summary: xr.Dataset, panels: Sequence[Panel], row: Row) -> Array:
    """Means and interval ends of a row, for the reach of its axis.

    Ends beyond all single values, as those of few seeds are, do not count.
    """
    found = []
    for cell in (cell for panel in panels for index in panel.cells.values() for cell in index):
        for curve in row.curves:
            mean, *ends, _ = _interval(summary, cell, curve, row)
            single = row.factor * seed_values(summary, cell, curve.quantity, curve.part)
            single = single[np.isfinite(single) & ((single > 0.0) | (not row.log))]
            if single.size:
                found += [mean, *np.clip(ends, single.min(), single.max())]
    values = np.array(found)
    return values[np.isfinite(values)]


def _share_y(drawn: Sequence[Axes], row: Row, values: Array) -> None:
    """One vertical axis for all panels of a row; an interval from few seeds may leave it."""
    low, high = (values.min(), values.max()) if values.size else (0.1, 1.0)
    if row.log:
        margin = max((high / low) ** 0.08, 1.15)
        limits = low / margin, high * margin
    else:
        margin = 0.08 * (high - low) or 0.5
        limits = low - margin, high + margin
    for axes in drawn:
        if row.log:
            axes.set_yscale("log")
        axes.set_ylim(*limits)
        if row.log:
            log_ticks(axes.yaxis, *limits)
    if drawn:
        drawn[0].set_ylabel(row.label, fontsize=7.5)
        drawn[0].yaxis.set_label_coords(-0.52 / _COLUMN_IN, 0.5)
        if row.second is not None:
            _second_axis(drawn[-1], *row.second, limits)


def _second_axis(axes: Axes, label: str, factor: float, limits: tuple[float, float]) -> None:
    """The same values in a practical unit, on the right."""
    other = axes.secondary_yaxis("right", functions=(lambda v: factor * v, lambda v: v / factor))
    log_ticks(other.yaxis, factor * limits[0], factor * limits[1])
    other.set_ylabel(label, fontsize=7.5)


def _x_axis(axes: Axes, values: Array) -> None:
    """Logarithmic, ticks at the values of the sweep."""
    axes.set_xscale("log")
    low, high = values.min(), values.max()
    margin = max((high / low) ** 0.06, 1.05) if high > low else 1.4
    axes.set_xlim(low / margin, high * margin)
    ticks = spaced(values)
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
    axes.xaxis.set_minor_locator(FixedLocator(np.unique(values)))
    axes.xaxis.set_minor_formatter(NullFormatter())
