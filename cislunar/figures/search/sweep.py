"""A sweep over a key of a scenario: what the architectures reach, and how well they track."""

from collections.abc import Iterator
from textwrap import fill
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cislunar.campaign.tracking.sweep_table import plotted_values
from cislunar.figures import axes as layout
from cislunar.figures import panels, style
from cislunar.figures.axes import Array, Grid
from cislunar.figures.labels import plain, value_label
from cislunar.figures.panels import COUNT, PERCENT, Row

_LEFT, _RIGHT, _GAP = 0.48, 0.12, 0.46
_ROW_IN, _BETWEEN_IN = 1.25, 0.86
_HEAD, _FOOT = 0.58, 0.9
_COLUMNS = 4
_NAMES_GAP, _NAME_LETTER_IN, _WIDEST_NAME, _NAME_SIZE = 0.16, 0.051, 33, 6.5
_NAME_IN, _LINE_IN = 0.08, 0.12
"""Room between the names of values, and height of a line of a name."""
_LOGARITHMIC_FROM = 10.0
"""Ratio of the largest value to the smallest from which the axis of values is logarithmic."""


SIGMA = "3\N{GREEK SMALL LETTER SIGMA}, % of time"
ARCHITECTURE = (
    Row("figure of merit J,\ndimensionless", ("J", "", ""), log=True),
    Row("number of\nsatellites", ("satellites", "", ""), within=COUNT),
    Row("target-hours\nvisible, %", ("union_coverage", "", ""), 100.0, within=PERCENT),
    Row("static targets\nnever visible", ("static_never_seen", "", ""), within=COUNT),
)
TRACKING = (
    Row(f"attitude within\n{SIGMA}", ("coverage", "attitude", ""), 100.0, within=PERCENT),
    Row("final attitude error,\nmedian, deg", ("final_attitude_error_median", "", ""), log=True),
    Row("final position error,\nall targets, km", ("final_error_geometric_all", "position", "km"),
        log=True),
    Row("moving targets\nnever observed", ("never_observed", "", ""), within=COUNT),
)  # fmt: skip
ORBITS = (
    Row(f"position within\n{SIGMA}", ("coverage", "position", ""), 100.0, within=PERCENT),
    Row("ANEES of position,\nmean, dimensionless", ("anees_mean", "position", ""), log=True),
    Row("velocity RMSE,\nmedian, m/s", ("rmse_median", "velocity", "m s-1"), log=True),
    Row("targets with\ninconsistent orbit", ("inconsistent_translation", "", ""), within=COUNT),
)


class _Values(NamedTuple):
    """The swept values: names, labels, places on their axis, whether it is logarithmic.

    A sweep is `numeric` if its values are numbers and more than one; they lie along the horizontal
    axis. Other values have labels in words along the vertical axis.
    """

    names: list[str]
    labels: list[str]
    places: Array
    log: bool
    numeric: bool


def _values_of(table: pd.DataFrame) -> _Values:
    names, numbers = plotted_values(table)
    if numbers is None or len(names) == 1:
        # a value of several keys is a scenario named after the one that it changes
        scenarios = set(table["scenario"]) if "scenario" in table else set()
        own = [name.split("-", 1)[-1] if name in scenarios else name for name in names]
        labels = [fill(plain(value_label(name)), _WIDEST_NAME) for name in own]
        return _Values(names, labels, np.arange(float(len(names))), False, False)
    log = numbers.min() > 0.0 and numbers.max() / numbers.min() >= _LOGARITHMIC_FROM
    return _Values(names, names, numbers, bool(log), True)


@style.house_style()
def sweep_figure(table: pd.DataFrame) -> Figure:
    """Draw what the architectures of ``tables/sweep_{name}.csv`` reach, where the values differ.

    Two rows of panels follow for each number of targets, the second of orbits only. Quantities
    without values have no panel.
    """
    values = _values_of(table)
    known = table[table["mean"].notna()]
    groups = [("architecture", ARCHITECTURE, known[known["targets"].isna()])]
    for n, own in known.groupby("targets"):
        groups.append((f"tracking of {int(n)} targets", TRACKING, own))
        groups.append((f"orbits of {int(n)} targets", ORBITS, own))
    rows = [
        (heading, drawn)
        for heading, quantities, own in groups
        if (
            drawn := [(each, rows) for each in quantities if len(rows := panels.rows_of(own, each))]
        )
    ]
    columns = max((len(drawn) for _, drawn in rows), default=_COLUMNS)
    grid = _grid(values, len(rows), columns)
    figure = style.new_figure(_HEAD + grid.size[1] + _FOOT)
    number = 0
    for row, (heading, drawn) in enumerate(rows):
        for column, (quantity, own) in enumerate(drawn):
            axes = grid.place(figure, row, column)
            draw = _against_values if values.numeric else _by_name
            draw(axes, own, quantity, values)
            axes.tick_params(labelleft=values.numeric or column == 0)
            layout.panel_title(axes, number, quantity.label, pad=4, fontsize=7.0)
            number += 1
        top = (grid.corner(row, 0)[1] + grid.height + 0.35) / figure.get_size_inches()[1]
        figure.text(grid.left / style.PAGE_WIDTH_IN, top, heading, va="bottom")
    _below(figure, table, values)
    return figure


