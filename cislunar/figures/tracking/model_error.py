"""Tracking when the truth differs from the assumed model, by kind and size of the difference."""

from collections.abc import Sequence
from textwrap import fill

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cislunar.campaign.tracking.model_errors import NONE
from cislunar.errors import InputFileError
from cislunar.figures import axes as layout
from cislunar.figures import panels, style
from cislunar.figures.axes import Array, Grid
from cislunar.figures.labels import MODEL_ERRORS, architecture_label, interval_text
from cislunar.figures.panels import COUNT, PERCENT, Row

_LEFT, _RIGHT, _GAP = 0.72, 0.12, 0.10
_ROW_IN, _BETWEEN_IN = 1.15, 0.14
_HEAD, _AXIS, _LINE_IN = 0.44, 0.42, 0.15
_PANELS_IN, _WIDEST_IN, _NARROWEST_IN, _WIDE_IN = 6.2, 1.6, 4.2, 6.0
_LETTER_IN = 0.058
_TICK_SPACING = 0.24
"""Least distance between two tick labels, as a share of the axis."""


ROWS = (
    Row("attitude within\n3\N{GREEK SMALL LETTER SIGMA}, % of time", ("coverage",), 100.0,
        within=PERCENT),
    Row("final attitude error,\nmedian, deg", ("final_attitude_error_median",), log=True),
    Row("inconsistent\nrotation, targets", ("inconsistent_rotation",), within=COUNT),
)  # fmt: skip


