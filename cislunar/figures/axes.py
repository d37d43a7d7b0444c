"""Places of panels, limits and ticks of their axes, titles, legends and notes.

Places are in inches from the lower left corner of the figure.
"""

from collections.abc import Sequence
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator, NullFormatter
from numpy.typing import ArrayLike

from cislunar.figures.style import BLACK, panel_letter
from cislunar.runtime import Array

_LEAST_SPACING = 0.13
"""Least distance between two tick labels, as a share of the axis."""

_NOTE_LETTER_IN = 0.053
"""Mean width of a letter of a note."""


def place(
    figure: Figure, left_in: float, bottom_in: float, width_in: float, height_in: float
) -> Axes:
    """Axes with a lower left corner and a size in inches."""
    width, height = figure.get_size_inches()
    return figure.add_axes(
        (left_in / width, bottom_in / height, width_in / width, height_in / height)
    )


class Grid(NamedTuple):
    """Panels of equal size in rows and columns; lengths in inches.

    A panel has the size `width` by `height`. The lower left panel begins at `left` and `foot`.
    Panels are `gap` apart in a row and `between` apart in a column.
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
    """Give a panel a title with its letter, at the left."""
    axes.set_title(f"{panel_letter(number)} {text}", loc="left", **more)


def title_above(figure: Figure, text: str) -> None:
    """Give the whole figure a title in its upper left corner."""
    width, height = figure.get_size_inches()
    figure.text(0.14 / width, 1.0 - 0.07 / height, text, va="top", fontsize=8.5)


def legend_below(
    figure: Figure, handles: Sequence[Artist], bottom_in: float, ncols: int | None = None, **more
) -> None:
    """Place a legend in the middle, its lower edge at `bottom_in`; in one row by default."""
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=ncols or len(handles),
        bbox_to_anchor=(0.5, bottom_in / figure.get_size_inches()[1]),
        borderaxespad=0.0,
        **more,
    )


def note_lines(text: str, width_in: float) -> str:
    """A note in lines that fit into a figure of a width."""
    letters = int((width_in - 0.1) / _NOTE_LETTER_IN)
    return "\n".join(filter(None, (fill(line, letters) for line in text.split("\n"))))


def note_height(lines: str) -> float:
    """Height above the lower edge from which on there is room above a note, inches."""
    return 0.1 + 0.11 * (lines.count("\n") + 1) if lines else 0.07


def note_below(figure: Figure, text: str) -> float:
    """Write a note at the lower edge; where a legend above it may begin is returned, inches."""
    width, height = figure.get_size_inches()
    text = note_lines(text, width)
    figure.text(0.5, 0.06 / height, text, ha="center", va="bottom", fontsize=6.5, linespacing=1.2)
    return note_height(text)


def reach(
    values: ArrayLike, *, log: bool, share: float = 0.08, least: float = 1.15
) -> tuple[float, float]:
    """Limits of an axis that holds the values; those of 0.1 and 1 if there is none.

    Values that are not finite, and on a logarithmic axis those that are not positive, are left out.
    The margin is `share` of the range of the values, on a logarithmic axis at least a factor
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
    """Write in an empty panel why it is empty."""
    centered = {"ha": "center", "va": "center", "fontsize": 6.5, "color": BLACK}
    axes.text(0.5, 0.5, text, transform=axes.transAxes, **centered)


def widened(low: float, high: float) -> tuple[float, float]:
    """Limits of an axis of counts: at least 2 apart, with little room below zero."""
    spare = max(0.0, 0.5 * (2.5 - (high - low)))
    low, high = low - spare, high + spare
    return max(low, -0.1 * max(high, 2.0)), high if low > 0.0 else max(high, 2.0)


def whole_numbers(axis: Axis) -> None:
    """Set ticks at whole numbers, with at most four steps between them."""
    axis.set_major_locator(MaxNLocator(4, integer=True, min_n_ticks=1))


def set_vertical(axes: Axes, limits: tuple[float, float], *, log: bool) -> None:
    """Set the limits of the vertical axis, with labeled ticks if it is logarithmic."""
    if log:
        axes.set_yscale("log")
    axes.set_ylim(*limits)
    if log:
        log_ticks(axes.yaxis, *limits)


def fixed_ticks(axis: Axis, ticks: ArrayLike, names: Sequence[str] | None = None) -> None:
    """Set ticks with names, by default their numbers; minor ticks have no names."""
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_major_formatter(FixedFormatter(names or [f"{tick:g}" for tick in ticks]))
    axis.set_minor_formatter(NullFormatter())


def nice_ticks(low: float, high: float) -> Array:
    """At most five ticks of a logarithmic axis, closer than decades where the axis is short.

    There are at least two unless the axis is shorter than half a digit.
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
    """Labels of ticks: plain numbers, or powers of ten where plain numbers are long."""
    if ticks.size and ticks.min() >= 1e-3 and ticks.max() < 1e4:
        return [f"{tick:g}" for tick in ticks]
    names = []
    for tick in ticks:
        mantissa, exponent = f"{tick:.1e}".split("e")
        power, digits = rf"10^{{{int(exponent)}}}", f"{float(mantissa):g}"
        names.append(f"${power}$" if digits == "1" else rf"${digits}\times{power}$")
    return names


def log_ticks(axis: Axis, low: float, high: float) -> None:
    """Set labeled ticks on a logarithmic axis."""
    ticks = nice_ticks(low, high)
    fixed_ticks(axis, ticks, tick_names(ticks))


def spaced(values: Array, least: float = _LEAST_SPACING) -> Array:
    """Those of some positive values that can be labeled side by side on a logarithmic axis.

    The least and the greatest are always among them; neighbors are at least a share `least` of the
    axis apart.
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
