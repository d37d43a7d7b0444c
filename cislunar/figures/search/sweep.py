"""A sweep over a key of a scenario: what the architectures reach, and how they track."""

from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cislunar.campaign.tracking.sweep_table import plotted_values
from cislunar.figures.axes import (
    Array,
    Grid,
    fixed_ticks,
    legend_below,
    panel_title,
    reach,
    set_vertical,
    spaced,
    whole_numbers,
    widened,
)
from cislunar.figures.panels import COUNT, PERCENT, draw_means
from cislunar.figures.style import (
    PAGE_WIDTH_IN,
    estimator_style,
    house_style,
    new_figure,
    optimizer_style,
)

_LEFT, _RIGHT, _GAP = 0.48, 0.12, 0.46
_ROW_IN, _BETWEEN_IN = 1.25, 0.86
_HEAD, _FOOT, _LINE_IN = 0.58, 0.84, 0.14
_COLUMNS = 4
_LOGARITHMIC_FROM = 10.0
"""Ratio of the largest value to the smallest from which the values' axis is logarithmic."""


class Quantity(NamedTuple):
    """A panel: a quantity of the table, what it is called, and its axis."""

    name: str
    title: str
    part: str = ""
    unit: str = ""
    factor: float = 1.0
    log: bool = False
    within: tuple[float, float] = (-np.inf, np.inf)


ARCHITECTURE = (
    Quantity("J", "J, dimensionless", log=True),
    Quantity("satellites", "satellites", within=COUNT),
    Quantity("union_coverage", "share of target-hours\nseen, %", factor=100.0, within=PERCENT),
    Quantity("static_never_seen", "static targets\nnever seen", within=COUNT),
)
TRACKING = (
    Quantity("coverage", "attitude within\n3\N{GREEK SMALL LETTER SIGMA}, % of time", "attitude",
             factor=100.0, within=PERCENT),
    Quantity("final_attitude_error_median", "final attitude error,\nmedian, degree", log=True),
    Quantity("final_error_geometric_all", "final position error,\nall targets, km", "position",
             "km", log=True),
    Quantity("never_observed", "moving targets\nnever observed", within=COUNT),
)  # fmt: skip
ORBITS = (
    Quantity("coverage", "position within\n3\N{GREEK SMALL LETTER SIGMA}, % of time", "position",
             factor=100.0, within=PERCENT),
    Quantity("anees_mean", "ANEES of position,\nmean", "position", log=True),
    Quantity("rmse_median", "velocity RMSE,\nmedian, m/s", "velocity", "m s-1", log=True),
    Quantity("inconsistent_translation", "targets with\ninconsistent orbit", within=COUNT),
)  # fmt: skip


class _Values(NamedTuple):
    """The horizontal axis: names of the values, their places, and whether it is logarithmic.

    Values that are no numbers have one in their order, and their names stand below the panels.
    """

    names: list[str]
    places: Array
    log: bool
    numeric: bool


def _axis_of(table: pd.DataFrame) -> _Values:
    names, numbers = plotted_values(table)
    if numbers is None:
        return _Values(names, np.arange(1.0, len(names) + 1.0), False, False)
    positive = numbers.min() > 0.0
    return _Values(
        names, numbers, positive and numbers.max() / numbers.min() >= _LOGARITHMIC_FROM, True
    )


