"""Placing axes and labelling logarithmic ones, for the figures of tracking."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter

from cislunar.figures.space.scene import Array

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


def nice_ticks(low: float, high: float) -> Array:
    """Ticks of a logarithmic axis: decades, or finer where it is short.

    Parameters
    ----------
    low, high : float
        Ends of the axis, positive.

    Returns
    -------
    ndarray
        At most five values; at least two unless the axis is shorter than half a digit.
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
    """Put labelled ticks on a logarithmic axis.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
        The axis.
    low, high : float
        Its ends.
    """
    ticks = nice_ticks(low, high)
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_major_formatter(FixedFormatter(tick_names(ticks)))
    axis.set_minor_formatter(NullFormatter())


def spaced(values: Array, least: float = _LEAST_SPACING) -> Array:
    """Values that can be labelled side by side on a logarithmic axis, the ends always.

    Parameters
    ----------
    values : ndarray
        Positive.
    least : float
        Least distance, as a share of the whole.

    Returns
    -------
    ndarray
        In rising order.
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
