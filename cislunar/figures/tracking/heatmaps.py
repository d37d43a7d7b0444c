"""Heat maps of tracking: a row for each target, a column for each component of the state."""

from collections.abc import Callable, Mapping, Sequence
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
from cislunar.evaluation.metrics import DIVERGED, NEVER_OBSERVED
from cislunar.figures.axes import (
    Array,
    fixed_ticks,
    legend_below,
    panel_title,
    place,
    tick_names,
    title_above,
)
from cislunar.figures.labels import (
    AXES,
    PARTS,
    architecture_text,
    capitalized,
    interval_text,
    observers_text,
    realization_text,
    shown,
)
from cislunar.figures.style import BLACK, VERMILION, house_style, new_figure

UNSEEN = "#B5B5B5"
"""Rows of targets that are never observed; in none of the color maps."""

_MAP_WIDTH_IN, _MAP_HEIGHT_IN = 2.36, 2.3
_LEFT, _GAP, _BARS = 0.62, 0.52, 1.34
_TITLE, _TICKS = 0.22, 0.44
_HEAD, _LEGEND = 0.6, 0.3
_LEAST_WIDTH_IN = 4.8

_MEASURES = {
    "coverage": "share of time within 3\N{GREEK SMALL LETTER SIGMA}",
    "anees": "component-wise ANEES",
    "rmse": "RMSE",
}
_MOST_DECADES = 3.0


class Rows(NamedTuple):
    """A measure of all blocks, one row for each target.

    `values`, shape (row, 12), are NaN for targets never observed, which `unseen`, shape (row,),
    marks; `diverged`, shape (2, row), is of rotation and translation. `edges` are the first row of
    every block, and the end.
    """

    values: Array
    unseen: Array
    diverged: Array
    edges: list[int]


def block_rows(blocks: Sequence[xr.Dataset], measure: str) -> Rows:
    """Stack a measure of cells: ``coverage``, ``anees`` (its decimal logarithm) or ``rmse``."""
    values = np.concatenate([shown(cell, measure) for cell in blocks]).astype(float)
    unseen = np.concatenate([shown(cell, "status") == NEVER_OBSERVED for cell in blocks])
    diverged = np.stack(
        [
            np.concatenate([shown(cell, f"status_{which}") == DIVERGED for cell in blocks])
            for which in ("rotation", "translation")
        ]
    )
    values[unseen] = np.nan
    if measure == "anees":
        with np.errstate(divide="ignore"):
            values = np.log10(values)
    values[~np.isfinite(values)] = np.nan
    edges = np.cumsum([0, *(cell.sizes["target"] for cell in blocks)])
    return Rows(values, unseen, diverged, [int(edge) for edge in edges])


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


def _draw_map(axes: Axes, rows: Rows, colors: Sequence[Scale], labels: Sequence[str]) -> None:
    """A heat map with its labelled blocks, the targets never observed and those that diverged."""
    number, components = rows.values.shape
    lines = np.arange(number + 1)
    factor = 100.0 if colors[0].label.endswith("%") else 1.0
    for scale in colors:
        columns = np.arange(scale.columns.start, scale.columns.stop + 1)
        values = np.ma.masked_invalid(factor * rows.values[:, scale.columns])
        axes.pcolormesh(
            columns, lines, values, cmap=scale.cmap, norm=scale.norm, rasterized=True, zorder=2
        )
    axes.set(xlim=(0, components), ylim=(number, 0), facecolor=UNSEEN)
    axes.grid(False)
    row_points = 72.0 * axes.get_window_extent().height / axes.get_figure().dpi / number
    line = {**_UNSEEN_LINE, "linewidth": min(0.5, 0.4 * row_points)}
    for row in np.flatnonzero(rows.unseen):
        axes.plot([0, components], [row + 0.5] * 2, **line)
    for part in PARTS[1:]:
        axes.axvline(part.columns.start, color="white", linewidth=1.2, zorder=3)
    for edge in rows.edges[1:-1]:
        axes.axhline(edge, color=BLACK, linewidth=1.4, zorder=5)
    for which, (mark, shift) in enumerate(zip(_MARKS, (0.35, 0.85), strict=True)):
        at = np.flatnonzero(rows.diverged[which])
        axes.plot(np.full(at.size, components + shift), at + 0.5, clip_on=False, **mark)
    _label_columns(axes)
    middles = np.convolve(rows.edges, [0.5, 0.5], mode="valid")
    axes.set_yticks(middles, labels, rotation=90, va="center", fontsize=6.5)
    axes.tick_params(length=0, pad=2)


_UNSEEN_LINE = {
    "color": BLACK,
    "linestyle": (0, (2.0, 2.0)),
    "zorder": 4,
}
_MARKS = tuple(
    {
        "linestyle": "none",
        "marker": marker,
        "markersize": 2.6,
        "color": color,
        "markeredgewidth": width,
        "zorder": 6,
    }
    for marker, color, width in (("<", VERMILION, 0.0), ("x", BLACK, 0.6))
)


def _label_columns(axes: Axes) -> None:
    """x, y, z below each column, the part of the state below three of them."""
    axes.set_xticks(np.arange(12) + 0.5, AXES * len(PARTS), fontsize=6.5)
    for part in PARTS:
        axes.annotate(
            part.stacked,
            ((part.columns.start + 1.5) / 12.0, 0.0),
            xycoords="axes fraction",
            xytext=(0, -11.5),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=6.5,
            linespacing=0.95,
        )


