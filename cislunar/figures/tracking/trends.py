"""Statistics of tracking against the number of targets and the tasking interval.

A column for each scenario (and number of targets), a row for each statistic over the targets, with
confidence intervals over the seeds; compared are either the architectures or both estimators.
"""

from collections.abc import Callable, Mapping, Sequence
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

from cislunar.campaign.tracking.realizations import (
    PRACTICAL_UNITS,
    cells_of,
    realizations,
    select,
    usual_interval,
    values_of,
)
from cislunar.campaign.tracking.statistics import interval_of, log_interval
from cislunar.figures.axes import Array, Grid, fixed_ticks, legend_below, log_ticks, reach, spaced
from cislunar.figures.panels import COUNT, PERCENT, Row, draw_means, draw_rows
from cislunar.figures.style import (
    BLACK,
    DOTTED,
    ESTIMATOR_STYLE,
    GRAY,
    SeriesStyle,
    house_style,
    new_figure,
    optimizer_style,
)

_LEFT, _RIGHT, _GAP = 1.0, 0.76, 0.14
_ROW_IN, _BETWEEN_IN, _COLUMN_IN = 1.02, 0.16, 1.78
_HEAD, _FOOT = 0.48, 1.02
_BAND = {"color": GRAY, "alpha": 0.35, "linewidth": 0, "zorder": 1}


class Curve(NamedTuple):
    """A quantity of ``task2/summary.nc``, for a `part` of the state where it has them.

    Markers are `filled`, or hollow where a panel has two quantities. `only` is the one series it is
    drawn for (None: all), `style` its own look instead of the series'.
    """

    quantity: str
    part: str | None = None
    filled: bool = True
    only: str | None = None
    style: SeriesStyle | None = None


class _Column(NamedTuple):
    """A column of panels: title, realizations by series, small print under the title."""

    title: str
    cells: dict[str, pd.DataFrame]
    note: str


BOUND_STYLE = SeriesStyle("Cramér-Rao bound", BLACK, DOTTED, "x", filled=False)
ESTIMATOR_STYLES = {
    "mukf": ESTIMATOR_STYLE["mukf"]._replace(label="filter of the paper (MUKF)", filled=True),
    "batch": ESTIMATOR_STYLE["batch"]._replace(label="multi-hypothesis batch"),
}


def _bound(quantity: str) -> Curve:
    """The bound, which both estimators share: their measurements are all but the same."""
    return Curve(quantity, only="batch", style=BOUND_STYLE)


EFFICIENT = float(np.sqrt(chi2.median(1))), float(np.sqrt(chi2.median(3) / 3.0))
"""Median error of an efficient estimator over the root mean square error, which the bound is of.

The length of a Gaussian vector in three dimensions: all its variance in one direction, or the same
in all. Both hold for errors that last over the final hours; quicker ones come nearer to 1.
"""

DEGREE, KM = PRACTICAL_UNITS["attitude"][1], PRACTICAL_UNITS["position"][1]

