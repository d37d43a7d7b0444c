"""Heat maps of tracking: a row for each target, a block of columns for each cell."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cislunar.campaign.settings.cells import Cell
from cislunar.evaluation.metrics import INCONSISTENT, NEVER_OBSERVED
from cislunar.figures import labels, style
from cislunar.figures.axes import Array, legend_below, place, title_above
from cislunar.figures.labels import PARTS
from cislunar.figures.tracking.heatmap_colors import MEASURES, Scale, draw_bars, scales

UNSEEN = "#B5B5B5"
"""Color of targets that are never observed; in none of the color maps."""

_RIGHT, _ASIDE = 0.14, 0.14
_LETTER_IN, _LONGEST = 0.043, 42
"""Width of a letter of a target's name; longer names are cut."""
_MARKS_IN, _GAP = 0.11, 0.04
_HEAD, _GROUP_HEAD, _HEADING_IN, _COLUMNS_FOOT = 0.46, 0.34, 0.18, 0.5
_BARS_IN, _LEGEND_IN = 0.78, 0.26
_MAPS_IN, _ROW_RANGE_IN = 7.0, (0.065, 0.115)


class Rows(NamedTuple):
    """A measure of a cell, one row for each target of the table.

    `values`, shape (row, 12), are NaN for targets that the cell does not monitor and for those
    never observed, which `unseen`, shape (row,), marks; `inconsistent`, shape (2, row), is of
    rotation and translation. Rows from `last` on are not of the cell.
    """

    values: Array
    unseen: Array
    inconsistent: Array
    last: int


def target_rows(cells: Sequence[xr.Dataset]) -> dict[int, str]:
    """Names of the targets of any cell by identity, in order of appearance."""
    found: dict[int, str] = {}
    for cell in cells:
        for index, identity in enumerate(cell["target_id"].values):
            name = labels.target_text(cell, index)
            if len(name) > _LONGEST:
                name = f"\N{HORIZONTAL ELLIPSIS}{name[1 - _LONGEST :]}"
            found.setdefault(int(identity), name)
    return found


def block_rows(cell: xr.Dataset, measure: str, table: Sequence[int]) -> Rows:
    """A measure of a cell: ``outside`` in %, ``anees``, or ``rmse`` in practical units.

    `table` holds the identities of the targets in the rows.
    """
    row = {identity: number for number, identity in enumerate(table)}
    at = [row[int(identity)] for identity in cell["target_id"].values]
    if measure == "outside":
        own = 100.0 * (1.0 - labels.shown(cell, "coverage").astype(float))
    else:
        own = labels.shown(cell, measure).astype(float)
    if measure == "rmse":
        own = own * np.repeat([part.factor for part in PARTS], 3)
    never = labels.shown(cell, "status") == NEVER_OBSERVED
    own[never] = np.nan
    own[~np.isfinite(own)] = np.nan
    values, unseen = np.full((len(row), own.shape[1]), np.nan), np.zeros(len(row), dtype=bool)
    inconsistent = np.zeros((2, len(row)), dtype=bool)
    values[at], unseen[at] = own, never
    for which, name in enumerate(("rotation", "translation")):
        inconsistent[which, at] = labels.shown(cell, f"status_{name}") == INCONSISTENT
    return Rows(values, unseen, inconsistent, max(at) + 1)


def _draw_map(axes: Axes, rows: Rows, colors: Sequence[Scale]) -> None:
    """Draw a block: the measure; gray for targets never observed, white for those not monitored."""
    number, components = rows.last, rows.values.shape[1]
    lines = np.arange(number + 1)
    for scale in colors:
        columns = np.arange(scale.columns.start, scale.columns.stop + 1)
        values = np.ma.masked_invalid(rows.values[:number, scale.columns])
        colored = {"cmap": scale.cmap, "norm": scale.norm, "rasterized": True, "zorder": 2}
        axes.pcolormesh(columns, lines, values, **colored)
    axes.set(xlim=(0, components), ylim=(number, 0))
    axes.grid(False)
    for row in np.flatnonzero(rows.unseen):
        axes.axhspan(row, row + 1, color=UNSEEN, linewidth=0, zorder=2)
        axes.plot([0, components], [row + 0.5] * 2, **_UNSEEN_LINE)
    for part in PARTS[1:]:
        axes.axvline(part.columns.start, color=_BETWEEN_PARTS, linewidth=0.8, zorder=3)
    names = ["ang. vel." if part.name == "angular velocity" else part.name for part in PARTS]
    axes.set_xticks([part.columns.start + 1.5 for part in PARTS], names, rotation=90, fontsize=5.6)
    axes.tick_params(length=0, pad=2, labelleft=False)


