"""Heat maps of tracking: a row for each target, a block of columns for each cell."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from cislunar.campaign.settings.cells import Cell
from cislunar.evaluation.metrics import INCONSISTENT, NEVER_OBSERVED
from cislunar.figures.axes import (
    Array,
    fixed_ticks,
    legend_below,
    place,
    tick_names,
    title_above,
)
from cislunar.figures.labels import (
    PARTS,
    architecture_text,
    capitalized,
    interval_text,
    observers_text,
    realization_text,
    shown,
    target_text,
)
from cislunar.figures.style import (
    BLACK,
    PAGE_WIDTH_IN,
    VERMILION,
    house_style,
    new_figure,
    panel_letter,
)

UNSEEN = "#B5B5B5"
"""Rows of targets that are never observed; in none of the color maps."""

MEASURES = {
    "coverage": "time within 3\N{GREEK SMALL LETTER SIGMA}",
    "anees": "component-wise ANEES",
    "rmse": "RMSE",
}
_MOST_DECADES = 3.0

_RIGHT, _ASIDE = 0.14, 0.14
_LETTER_IN, _LONGEST = 0.043, 42
"""Width of a letter of a target's name; longer names are cut."""
_MARKS_IN, _GAP = 0.11, 0.04
_HEAD, _GROUP_HEAD, _HEADING_IN, _COLUMNS_FOOT = 0.3, 0.34, 0.18, 0.5
_BARS_IN, _LEGEND_IN = 0.74, 0.26
_MAPS_IN, _ROW_RANGE_IN = 7.0, (0.065, 0.115)