@house_style()
def sweep_figure(table: pd.DataFrame) -> Figure:
    """What the architectures of ``tables/sweep_{name}.csv`` reach and where they differ.

    Then two rows of panels for each target count, the second of the orbits alone.
    """
    values = _axis_of(table)
    counts = sorted(table["targets"].dropna().unique())
    rows = [("the architecture", ARCHITECTURE, table[table["targets"].isna()])]
    for n in counts:
        own, heading = table[table["targets"] == n], f"$n_T$ = {int(n)} moving targets"
        rows += [(f"tracking of {heading}", TRACKING, own), (f"orbits of {heading}", ORBITS, own)]
    rows = [row for row in rows if not row[2].empty]
    foot = _FOOT + (0.0 if values.numeric else _LINE_IN * len(values.names))
    width_in = (PAGE_WIDTH_IN - _LEFT - _RIGHT - (_COLUMNS - 1) * _GAP) / _COLUMNS
    grid = Grid(len(rows), _COLUMNS, width_in, _ROW_IN, _LEFT, foot, _GAP, _BETWEEN_IN)
    figure = new_figure(_HEAD + grid.size[1] + foot)
    for number, (heading, quantities, own) in enumerate(rows):
        for column, quantity in enumerate(quantities):
            axes = grid.place(figure, number, column)
            _draw(axes, own, quantity, values)
            panel_title(axes, number * _COLUMNS + column, quantity.title, pad=4, fontsize=7.0)
            _value_axis(axes, values)
        top = (grid.corner(number, 0)[1] + _ROW_IN + 0.35) / figure.get_size_inches()[1]
        figure.text(_LEFT / PAGE_WIDTH_IN, top, heading, va="bottom")
    _below(figure, table, values)
    return figure


def _draw(axes: Axes, table: pd.DataFrame, quantity: Quantity, values: _Values) -> None:
    """A quantity against the values, for every estimator; the architecture's own has none."""
    chosen = table[table["quantity"] == quantity.name]
    if quantity.part:
        chosen = chosen[chosen["part"] == quantity.part]
    if quantity.unit:
        chosen = chosen[chosen["unit"] == quantity.unit]
    held = [np.empty(0)]
    groups = chosen.groupby(chosen["estimator"].fillna(""), sort=False)
    for index, (name, own) in enumerate(groups):
        look = estimator_style(name) if name else optimizer_style(str(own["architecture"].iloc[0]))
        if not values.numeric:
            look = look._replace(line="none")
        order = np.argsort(values.places, kind="stable")
        ordered = own.set_index(own["value"].astype(str)).reindex(np.array(values.names)[order])
        mean, low, high, smallest, largest = (
            quantity.factor * ordered[key].to_numpy(float)
            for key in ("mean", "low", "high", "smallest", "largest")
        )
        at = _beside(values, index - 0.5 * (len(groups) - 1))[order]
        draw_means(axes, at, (mean, low, high), look, quantity.within)
        # an interval of few seeds may leave the panel
        held += [mean, np.fmax(low, smallest), np.fmin(high, largest)]
    limits = reach(np.concatenate(held), log=quantity.log)
    if quantity.within == COUNT:
        set_vertical(axes, widened(*limits), log=False)
        whole_numbers(axes.yaxis)
    else:
        set_vertical(axes, limits, log=quantity.log)
        if not quantity.log:
            axes.yaxis.set_major_locator(MaxNLocator(4, min_n_ticks=1))


def _beside(values: _Values, number: float) -> Array:
    """Places moved a little, so that the intervals of one estimator do not hide another's."""
    low, high = values.places.min(), values.places.max()
    if values.log:
        return values.places * (high / low) ** (0.016 * number)
    return values.places + 0.016 * number * (high - low)


def _value_axis(axes: Axes, values: _Values) -> None:
    """The swept values."""
    if values.log:
        axes.set_xscale("log")
    axes.set_xlim(*reach(values.places, log=values.log, share=0.07 if values.log else 0.08))
    fixed_ticks(axes.xaxis, spaced(values.places, 0.2) if values.log else np.unique(values.places))
    axes.tick_params(axis="x", which="minor", bottom=False)


def _below(figure: Figure, table: pd.DataFrame, values: _Values) -> None:
    """What is swept, values that are no numbers, who observes, and the estimators."""
    height = figure.get_size_inches()[1]
    estimators = list(dict.fromkeys(table["estimator"].dropna()))
    architecture = str(table["architecture"].iloc[0])
    lines = [str(table["label"].iloc[0])]
    if not values.numeric:
        lines += [
            f"{place:g}: {name}" for place, name in zip(values.places, values.names, strict=True)
        ]
    text = "\n".join(lines)
    figure.text(0.5, 0.36 / height, text, ha="center", va="bottom", fontsize=8.0)
    handles = [estimator_style(name).legend_handle() for name in estimators]
    if table["targets"].isna().any():
        handles.insert(0, optimizer_style(architecture).legend_handle())
    legend_below(figure, handles, 0.1, handlelength=2.8)
