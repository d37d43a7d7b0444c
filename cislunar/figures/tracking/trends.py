"""Statistics of tracking against the number of targets and the tasking interval.

There is a column for each scenario (and number of targets) and a row for each statistic over the
targets. Either the architectures or both estimators are compared.
"""

from collections.abc import Callable, Mapping, Sequence
from textwrap import fill
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator
from scipy.stats import chi2

from cislunar.campaign.tracking import cells_of, select, values_of
from cislunar.campaign.tracking import realizations as table
from cislunar.evaluation.intervals import interval_of, log_interval
from cislunar.figures import axes as layout
from cislunar.figures import panels, style
from cislunar.figures.axes import Array, Grid
from cislunar.figures.labels import PARTS, architecture_label
from cislunar.figures.panels import COUNT, PERCENT, Row

_LEFT, _RIGHT, _GAP = 0.92, 0.12, 0.14
_ROW_IN, _BETWEEN_IN, _COLUMN_IN = 0.96, 0.14, 1.98
_HEAD = 0.3
_NOTE_LETTERS = 46
"""Letters in a line under a title."""
_BAND = {"color": style.GRAY, "alpha": 0.35, "linewidth": 0, "zorder": 1}


class Curve(NamedTuple):
    """A quantity of ``task2/summary.nc``, for a `part` of the state where it has parts.

    Markers are `filled`, or hollow where a panel has two quantities. `only` is the only series for
    which it is drawn (None: all), `series` a style in place of that of the series.
    """

    quantity: str
    part: str | None = None
    filled: bool = True
    only: str | None = None
    series: style.SeriesStyle | None = None


class _Column(NamedTuple):
    """A column of panels: title, realizations by series, observers."""

    title: str
    cells: dict[str, pd.DataFrame]
    note: str


BOUND_STYLE = style.SeriesStyle("Cramér-Rao bound", style.BLACK, style.DOTTED, "x", filled=False)


def _bound(quantity: str) -> Curve:
    """The bound, which is drawn once, since both estimators have about the same measurements."""
    return Curve(quantity, only="batch", series=BOUND_STYLE)


EFFICIENT = float(np.sqrt(chi2.median(1))), float(np.sqrt(chi2.median(3) / 3.0))
"""Median error of an efficient estimator, relative to the bound of the root mean square error.

They are those of the length of a Gaussian vector in three dimensions with all variance in one
direction, and with the same variance in all. Both hold for errors that last over the final hours;
the ratio is closer to 1 for errors that change faster.
"""

ROWS = {
    "architecture": (
        Row("within 3\N{GREEK SMALL LETTER SIGMA},\n% of time",
            (Curve("coverage", "attitude"), Curve("coverage", "position", False)), factor=100.0,
            within=PERCENT),
        Row("ANEES, median,\ndimensionless",
            (Curve("anees_median", "attitude"), Curve("anees_median", "position", False)),
            log=True, reference=1.0),
        Row("attitude RMSE,\nmedian, deg", (Curve("rmse_median", "attitude"),), log=True,
            factor=PARTS[0].factor),
        Row("position RMSE,\nmedian, km", (Curve("rmse_median", "position", False),), log=True,
            factor=PARTS[2].factor),
        Row("final attitude\nerror, median, deg", (Curve("final_attitude_error_median"),),
            log=True),
        Row("in custody,\n% of all targets", (Curve("custody_share"),), factor=100.0,
            within=PERCENT),
        Row("never observed,\ntargets", (Curve("never_observed"),), within=COUNT),
        Row("inconsistent, % of\nobserved targets",
            (Curve("inconsistent_rotation_share"),
             Curve("inconsistent_translation_share", None, False)),
            factor=100.0, within=PERCENT),
    ),
    "estimator": (
        Row("attitude within\n3\N{GREEK SMALL LETTER SIGMA}, % of time",
            (Curve("coverage", "attitude"),), factor=100.0, reference=99.7, within=PERCENT),
        Row("final attitude\nerror, median, deg",
            (Curve("final_attitude_error_median"), _bound("bound_attitude_median")), log=True),
        Row("final attitude\nerror, 90th\npercentile, deg",
            (Curve("final_attitude_error_90"), _bound("bound_attitude_90")), log=True),
        Row("error to bound,\nmedian ratio", (Curve("bound_ratio_median", "attitude"),),
            log=True, reference=EFFICIENT),
        Row("attitude RMSE,\nmedian, deg", (Curve("rmse_median", "attitude"),),
            factor=PARTS[0].factor, log=True),
        Row("inconsistent\nrotation, targets", (Curve("inconsistent_rotation"),), within=COUNT),
        Row("position RMSE,\nmedian, km", (Curve("rmse_median", "position"),),
            factor=PARTS[2].factor, log=True),
    ),
}  # fmt: skip
"""The rows of panels, by what is compared."""


