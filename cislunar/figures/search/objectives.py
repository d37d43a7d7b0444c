"""Figure of the objectives: what each number of satellites reaches, and coverage against orbits."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, PercentFormatter
from numpy.typing import NDArray

from cislunar.figures.axes import Grid, legend_below, log_ticks, note_empty, panel_title
from cislunar.figures.style import (
    BLACK,
    BLUE,
    DASH_DOT,
    DASHED,
    DOTTED,
    GRAY,
    GREEN,
    PAGE_WIDTH_IN,
    PURPLE,
    SOLID,
    VERMILION,
    SeriesStyle,
    house_style,
    new_figure,
    optimizer_style,
)

_LOOKS = (
    (GREEN, SOLID), (BLUE, DASHED), (VERMILION, DASH_DOT), (PURPLE, DOTTED), (BLACK, DASHED),
)  # fmt: skip
_MARKERS = {
    "coverage": "^", "target-days": "<", "longest-gap": ">", "mean-gap": "8", "mean-wait": "H",
    "information": "v", "attitude": "P", "J": "X", "chance": ".",
}  # fmt: skip
_SEARCHES = {"tpe": "TPE", "random": "random search", "certified": ""}
_LEFT, _RIGHT, _GAP = 0.55, 0.08, 0.55
_ROW_IN, _BETWEEN_IN, _HEAD_IN = 1.75, 0.72, 0.34
_LABELS = "number of satellites", "target-hours seen, %"


def _looks(names: Sequence[str]) -> dict[str, SeriesStyle]:
    """How fronts are drawn, in the order of their names."""
    return {
        name: SeriesStyle(name, *_LOOKS[k % len(_LOOKS)], "o", filled=False)
        for k, name in enumerate(names)
    }


def _marker(each: pd.Series) -> SeriesStyle:
    """How an architecture is drawn: a design by its objective, hollow if the paper's search did."""
    name, objective, method = (each[key] for key in ("architecture", "objective", "method"))
    if not method:
        return optimizer_style(name)
    by = "by chance" if method == "chance" else f"by {objective}"
    search = _SEARCHES.get(method)
    label = f"{by}, {search}" if search else by
    marker = "s" if method == "random" else _MARKERS.get(objective, "d")
    return SeriesStyle(label, GRAY, SOLID, marker, filled=not search)