class Rows(NamedTuple):
    """A measure of a cell, one row for each target of the table.

    `values`, shape (row, 12), are NaN for targets that the cell does not monitor and for those
    never observed, which `unseen`, shape (row,), marks; `inconsistent`, shape (2, row), is of
    rotation and translation. No row from `last` on is the cell's.
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
            name = target_text(cell, index)
            short = (
                name if len(name) <= _LONGEST else f"\N{HORIZONTAL ELLIPSIS}{name[1 - _LONGEST :]}"
            )
            found.setdefault(int(identity), short)
    return found


def block_rows(cell: xr.Dataset, measure: str, table: Sequence[int]) -> Rows:
    """A measure of a cell: ``coverage``, ``anees`` (its decimal logarithm) or ``rmse``.

    `table` holds the identities of the targets in the rows.
    """
    row = {identity: number for number, identity in enumerate(table)}
    at = [row[int(identity)] for identity in cell["target_id"].values]
    own = shown(cell, measure).astype(float)
    if measure == "anees":
        with np.errstate(divide="ignore"):
            own = np.log10(own)
    never = shown(cell, "status") == NEVER_OBSERVED
    own[never] = np.nan
    own[~np.isfinite(own)] = np.nan
    values, unseen = np.full((len(row), own.shape[1]), np.nan), np.zeros(len(row), dtype=bool)
    inconsistent = np.zeros((2, len(row)), dtype=bool)
    values[at], unseen[at] = own, never
    for which, name in enumerate(("rotation", "translation")):
        inconsistent[which, at] = shown(cell, f"status_{name}") == INCONSISTENT
    return Rows(values, unseen, inconsistent, max(at) + 1)


class Scale(NamedTuple):
    """Colors of one or three columns of a measure: of all parts, or of one part."""

    columns: slice
    cmap: str
    norm: Normalize
    extend: str
    label: str


def _extend(values: Array, norm: Normalize) -> str:
    """At which ends values lie outside the colors."""
    low, high = (values < norm.vmin).any(), (values > norm.vmax).any()
    return {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[int(low), int(high)]


def scales(measure: str, maps: Sequence[Rows]) -> list[Scale]:
    """Colors of a measure, common to all its maps: one scale for all components.

    For the RMSE one for each part of the state, since their units differ.
    """
    values = np.concatenate([each.values for each in maps])
    everything = slice(0, values.shape[1])
    if measure == "coverage":
        label = "share of time, %"
        return [Scale(everything, "viridis", Normalize(0.0, 100.0), "neither", label)]
    if measure == "anees":
        reach = np.nanmax(np.abs(values), initial=1.0)
        reach = min(np.ceil(reach), _MOST_DECADES)
        norm = Normalize(-reach, reach)
        label = r"$\log_{10}$ ANEES (0: consistent)"
        return [Scale(everything, "PuOr_r", norm, _extend(values, norm), label)]
    return [
        _rmse_scale(part.columns, values[:, part.columns], f"{part.short}, {part.unit}")
        for part in PARTS
    ]


def _rmse_scale(columns: slice, values: Array, label: str) -> Scale:
    """Half decades that hold the values but for the outermost percent."""
    positive = values[np.isfinite(values) & (values > 0.0)]
    halves = 2.0 * np.log10(np.percentile(positive, (1.0, 99.0)) if positive.size else (0.1, 1.0))
    bottom = np.floor(halves[0])
    ends = (_half_decade(bottom), _half_decade(max(np.ceil(halves[1]), bottom + 1.0)))
    norm = LogNorm(*ends)
    return Scale(columns, "magma_r", norm, _extend(values, norm), label)


def _half_decade(half: float) -> float:
    """1 or 3 times a power of ten."""
    return float((3.0 if half % 2 else 1.0) * 10.0 ** (half // 2))


def _draw_map(axes: Axes, rows: Rows, colors: Sequence[Scale]) -> None:
    """A block: the measure, the targets never observed; white where none is monitored."""
    number, components = rows.last, rows.values.shape[1]
    lines = np.arange(number + 1)
    factor = 100.0 if colors[0].label.endswith("%") else 1.0
    for scale in colors:
        columns = np.arange(scale.columns.start, scale.columns.stop + 1)
        values = np.ma.masked_invalid(factor * rows.values[:number, scale.columns])
        axes.pcolormesh(
            columns, lines, values, cmap=scale.cmap, norm=scale.norm, rasterized=True, zorder=2
        )
    axes.set(xlim=(0, components), ylim=(number, 0))
    axes.grid(False)
    for row in np.flatnonzero(rows.unseen):
        axes.axhspan(row, row + 1, color=UNSEEN, linewidth=0, zorder=2)
        axes.plot([0, components], [row + 0.5] * 2, **_UNSEEN_LINE)
    for part in PARTS[1:]:
        axes.axvline(part.columns.start, color="white", linewidth=0.8, zorder=3)
    axes.set_xticks([part.columns.start + 1.5 for part in PARTS],
                    ["ang. vel." if part.stacked != part.name else part.name for part in PARTS],
                    rotation=90, fontsize=5.6)  # fmt: skip
    axes.tick_params(length=0, pad=2, labelleft=False)


def _mark_inconsistent(axes: Axes, rows: Rows) -> None:
    """Marks beside the rows of inconsistent targets."""
    for which, (mark, points) in enumerate(zip(_MARKS, (2.4, 5.6), strict=True)):
        for row in np.flatnonzero(rows.inconsistent[which]):
            shift = points / 72.0 / (axes.get_position().width * PAGE_WIDTH_IN)
            axes.plot(1.0 + shift, row + 0.5, transform=axes.get_yaxis_transform(),
                      clip_on=False, **mark)  # fmt: skip


_UNSEEN_LINE = {"color": BLACK, "linestyle": (0, (2.0, 2.0)), "zorder": 4, "linewidth": 0.4}
_MARKS = tuple(
    {
        "linestyle": "none",
        "marker": marker,
        "markersize": 2.4,
        "color": color,
        "markeredgewidth": width,
        "zorder": 6,
    }
    for marker, color, width in (("<", VERMILION, 0.0), ("x", BLACK, 0.6))
)


def _draw_bars(figure: Figure, left_in: float, width_in: float, colors: Sequence[Scale]) -> None:
    """Color bars of a measure below its maps, two side by side where there are several."""
    columns = min(len(colors), 2)
    wide = (width_in - 0.3 * (columns - 1)) / columns
    for index, scale in enumerate(colors):
        row, column = divmod(index, columns)
        left = left_in + column * (wide + 0.3)
        bottom = _LEGEND_IN + _BARS_IN - 0.24 - 0.38 * row
        axes = place(figure, left + 0.05, bottom, wide - 0.1, 0.07)
        mappable = ScalarMappable(norm=scale.norm, cmap=scale.cmap)
        bar = figure.colorbar(mappable, cax=axes, extend=scale.extend, orientation="horizontal")
        bar.outline.set_linewidth(0.5)
        if columns > 1:
            ends = np.array([scale.norm.vmin, scale.norm.vmax])
            fixed_ticks(bar.ax.xaxis, ends, tick_names(ends))
        else:
            bar.ax.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        bar.ax.tick_params(labelsize=5.8, length=1.5, pad=1.0)
        bar.ax.set_title(scale.label, fontsize=5.8, pad=2.0)


def _marks_legend(figure: Figure, maps: Sequence[Rows]) -> None:
    """What is marked in the maps."""
    unseen = Patch(facecolor=UNSEEN, label="never observed (broken line)")
    names = ("rotation inconsistent", "translation inconsistent")
    used = [np.any([each.inconsistent[which].any() for each in maps]) for which in range(2)]
    handles = [unseen] if any(each.unseen.any() for each in maps) else []
    handles += [
        Line2D([], [], label=name, **{**mark, "markersize": 4.5})
        for name, mark, present in zip(names, _MARKS, used, strict=True)
        if present
    ]
    if handles:
        legend_below(figure, handles, 0.06, columnspacing=1.6)


class _Group(NamedTuple):
    """Cells side by side: what they share, their data by label, their targets, a row's height."""

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
    """Measures side by side, each with a block for every cell; groups of cells below each other.

    A group has a heading and its cells by their labels. Colors are common to all groups. The row's
    height lets the names of the targets be read as long as there are not too many.
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
    figure = new_figure(_HEAD + sum(heights) + _BARS_IN + _LEGEND_IN)
    title_above(figure, title)
    longest = max(len(name) for table in tables for name in table.values())
    margin = 0.14 + _LETTER_IN * max(longest, 18)
    wide = (PAGE_WIDTH_IN - margin - _RIGHT - _ASIDE * (len(measures) - 1)) / len(measures)
    every: list[Rows] = []
    for column, measure in enumerate(measures):
        left = margin + column * (wide + _ASIDE)
        maps = [
            [block_rows(cell, measure, list(group.table)) for cell in group.cells.values()]
            for group in drawn
        ]
        colors = scales(measure, [rows for each in maps for rows in each])
        top = figure.get_size_inches()[1] - _HEAD
        for number, (group, rows, height) in enumerate(zip(drawn, maps, heights, strict=True)):
            letter = panel_letter(number * len(measures) + column)
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
        _draw_bars(figure, left, wide, colors)
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
    """The blocks of a measure; the first measure has names of targets and marks of inconsistency.

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
    """Names of the targets, which end at the corner's left coordinate, inches."""
    page = figure.get_size_inches()
    size = min(5.6, 0.92 * 72.0 * group.row_in)
    for number, name in enumerate(group.table.values()):
        middle = corner[1] + group.height_in - (number + 0.5) * group.row_in
        at = (corner[0] / page[0], middle / page[1])
        figure.text(*at, name, fontsize=size, ha="right", va="center_baseline")


