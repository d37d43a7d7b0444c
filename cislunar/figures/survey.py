"""Catalogs of surveys that start without one: completeness, wrong orbits and consistency."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cislunar.figures import axes as layout
from cislunar.figures import panels, style
from cislunar.figures.axes import Grid
from cislunar.figures.labels import plain
from cislunar.figures.panels import PERCENT, Row

_RIGHT, _GAP, _HEAD, _FOOT = 0.12, 0.14, 0.32, 1.15
_LETTER = 0.054
"""Width of a letter of the names of surveys, inches."""
_WIDTH_IN, _LINE_IN = 1.32, 0.19

_SERIES = (
    style.SeriesStyle("objects on orbits of the families", style.BLUE, "none", "o"),
    style.SeriesStyle("objects outside of the families", style.VERMILION, "none", "s"),
)
_ALL = style.SeriesStyle("all objects", style.BLACK, "none", "D")
_ASIDE = 0.16
"""Of the two groups from the middle of a line."""


def _groups(quantity: str) -> tuple[str, str]:
    """A quantity of the objects of either series."""
    return f"{quantity}_inside", f"{quantity}_outside"


ROWS = (
    Row("correct orbits,\n% of all objects", _groups("completeness_all"), 100.0, within=PERCENT),
    Row(
        "correct orbits, % of\nfindable objects",
        _groups("completeness"),
        100.0,
        within=PERCENT,
    ),
    Row("wrong orbits,\n% of confirmed", ("wrong_share",), factor=100.0, within=PERCENT),
    Row("normalized estimation\nerror squared", ("nees",), reference=6.0, within=(0.0, np.inf)),
)
"""The panels: quantities of ``tables/catalog.csv``, by series if there are two."""

_BALLISTIC = Row(
    "normalized error squared,\nobjects without maneuver", ("nees_ballistic",), reference=6.0,
    within=(0.0, np.inf),
)  # fmt: skip
"""In place of the last panel for objects that maneuver: a maneuver after the last detection of an
object leaves an error without a limit."""


@style.house_style()
def catalog_figure(table: pd.DataFrame) -> Figure:
    """Draw the catalogs of all surveys of ``tables/catalog.csv`` at each day of the table: correct
    orbits by groups of objects, and wrong orbits and consistency of all."""
    places = list(table.groupby(["label", "day"], sort=False).groups)
    moving = _BALLISTIC.curves[0] in set(table["quantity"])
    rows = (*ROWS[:-1], _BALLISTIC if moving else ROWS[-1])
    names = [f"{plain(label)} ({day:g} d)" for label, day in places]
    left = 0.25 + _LETTER * max(map(len, names), default=0)
    grid = Grid(1, len(rows), _WIDTH_IN, _LINE_IN * (len(places) + 1), left, _FOOT, _GAP)
    width, height = grid.size
    figure = style.new_figure(_HEAD + height + _FOOT, left + width + _RIGHT)
    for number, row in enumerate(rows):
        axes = grid.place(figure, 0, number)
        several, empty = len(row.curves) > 1, True
        for which, (quantity, series) in enumerate(zip(row.curves, _SERIES, strict=False)):
            own = table[table["quantity"] == quantity].set_index(["label", "day"])
            at = [k for k, place in enumerate(places) if place in own.index]
            if not at:
                continue
            empty = False
            found = panels.table_estimates(own.loc[[places[k] for k in at]]).scaled(row.factor)
            panels.draw_estimates(
                axes,
                np.array(at) + several * _ASIDE * (2 * which - 1),
                found,
                series if several else _ALL,
                row.within,
                horizontal=True,
            )
        if empty:
            layout.note_empty(axes, "no orbit")
        if row.curves == ("wrong_share",):
            axes.set_xlim(left=-0.05, right=max(axes.get_xlim()[1], 1.0))
        if row.reference is not None:
            if axes.get_xlim()[1] > 10.0 * row.reference:
                axes.set_xscale("log")
            axes.axvline(row.reference, color="0.6", linewidth=0.6, zorder=1)
        axes.set_xlabel(row.label)
        axes.set_ylim(len(places) - 0.4, -0.6)
        layout.fixed_ticks(
            axes.yaxis, range(len(places)), names if number == 0 else [""] * len(names)
        )
        layout.panel_title(axes, number, "")
    handles = [each.legend_handle(line=False) for each in (*_SERIES, _ALL)]
    note = f"In parentheses: time since the start of the survey.\n{panels.table_note(table)}"
    layout.legend_below(figure, handles, layout.note_below(figure, note))
    return figure
