"""Association by several methods against the number of false alarms, field of view and targets."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cislunar.figures import axes as layout
from cislunar.figures import panels, style
from cislunar.figures.axes import Array, Grid
from cislunar.figures.labels import ASSOCIATORS
from cislunar.figures.panels import COUNT, Row

_LEFT, _RIGHT, _GAP = 0.75, 0.12, 0.14
_ROW_IN, _BETWEEN_IN, _COLUMN_IN = 1.3, 0.16, 1.9
_HEAD, _FOOT = 0.32, 0.95
_ASIDE = 0.12
"""Distance of neighboring series, in steps of the horizontal axis, so that none hides another."""

_NO_LINE = "none"

_STYLES = {
    "nearest-neighbor": (style.VERMILION, _NO_LINE, "s"),
    "joint-probabilities": (style.GREEN, _NO_LINE, "D"),
    "multiple-frames": (style.BLUE, _NO_LINE, "o"),
}

ROWS = (
    Row("wrong associations\nper day", ("wrong_associations_per_day",), within=COUNT),
    Row("tracks lost by\nwrong associations", ("lost_tracks",), within=COUNT),
    Row("GOSPA metric, ratio to\nknown identities", ("gospa_ratio",), reference=1.0),
)
"""The panels: quantities of ``tables/association.csv``."""

_USUAL = {"mode": "paper", "estimator": "mukf", "dynamics": "cr3bp", "population": "A"}
_COLUMNS = (
    ("clutter", "false alarms per exposure", {"field_deg": 3.0, "targets": 100}),
    ("field_deg", "field of view, deg", {"clutter": 1.0, "targets": 100}),
    ("targets", "number of targets", {"clutter": 1.0, "field_deg": 3.0}),
)
"""Columns: what varies, its label, and what does not."""


@style.house_style()
def association_figure(table: pd.DataFrame) -> Figure:
    """Draw wrong associations, lost tracks and the GOSPA metric of ``tables/association.csv``."""
    for key, value in _USUAL.items():
        table = table[table[key] == value]
    styles = {
        name: style.SeriesStyle(ASSOCIATORS[name], *each, filled=number % 2 == 0)
        for number, (name, each) in enumerate(_STYLES.items())
    }
    grid = Grid(len(ROWS), len(_COLUMNS), _COLUMN_IN, _ROW_IN, _LEFT, _FOOT, _GAP, _BETWEEN_IN)
    width, height = grid.size
    figure = style.new_figure(_HEAD + height + _FOOT, _LEFT + width + _RIGHT)
    chosen = [_selected(table, same) for _, _, same in _COLUMNS]

    def draw(axes: Axes, row: Row, number: int) -> Array:
        key = _COLUMNS[number][0]
        own = chosen[number]
        own = own[own["quantity"] == row.curves[0]]
        places = sorted(chosen[number][key].unique())
        values = [np.empty(0)]
        for rank, (name, series) in enumerate(styles.items()):
            rows = own[own["associator"] == name].sort_values(key, kind="stable")
            at = np.array([places.index(value) for value in rows[key]], dtype=float)
            found = panels.table_estimates(rows)
            aside = _ASIDE * (rank - 0.5 * (len(styles) - 1))
            values.append(panels.draw_estimates(axes, at + aside, found, series, row.within))
        if row.reference is not None:
            axes.axhline(row.reference, color="0.6", linewidth=0.6, zorder=1)
        axes.set_xlim(-0.5, len(places) - 0.5)
        layout.fixed_ticks(axes.xaxis, range(len(places)), [f"{value:g}" for value in places])
        return np.concatenate(values)

    titles = ["against false alarms", "against field of view", "against targets"]
    for axes, (_, label, _) in zip(
        panels.draw_rows(figure, grid, ROWS, titles, draw)[-1], _COLUMNS, strict=True
    ):
        axes.set_xlabel(label)
    top = layout.note_below(figure, panels.table_note(table))
    layout.legend_below(figure, [one.legend_handle() for one in styles.values()], top, 3)
    return figure


def _selected(table: pd.DataFrame, same: dict[str, float]) -> pd.DataFrame:
    """Rows with these values."""
    for key, value in same.items():
        table = table[np.isclose(table[key], value)]
    return table
