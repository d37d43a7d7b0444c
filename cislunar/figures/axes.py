"""Placing panels, reach and ticks of their axes, titles and legends, in inches from below left."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator, NullFormatter
from numpy.typing import ArrayLike, NDArray

from cislunar.figures.style import BLACK, panel_letter

Array = NDArray[np.float64]

_LEAST_SPACING = 0.13
"""Least distance of two tick labels, as a share of the axis."""


def place(
    figure: Figure, left_in: float, bottom_in: float, width_in: float, height_in: float
) -> Axes:
    """Axes at a place in inches from the lower left corner."""
    width, height = figure.get_size_inches()
    return figure.add_axes(
        (left_in / width, bottom_in / height, width_in / width, height_in / height)
    )


class Grid(NamedTuple):
    """Panels of equal size in rows and columns; lengths in inches.

    `width` and `height` are a panel's, `left` and `foot` place the lower left one, `gap` and
    `between` lie from panel to panel in a row and in a column.
    """

    rows: int
    columns: int
    width: float
    height: float
    left: float
    foot: float
    gap: float = 0.0
    between: float = 0.0

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of all panels, inches."""
        return (
            self.columns * self.width + (self.columns - 1) * self.gap,
            self.rows * self.height + (self.rows - 1) * self.between,
        )

    def corner(self, row: int, column: int) -> tuple[float, float]:
        """Lower left corner of a panel, inches; rows count from above."""
        top = self.foot + self.size[1]
        return (
            self.left + column * (self.width + self.gap),
            top - (row + 1) * self.height - row * self.between,
        )

    def place(self, figure: Figure, row: int, column: int) -> Axes:
        """Axes of a panel."""
        return place(figure, *self.corner(row, column), self.width, self.height)


def panel_title(axes: Axes, number: int, text: str, **more: Any) -> None:
    """Title of a panel with its letter, at the left."""
    axes.set_title(f"{panel_letter(number)} {text}", loc="left", **more)


def title_above(figure: Figure, text: str) -> None:
    """Title of the whole figure, in its upper left corner."""
    width, height = figure.get_size_inches()
    figure.text(0.14 / width, 1.0 - 0.07 / height, text, va="top", fontsize=8.5)


def legend_below(
    figure: Figure, handles: Sequence[Artist], bottom_in: float, ncols: int | None = None, **more
) -> None:
    """Legend in the middle, so high above the lower edge; in one row unless told."""
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=ncols or len(handles),
        bbox_to_anchor=(0.5, bottom_in / figure.get_size_inches()[1]),
        borderaxespad=0.0,
        **more,
    )


def reach(
    values: ArrayLike, *, log: bool, share: float = 0.08, least: float = 1.15
) -> tuple[float, float]:
    """Ends of an axis that holds the values, from 0.1 to 1 with a margin if none counts.

    Values that are not finite, or on a logarithmic axis not positive, do not count. The margin is
    `share` of what lies between the outermost ones, on a logarithmic axis at least a factor
    `least`.
    """
    values = np.ravel(values)
    values = values[np.isfinite(values) & ((values > 0.0) | (not log))]
    low, high = (values.min(), values.max()) if values.size else (0.1, 1.0)
    if log:
        margin = max((high / low) ** share, least)
        return low / margin, high * margin
    margin = share * (high - low) or 0.5
    return low - margin, high + margin


def note_empty(axes: Axes, text: str) -> None:
    """Say in an empty panel why there is nothing in it."""
    look = {"ha": "center", "va": "center", "fontsize": 6.5, "color": BLACK}
    axes.text(0.5, 0.5, text, transform=axes.transAxes, **look)


def widened(low: float, high: float) -> tuple[float, float]:
    """Ends of an axis of counts: two at least between them, and little room below zero."""
    spare = max(0.0, 0.5 * (2.5 - (high - low)))
    low, high = low - spare, high + spare
    return max(low, -0.1 * max(high, 2.0)), high if low > 0.0 else max(high, 2.0)


def whole_numbers(axis: Axis, most: int = 4) -> None:
    """Ticks at whole numbers alone, so many steps at most."""
    axis.set_major_locator(MaxNLocator(most, integer=True, min_n_ticks=1))


def set_vertical(axes: Axes, limits: tuple[float, float], *, log: bool) -> None:
    """Ends of the vertical axis, with labelled ticks where it is logarithmic."""
    if log:
        axes.set_yscale("log")
    axes.set_ylim(*limits)
    if log:
        log_ticks(axes.yaxis, *limits)


def fixed_ticks(axis: Axis, ticks: ArrayLike, names: Sequence[str] | None = None) -> None:
    """Ticks at some places, named by their numbers unless told; minor ones have no names."""
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_major_formatter(FixedFormatter(names or [f"{tick:g}" for tick in ticks]))
    axis.set_minor_formatter(NullFormatter())


def nice_ticks(low: float, high: float) -> Array:
    """At most five ticks of a logarithmic axis, finer than decades where it is short.

    At least two unless the axis is shorter than half a digit.
    """
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    for digits in (
        (1.0,),
        (1.0, 3.0),
        (1.0, 2.0, 5.0),
        np.arange(1.0, 10.0),
        np.arange(1.0, 10.0, 0.5),
    ):
        ticks = np.sort(np.outer(powers, digits).ravel())
        ticks = ticks[(ticks >= low) & (ticks <= high)]
        if ticks.size >= 2:
            break
    return ticks[:: max(1, -(-ticks.size // 5))]


def tick_names(ticks: Array) -> list[str]:
    """Labels of ticks: plain numbers, or powers of ten where those are long."""
    if ticks.size and ticks.min() >= 1e-3 and ticks.max() < 1e4:
        return [f"{tick:g}" for tick in ticks]
    names = []
    for tick in ticks:
        mantissa, exponent = f"{tick:.1e}".split("e")
        power, digits = rf"10^{{{int(exponent)}}}", f"{float(mantissa):g}"
        names.append(f"${power}$" if digits == "1" else rf"${digits}\times{power}$")
    return names


def log_ticks(axis: Axis, low: float, high: float) -> None:
    """Labelled ticks on a logarithmic axis from one end to the other."""
    ticks = nice_ticks(low, high)
    fixed_ticks(axis, ticks, tick_names(ticks))


def spaced(values: Array, least: float = _LEAST_SPACING) -> Array:
    """Positive values, rising, that can be labelled side by side on a logarithmic axis.

    The ends always; the others at least a share `least` of the whole apart.
    """
    values = np.unique(values)
    if values.size < 3:
        return values
    place_of = np.log(values / values[0]) / np.log(values[-1] / values[0])
    kept = [0]
    for index in range(1, values.size - 1):
        if place_of[index] - place_of[kept[-1]] >= least and 1.0 - place_of[index] >= least:
            kept.append(index)
    return values[[*kept, values.size - 1]]