def _column(
    frame: pd.DataFrame, by: str, title: str, scenario: str, along: str, least: int, **chosen: int
) -> _Column:
    """Cells with the usual settings of every series with at least `least` values of a label."""
    if by == "architecture":
        common = {"estimator": frame["estimator"].iloc[0]}
        series = frame[by].unique()
    else:
        here = frame["scenario"] == scenario
        common = {"architecture": frame.loc[here, "architecture"].iloc[0]}
        series = [name for name in frame[by].unique() if name in style.ESTIMATOR_STYLE]
    own = select(frame, scenario=scenario, variant="", **common, **chosen)
    found = {name: select(own, **{by: name}) for name in series}
    found = {name: cells for name, cells in found.items() if cells[along].nunique() >= least}
    if by == "estimator":
        return _Column(title, found, f"observers: {architecture_label(common['architecture'])}")
    named = {name: architecture_label(name) for name in found}
    counts = [
        f"{named[name]} {cells['observers'].iloc[0]}"
        for name, cells in found.items()
        if not named[name].endswith(" satellites")
    ]
    return _Column(title, found, fill(f"observers: {', '.join(counts)}", _NOTE_LETTERS))


@style.house_style()
def against_targets_figure(summary: xr.Dataset, by: str = "architecture") -> Figure:
    """Draw statistics of ``task2/summary.nc`` against the number of targets, by scenario.

    `by` is what is compared: ``architecture``, with the first estimator; or ``estimator``, with the
    Cramer-Rao bound and the first architecture of each scenario.
    """
    frame = table.realizations(summary)
    usual = table.usual_interval(frame)
    columns = [
        _column(frame, by, f"scenario {name}", name, "targets", 1, interval_minutes=usual)
        for name in frame["scenario"].unique()
    ]
    return _figure(by, columns, lambda cells: 1.0 * cells["targets"], "number of targets")


@style.house_style()
def against_interval_figure(summary: xr.Dataset, by: str = "architecture") -> Figure:
    """Draw statistics against the tasking interval, by scenario and number of targets.

    `summary` and `by` are those of `against_targets_figure`.
    """
    frame = table.realizations(summary)
    columns = []
    for scenario, targets in sorted(set(zip(frame["scenario"], frame["targets"], strict=True))):
        title = f"scenario {scenario}, {targets} targets"
        chosen = {"targets": targets}
        columns.append(_column(frame, by, title, scenario, "interval_minutes", 2, **chosen))
    minutes = [each for column in columns for cells in column.cells.values()
               for each in cells["interval_minutes"]]  # fmt: skip
    unit, length = ("h", 60.0) if all(each % 30 == 0 for each in minutes) else ("min", 1.0)
    label = f"tasking interval, {unit}"
    return _figure(by, columns, lambda cells: cells["interval_minutes"] / length, label)