def tracking_errors(tracking: pd.DataFrame) -> pd.Series:
    """Position errors by scenario and architecture: geometric mean over all targets, km.

    From ``tables/tracking.csv``: by the first estimator, with the settings of the configuration, in
    the kind of cell that most architectures have.
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


@house_style()
def objectives_figure(
    tables: Mapping[str, pd.DataFrame], errors: pd.Series | None = None
) -> Figure:
    """Fronts of every scenario with their bounds, and all architectures in one plane.

    From ``tables/objectives_{scenario}.csv`` by scenario: a row of panels for each. With `errors`
    of `tracking_errors` architectures are coloured by how well they track.
    """
    whole = pd.concat([table.assign(shown=name) for name, table in tables.items()])
    texts = {key: whole[key].astype(object).fillna("") for key in ("front", "method")}
    # a table of shares alone is read with units that are numbers
    units = whole["unit"].astype(str).str.removesuffix(".0")
    whole = whole.assign(**texts, unit=units)
    errors = pd.Series(dtype=float) if errors is None else errors
    at = pd.MultiIndex.from_frame(whole[["shown", "architecture"]])
    whole["error"] = errors.reindex(at).to_numpy() if len(errors) else np.nan
    fronts = _looks(list(dict.fromkeys(whole.loc[whole["front"] != "", "front"])))
    singles = whole[whole["front"] == ""].drop_duplicates("architecture")
    handles = _handles(fronts, singles)
    colors = _colors(whole["error"].to_numpy(dtype=float))
    foot = 0.5 + 0.16 * -(-len(handles) // 4)
    width = (PAGE_WIDTH_IN - _LEFT - _RIGHT - 2 * _GAP) / 3
    grid = Grid(len(tables), 3, width, _ROW_IN, _LEFT, foot, _GAP, _BETWEEN_IN)
    figure = new_figure(_HEAD_IN + grid.size[1] + foot)
    for row, scenario in enumerate(tables):
        own = whole[whole["shown"] == scenario]
        panels = [grid.place(figure, row, column) for column in range(3)]
        for column, (axes, unit) in enumerate(zip(panels, ("1", "nat"), strict=False)):
            kind = "share" if unit == "1" else "information"
            panel_title(axes, 3 * row + column, f"Scenario {scenario}, {kind}")
            # J is no share
            drawn = own[(own["unit"] == unit) & (own["objective"] != "J") & (own["front"] != "")]
            _fronts(axes, drawn, fronts)
            axes.set_xlabel(_LABELS[0])
            axes.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True, steps=[1, 2, 5, 10]))
            if drawn.empty:
                note_empty(axes, "no front")
                axes.set(xticks=[], yticks=[])
        panels[0].yaxis.set_major_formatter(PercentFormatter(xmax=1.0, symbol=""))
        panels[0].set_ylabel("value of the objective, %")
        panels[1].set_ylabel("per target and day, nat")
        panel_title(panels[2], 3 * row + 2, f"Scenario {scenario}")
        _plane(panels[2], own, fronts, colors)
    legend_below(figure, handles, 0.06, ncols=4, handlelength=2.4)
    return figure


def _fronts(axes: Axes, table: pd.DataFrame, looks: Mapping[str, SeriesStyle]) -> None:
    """Values of fronts by number of satellites, with the room below their bounds."""
    for name, look in looks.items():
        own = table[table["front"] == name].sort_values("satellites")
        at, value = own["satellites"].to_numpy(), own["value"].to_numpy()
        axes.plot(at, value, color=look.color, linestyle=look.line, zorder=3)
        axes.fill_between(at, value, own["bound"].to_numpy(), color=look.color, alpha=0.2, lw=0)


def _colors(errors: NDArray[np.float64]) -> ScalarMappable | None:
    """Colours of errors, on a logarithmic scale; None if there are none."""
    known = errors[np.isfinite(errors)]
    if known.size == 0:
        return None
    return ScalarMappable(LogNorm(0.95 * known.min(), 1.05 * known.max()), "viridis_r")


def _emptiest_corner(axes: Axes, table: pd.DataFrame) -> tuple[float, float]:
    """Where a bar of colours hides the fewest points of the plane, in shares of the axes."""
    axes.autoscale_view()  # else the limits are set when all is drawn
    points = table[["union_coverage", "information_nat"]].dropna().to_numpy()
    x, y = (axes.transData + axes.transAxes.inverted()).transform(points).T
    corners = [(0.55, 0.1), (0.05, 0.1), (0.05, 0.84), (0.55, 0.84)]
    hidden = [
        np.sum((abs(x - left - 0.2) < 0.25) & (abs(y - low - 0.02) < 0.14)) for left, low in corners
    ]
    return corners[int(np.argmin(hidden))]


def _plane(
    axes: Axes,
    table: pd.DataFrame,
    looks: Mapping[str, SeriesStyle],
    colors: ScalarMappable | None,
) -> None:
    """Orbit information against coverage: fronts as lines, architectures as markers."""
    for name, look in looks.items():
        own = table[table["front"] == name].sort_values("satellites")
        x, y = own["union_coverage"].to_numpy(), own["information_nat"].to_numpy()
        line = {"color": look.color, "linestyle": look.line, "marker": ".", "markersize": 2.5}
        axes.plot(x, y, linewidth=0.8, zorder=2, **line)
    singles = table[table["front"] == ""]
    by_chance = singles["method"] == "chance"
    for _, each in pd.concat([singles[by_chance], singles[~by_chance]]).iterrows():
        look = _marker(each)
        at = each["union_coverage"], each["information_nat"]
        drawn = look.marker_kwargs(5.0) | {"linestyle": "none", "color": look.color, "zorder": 4}
        if colors is not None and np.isfinite(each["error"]):
            filled = "markerfacecolor" if look.filled else "markeredgecolor"
            drawn[filled] = colors.to_rgba(each["error"])
        axes.plot(*at, **drawn)
        if np.isfinite(at[1]) and each["method"] != "chance":
            axes.annotate(
                f"{int(each['satellites'])}", at, xytext=(3, 2), textcoords="offset points",
                fontsize=5.5,
            )  # fmt: skip
    axes.xaxis.set_major_formatter(PercentFormatter(xmax=1.0, symbol=""))
    axes.set_xlabel(_LABELS[1])
    axes.set_ylabel("orbit information, nat")
    if colors is not None and np.isfinite(table["error"]).any():
        inside = axes.inset_axes((*_emptiest_corner(axes, table), 0.4, 0.04))
        bar = axes.figure.colorbar(colors, cax=inside, orientation="horizontal")
        log_ticks(bar.ax.xaxis, *colors.get_clim())
        bar.ax.set_title("position error, km", fontsize=5.5, pad=2)
        bar.ax.tick_params(labelsize=5.5, pad=1)


def _handles(fronts: Mapping[str, SeriesStyle], singles: pd.DataFrame) -> list:
    found: list = [
        Line2D([], [], color=look.color, linestyle=look.line, label=f"most {name}")
        for name, look in fronts.items()
    ]
    if fronts:
        found.append(Patch(facecolor=GRAY, alpha=0.35, label="up to the proven bound"))
    looks = dict.fromkeys(_marker(each) for _, each in singles.iterrows())
    return found + [look.legend_handle(line=False) for look in looks]
