"""Tracking when the truth is not what the estimators believe, by kind and size of the error."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator

from cislunar.campaign.settings.model_error import NONE
from cislunar.errors import InputFileError
from cislunar.figures.axes import log_ticks, place
from cislunar.figures.space.scene import Array
from cislunar.figures.style import (
    DOTTED,
    SeriesStyle,
    estimator_style,
    house_style,
    new_figure,
    panel_letter,
)

_LEFT, _RIGHT, _GAP = 0.72, 0.12, 0.10
_ROW_IN, _BETWEEN_IN = 1.15, 0.14
_HEAD, _FOOT = 0.44, 0.82
_PANELS_IN, _WIDEST_IN, _NARROWEST_IN = 6.2, 1.6, 4.2
_TICK_SPACING = 0.24
"""Least distance of two tick labels, as a share of the axis."""


class Row(NamedTuple):
    """A row of panels: a quantity of the table, its label, and its axis."""

    quantity: str
    label: str
    factor: float = 1.0
    log: bool = False


ROWS = (
    Row("coverage", "attitude within\n3\N{GREEK SMALL LETTER SIGMA}, % of time", 100.0),
    Row("final_attitude_error_median", "final attitude error,\nmedian, degree", log=True),
    Row("diverged_rotation", "diverged in\nrotation, targets"),
)

KIND_LABELS = {
    "material.diffuse_weight": "diffuse\nweight",
    "material.specular_weight": "specular\nweight",
    "material.diffuse_albedo": "diffuse\nalbedo",
    "material.rms_slope": "slope of\nmicrofacets",
    "material.normal_reflectance": "normal\nreflectance",
    "body.stretch": "stretch of\nthe shape",
    "body.radius_m": "size of\nthe shape",
    "body.inertia": "axial\ninertia",
    "sensor.magnitude_noise": "magnitude\nnoise",
    "sensor.angle_noise_arcsec": "angle\nnoise",
    "angular_acceleration_deg_h2": "torque,\nturn in a run",
}
"""What the kinds of errors are called."""


def _remedied(table: pd.DataFrame) -> pd.Series:
    """Rows of variants that change more than the truth."""
    return table["also"].notna() & (table["also"] != "")


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of one scenario, architecture and number of targets, with an error of some size."""
    measured = table[table["size"].notna()]
    faulty = measured[(measured["kind"] != NONE) & ~_remedied(measured)]
    if faulty.empty:
        raise InputFileError(
            "tables/model_error.csv has no variant with an error of known size: give variants of "
            "the configuration key 'task2.variants.cells' numbers of targets, or leave the figure "
            "out"
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
    """Rows of one kind of error and one estimator, by rising size.

    Parameters
    ----------
    table : DataFrame
        ``tables/model_error.csv``.
    kind, estimator, quantity : str
        As in its columns.
    remedied : bool
        True for the variants in which the estimator is set otherwise, too.

    Returns
    -------
    DataFrame
        Beginning with no error unless remedied; empty if the estimator has no such error.
    """
    own = table[(table["estimator"] == estimator) & (table["quantity"] == quantity)]
    faulty = own[(own["kind"] == kind) & (_remedied(own) == remedied)]
    if not (faulty.empty or remedied):
        faulty = pd.concat([own[own["kind"] == NONE], faulty])
    return faulty.sort_values("size", kind="stable")


def _series(table: pd.DataFrame) -> list[tuple[str, bool, SeriesStyle]]:
    """Estimators, as they are and remedied, with their looks."""
    found = []
    for name in dict.fromkeys(table["estimator"]):
        look = estimator_style(name)
        found.append((name, False, look))
        if _remedied(table[table["estimator"] == name]).any():
            mended = look._replace(
                label=f"{look.label} with a remedy", line=DOTTED, marker="^", filled=False
            )
            found.append((name, True, mended))
    return found


@house_style()
def model_error_figure(table: pd.DataFrame) -> Figure:
    """Coverage, final attitude error and divergences, a column for each kind of error.

    Parameters
    ----------
    table : DataFrame
        ``tables/model_error.csv``. Of several scenarios, architectures or numbers of targets the
        one with the most errors is drawn. Variants that change more than the truth are taken for
        remedies.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputFileError
        If the table has no error of known size.
    """
    shown = _shown(table)
    kinds = [kind for kind in dict.fromkeys(shown["kind"]) if kind != NONE]
    series = _series(shown)
    column_in = min(_WIDEST_IN, (_PANELS_IN + _GAP) / len(kinds) - _GAP)
    panels_in = len(kinds) * (column_in + _GAP) - _GAP
    left_in = max(_LEFT, 0.5 * (_NARROWEST_IN - panels_in))
    width_in = max(_LEFT + panels_in + _RIGHT, _NARROWEST_IN)
    rows_in = len(ROWS) * (_ROW_IN + _BETWEEN_IN) - _BETWEEN_IN
    figure = new_figure(_HEAD + rows_in + _FOOT, width_in)
    for number, row in enumerate(ROWS):
        bottom = _FOOT + rows_in - (number + 1) * _ROW_IN - number * _BETWEEN_IN
        drawn = []
        for column, kind in enumerate(kinds):
            left = left_in + column * (column_in + _GAP)
            axes = place(figure, left, bottom, column_in, _ROW_IN)
            _draw(axes, shown, kind, series, row)
            axes.tick_params(labelbottom=number == len(ROWS) - 1, labelleft=column == 0)
            if number == 0:
                name = KIND_LABELS.get(kind, kind.split(".")[-1].replace("_", " "))
                axes.set_title(f"{panel_letter(column)} {name}", loc="left", fontsize=7.0, pad=4)
            if number == len(ROWS) - 1:
                units = shown.loc[shown["kind"] == kind, "size_unit"]
                axes.set_xlabel("degree" if units.iloc[0] == "degree" else "excess, %")
            drawn.append(axes)
        _share_y(drawn, shown, row)
        drawn[0].set_ylabel(row.label, fontsize=7.5)
        drawn[0].yaxis.set_label_coords(-0.42 / column_in, 0.5)
    _legend(figure, shown, series)
    return figure


def _draw(
    axes: Axes,
    table: pd.DataFrame,
    kind: str,
    series: Sequence[tuple[str, bool, SeriesStyle]],
    row: Row,
) -> None:
    """Means with intervals of every estimator for one kind of error."""
    sizes = np.unique([0.0, *table.loc[table["kind"] == kind, "size"]])
    reach = float(np.ptp(sizes)) or 1.0
    for index, (name, remedied, look) in enumerate(series):
        found = curve(table, kind, name, row.quantity, remedied=remedied)
        if found.empty:
            continue
        aside = 0.03 * reach * (index - 0.5 * (len(series) - 1))
        mean, low, high = (
            row.factor * found[key].to_numpy(float) for key in ("mean", "low", "high")
        )
        axes.errorbar(
            found["size"].to_numpy(float) + aside,
            mean,
            yerr=np.nan_to_num([mean - low, high - mean]),
            color=look.color,
            linestyle=look.line,
            linewidth=0.9,
            elinewidth=0.7,
            capsize=1.4,
            capthick=0.7,
            zorder=3,
            **look.marker_kwargs(3.2),
        )
    axes.set_xlim(sizes[0] - 0.1 * reach, sizes[-1] + 0.1 * reach)
    ticks = _ticks(sizes)
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(FixedFormatter([_signed(tick) for tick in ticks]))


def _signed(size: float) -> str:
    """A size with a proper minus sign."""
    return f"{size:g}".replace("-", "\N{MINUS SIGN}")


def _ticks(sizes: Array) -> Array:
    """Sizes that can be labelled side by side: zero and the ends first."""
    reach = float(np.ptp(sizes)) or 1.0
    kept: list[float] = []
    for size in [0.0, sizes[-1], sizes[0], *sizes[::-1]]:
        if all(abs(size - other) >= _TICK_SPACING * reach for other in kept):
            kept.append(float(size))
    return np.sort(kept)


def _share_y(drawn: Sequence[Axes], table: pd.DataFrame, row: Row) -> None:
    """One vertical axis for a row, that holds all means; intervals of few seeds may leave it."""
    own = table[table["quantity"] == row.quantity]
    values = row.factor * own["mean"].to_numpy(float)
    spread = row.factor * own[["low", "high"]].to_numpy(float)
    if own["seeds"].max() > 2:
        values = np.concatenate([values, spread.ravel()])
    values = values[np.isfinite(values) & ((values > 0.0) | (not row.log))]
    low, high = (values.min(), values.max()) if values.size else (0.1, 1.0)
    if row.log:
        margin = max((high / low) ** 0.08, 1.15)
        limits = low / margin, high * margin
    else:
        margin = 0.08 * (high - low) or 0.5
        limits = low - margin, high + margin
    for axes in drawn:
        if row.log:
            axes.set_yscale("log")
        axes.set_ylim(*limits)
        if row.log:
            log_ticks(axes.yaxis, *limits)


def _legend(
    figure: Figure, table: pd.DataFrame, series: Sequence[tuple[str, bool, SeriesStyle]]
) -> None:
    """Estimators, and which cell is drawn."""
    cell = table.iloc[0]
    height = figure.get_size_inches()[1]
    figure.legend(
        handles=[look.legend_handle() for _, _, look in series],
        loc="lower center",
        ncols=len(series),
        bbox_to_anchor=(0.5, 0.22 / height),
        borderaxespad=0.0,
        handlelength=2.8,
    )
    text = (
        f"scenario {cell['scenario']}, {cell['architecture']} architecture, "
        f"{int(cell['targets'])} targets, tasking every {int(cell['interval_minutes'])} min"
    )
    figure.text(0.5, 0.08 / height, text, ha="center", va="bottom", fontsize=7.0)