def _figure(
    by: str, columns: Sequence[_Column], x_of: Callable[[pd.DataFrame], pd.Series], x_label: str
) -> Figure:
    """Draw all rows and columns, with a legend; `x_of` gives the horizontal places of cells."""
    columns = [column for column in columns if column.cells]
    names = dict.fromkeys(name for column in columns for name in column.cells)
    style_of = style.optimizer_style if by == "architecture" else style.estimator_style
    styles = style.distinct({name: style_of(name)._replace(filled=True) for name in names})
    rows = ROWS[by]
    abreast = max(1, min(len(columns), 3))
    foot = 0.74 + 0.15 * -(-(len(styles) + 3) // abreast) + 0.11 * (abreast < 3)
    noted = 1 + max((column.note.count("\n") for column in columns), default=0)
    panel = _COLUMN_IN, _ROW_IN, _LEFT, foot, _GAP, _BETWEEN_IN
    grid = Grid(len(rows), max(len(columns), 1), *panel)
    width, height = grid.size
    figure = style.new_figure(_HEAD + 0.1 * noted + height + foot, _LEFT + width + _RIGHT)

    def draw(axes: Axes, row: Row, number: int) -> Array:
        cells = columns[number].cells
        x = {name: x_of(cells_of(own)).to_numpy() for name, own in cells.items()}
        shown_values = []
        for index, (name, series) in enumerate(styles.items()):
            if name in cells:
                at = x[name] * 1.018 ** (index - 0.5 * (len(styles) - 1))
                shown_values += _draw(axes, cells[name], at, row, name, series)
        if isinstance(row.reference, tuple):
            axes.axhspan(*row.reference, **_BAND)
        elif row.reference is not None:
            axes.axhline(row.reference, color=style.GRAY, linewidth=0.8, zorder=1)
        _x_axis(axes, np.concatenate(list(x.values())))
        return np.concatenate([np.empty(0), *shown_values])

    titles = [column.title for column in columns]
    drawn = panels.draw_rows(figure, grid, rows, titles, draw, pad=5 + 7 * noted)
    for axes, column in zip(drawn[0], columns, strict=True):
        axes.annotate(column.note, (0.0, 1.0), xytext=(0, 4), fontsize=5.6, linespacing=1.1,
                      xycoords="axes fraction", textcoords="offset points")  # fmt: skip
    for first, *_ in drawn:
        first.yaxis.set_label_coords(-0.5 / _COLUMN_IN, 0.5)
    for axes in drawn[-1]:
        axes.set_xlabel(x_label)
    _legend(figure, by, styles, _counts(columns), abreast)
    return figure


def _counts(columns: Sequence[_Column]) -> list[int]:
    """Numbers of realizations of all cells that are drawn."""
    return [
        int(np.isfinite(values_of(own, "custody_share")).sum(axis=0).max())
        for column in columns
        for own in column.cells.values()
    ]


def _draw(
    axes: Axes, cells: pd.DataFrame, at: Array, row: Row, name: str, series: style.SeriesStyle
) -> list[Array]:
    """Draw one series; the values drawn are returned."""
    shown_values = []
    targets = cells_of(cells)["targets"]
    for curve in row.curves:
        if curve.only not in (None, name):
            continue
        single = values_of(cells, curve.quantity, curve.part).T
        # a large ANEES of a single realization is to show
        geometric = row.log and not curve.quantity.startswith("anees")
        intervals = [
            log_interval(values) if geometric else interval_of(curve.quantity, values, count)
            for values, count in zip(single, targets, strict=True)
        ]
        found = panels.estimates(single, intervals).scaled(row.factor)
        own = curve.series or series._replace(filled=curve.filled)
        shown_values.append(panels.draw_estimates(axes, at, found, own, row.within, zorder=3))
    return shown_values


def _x_axis(axes: Axes, values: Array) -> None:
    """Set a logarithmic axis with ticks at the values of the sweep."""
    axes.set_xscale("log")
    least = 1.05 if np.ptp(values) else 1.4
    axes.set_xlim(*layout.reach(values, log=True, share=0.06, least=least))
    layout.fixed_ticks(axes.xaxis, layout.spaced(values))
    axes.xaxis.set_minor_locator(FixedLocator(np.unique(values)))


def _legend(figure: Figure, by: str, styles: Mapping, counts: Sequence[int], abreast: int) -> None:
    """Draw the legend, with entries `abreast`, and a note on the realizations."""
    handles = [series.legend_handle() for series in styles.values()]
    means = "on logarithmic axes"
    if by == "estimator":
        handles.append(BOUND_STYLE.legend_handle())
        handles.append(Patch(label="median expected of an estimator at the bound", **_BAND))
        label = "99.7 % (Gaussian errors)"
        handles.append(Line2D([], [], color=style.GRAY, linewidth=0.8, label=label))
    else:
        plain = {"color": style.BLACK, "linestyle": "none", "marker": "o", "markersize": 4.0}
        hollow = plain | {"markerfacecolor": "none"}
        handles += [
            Line2D([], [], label="filled marker: attitude, rotation", **plain),
            Line2D([], [], label="hollow marker: position, translation", **hollow),
            Line2D([], [], color=style.GRAY, linewidth=0.8, label="consistent estimator (ANEES 1)"),
        ]
        means += ", except for ANEES"
    top = layout.note_below(figure, panels.realizations_note(counts, geometric=means))
    layout.legend_below(figure, handles, top, abreast, handlelength=2.8, columnspacing=1.4)
