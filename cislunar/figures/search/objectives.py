"""Figure of the objectives: what each number of satellites reaches, and coverage by information."""

from collections.abc import Mapping
from itertools import product

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, PercentFormatter
from matplotlib.transforms import Affine2D, Bbox
from numpy.typing import NDArray

from cislunar.figures import style
from cislunar.figures.axes import Grid, legend_below, log_ticks, note_below, panel_title, place
from cislunar.figures.labels import OBJECTIVES, words

_CRITERIA = {
    "J": (style.GREEN, style.SOLID, "X"),
    "coverage": (style.BLUE, style.DASHED, "^"),
    "information": (style.VERMILION, style.DASH_DOT, "v"),
    "attitude": (style.PURPLE, style.DOTTED, "P"),
    "target-days": (style.BLACK, style.DASHED, "<"),
    "search": (style.ORANGE, style.SOLID, "D"),
    "longest-gap": (style.BLACK, style.DASH_DOT, ">"),
    "mean-gap": (style.BLACK, style.DOTTED, "8"),
    "mean-wait": (style.BLACK, style.SOLID, "H"),
    "chance": (style.GRAY, style.SOLID, "."),
}
"""Color, line and marker of the criteria by which architectures are chosen."""

_SEARCHED = ("tpe", "random")
"""Methods of designs that are the paper's searches."""
_LEFT, _RIGHT, _GAP = 0.55, 0.08, 0.55
_ROW_IN, _BETWEEN_IN, _HEAD_IN = 1.75, 0.72, 0.34
_BAR_IN = 0.62
_SHARE, _INFORMATION = "value of the objective, %", "value of the objective, nat"
_SATELLITES, _COVERAGE = "number of satellites", "target-hours visible, %"


def _criterion(objective: str, name: str = "") -> style.SeriesStyle:
    """Style of a criterion of choice; `name` distinguishes fronts of one objective."""
    color, line, marker = _CRITERIA.get(objective, (style.GRAY, style.SOLID, "d"))
    label = OBJECTIVES.get(objective, words(objective))
    label = label if objective == "chance" else f"maximum {label}"
    return style.SeriesStyle(f"{label} ({words(name)})" if name else label, color, line, marker)


def _fronts_of(table: pd.DataFrame) -> dict[str, style.SeriesStyle]:
    """Styles of the fronts, in the order of their names."""
    found = table.loc[table["front"] != "", ["front", "objective"]].drop_duplicates()
    several = found["objective"].duplicated(keep=False)
    return {
        front: _criterion(objective, front if alike else "")
        for front, objective, alike in zip(found["front"], found["objective"], several, strict=True)
    }


def _style(each: pd.Series) -> style.SeriesStyle:
    """Style of an architecture: that of its optimizer, or of the criterion of a design.

    Designs of the paper's searches are hollow.
    """
    if not each["method"]:
        return style.optimizer_style(each["architecture"])
    objective = "chance" if each["method"] == "chance" else each["objective"]
    return _criterion(objective)._replace(filled=each["method"] not in _SEARCHED)


def tracking_errors(tracking: pd.DataFrame) -> pd.Series:
    """Position errors by scenario and architecture: geometric mean over all targets, km.

    They come from ``tables/tracking.csv``: the first estimator, the settings of the configuration,
    and the number of targets and interval that most architectures have.
    """
    own = tracking[
        (tracking["quantity"] == "rmse_geometric_all")
        & (tracking["part"] == "position")
        & (tracking["unit"] == "km")
        & (tracking["variant"].astype(object).fillna("") == "")
    ]
    own = own[own["estimator"] == own["estimator"].iloc[0]] if len(own) else own
    kinds = own.groupby(["targets", "interval_minutes"], sort=False)
    cells = max((cells for _, cells in kinds), key=len, default=own)
    return cells.set_index(["scenario", "architecture"])["mean"]