def _remedied(table: pd.DataFrame) -> pd.Series:
    """Rows of variants that change more than the truth: mostly what the estimator estimates."""
    return table["also"].notna() & (table["also"] != "")


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of errors with a size, of one scenario, architecture and number of targets."""
    measured = table[table["size"].notna()]
    faulty = measured[(measured["kind"] != NONE) & ~_remedied(measured)]
    if faulty.empty:
        raise InputFileError(
            "tables/model_error.csv has no variant with an error of known size: give families of "
            "the configuration key 'task2.variants.families' numbers of targets, or leave the "
            "figure out"
        )
    keys = ["scenario", "architecture", "targets", "interval_minutes"]
    chosen = faulty.groupby(keys, sort=False).size().idxmax()
    same = np.logical_and.reduce(
        [measured[key] == value for key, value in zip(keys, chosen, strict=True)]
    )
    return measured[same]


def curve(
    table: pd.DataFrame, kind: str, estimator: str, quantity: str, *, remedied: bool = False
) -> pd.DataFrame:
    """Rows of ``tables/model_error.csv`` for one kind of error and one estimator, by rising size.

    They include the cell without error. With `remedied` they are those of variants with other
    settings of the estimator as well, and the cell without error only if it has the same settings.
    Empty if there is no such error.
    """
    own = table[(table["estimator"] == estimator) & (table["quantity"] == quantity)]
    faulty = own[(own["kind"] == kind) & (_remedied(own) == remedied)]
    none = own[(own["kind"] == NONE) & (_remedied(own) == remedied)]
    if remedied:
        none = none[none["also"].isin(faulty["also"])]
    if not faulty.empty:
        faulty = pd.concat([none, faulty])
    return faulty.sort_values("size", kind="stable")


def _compared(table: pd.DataFrame) -> list[tuple[str, bool, style.SeriesStyle]]:
    """Estimators as configured and with remedies, with their styles."""
    found = []
    for name in dict.fromkeys(table["estimator"]):
        series = style.estimator_style(name)
        found.append((name, False, series))
        if _remedied(table[table["estimator"] == name]).any():
            label = f"{series.label}, adapted settings"
            drawn = {"line": style.DOTTED, "marker": "^", "filled": False}
            found.append((name, True, series._replace(label=label, **drawn)))
    return found


@style.house_style()
def model_error_figure(table: pd.DataFrame) -> Figure:
    """Draw coverage, final attitude error and inconsistent targets by kind of error.

    The scenario, architecture and number of targets are those with the most errors in
    ``tables/model_error.csv``. Variants that change more than the truth count as remedies. An
    `InputFileError` if the table has no error of known size.
    """
    shown = _shown(table)
    kinds = [kind for kind in dict.fromkeys(shown["kind"]) if kind != NONE]
    compared = _compared(shown)
    column_in = min(_WIDEST_IN, (_PANELS_IN + _GAP) / len(kinds) - _GAP)
    panels_in = len(kinds) * (column_in + _GAP) - _GAP
    left_in = max(_LEFT, 0.5 * (_NARROWEST_IN - panels_in))
    width_in = max(_LEFT + panels_in + _RIGHT, _NARROWEST_IN)
    note = layout.note_lines(_note(shown), width_in)
    abreast = min(len(compared), 3 if width_in > _WIDE_IN else 2)
    foot = _AXIS + layout.note_height(note) + _LINE_IN * -(-len(compared) // abreast)
    grid = Grid(len(ROWS), len(kinds), column_in, _ROW_IN, left_in, foot, _GAP, _BETWEEN_IN)
    figure = style.new_figure(_HEAD + grid.size[1] + foot, width_in)
    names = [MODEL_ERRORS.get(kind, kind.split(".")[-1].replace("_", " ")) for kind in kinds]
    names = [fill(name, max(int(column_in / _LETTER_IN), 8)) for name in names]

    def draw(axes: Axes, row: Row, column: int) -> Array:
        return _draw(axes, shown, kinds[column], compared, row)

    drawn = panels.draw_rows(figure, grid, ROWS, names, draw, fontsize=7.0, pad=4)
    for first, *_ in drawn:
        first.yaxis.set_label_coords(-0.42 / column_in, 0.5)
    for axes, kind in zip(drawn[-1], kinds, strict=True):
        units = shown.loc[shown["kind"] == kind, "size_unit"]
        axes.set_xlabel("deg" if units.iloc[0] == "degree" else "%", labelpad=1.5)
    handles = [series.legend_handle() for _, _, series in compared]
    layout.legend_below(figure, handles, layout.note_below(figure, note), abreast, handlelength=2.8)
    return figure


def _draw(
    axes: Axes,
    table: pd.DataFrame,
    kind: str,
    compared: Sequence[tuple[str, bool, style.SeriesStyle]],
    row: Row,
) -> Array:
    """Draw a quantity against the size of one kind of error; the values drawn are returned."""
    sizes = np.unique([0.0, *table.loc[table["kind"] == kind, "size"]])
    shown_values = [np.empty(0)]
    (quantity,) = row.curves
    for index, (name, remedied, series) in enumerate(compared):
        found = curve(table, kind, name, quantity, remedied=remedied)
        if found.empty:
            continue
        aside = 0.03 * np.ptp(sizes) * (index - 0.5 * (len(compared) - 1))
        at = found["size"].to_numpy(float) + aside
        scaled = panels.table_estimates(found).scaled(row.factor)
        shown_values.append(panels.draw_estimates(axes, at, scaled, series, row.within, zorder=3))
    axes.set_xlim(*layout.reach(sizes, log=False, share=0.1))
    ticks = _ticks(sizes)
    layout.fixed_ticks(axes.xaxis, ticks, [_signed(tick) for tick in ticks])
    return np.concatenate(shown_values)


def _signed(size: float) -> str:
    """A size with a minus sign."""
    return f"{size:g}".replace("-", "\N{MINUS SIGN}")


def _ticks(sizes: Array) -> Array:
    """Sizes that can be labeled side by side; zero and the ends have priority."""
    reach = float(np.ptp(sizes)) or 1.0
    kept: list[float] = []
    for size in [0.0, sizes[-1], sizes[0], *sizes[::-1]]:
        if all(abs(size - other) >= _TICK_SPACING * reach for other in kept):
            kept.append(float(size))
    return np.sort(kept)


def _note(table: pd.DataFrame) -> str:
    """Note on the horizontal axes, the cell and the realizations."""
    cell = table.iloc[0]
    return (
        "Horizontal axes: truth minus assumed value, % of the assumed value; of a torque, the "
        f"rotation that it causes during the run.\nScenario {cell['scenario']}, "
        f"{architecture_label(cell['architecture'])}, {int(cell['targets'])} targets, tasking "
        f"every {interval_text(int(cell['interval_minutes']))}.\n{panels.table_note(table)}"
    )
