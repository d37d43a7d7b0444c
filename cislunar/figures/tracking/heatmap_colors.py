"""Colors of the heat maps of tracking, and their color bars."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from cislunar.figures.axes import Array, fixed_ticks, place
from cislunar.figures.labels import PARTS

MEASURES = {
    "outside": "time outside 3\N{GREEK SMALL LETTER SIGMA}",
    "anees": "component-wise ANEES",
    "rmse": "RMSE",
}
_MOST_DECADES = 3.0
_NOMINAL_PERCENT = 0.3
"""Least share of time that has a color of its own; 0.27 % is that of a consistent filter."""


class Scale(NamedTuple):
    """Colors of three columns of a measure, or of all; logarithmic."""

    columns: slice
    cmap: str
    norm: LogNorm
    extend: str
    label: str


def _extend(values: Array, low: float, high: float) -> str:
    """At which ends values lie outside the colors."""
    outside = bool((values < low).any()), bool((values > high).any())
    return {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[outside]


def scales(measure: str, values: Array) -> list[Scale]:
    """Colors of the values (row, 12) of a measure: one scale for all components.

    The RMSE has one for each part of the state, since their units differ. Those of attitude and
    angular velocity span as many decades as each other, and so do those of position and velocity:
    either pair shares a color bar with two rows of numbers.
    """
    everything = slice(0, values.shape[1])
    if measure == "outside":
        label = f"{MEASURES[measure]}, %"
        norm = LogNorm(_NOMINAL_PERCENT, 100.0, clip=True)
        return [Scale(everything, "Reds", norm, "min", label)]
    if measure == "anees":
        with np.errstate(divide="ignore"):
            decades = np.abs(np.log10(values[np.isfinite(values)]))
        most = 10.0 ** min(np.ceil(np.max(decades, initial=1.0)), _MOST_DECADES)
        norm, extend = LogNorm(1.0 / most, most), _extend(values, 1.0 / most, most)
        return [Scale(everything, "PuOr_r", norm, extend, "ANEES (1: consistent)")]
    halves = [_half_decades(values[:, part.columns]) for part in PARTS]
    for k in (0, 2):
        # ends that are the same multiple of powers of ten in both parts of a pair
        halves[k + 1][0] -= (halves[k + 1][0] - halves[k][0]) % 2
    spans = [max(high - low for low, high in halves[k : k + 2]) for k in (0, 0, 2, 2)]
    found = []
    for part, (low, _), span in zip(PARTS, halves, spans, strict=True):
        ends = _half_decade(low), _half_decade(low + span)
        extend = _extend(values[:, part.columns], *ends)
        found.append(Scale(part.columns, "magma_r", LogNorm(*ends), extend,
                           f"{part.name}, {part.unit}"))  # fmt: skip
    return found


def _half_decades(values: Array) -> list[float]:
    """Half decades that hold the values, except for the outermost percent."""
    positive = values[np.isfinite(values) & (values > 0.0)]
    low, high = 2.0 * np.log10(
        np.percentile(positive, (1.0, 99.0)) if positive.size else (0.1, 1.0)
    )
    return [np.floor(low), max(np.ceil(high), np.floor(low) + 1.0)]


def _half_decade(half: float) -> float:
    """1 or 3 times a power of ten."""
    return float((3.0 if half % 2 else 1.0) * 10.0 ** (half // 2))


def draw_bars(
    figure: Figure, corner_in: tuple[float, float], width_in: float, colors: Sequence[Scale]
) -> None:
    """Draw the color bars of a measure, one, or one for each pair of parts, in a row.

    `corner_in` is the lower left corner of the bars.
    """
    pairs = [colors[k : k + 2] for k in range(0, len(colors), 2)]
    wide = (width_in - 0.12 * (len(pairs) - 1)) / len(pairs)
    for index, (scale, *others) in enumerate(pairs):
        left = corner_in[0] + index * (wide + 0.12) + 0.12
        axes = place(figure, left, corner_in[1], wide - 0.24, 0.08)
        mappable = ScalarMappable(norm=scale.norm, cmap=scale.cmap)
        bar = figure.colorbar(mappable, cax=axes, extend=scale.extend, orientation="horizontal")
        bar.outline.set_linewidth(0.5)
        _decades(bar.ax, scale)
        rulers = [(bar.ax, scale)]
        for other in others:
            factor = other.norm.vmin / scale.norm.vmin
            functions = (lambda v, f=factor: f * v, lambda v, f=factor: v / f)
            above = bar.ax.secondary_xaxis("top", functions=functions)
            _decades(above, other)
            rulers.append((above, other))
        for ruler, each in rulers:
            ruler.tick_params(labelsize=5.8, length=1.5, pad=1.0)
            ruler.tick_params(which="minor", length=0)
            ruler.set_xlabel(each.label, fontsize=5.8, labelpad=2.0)


def _decades(ruler: Axes, scale: Scale) -> None:
    """Set ticks at the decades of a color bar, and at the least of its values if it is nominal."""
    low, high = scale.norm.vmin, scale.norm.vmax
    lowest, top = int(np.ceil(np.log10(low) - 1e-9)), int(np.floor(np.log10(high) + 1e-9))
    ticks = 10.0 ** np.arange(lowest, top + 1)
    if low == _NOMINAL_PERCENT:
        ticks = np.array([low, *ticks])
    fixed_ticks(ruler.xaxis, ticks)