@style.house_style()
def objectives_figure(
    tables: Mapping[str, pd.DataFrame], tracking: pd.DataFrame | None = None
) -> Figure:
    """Draw the fronts of every scenario with their bounds, and all architectures in one plane.

    There is a row of panels for each table ``tables/objectives_{scenario}.csv``, without panels for
    objectives that have no front. Architectures are colored by their tracking errors if
    `tracking`, the table ``tables/tracking.csv``, is given.
    """
    whole = pd.concat([table.assign(shown=name) for name, table in tables.items()])
    texts = {key: whole[key].astype(object).fillna("") for key in ("front", "method")}
    # a table of shares only is read with units that are numbers
    units = whole["unit"].astype(str).str.removesuffix(".0")
    whole = whole.assign(**texts, unit=units)
    errors = pd.Series(dtype=float) if tracking is None else tracking_errors(tracking)
    at = pd.MultiIndex.from_frame(whole[["shown", "architecture"]])
    whole["error"] = errors.reindex(at).to_numpy() if len(errors) else np.nan
    fronts = _fronts_of(whole)
    handles = _handles(fronts, whole[whole["front"] == ""])
    colors = _colors(whole["error"].to_numpy(dtype=float))
    foot = 0.68 + 0.15 * -(-len(handles) // 3) + _BAR_IN * (colors is not None)
    width = (style.PAGE_WIDTH_IN - _LEFT - _RIGHT - 2 * _GAP) / 3
    grid = Grid(len(tables), 3, width, _ROW_IN, _LEFT, foot, _GAP, _BETWEEN_IN)
    figure = style.new_figure(_HEAD_IN + grid.size[1] + foot)
    number = 0
    for row, scenario in enumerate(tables):
        own = whole[whole["shown"] == scenario]
        # J is no share
        on_fronts = own[(own["front"] != "") & (own["objective"] != "J")]
        kinds = [(on_fronts[on_fronts["unit"] == unit], label)
                 for unit, label in (("1", _SHARE), ("nat", _INFORMATION))]  # fmt: skip
        column = 0
        for drawn, label in kinds:
            if drawn.empty:
                continue
            axes = grid.place(figure, row, column)
            _fronts(axes, drawn, fronts)
            axes.set(xlabel=_SATELLITES, ylabel=label)
            axes.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True, steps=[1, 2, 5, 10]))
            if label == _SHARE:
                axes.yaxis.set_major_formatter(PercentFormatter(xmax=1.0, symbol=""))
            panel_title(axes, number, f"Scenario {scenario}")
            number, column = number + 1, column + 1
        axes = grid.place(figure, row, column)
        panel_title(axes, number, f"Scenario {scenario}, architectures")
        number += 1
        _plane(axes, own, fronts, colors)
    note = "Information is per target and day. Numbers: satellites, where there is room."
    hollow = whole["method"].isin(_SEARCHED).any()
    note += " Hollow markers: found by the paper's searches." * bool(hollow)
    top = note_below(figure, note)
    legend_below(figure, handles, top, ncols=3, handlelength=2.6)
    if colors is not None:
        _color_bar(figure, colors, foot - 0.46)
    return figure


def _fronts(axes: Axes, table: pd.DataFrame, fronts: Mapping[str, style.SeriesStyle]) -> None:
    """Draw values of fronts by number of satellites, with the room below their bounds."""
    for name, series in fronts.items():
        own = table[table["front"] == name].sort_values("satellites")
        at, value = own["satellites"].to_numpy(), own["value"].to_numpy()
        axes.plot(at, value, zorder=3, **series.line_kwargs())
        axes.fill_between(at, value, own["bound"].to_numpy(), color=series.color, alpha=0.2, lw=0)


def _colors(errors: NDArray[np.float64]) -> ScalarMappable | None:
    """Colors of errors, on a logarithmic scale; None if there are none."""
    known = errors[np.isfinite(errors)]
    if known.size == 0:
        return None
    return ScalarMappable(LogNorm(0.95 * known.min(), 1.05 * known.max()), "viridis_r")


def _color_bar(figure: Figure, colors: ScalarMappable, top_in: float) -> None:
    """Draw the bar of the colors of tracking errors above the legend."""
    axes = place(figure, 0.5 * style.PAGE_WIDTH_IN - 1.2, top_in - 0.12, 2.4, 0.09)
    bar = figure.colorbar(colors, cax=axes, orientation="horizontal")
    log_ticks(bar.ax.xaxis, *colors.get_clim())
    bar.ax.tick_params(labelsize=6.5, pad=1)
    text = "color of markers: position RMSE of all targets, geometric mean, km"
    bar.ax.set_xlabel(text, fontsize=7.0, labelpad=2)


