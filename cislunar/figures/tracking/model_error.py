"""Tracking when the truth is not what the estimators believe, by kind and size of the error."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cislunar.campaign.tracking.model_errors import NONE
from cislunar.errors import InputFileError
from cislunar.figures.axes import Array, Grid, fixed_ticks, legend_below, reach
from cislunar.figures.panels import COUNT, PERCENT, Row, draw_means, draw_rows
from cislunar.figures.style import (
    DOTTED,
    SeriesStyle,
    estimator_style,
    house_style,
    new_figure,
)

_LEFT, _RIGHT, _GAP = 0.72, 0.12, 0.10
_ROW_IN, _BETWEEN_IN = 1.15, 0.14
_HEAD, _FOOT = 0.44, 0.82
_PANELS_IN, _WIDEST_IN, _NARROWEST_IN = 6.2, 1.6, 4.2
_TICK_SPACING = 0.24
"""Least distance of two tick labels, as a share of the axis."""


ROWS = (
    Row(
        "attitude within\n3\N{GREEK SMALL LETTER SIGMA}, % of time",
        ("coverage",),
        100.0,
        within=PERCENT,
    ),
    Row("final attitude error,\nmedian, degree", ("final_attitude_error_median",), log=True),
    Row("inconsistent\nrotation, targets", ("inconsistent_rotation",), within=COUNT),
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
    """Rows of variants that change more than the truth: what the estimator estimates, mostly."""
    return table["also"].notna() & (table["also"] != "")


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of one scenario, architecture and number of targets, with an error of some size."""
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

    Beginning with no error. With `remedied` those of variants in which the estimator is set
    otherwise, too, none without the error unless set alike. Empty if there is no such error.
    """
    own = table[(table["estimator"] == estimator) & (table["quantity"] == quantity)]
    faulty = own[(own["kind"] == kind) & (_remedied(own) == remedied)]
    none = own[(own["kind"] == NONE) & (_remedied(own) == remedied)]
    if remedied:
        none = none[none["also"].isin(faulty["also"])]
    if not faulty.empty:
        faulty = pd.concat([none, faulty])
    return faulty.sort_values("size", kind="stable")


def _series(table: pd.DataFrame) -> list[tuple[str, bool, SeriesStyle]]:
    """Estimators, as they are and remedied, with their looks."""
    found = []
    for name in dict.fromkeys(table["estimator"]):
        look = estimator_style(name)
        found.append((name, False, look))
        if _remedied(table[table["estimator"] == name]).any():
            mended = look._replace(
                label=f"{look.label}, estimating more", line=DOTTED, marker="^", filled=False
            )
            found.append((name, True, mended))
    return found


@house_style()
def model_error_figure(table: pd.DataFrame) -> Figure:
    """Coverage, final attitude error and inconsistent targets, a column for each kind of error.

    Of several scenarios, architectures or numbers of targets in ``tables/model_error.csv`` the one
    with the most errors is drawn. Variants that change more than the truth are taken for remedies.
    An `InputFileError` if the table has no error of known size.
    """
    shown = _shown(table)
    kinds = [kind for kind in dict.fromkeys(shown["kind"]) if kind != NONE]
    series = _series(shown)
    column_in = min(_WIDEST_IN, (_PANELS_IN + _GAP) / len(kinds) - _GAP)
    panels_in = len(kinds) * (column_in + _GAP) - _GAP
    left_in = max(_LEFT, 0.5 * (_NARROWEST_IN - panels_in))
    width_in = max(_LEFT + panels_in + _RIGHT, _NARROWEST_IN)
    grid = Grid(len(ROWS), len(kinds), column_in, _ROW_IN, left_in, _FOOT, _GAP, _BETWEEN_IN)
    figure = new_figure(_HEAD + grid.size[1] + _FOOT, width_in)
    names = [KIND_LABELS.get(kind, kind.split(".")[-1].replace("_", " ")) for kind in kinds]

    def draw(axes: Axes, row: Row, column: int) -> Array:
        return _draw(axes, shown, kinds[column], series, row)

    panels = draw_rows(figure, grid, ROWS, names, draw, fontsize=7.0, pad=4)
    for first, *_ in panels:
        first.yaxis.set_label_coords(-0.42 / column_in, 0.5)
    for axes, kind in zip(panels[-1], kinds, strict=True):
        units = shown.loc[shown["kind"] == kind, "size_unit"]
        axes.set_xlabel("degree" if units.iloc[0] == "degree" else "excess, %")
    _legend(figure, shown, series)
    return figure


def _draw(
    axes: Axes,
    table: pd.DataFrame,
    kind: str,
    series: Sequence[tuple[str, bool, SeriesStyle]],
    row: Row,
) -> Array:
    """A quantity against the size of one kind of error; what the axis holds of it."""
    sizes = np.unique([0.0, *table.loc[table["kind"] == kind, "size"]])
    held = [np.empty(0)]
    (quantity,) = row.curves
    for index, (name, remedied, look) in enumerate(series):
        found = curve(table, kind, name, quantity, remedied=remedied)
        if found.empty:
            continue
        aside = 0.03 * np.ptp(sizes) * (index - 0.5 * (len(series) - 1))
        bounds = tuple(row.factor * found[key].to_numpy(float) for key in ("mean", "low", "high"))
        bounds = bounds[0], *(np.clip(end, *row.within) for end in bounds[1:])
        at = found["size"].to_numpy(float) + aside
        draw_means(axes, at, bounds, look, row.within, zorder=3)
        # intervals of few seeds may leave the panel
        held += bounds if found["seeds"].max() > 2 else bounds[:1]
    axes.set_xlim(*reach(sizes, log=False, share=0.1))
    ticks = _ticks(sizes)
    fixed_ticks(axes.xaxis, ticks, [_signed(tick) for tick in ticks])
    return np.concatenate(held)


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


def _legend(
    figure: Figure, table: pd.DataFrame, series: Sequence[tuple[str, bool, SeriesStyle]]
) -> None:
    """Estimators, and which cell is drawn."""
    cell = table.iloc[0]
    handles = [look.legend_handle() for _, _, look in series]
    legend_below(figure, handles, 0.22, handlelength=2.8)
    text = (
        f"scenario {cell['scenario']}, {cell['architecture']} architecture, "
        f"{int(cell['targets'])} targets, tasking every {int(cell['interval_minutes'])} min"
    )
    figure.text(
        0.5, 0.08 / figure.get_size_inches()[1], text, ha="center", va="bottom", fontsize=7.0
    )
