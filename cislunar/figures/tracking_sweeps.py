"""Both sweeps as a whole: statistics over the targets with confidence intervals over seeds."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter

from cislunar.campaign.statistics import Interval, log_interval, t_interval
from cislunar.campaign.tracking_summary import cell_index, seed_values
from cislunar.campaign.tracking_tables import PRACTICAL_UNITS
from cislunar.campaign.tracking_verdicts import usual_interval
from cislunar.figures.scene import Array
from cislunar.figures.style import (
    BLACK,
    GRAY,
    house_style,
    new_figure,
    optimizer_style,
    panel_letter,
)
from cislunar.figures.tracking_axes import log_ticks, place, spaced

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
    """

    quantity: str
    part: str | None = None
    filled: bool = True


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


ROWS = (
    Row(
        "within 3\N{GREEK SMALL LETTER SIGMA}, % of time",
        (Curve("coverage", "attitude"), Curve("coverage", "position", False)),
        factor=100.0,
    ),
    Row(
        "median ANEES,\ndimensionless",
        (Curve("anees_median", "attitude"), Curve("anees_median", "position", False)),
        log=True,
        reference=1.0,
    ),
    Row(
        "attitude RMSE,\nGRP, nondim.",
        (Curve("rmse_median", "attitude"),),
        log=True,
        second=("degree", PRACTICAL_UNITS["attitude"][1]),
    ),
    Row(
        "position RMSE,\nnondim.",
        (Curve("rmse_median", "position", False),),
        log=True,
        second=("km", PRACTICAL_UNITS["position"][1]),
    ),
    Row("final attitude\nerror, degree", (Curve("final_attitude_error_median"),), log=True),
    Row("never observed,\ntargets", (Curve("never_observed"),)),
    Row(
        "diverged, % of\nobserved targets",
        (Curve("diverged_rotation_share"), Curve("diverged_translation_share", None, False)),
        factor=100.0,
    ),
)


class Panel(NamedTuple):
    """A column of panels: cells of the summary by architecture, and their places on the axis.

    Attributes
    ----------
    title : str
    cells : dict of str to ndarray of int
        Indices into the summary, in rising order, for every architecture.
    """

    title: str
    cells: dict[str, Array]


def _architectures(summary: xr.Dataset) -> list[str]:
    return list(dict.fromkeys(summary["architecture"].values.astype(str)))


def _panel(summary: xr.Dataset, title: str, **wanted: Any) -> Panel:
    """Cells with the usual settings, for every architecture that has some."""
    estimator = str(summary["estimator"].values[0])
    found = {
        name: cell_index(summary, architecture=name, estimator=estimator, variant="", **wanted)
        for name in _architectures(summary)
    }
    return Panel(title, {name: index for name, index in found.items() if index.size})


@house_style()
def against_targets_figure(summary: xr.Dataset) -> Figure:
    """Every statistic against the number of targets, a column for each scenario.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    usual = usual_interval(summary)
    scenarios = list(dict.fromkeys(summary["scenario"].values.astype(str)))
    panels = [
        _panel(summary, f"scenario {name}", scenario=name, interval_minutes=usual)
        for name in scenarios
    ]
    return _sweep_figure(
        summary,
        [panel for panel in panels if panel.cells],
        lambda index: summary["targets"].values[index].astype(float),
        "number of targets $n_T$",
    )


@house_style()
def against_interval_figure(summary: xr.Dataset) -> Figure:
    """Every statistic against the tasking interval, a column for each scenario and target count.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    pairs = zip(summary["scenario"].values.astype(str), summary["targets"].values, strict=True)
    panels = []
    for scenario, targets in sorted(set(pairs)):
        title = f"scenario {scenario}, $n_T$ = {int(targets)}"
        panel = _panel(summary, title, scenario=scenario, targets=targets)
        swept = {
            name: index
            for name, index in panel.cells.items()
            if np.unique(summary["interval_minutes"].values[index]).size > 1
        }
        if swept:
            panels.append(Panel(title, swept))
    return _sweep_figure(
        summary,
        panels,
        lambda index: summary["interval_minutes"].values[index] / 60.0,
        "tasking interval $T_{ST}$, h",
    )