def _plane(
    axes: Axes,
    table: pd.DataFrame,
    fronts: Mapping[str, style.SeriesStyle],
    colors: ScalarMappable | None,
) -> None:
    """Draw orbit information against coverage: fronts as lines, architectures as markers."""
    for name, series in fronts.items():
        own = table[table["front"] == name].sort_values("satellites")
        x, y = own["union_coverage"].to_numpy(), own["information_nat"].to_numpy()
        dot = {"marker": ".", "markersize": 2.5}
        axes.plot(x, y, linewidth=0.8, zorder=2, **series.line_kwargs(), **dot)
    singles = table[table["front"] == ""]
    by_chance = singles["method"] == "chance"
    for _, each in pd.concat([singles[by_chance], singles[~by_chance]]).iterrows():
        series = _style(each)
        drawn = series.point_kwargs(5.0) | {"zorder": 4}
        drawn |= {"markeredgecolor": series.color, "markeredgewidth": 0.7}
        if colors is not None and series.filled:
            known = np.isfinite(each["error"])
            drawn["markerfacecolor"] = colors.to_rgba(each["error"]) if known else "white"
        axes.plot(each["union_coverage"], each["information_nat"], **drawn)
    axes.xaxis.set_major_formatter(PercentFormatter(xmax=1.0, symbol=""))
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.set(xlabel=_COVERAGE, ylabel="orbit information, nat")
    axes.margins(0.09)
    _number(axes, singles[~by_chance], singles)


def _number(axes: Axes, table: pd.DataFrame, every: pd.DataFrame) -> None:
    """Write numbers of satellites beside markers, where they hide neither markers nor numbers.

    `every` holds all markers.
    """
    axes.autoscale_view()  # else the limits are set when all is drawn
    to_points = axes.transData + Affine2D().scale(72.0 / axes.figure.dpi)
    left, low, right, high = axes.bbox.extents * 72.0 / axes.figure.dpi

    def known(rows: pd.DataFrame) -> pd.DataFrame:
        return rows.dropna(subset=["union_coverage", "information_nat"])

    def places(rows: pd.DataFrame) -> NDArray[np.float64]:
        return to_points.transform(rows[["union_coverage", "information_nat"]].to_numpy(float))

    taken = [Bbox.from_extents(x - 3.0, y - 3.0, x + 3.0, y + 3.0) for x, y in places(known(every))]
    numbers = known(table)["satellites"].astype(int).astype(str)
    for at, text in zip(places(known(table)), numbers, strict=True):
        wide, tall = 3.4 * len(text), 5.0
        across, along = (4.0, -4.0 - wide, -0.5 * wide), (-2.5, 3.0, -8.0)
        for aside in [*product(across[:2], along), *product(across[2:], (4.5, -9.5))]:
            x, y = at + aside
            box = Bbox.from_bounds(x, y, wide, tall)
            inside = x > left and y > low and x + wide < right and y + tall < high
            if inside and not box.count_overlaps(taken):
                taken.append(box)
                axes.text(*to_points.inverted().transform((x, y + 0.8)), text, fontsize=5.5)
                break


def _handles(fronts: Mapping[str, style.SeriesStyle], singles: pd.DataFrame) -> list:
    """Legend entries: a line, a marker or both for what architectures are chosen by."""
    found: dict[str, Line2D] = {}
    markers = {}
    for _, each in singles.drop_duplicates("architecture").iterrows():
        series = _style(each)
        markers.setdefault(series.label, series._replace(filled=True))
    for series in fronts.values():
        found[series.label] = series.legend_handle()
        if series.label not in markers:
            found[series.label].set(marker="none")
    handles: list = list(found.values())
    if fronts:
        handles.append(Patch(facecolor=style.GRAY, alpha=0.35, label="up to the proven bound"))
    return handles + [
        series.legend_handle(line=False) for label, series in markers.items() if label not in found
    ]
