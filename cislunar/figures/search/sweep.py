"""A sweep over a key of a scenario: what the architectures reach, and how they track."""

from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator, NullFormatter

from cislunar.campaign.tracking.sweep_table import plotted_values
from cislunar.figures.axes import log_ticks, place, spaced
from cislunar.figures.space.scene import Array
from cislunar.figures.style import (
    PAGE_WIDTH_IN,
    estimator_style,
    house_style,
    new_figure,
    optimizer_style,
    panel_letter,
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
    whole: bool = False


ARCHITECTURE = (
    Quantity("J", "J, dimensionless", log=True),
    Quantity("satellites", "satellites", whole=True),
    Quantity("union_coverage", "share of target-hours\nseen, %", factor=100.0),
    Quantity("static_never_seen", "static targets\nnever seen", whole=True),
)
TRACKING = (
    Quantity("coverage", "attitude within\n3\N{GREEK SMALL LETTER SIGMA}, % of time", "attitude",
             factor=100.0),
    Quantity("final_attitude_error_median", "final attitude error,\nmedian, degree", log=True),
    Quantity("rmse_median", "position RMSE,\nmedian, km", "position", "km", log=True),
    Quantity("never_observed", "moving targets\nnever observed"),
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
    """What the architectures reach, where they differ, then a row of panels for each target count.

    Parameters
    ----------
    table : DataFrame
        ``tables/sweep_{name}.csv``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    values = _axis_of(table)
    counts = sorted(table["targets"].dropna().unique())
    rows = [("the architecture", ARCHITECTURE, table[table["targets"].isna()])]
    rows += [
        (f"tracking of $n_T$ = {int(n)} moving targets", TRACKING, table[table["targets"] == n])
        for n in counts
    ]
    rows = [row for row in rows if not row[2].empty]
    rows_in = len(rows) * (_ROW_IN + _BETWEEN_IN) - _BETWEEN_IN
    foot = _FOOT + (0.0 if values.numeric else _LINE_IN * len(values.names))
    figure = new_figure(_HEAD + rows_in + foot)
    width_in = (PAGE_WIDTH_IN - _LEFT - _RIGHT - (_COLUMNS - 1) * _GAP) / _COLUMNS
    for number, (heading, quantities, own) in enumerate(rows):
        bottom = foot + rows_in - (number + 1) * _ROW_IN - number * _BETWEEN_IN
        for column, quantity in enumerate(quantities):
            left = _LEFT + column * (width_in + _GAP)
            axes = place(figure, left, bottom, width_in, _ROW_IN)
            _draw(axes, own, quantity, values)
            letter = panel_letter(number * _COLUMNS + column)
            axes.set_title(f"{letter} {quantity.title}", loc="left", pad=4, fontsize=7.0)
            _value_axis(axes, values)
        top = (bottom + _ROW_IN + 0.35) / figure.get_size_inches()[1]
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
    reach = []
    groups = chosen.groupby(chosen["estimator"].fillna(""), sort=False)
    for index, (name, own) in enumerate(groups):
        look = estimator_style(name) if name else optimizer_style(str(own["architecture"].iloc[0]))
        ordered = own.set_index(own["value"].astype(str)).reindex(values.names)
        mean, low, high = (
            quantity.factor * ordered[key].to_numpy(float) for key in ("mean", "low", "high")
        )
        order = np.argsort(values.places, kind="stable")
        axes.errorbar(
            _beside(values, index - 0.5 * (len(groups) - 1))[order],
            mean[order],
            yerr=np.nan_to_num([mean - low, high - mean])[:, order],
            color=look.color,
            linestyle=look.line if values.numeric else "none",
            linewidth=0.9,
            elinewidth=0.7,
            capsize=1.4,
            capthick=0.7,
            **look.marker_kwargs(3.2),
        )
        single = ordered[["smallest", "largest"]].to_numpy(float).T * quantity.factor
        reach += [mean, np.fmax(low, single[0]), np.fmin(high, single[1])]
    _vertical_axis(axes, np.concatenate(reach), quantity)


def _beside(values: _Values, number: float) -> Array:
    """Places moved a little, so that the intervals of one estimator do not hide another's."""
    low, high = values.places.min(), values.places.max()
    if values.log:
        return values.places * (high / low) ** (0.016 * number)
    return values.places + 0.016 * number * (high - low)


def _vertical_axis(axes: Axes, values: Array, quantity: Quantity) -> None:
    """Holds the values; an interval of few seeds may leave it."""
    values = values[np.isfinite(values) & ((values > 0.0) | (not quantity.log))]
    low, high = (values.min(), values.max()) if values.size else (0.1, 1.0)
    if quantity.log:
        margin = max((high / low) ** 0.08, 1.15)
        axes.set_yscale("log")
        axes.set_ylim(low / margin, high * margin)
        log_ticks(axes.yaxis, low / margin, high * margin)
    else:
        margin = 0.08 * (high - low) or 0.5
        axes.set_ylim(low - margin, high + margin)
        axes.yaxis.set_major_locator(MaxNLocator(4, integer=quantity.whole, min_n_ticks=1))


def _value_axis(axes: Axes, values: _Values) -> None:
    """The swept values."""
    low, high = values.places.min(), values.places.max()
    if values.log:
        axes.set_xscale("log")
        margin = (high / low) ** 0.07
        axes.set_xlim(low / margin, high * margin)
        ticks = spaced(values.places, 0.2)
    else:
        margin = 0.08 * (high - low) or 0.5
        axes.set_xlim(low - margin, high + margin)
        ticks = np.unique(values.places)
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
    axes.xaxis.set_minor_formatter(NullFormatter())
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
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=len(handles),
        bbox_to_anchor=(0.5, 0.1 / height),
        borderaxespad=0.0,
        handlelength=2.8,
    )