def _grid(values: _Values, rows: int, columns: int) -> Grid:
    """Panels; with names, as high as these need, and with room for them at the left."""
    left, gap, height = _LEFT, _GAP, _ROW_IN
    if not values.numeric:
        lines = [label.split("\n") for label in values.labels]
        left = 0.2 + _NAME_LETTER_IN * max(len(line) for each in lines for line in each)
        each = max(0.18, _NAME_IN + _LINE_IN * max(map(len, lines)))
        gap, height = _NAMES_GAP, max(0.5, each * len(lines))
    width = (style.PAGE_WIDTH_IN - left - _RIGHT - (columns - 1) * gap) / columns
    return Grid(rows, columns, width, height, left, _FOOT, gap, _BETWEEN_IN)


def _series(
    table: pd.DataFrame, quantity: Row, values: _Values
) -> Iterator[tuple[style.SeriesStyle, panels.PlottedValues, float]]:
    """Style, estimates by value, and offset of every estimator, or of the architecture itself."""
    groups = table.groupby(table["estimator"].fillna(""), sort=False)
    for index, (name, own) in enumerate(groups):
        series = style.estimator_style(name) if name else style.optimizer_style(_architecture(own))
        ordered = own.set_index(own["value"].astype(str)).reindex(values.names)
        found = panels.table_estimates(ordered).scaled(quantity.factor)
        yield series, found, index - 0.5 * (len(groups) - 1)


def _architecture(table: pd.DataFrame) -> str:
    return str(table["architecture"].iloc[0]) if "architecture" in table else ""


def _against_values(axes: Axes, table: pd.DataFrame, quantity: Row, values: _Values) -> None:
    """Draw a quantity against values that are numbers."""
    shown_values = []
    order = np.argsort(values.places, kind="stable")
    span = np.log(values.places) if values.log else values.places
    for series, found, offset in _series(table, quantity, values):
        aside = span + 0.016 * offset * np.ptp(span)
        at = (np.exp(aside) if values.log else aside)[order]
        sorted_found = panels.PlottedValues(*(each[order] for each in found))
        shown_values.append(panels.draw_estimates(axes, at, sorted_found, series, quantity.within))
    panels.set_values(axes, "y", shown_values, quantity, 4)
    if values.log:
        axes.set_xscale("log")
    axes.set_xlim(*layout.reach(values.places, log=values.log, share=0.07 if values.log else 0.08))
    ticks = layout.spaced(values.places, 0.2) if values.log else np.unique(values.places)
    layout.fixed_ticks(axes.xaxis, ticks)
    axes.tick_params(axis="x", which="minor", bottom=False)


def _by_name(axes: Axes, table: pd.DataFrame, quantity: Row, values: _Values) -> None:
    """Draw a quantity of values with names, which lie along the vertical axis.

    The number stands beside the marker of a single value.
    """
    shown_values = []
    for series, found, offset in _series(table, quantity, values):
        at, points = values.places + 0.2 * offset, series._replace(line="none")
        shown_values.append(
            panels.draw_estimates(axes, at, found, points, quantity.within, horizontal=True)
        )
        if len(at) == 1 and np.isfinite(found.mean[0]):
            mean = found.mean[0]
            text = f"{mean:.3g}" if abs(mean) >= 1e-3 else layout.tick_names(found.mean[:1])[0]
            above = {"ha": "center", "fontsize": 6, "textcoords": "offset points"}
            axes.annotate(text, (mean, at[0]), xytext=(0, 4), **above)
    panels.set_values(axes, "x", shown_values, quantity, 3)
    axes.set_yticks(values.places, values.labels, fontsize=_NAME_SIZE)
    axes.set_ylim(len(values.places) - 0.45, -0.55)


def _below(figure: Figure, table: pd.DataFrame, values: _Values) -> None:
    """Write what is swept, who observes and what is drawn."""
    handles = [style.estimator_style(name).legend_handle(line=values.numeric)
               for name in dict.fromkeys(table["estimator"].dropna())]  # fmt: skip
    if table["targets"].isna().any():
        series = style.optimizer_style(_architecture(table))
        label = f"architecture: {series.label}"
        handles.insert(0, series.legend_handle(label, line=values.numeric))
    top = layout.note_below(figure, panels.table_note(table))
    layout.legend_below(figure, handles, top, handlelength=2.8)
    label = str(table["label"].iloc[0])
    kind = "horizontal" if values.numeric else "vertical"
    text = f"{kind} axes: {label}" + (", one value only" if len(values.names) == 1 else "")
    at = (0.5, (top + 0.24) / figure.get_size_inches()[1])
    figure.text(*at, text, ha="center", va="bottom", fontsize=8.0)