@house_style()
def target_counts_figure(columns: Sequence[Mapping[Cell, xr.Dataset]]) -> Figure:
    """Coverage, ANEES and RMSE of every target, in blocks by number of targets.

    `columns` are the cells of every group, without time histories; so they are for the others.
    """
    cell, data = next(iter(columns[0].items()))
    title = (
        f"{capitalized(observers_text(cell, data))} ({architecture_text(cell)}), tasking every "
        f"{interval_text(cell.interval_minutes)}; {realization_text(data)}"
    )
    groups = [("", {f"$n_T$ = {c.targets}": d for c, d in cells.items()}) for cells in columns]
    return _heat_maps(groups, list(MEASURES), title)


@house_style()
def intervals_figure(columns: Sequence[Mapping[Cell, xr.Dataset]]) -> Figure:
    """Coverage, ANEES and RMSE of every target, in blocks by tasking interval."""
    return _by_interval(columns, list(MEASURES))


@house_style()
def high_load_figure(columns: Sequence[Mapping[Cell, xr.Dataset]]) -> Figure:
    """ANEES and RMSE of every target, in blocks by tasking interval (Paul & Fan, figure 8)."""
    return _by_interval(columns, ["anees", "rmse"])


def _by_interval(columns: Sequence[Mapping[Cell, xr.Dataset]], measures: Sequence[str]) -> Figure:
    """Measures of every target, a group for each column of cells."""
    groups = []
    for cells in columns:
        cell, data = next(iter(cells.items()))
        heading = capitalized(f"{observers_text(cell, data)}, $n_T$ = {cell.targets}")
        groups.append((heading, {interval_text(c.interval_minutes): d for c, d in cells.items()}))
    cell, data = next(iter(columns[0].items()))
    title = (
        f"{capitalized(architecture_text(cell))}; blocks by tasking interval $T_{{ST}}$; "
        f"{realization_text(data)}"
    )
    return _heat_maps(groups, measures, title)
