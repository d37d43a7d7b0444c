"""What is known of all targets against the number of satellites, one curve to a way of working."""

import re

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cislunar.figures.axes import Array, Grid, fixed_ticks, legend_below, reach, spaced
from cislunar.figures.panels import COUNT, PERCENT, Row, draw_means, draw_rows
from cislunar.figures.style import (
    BLACK,
    BLUE,
    DASH_DOT,
    DASHED,
    DOTTED,
    GREEN,
    PURPLE,
    SOLID,
    VERMILION,
    SeriesStyle,
    house_style,
    new_figure,
)

_LEFT, _RIGHT, _GAP = 0.72, 0.12, 0.14
_ROW_IN, _BETWEEN_IN, _COLUMN_IN = 1.15, 0.16, 2.0
_HEAD, _FOOT, _LINE_IN = 0.32, 0.52, 0.16
_LOOKS = (
    (BLUE, SOLID, "o"),
    (VERMILION, DASHED, "s"),
    (GREEN, DASH_DOT, "D"),
    (PURPLE, DOTTED, "^"),
    (BLACK, DASHED, "P"),
)

_FINAL = "final_error_geometric_all"
ROWS = (
    Row("in custody, % of\nall targets", (("custody_share", "", "1"),), factor=100.0,
        within=PERCENT),
    Row("final position error\nof all targets, km", ((_FINAL, "position", "km"),), log=True),
    Row("final attitude error\nof all targets, degree", ((_FINAL, "attitude", "degree"),),
        log=True),
    Row("never observed,\ntargets", (("never_observed", "", "1"),), within=COUNT),
)  # fmt: skip
"""What is shown: quantity, part and unit in ``tables/pooled.csv``."""


def _series(table: pd.DataFrame) -> pd.Series:
    """What a row belongs to: designs that differ in their number alone, estimator and variant."""
    stem = table["architecture"].map(lambda name: re.sub(r"-?\d+$", "", name))
    variant = table["variant"].fillna("").map(lambda name: f", {name}" if name else "")
    return stem + ", " + table["estimator"] + variant


@house_style()
def pooled_figure(table: pd.DataFrame) -> Figure:
    """Custody and errors of ``tables/pooled.csv``, a column for each number of targets.

    Ways of working with one number of satellites alone are left out, unless all are.
    """
    table = table.assign(part=table["part"].fillna(""), series=_series(table))
    several = table.groupby("series", sort=False)["observers"].nunique() > 1
    names = list(several.index[several]) or list(several.index)
    styles = {
        name: SeriesStyle(name, *_LOOKS[number % len(_LOOKS)], filled=number % 2 == 0)
        for number, name in enumerate(names)
    }
    table = table[table["series"].isin(names)]
    counts = sorted(table["targets"].unique())
    lines = -(-len(names) // 2)
    foot = _FOOT + _LINE_IN * lines
    grid = Grid(len(ROWS), len(counts), _COLUMN_IN, _ROW_IN, _LEFT, foot, _GAP, _BETWEEN_IN)
    width, height = grid.size
    figure = new_figure(_HEAD + height + foot, _LEFT + width + _RIGHT)

    def draw(axes: Axes, row: Row, number: int) -> Array:
        own = table[table["targets"] == counts[number]]
        held = _draw(axes, own, row, styles)
        axes.set_xscale("log")
        axes.set_xlim(*reach(own["observers"], log=True, share=0.06, least=1.08))
        fixed_ticks(axes.xaxis, spaced(own["observers"].to_numpy(float)))
        axes.tick_params(axis="x", which="minor", bottom=False)
        return held

    titles = [f"$n_T$ = {count}" for count in counts]
    for axes in draw_rows(figure, grid, ROWS, titles, draw)[-1]:
        axes.set_xlabel("number of satellites")
    handles = [style.legend_handle() for style in styles.values()]
    legend_below(figure, handles, 0.06, 2 if len(counts) > 1 else 1, handlelength=2.8)
    return figure


def _draw(axes: Axes, table: pd.DataFrame, row: Row, styles: dict[str, SeriesStyle]) -> Array:
    """Means with intervals of every series; what the axis holds of them."""
    held = [np.empty(0)]
    for quantity, part, unit in row.curves:
        chosen = table[
            (table["quantity"] == quantity) & (table["part"] == part) & (table["unit"] == unit)
        ]
        for number, (name, look) in enumerate(styles.items()):
            own = chosen[chosen["series"] == name].sort_values("observers", kind="stable")
            mean, low, high, smallest, largest = (
                row.factor * own[key].to_numpy(float)
                for key in ("mean", "low", "high", "smallest", "largest")
            )
            at = own["observers"].to_numpy(float) * 1.012 ** (number - 0.5 * (len(styles) - 1))
            draw_means(axes, at, (mean, low, high), look, row.within)
            # an interval of few realizations may leave the panel
            held += [mean, np.fmax(low, smallest), np.fmin(high, largest)]
    return np.concatenate(held)
