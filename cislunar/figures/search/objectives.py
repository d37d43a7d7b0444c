"""Figure of the objectives: what each number of satellites reaches, and coverage against orbits."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, PercentFormatter

from cislunar.figures.axes import Grid, legend_below, panel_title
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
_DESIGN_MARKERS = "^vPXhD"
_LEFT, _RIGHT, _GAP = 0.55, 0.08, 0.55
_ROW_IN, _BETWEEN_IN, _HEAD_IN = 1.75, 0.72, 0.34
_LABELS = "number of satellites", "target-hours seen, %"


def _looks(names: Sequence[str]) -> dict[str, SeriesStyle]:
    """How fronts are drawn, in the order of their names."""
    return {
        name: SeriesStyle(name, *_LOOKS[k % len(_LOOKS)], "o", filled=False)
        for k, name in enumerate(names)
    }


def _marker(name: str, objective: str, designs: Sequence[str]) -> SeriesStyle:
    """How an architecture is drawn; designs have no color of their own."""
    if objective == "J":
        return optimizer_style(name)
    marker = _DESIGN_MARKERS[list(designs).index(name) % len(_DESIGN_MARKERS)]
    return SeriesStyle(name, GRAY, SOLID, marker)


@house_style()
def objectives_figure(tables: Mapping[str, pd.DataFrame]) -> Figure:
    """Fronts of every scenario with their bounds, and all architectures in one plane.

    From ``tables/objectives_{scenario}.csv`` by scenario: a row of panels for each.
    """
    whole = pd.concat([table.assign(shown=name) for name, table in tables.items()])
    whole = whole.assign(front=whole["front"].astype(object).fillna(""))
    fronts = _looks(list(dict.fromkeys(whole.loc[whole["front"] != "", "front"])))
    singles = whole[whole["front"] == ""].drop_duplicates("architecture")
    designs = list(singles.loc[singles["objective"] != "J", "architecture"])
    handles = _handles(fronts, singles, designs)
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
            _fronts(axes, own[own["unit"] == unit], fronts)
            axes.set_xlabel(_LABELS[0])
            axes.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True, steps=[1, 2, 5, 10]))
        panels[0].yaxis.set_major_formatter(PercentFormatter(xmax=1.0, symbol=""))
        panels[0].set_ylabel("value of the objective, %")
        panels[1].set_ylabel("per target and day, nat")
        panel_title(panels[2], 3 * row + 2, f"Scenario {scenario}")
        _plane(panels[2], own, fronts, designs)
    legend_below(figure, handles, 0.06, ncols=4, handlelength=2.4)
    return figure


def _fronts(axes: Axes, table: pd.DataFrame, looks: Mapping[str, SeriesStyle]) -> None:
    """Values of fronts by number of satellites, with the room below their bounds."""
    for name, look in looks.items():
        own = table[table["front"] == name].sort_values("satellites")
        at, value = own["satellites"].to_numpy(), own["value"].to_numpy()
        axes.plot(at, value, color=look.color, linestyle=look.line, zorder=3)
        axes.fill_between(at, value, own["bound"].to_numpy(), color=look.color, alpha=0.2, lw=0)


def _plane(
    axes: Axes, table: pd.DataFrame, looks: Mapping[str, SeriesStyle], designs: Sequence[str]
) -> None:
    """Orbit information against coverage: fronts as lines, architectures as markers."""
    for name, look in looks.items():
        own = table[table["front"] == name].sort_values("satellites")
        x, y = own["union_coverage"].to_numpy(), own["information_nat"].to_numpy()
        line = {"color": look.color, "linestyle": look.line, "marker": ".", "markersize": 2.5}
        axes.plot(x, y, linewidth=0.8, zorder=2, **line)
    for _, each in table[table["front"] == ""].iterrows():
        look = _marker(each["architecture"], each["objective"], designs)
        at = each["union_coverage"], each["information_nat"]
        axes.plot(*at, linestyle="none", color=look.color, zorder=4, **look.marker_kwargs(5.0))
        if np.isfinite(at[1]):
            axes.annotate(
                f"{int(each['satellites'])}", at, xytext=(3, 2), textcoords="offset points",
                fontsize=5.5,
            )  # fmt: skip
    axes.xaxis.set_major_formatter(PercentFormatter(xmax=1.0, symbol=""))
    axes.set_xlabel(_LABELS[1])
    axes.set_ylabel("orbit information, nat")


def _handles(
    fronts: Mapping[str, SeriesStyle], singles: pd.DataFrame, designs: Sequence[str]
) -> list:
    found: list = [
        Line2D([], [], color=look.color, linestyle=look.line, label=name)
        for name, look in fronts.items()
    ]
    if fronts:
        found.append(Patch(facecolor=GRAY, alpha=0.35, label="up to the proven bound"))
    for name, objective in zip(singles["architecture"], singles["objective"], strict=True):
        found.append(_marker(name, objective, designs).legend_handle(line=False))
    return found