def _mark_inconsistent(axes: Axes, rows: Rows) -> None:
    """Draw marks beside the rows of inconsistent targets."""
    for which, (mark, points) in enumerate(zip(_MARKS, (2.4, 5.6), strict=True)):
        for row in np.flatnonzero(rows.inconsistent[which]):
            shift = points / 72.0 / (axes.get_position().width * style.PAGE_WIDTH_IN)
            axes.plot(1.0 + shift, row + 0.5, transform=axes.get_yaxis_transform(),
                      clip_on=False, **mark)  # fmt: skip


_BETWEEN_PARTS = "#777777"
_UNSEEN_LINE = {"color": style.BLACK, "linestyle": (0, (2.0, 2.0)), "zorder": 4, "linewidth": 0.4}
_MARKS = tuple(
    {"linestyle": "none", "marker": marker, "markersize": 2.4, "color": color,
     "markeredgewidth": width, "zorder": 6}
    for marker, color, width in (("<", style.VERMILION, 0.0), ("x", style.BLACK, 0.6))
)  # fmt: skip


def _marks_legend(figure: Figure, maps: Sequence[Rows]) -> None:
    """Draw a legend of the marks that the maps have."""
    unseen = Patch(facecolor=UNSEEN, label="never observed")
    handles: list = [unseen] if any(each.unseen.any() for each in maps) else []
    for which, name in enumerate(("rotation inconsistent", "translation inconsistent")):
        if any(each.inconsistent[which].any() for each in maps):
            handles.append(Line2D([], [], label=name, **_MARKS[which] | {"markersize": 4.5}))
    if handles:
        legend_below(figure, handles, 0.06, columnspacing=1.6)


class _Group(NamedTuple):
    """Cells side by side: common heading, data by label, targets, height of a row."""

    heading: str
    cells: dict[str, xr.Dataset]
    table: dict[int, str]
    row_in: float

    @property
    def height_in(self) -> float:
        """Height of the maps."""
        return self.row_in * len(self.table)


def _heat_maps(
    groups: Sequence[tuple[str, Mapping[str, xr.Dataset]]], measures: Sequence[str], title: str
) -> Figure:
    """Draw measures side by side, with a block for every cell; groups stand below each other.

    A group has a heading and its cells by label. Colors are common to all groups. Rows are as high
    as the names of the targets need, if the page permits.
    """
    tables = [target_rows(list(cells.values())) for _, cells in groups]
    row_in = float(np.clip(_MAPS_IN / sum(map(len, tables)), *_ROW_RANGE_IN))
    drawn = [
        _Group(heading, dict(cells), table, row_in)
        for (heading, cells), table in zip(groups, tables, strict=True)
    ]
    heights = [
        _HEADING_IN * bool(group.heading) + _GROUP_HEAD + group.height_in + _COLUMNS_FOOT
        for group in drawn
    ]
    figure = style.new_figure(_HEAD + sum(heights) + _BARS_IN + _LEGEND_IN)
    title_above(figure, f"{title}; rows: targets; columns: x, y, z of every part of the state")
    longest = max(len(name) for table in tables for name in table.values())
    margin = 0.14 + _LETTER_IN * max(longest, 18)
    wide = (style.PAGE_WIDTH_IN - margin - _RIGHT - _ASIDE * (len(measures) - 1)) / len(measures)
    every: list[Rows] = []
    for column, measure in enumerate(measures):
        left = margin + column * (wide + _ASIDE)
        maps = [
            [block_rows(cell, measure, list(group.table)) for cell in group.cells.values()]
            for group in drawn
        ]
        colors = scales(measure, np.concatenate([rows.values for each in maps for rows in each]))
        top = figure.get_size_inches()[1] - _HEAD
        for number, (group, rows, height) in enumerate(zip(drawn, maps, heights, strict=True)):
            letter = style.panel_letter(number * len(measures) + column)
            foot = top - height + _COLUMNS_FOOT
            _draw_group(figure, group, rows, colors, (left, foot, wide), first=column == 0)
            above = foot + group.height_in + 0.18
            text = f"{letter} {MEASURES[measure]}"
            page = figure.get_size_inches()
            figure.text(left / page[0], above / page[1], text, fontsize=7.5, va="bottom")
            if column == 0:
                at = (0.14 / page[0], (above + 0.16) / page[1])
                figure.text(*at, group.heading, fontsize=7.5, va="bottom")
            top -= height
            every += rows
        draw_bars(figure, (left, _LEGEND_IN + 0.36), wide, colors)
    _marks_legend(figure, every)
    return figure