def _draw_bars(
    figure: Figure, left_in: float, bottom_in: float, height_in: float, colors: Sequence[Scale]
) -> None:
    """Color bars of a measure, one above the other."""
    several = len(colors) > 1
    above, below = (0.19, 0.05) if several else (0.0, 0.0)
    each = height_in / len(colors)
    for index, scale in enumerate(colors):
        bottom = bottom_in + height_in - (index + 1) * each + below
        axes = place(figure, left_in, bottom, 0.1, each - above - below)
        mappable = ScalarMappable(norm=scale.norm, cmap=scale.cmap)
        bar = figure.colorbar(mappable, cax=axes, extend=scale.extend, extendfrac=0.06)
        bar.outline.set_linewidth(0.5)
        if several:
            ends = np.array([scale.norm.vmin, scale.norm.vmax])
            fixed_ticks(bar.ax.yaxis, ends, tick_names(ends))
            bar.ax.set_title(scale.label, fontsize=6.0, loc="left", pad=6)
        else:
            bar.ax.yaxis.set_major_locator(MaxNLocator(5, integer=True))
            bar.set_label(scale.label)


def marks_legend(figure: Figure, maps: Sequence[Rows], bottom_in: float = 0.06) -> None:
    """What is marked in the maps."""
    unseen = Patch(facecolor=UNSEEN, label="never observed (broken line)")
    names = ("rotation diverged", "translation diverged")
    used = [np.any([each.diverged[which].any() for each in maps]) for which in range(2)]
    handles = [unseen] if any(each.unseen.any() for each in maps) else []
    handles += [
        Line2D([], [], label=name, **{**mark, "markersize": 4.5})
        for name, mark, present in zip(names, _MARKS, used, strict=True)
        if present
    ]
    handles.append(Line2D([], [], color=BLACK, linewidth=1.4, label="between cells"))
    legend_below(figure, handles, bottom_in, columnspacing=1.6)


def draw_measure(
    figure: Figure,
    measure: str,
    columns: Sequence[Mapping[Cell, xr.Dataset]],
    panels: Mapping[float, tuple[int, str]],
    box: tuple[float, float, float, float],
    label_of: Callable[[Cell], str],
) -> list[Rows]:
    """Maps of a measure side by side with common colors, and their color bars.

    `panels` are number and title of every map by its left edge; `box` is the lower edge, width and
    height of a map, and what lies between the last one and the color bars, all in inches.
    `label_of` names a cell's block.
    """
    bottom, width, height, aside = box
    maps = [block_rows(list(cells.values()), measure) for cells in columns]
    colors = scales(measure, maps)
    for cells, rows, (left, title) in zip(columns, maps, panels.items(), strict=True):
        axes = place(figure, left, bottom, width, height)
        panel_title(axes, *title, fontsize=8.0, pad=3.5)
        _draw_map(axes, rows, colors, [label_of(cell) for cell in cells])
        if cells is columns[0]:
            axes.set_ylabel("targets, one row each", labelpad=6)
    _draw_bars(figure, left + width + aside, bottom, height, colors)
    return maps


def _heat_maps(
    columns: Sequence[Mapping[Cell, xr.Dataset]],
    headings: Sequence[str],
    title: str,
    label_of: Callable[[Cell], str],
) -> Figure:
    """Every measure by every column of cells."""
    width = _LEFT + len(columns) * _MAP_WIDTH_IN + (len(columns) - 1) * _GAP + _BARS
    step = _TITLE + _MAP_HEIGHT_IN + _TICKS
    figure = new_figure(_HEAD + len(_MEASURES) * step + _LEGEND, max(width, _LEAST_WIDTH_IN))
    width, height = figure.get_size_inches()
    title_above(figure, title)
    lefts = [_LEFT + index * (_MAP_WIDTH_IN + _GAP) for index in range(len(columns))]
    for left, heading in zip(lefts, headings, strict=True):
        above = (left / width, 1.0 - (_HEAD - 0.06) / height)
        figure.text(*above, heading, fontsize=8.0, va="bottom")
    for row, (measure, name) in enumerate(_MEASURES.items()):
        bottom = height - _HEAD - row * step - _TITLE - _MAP_HEIGHT_IN
        panels = {left: (row * len(columns) + index, name) for index, left in enumerate(lefts)}
        box = (bottom, _MAP_WIDTH_IN, _MAP_HEIGHT_IN, 0.26)
        maps = draw_measure(figure, measure, columns, panels, box, label_of)
    marks_legend(figure, maps)
    return figure


@house_style()
def target_counts_figure(columns: Sequence[Mapping[Cell, xr.Dataset]]) -> Figure:
    """Coverage, ANEES and RMSE of every target, in blocks by number of targets.

    `columns` are the cells of every column of panels, without time histories.
    """
    cell, data = next(iter(columns[0].items()))
    title = (
        f"{capitalized(observers_text(cell, data))} ({architecture_text(cell)}),\ntasking every "
        f"{interval_text(cell.interval_minutes)}; {realization_text(data)}"
    )
    headings = [
        f"$n_T$ = {', '.join(str(cell.targets) for cell in cells)} targets" for cells in columns
    ]
    return _heat_maps(columns, headings, title, lambda cell: f"$n_T$ = {cell.targets}")


@house_style()
def intervals_figure(columns: Sequence[Mapping[Cell, xr.Dataset]]) -> Figure:
    """Coverage, ANEES and RMSE of every target, in blocks by tasking interval."""
    headings = []
    for cells in columns:
        cell, data = next(iter(cells.items()))
        headings.append(capitalized(f"{observers_text(cell, data)}, $n_T$ = {cell.targets}"))
    cell, data = next(iter(columns[0].items()))
    title = (
        f"{capitalized(architecture_text(cell))};\nblocks by tasking interval $T_{{ST}}$; "
        f"{realization_text(data)}"
    )
    return _heat_maps(columns, headings, title, lambda c: interval_text(c.interval_minutes))