def _sweep_figure(
    summary: xr.Dataset,
    panels: Sequence[Panel],
    x_of: Callable[[Array], Array],
    x_label: str,
) -> Figure:
    """All rows by all columns; a row shares its vertical axis."""
    columns = max(len(panels), 1)
    width_in = _LEFT + columns * _COLUMN_IN + (columns - 1) * _GAP + _RIGHT
    rows_in = len(ROWS) * _ROW_IN + (len(ROWS) - 1) * _BETWEEN_IN
    figure = new_figure(_HEAD + rows_in + _FOOT, width_in)
    names = [n for n in _architectures(summary) if any(n in panel.cells for panel in panels)]
    for number, row in enumerate(ROWS):
        bottom = _FOOT + rows_in - (number + 1) * _ROW_IN - number * _BETWEEN_IN
        drawn = []
        for column, panel in enumerate(panels):
            left = _LEFT + column * (_COLUMN_IN + _GAP)
            axes = place(figure, left, bottom, _COLUMN_IN, _ROW_IN)
            for index, name in enumerate(names):
                if name in panel.cells:
                    at = x_of(panel.cells[name]) * 1.018 ** (index - 0.5 * (len(names) - 1))
                    _draw(axes, summary, panel.cells[name], at, row, name)
            if row.reference is not None:
                axes.axhline(row.reference, color=GRAY, linewidth=0.8, zorder=1)
            _x_axis(axes, np.concatenate([x_of(index) for index in panel.cells.values()]))
            axes.tick_params(labelbottom=number == len(ROWS) - 1, labelleft=column == 0)
            if number == 0:
                axes.set_title(f"{panel_letter(column)} {panel.title}", loc="left", pad=14)
                axes.annotate(_observers(summary, panel), (0.0, 1.0), xytext=(0, 4), fontsize=5.6,
                              xycoords="axes fraction", textcoords="offset points")  # fmt: skip
            if number == len(ROWS) - 1:
                axes.set_xlabel(x_label)
            drawn.append(axes)
        _share_y(drawn, row, _values(summary, panels, row))
    _legend(figure, names)
    return figure


def _observers(summary: xr.Dataset, panel: Panel) -> str:
    """Observers of every architecture of a panel."""
    counts = [
        f"{optimizer_style(name).label.split()[0]} {int(summary['observers'].values[index[0]])}"
        for name, index in panel.cells.items()
    ]
    return f"observers: {', '.join(counts)}"


def _draw(
    axes: Axes, summary: xr.Dataset, cells: Array, at: Array, row: Row, architecture: str
) -> None:
    """Means with intervals of one architecture."""
    look = optimizer_style(architecture)
    for curve in row.curves:
        found = [_interval(summary, cell, curve, row) for cell in cells]
        middle = np.array([each.mean for each in found])
        low = np.array([each.low for each in found])
        high = np.array([each.high for each in found])
        axes.errorbar(
            at,
            middle,
            yerr=np.nan_to_num([middle - low, high - middle]),
            color=look.color,
            linestyle=look.line,
            linewidth=0.9,
            elinewidth=0.7,
            capsize=1.4,
            capthick=0.7,
            zorder=3,
            **look._replace(filled=curve.filled).marker_kwargs(3.2),
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


def _legend(figure: Figure, architectures: Sequence[str]) -> None:
    handles = [optimizer_style(name).legend_handle() for name in architectures]
    plain = {"color": BLACK, "linestyle": "none", "marker": "o", "markersize": 4.0}
    handles += [
        Line2D([], [], label="filled: attitude, rotation, all", **plain),
        Line2D([], [], label="hollow: position, translation", markerfacecolor="none", **plain),
        Line2D([], [], color=GRAY, linewidth=0.8, label="consistent filter (ANEES 1)"),
    ]
    wide = figure.get_size_inches()[0] > 6.0
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=3 if wide else 2,
        bbox_to_anchor=(0.5, 0.06 / figure.get_size_inches()[1]),
        borderaxespad=0.0,
        handlelength=2.8,
    )