ROWS = {
    "architecture": (
        Row("within 3\N{GREEK SMALL LETTER SIGMA}, % of time",
            (Curve("coverage", "attitude"), Curve("coverage", "position", False)), factor=100.0,
            within=PERCENT),
        Row("median ANEES,\ndimensionless",
            (Curve("anees_median", "attitude"), Curve("anees_median", "position", False)),
            log=True, reference=1.0),
        Row("attitude RMSE,\ndegree", (Curve("rmse_median", "attitude"),), log=True,
            factor=DEGREE, second=("GRP, nondim.", 1.0 / DEGREE)),
        Row("position RMSE,\nkm", (Curve("rmse_median", "position", False),), log=True,
            factor=KM, second=("nondim.", 1.0 / KM)),
        Row("final attitude\nerror, degree", (Curve("final_attitude_error_median"),), log=True),
        Row("in custody, % of\nall targets", (Curve("custody_share"),), factor=100.0,
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
        Row("final attitude error,\nmedian, degree",
            (Curve("final_attitude_error_median"), _bound("bound_attitude_median")), log=True),
        Row("final attitude error,\n90th pct., degree",
            (Curve("final_attitude_error_90"), _bound("bound_attitude_90")), log=True),
        Row("median error over\nbound, dimensionless", (Curve("bound_ratio_median", "attitude"),),
            log=True, reference=EFFICIENT),
        Row("attitude RMSE of the\nrun, median, degree", (Curve("rmse_median", "attitude"),),
            factor=DEGREE, log=True),
        Row("rotation inconsistent,\ntargets", (Curve("inconsistent_rotation"),), within=COUNT),
        Row("position RMSE,\nmedian, km", (Curve("rmse_median", "position", False),),
            factor=KM, log=True),
    ),
}  # fmt: skip
"""What is shown of the series compared."""


def _column(
    frame: pd.DataFrame, by: str, title: str, scenario: str, along: str, least: int, **wanted: int
) -> _Column:
    """Cells with the usual settings, for every series with at least so many values of a label."""
    if by == "architecture":
        common = {"estimator": frame["estimator"].iloc[0]}
        series = frame[by].unique()
    else:
        here = frame["scenario"] == scenario
        common = {"architecture": frame.loc[here, "architecture"].iloc[0]}
        series = [name for name in frame[by].unique() if name in ESTIMATOR_STYLES]
    own = select(frame, scenario=scenario, variant="", **common, **wanted)
    found = {name: select(own, **{by: name}) for name in series}
    found = {name: cells for name, cells in found.items() if cells[along].nunique() >= least}
    counts = [
        f"{optimizer_style(name).label.split()[0]} {cells['observers'].iloc[0]}"
        for name, cells in found.items()
    ]
    seen = ", ".join(counts) if by == "architecture" else common["architecture"]
    return _Column(title, found, f"observers: {seen}")


@house_style()
def against_targets_figure(summary: xr.Dataset, by: str = "architecture") -> Figure:
    """Every statistic of ``task2/summary.nc`` against the number of targets, a column per scenario.

    `by` is what is compared: ``architecture``, with the first estimator, or ``estimator``, both
    beside the Cramer-Rao bound with each scenario's first architecture.
    """
    frame = realizations(summary)
    usual = usual_interval(frame)
    columns = [
        _column(frame, by, f"scenario {name}", name, "targets", 1, interval_minutes=usual)
        for name in frame["scenario"].unique()
    ]
    return _figure(by, columns, lambda cells: 1.0 * cells["targets"], "number of targets $n_T$")


@house_style()
def against_interval_figure(summary: xr.Dataset, by: str = "architecture") -> Figure:
    """Every statistic against the tasking interval, a column by scenario and target count.

    `summary` and `by` as for `against_targets_figure`.
    """
    frame = realizations(summary)
    columns = []
    for scenario, targets in sorted(set(zip(frame["scenario"], frame["targets"], strict=True))):
        title = f"scenario {scenario}, $n_T$ = {targets}"
        wanted = {"targets": targets}
        columns.append(_column(frame, by, title, scenario, "interval_minutes", 2, **wanted))
    minutes = [each for column in columns for cells in column.cells.values()
               for each in cells["interval_minutes"]]  # fmt: skip
    unit, length = ("h", 60.0) if all(each % 30 == 0 for each in minutes) else ("min", 1.0)
    label = f"tasking interval $T_{{ST}}$, {unit}"
    return _figure(by, columns, lambda cells: cells["interval_minutes"] / length, label)


def _figure(
    by: str, columns: Sequence[_Column], x_of: Callable[[pd.DataFrame], pd.Series], x_label: str
) -> Figure:
    """All rows by all columns, with legend; `x_of` gives the places of cells."""
    columns = [column for column in columns if column.cells]
    names = dict.fromkeys(name for column in columns for name in column.cells)
    if by == "architecture":
        styles = {name: optimizer_style(name) for name in names}
    else:
        styles = {name: ESTIMATOR_STYLES[name] for name in names}
    rows = ROWS[by]
    # A narrow figure has its legend in one column.
    foot = _FOOT + (0.36 if by == "estimator" and len(columns) < 2 else 0.0)
    grid = Grid(
        len(rows), max(len(columns), 1), _COLUMN_IN, _ROW_IN, _LEFT, foot, _GAP, _BETWEEN_IN
    )
    width, height = grid.size
    figure = new_figure(_HEAD + height + foot, _LEFT + width + _RIGHT)

    def draw(axes: Axes, row: Row, number: int) -> Array:
        cells = columns[number].cells
        x = {name: x_of(cells_of(own)).to_numpy() for name, own in cells.items()}
        held = []
        for index, (name, look) in enumerate(styles.items()):
            if name in cells:
                at = x[name] * 1.018 ** (index - 0.5 * (len(styles) - 1))
                held += _draw(axes, cells[name], at, row, name, look)
        if isinstance(row.reference, tuple):
            axes.axhspan(*row.reference, **_BAND)
        elif row.reference is not None:
            axes.axhline(row.reference, color=GRAY, linewidth=0.8, zorder=1)
        _x_axis(axes, np.concatenate(list(x.values())))
        return np.array(held)

    titles = [column.title for column in columns]
    panels = draw_rows(figure, grid, rows, titles, draw, pad=14)
    for axes, column in zip(panels[0], columns, strict=True):
        axes.annotate(column.note, (0.0, 1.0), xytext=(0, 4), fontsize=5.6,
                      xycoords="axes fraction", textcoords="offset points")  # fmt: skip
    for row, drawn in zip(rows, panels, strict=True):
        for axes in drawn[:1]:
            axes.yaxis.set_label_coords(-0.52 / _COLUMN_IN, 0.5)
            if row.second is not None:
                _second_axis(drawn[-1], *row.second)
    for axes in panels[-1]:
        axes.set_xlabel(x_label)
    _legend(figure, by, styles)
    return figure


def _draw(
    axes: Axes,
    cells: pd.DataFrame,
    at: Array,
    row: Row,
    name: str,
    look: SeriesStyle,
) -> list[float]:
    """Means with intervals of one series; what the axis holds of them.

    Ends beyond all single values, as those of few seeds are, do not count.
    """
    held = []
    targets = cells_of(cells)["targets"]
    for curve in row.curves:
        if curve.only not in (None, name):
            continue
        single = values_of(cells, curve.quantity, curve.part).T
        found = [
            log_interval(values) if row.log else interval_of(curve.quantity, values, count)
            for values, count in zip(single, targets, strict=True)
        ]
        bounds = tuple(row.factor * np.array([each[k] for each in found]) for k in range(3))
        own = curve.style or look._replace(filled=curve.filled)
        draw_means(axes, at, bounds, own, row.within, zorder=3)
        for (mean, *ends, _), values in zip(found, single, strict=True):
            counted = values[np.isfinite(values) & ((values > 0.0) | (not row.log))]
            if counted.size:
                ends = np.clip(ends, counted.min(), counted.max())
                held += [row.factor * each for each in (mean, *ends)]
    return held


def _second_axis(axes: Axes, label: str, factor: float) -> None:
    """The same values in the paper's unit, on the right."""
    other = axes.secondary_yaxis("right", functions=(lambda v: factor * v, lambda v: v / factor))
    low, high = axes.get_ylim()
    log_ticks(other.yaxis, factor * low, factor * high)
    other.set_ylabel(label, fontsize=7.5)


def _x_axis(axes: Axes, values: Array) -> None:
    """Logarithmic, ticks at the values of the sweep."""
    axes.set_xscale("log")
    axes.set_xlim(*reach(values, log=True, share=0.06, least=1.05 if np.ptp(values) else 1.4))
    fixed_ticks(axes.xaxis, spaced(values))
    axes.xaxis.set_minor_locator(FixedLocator(np.unique(values)))


def _legend(figure: Figure, by: str, styles: Mapping[str, SeriesStyle]) -> None:
    handles = [style.legend_handle() for style in styles.values()]
    width = figure.get_size_inches()[0]
    if by == "estimator":
        handles.append(BOUND_STYLE.legend_handle())
        handles.append(Patch(label="median expected of an estimator at the bound", **_BAND))
        legend_below(figure, handles, 0.1, 2 if width > 4.5 else 1, handlelength=2.8)
        return
    plain = {"color": BLACK, "linestyle": "none", "marker": "o", "markersize": 4.0}
    handles += [
        Line2D([], [], label="filled: attitude, rotation, all", **plain),
        Line2D([], [], label="hollow: position, translation", markerfacecolor="none", **plain),
        Line2D([], [], color=GRAY, linewidth=0.8, label="consistent filter (ANEES 1)"),
    ]
    narrow = {"fontsize": 5.6, "handlelength": 2.2, "columnspacing": 1.2} if width < 4.5 else {}
    legend_below(figure, handles, 0.06, 3 if width > 6.0 else 2, **{"handlelength": 2.8} | narrow)