def _draw_group(
    figure: Figure,
    group: _Group,
    maps: Sequence[Rows],
    colors: Sequence[Scale],
    box: tuple[float, float, float],
    *,
    first: bool,
) -> None:
    """Draw the blocks of a measure; the `first` one has names of targets and marks.

    `box` is the lower left corner and the width of all blocks, inches.
    """
    left, foot, width = box
    gap = _MARKS_IN if first else _GAP
    each = width / len(maps) - gap
    for number, (label, rows) in enumerate(zip(group.cells, maps, strict=True)):
        tall = group.row_in * rows.last
        bottom = foot + group.height_in - tall
        axes = place(figure, left + number * (each + gap), bottom, each, tall)
        axes.set_title(label, fontsize=6.5, pad=2.5)
        _draw_map(axes, rows, colors)
        if first:
            _mark_inconsistent(axes, rows)
    if first:
        _name_rows(figure, group, (left - 0.03, foot))


def _name_rows(figure: Figure, group: _Group, corner: tuple[float, float]) -> None:
    """Write the names of the targets, which end at the left coordinate of the corner, inches."""
    page = figure.get_size_inches()
    size = min(5.6, 0.92 * 72.0 * group.row_in)
    for number, name in enumerate(group.table.values()):
        middle = corner[1] + group.height_in - (number + 0.5) * group.row_in
        at = (corner[0] / page[0], middle / page[1])
        figure.text(*at, name, fontsize=size, ha="right", va="center_baseline")


@style.house_style()
def target_counts_figure(cells: Sequence[tuple[Cell, xr.Dataset]]) -> Figure:
    """Time outside 3 sigma, ANEES and RMSE of every target, in blocks by number of targets.

    The data sets of the `cells` have no time histories, here and in the figure below.
    """
    cell, data = cells[0]
    title = (
        f"{labels.observers_text(cell, data)}, tasking every "
        f"{labels.interval_text(cell.interval_minutes)}; {labels.realization_text(data)}\n"
        "Blocks: number of targets"
    )
    return _heat_maps([("", {f"{c.targets}": d for c, d in cells})], list(MEASURES), title)


@style.house_style()
def intervals_figure(
    cells: Sequence[tuple[Cell, xr.Dataset]], measures: Sequence[str] = tuple(MEASURES)
) -> Figure:
    """Measures of every target (keys of `MEASURES`), a group for each scenario and number of
    targets, in blocks by tasking interval (Paul & Fan, figures 7 and 8)."""
    groups: dict[tuple[str, int], tuple[str, dict[str, xr.Dataset]]] = {}
    for cell, data in cells:
        heading = f"{labels.observers_text(cell, data, architecture=False)}, {cell.targets} targets"
        _, blocks = groups.setdefault((cell.scenario, cell.targets), (heading, {}))
        blocks[labels.interval_text(cell.interval_minutes)] = data
    cell, data = cells[0]
    architecture = labels.architecture_label(cell.architecture)
    title = f"Architecture: {architecture}; {labels.realization_text(data)}\n"
    title += "Blocks: tasking interval"
    return _heat_maps(list(groups.values()), measures, title)
