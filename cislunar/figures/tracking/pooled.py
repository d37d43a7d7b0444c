"""Errors of all targets against the number of satellites, a curve for each pipeline."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cislunar.figures import axes as layout
from cislunar.figures import panels, style
from cislunar.figures.axes import Array, Grid
from cislunar.figures.labels import IN_TABLES_ALONE, pipeline_label
from cislunar.figures.panels import COUNT, PERCENT, Row

_LEFT, _RIGHT, _GAP = 0.72, 0.12, 0.14
_ROW_IN, _BETWEEN_IN, _COLUMN_IN = 1.25, 0.16, 2.0
_HEAD, _FOOT, _LINE_IN = 0.32, 0.78, 0.16
_ASIDE = 1.025
"""Ratio of the places of neighboring series, so that none hides another."""
_LEGEND_LETTERS = 55
"""Longest label of a legend with two columns."""
_STYLES = (
    (style.BLUE, style.SOLID, "o"),
    (style.VERMILION, style.DASHED, "s"),
    (style.GREEN, style.DASH_DOT, "D"),
    (style.PURPLE, style.DOTTED, "^"),
    (style.BLACK, style.DASHED, "P"),
    (style.ORANGE, style.SOLID, "v"),
    (style.SKY, style.DASH_DOT, "X"),
)

ROWS = (
    Row("targets in custody,\n% of all targets", ("custody_share", "", "1"), 100.0,
        within=PERCENT),
    Row("position in custody,\n% of all targets", ("position_custody_share", "", "1"), 100.0,
        within=PERCENT),
    Row("attitude in custody,\n% of all targets", ("attitude_custody_share", "", "1"), 100.0,
        within=PERCENT),
    Row("final position error,\nall targets, km", ("final_error_geometric_all", "position", "km"),
        log=True),
    Row("final attitude error,\nall targets, deg",
        ("final_error_geometric_all", "attitude", "degree"), log=True),
    Row("targets\nnever observed", ("never_observed", "", "1"), within=COUNT),
)  # fmt: skip
"""The panels: quantity, part and unit in ``tables/pooled.csv``."""


@style.house_style()
def pooled_figure(table: pd.DataFrame) -> Figure:
    """Draw custody and errors of ``tables/pooled.csv``, a column for each number of targets.

    Designs that differ in their number of satellites only are one pipeline. Pipelines, and numbers
    of targets, with a single number of satellites are left out, unless all have one. So are those
    of `IN_TABLES_ALONE`.
    """
    keys = ("architecture", "estimator", "variant")
    rows = zip(*(table[key].fillna("") for key in keys), strict=True)
    table = table.assign(part=table["part"].fillna(""), series=[pipeline_label(*r) for r in rows])
    several = table.groupby("series", sort=False)["observers"].nunique() > 1
    names = [name for name in several.index[several] if name not in IN_TABLES_ALONE]
    names = names or list(several.index)
    styles = {
        name: style.SeriesStyle(name, *_STYLES[number % len(_STYLES)], filled=number % 2 == 0)
        for number, name in enumerate(names)
    }
    table = table[table["series"].isin(names)]
    numbers = table.groupby("targets")["observers"].nunique()
    counts = sorted(numbers.index[numbers > 1]) or sorted(numbers.index)
    columns = 2 if len(counts) > 1 and max(map(len, names)) <= _LEGEND_LETTERS else 1
    foot = _FOOT + _LINE_IN * -(-len(names) // columns)
    grid = Grid(len(ROWS), len(counts), _COLUMN_IN, _ROW_IN, _LEFT, foot, _GAP, _BETWEEN_IN)
    width, height = grid.size
    figure = style.new_figure(_HEAD + height + foot, _LEFT + width + _RIGHT)

    def draw(axes: Axes, row: Row, number: int) -> Array:
        own = table[table["targets"] == counts[number]]
        shown_values = _draw(axes, own, row, styles)
        axes.set_xscale("log")
        aside = _ASIDE ** (0.5 * len(names))
        ends = [own["observers"].min() / aside, own["observers"].max() * aside]
        axes.set_xlim(*layout.reach(ends, log=True, share=0.04, least=1.05))
        layout.fixed_ticks(axes.xaxis, layout.spaced(own["observers"].to_numpy(float)))
        axes.tick_params(axis="x", which="minor", bottom=False)
        return shown_values

    titles = [f"{count} targets" for count in counts]
    for axes in panels.draw_rows(figure, grid, ROWS, titles, draw)[-1]:
        axes.set_xlabel("number of satellites")
    top = layout.note_below(figure, panels.table_note(table))
    handles = [series.legend_handle() for series in styles.values()]
    layout.legend_below(figure, handles, top, columns, handlelength=2.8)
    return figure


def _draw(axes: Axes, table: pd.DataFrame, row: Row, styles: dict[str, style.SeriesStyle]) -> Array:
    """Draw every series; the values drawn are returned."""
    chosen = panels.rows_of(table, row)
    groups = chosen.groupby("observers")["series"]
    rank = chosen["series"].map(list(styles).index).groupby(chosen["observers"]).rank()
    aside = _ASIDE ** (rank - 0.5 * (groups.transform("size") + 1))
    chosen = chosen.assign(at=aside * chosen["observers"])
    values = [np.empty(0)]
    for name, series in styles.items():
        own = chosen[chosen["series"] == name].sort_values("observers", kind="stable")
        found = panels.table_estimates(own).scaled(row.factor)
        at = own["at"].to_numpy(float)
        values.append(panels.draw_estimates(axes, at, found, series, row.within))
    return np.concatenate(values)
