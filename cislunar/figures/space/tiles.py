"""Tiles: orbits in the viewing direction of the views in space, with a scale bar, without axes."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from cislunar.figures.axes import Array
from cislunar.figures.space.earth_moon import bodies, projected, stays_around_moon, thousands
from cislunar.figures.style import DOTTED, GRAY, SeriesStyle

_SHADOW = "#D9D9D9"
_SHORTEST, _MARGIN = 0.2, 1.12


class TileOrbit(NamedTuple):
    """An orbit of a tile: one period (samples, 3), its style, and satellites (count, 3)."""

    curve: Array
    series: SeriesStyle
    satellites: Array = np.empty((0, 3))


def draw_tile(
    axes: Axes,
    orbits: Sequence[TileOrbit],
    mu: float,
    length_unit_km: float,
    *,
    width: float = 0.6,
    satellites: bool = True,
    whole: bool = False,
) -> None:
    """Draw orbits over their projections on the plane of the primaries, with lines of a width.

    Scales are equal, and the scale bar has a round length. A tile shows the Moon, and the Earth as
    well if an orbit is not around the Moon or if the `whole` system is to be shown.
    """
    axes.set_axis_off()
    around_moon = not whole and all(stays_around_moon(each.curve, mu) for each in orbits)
    shown = {k: v for k, v in bodies(mu).items() if k == "Moon" or not around_moon}
    for each in orbits:
        axes.plot(*projected(each.curve * (1.0, 1.0, 0.0)).T, color=_SHADOW, lw=width, zorder=1)
    for each in orbits:
        series = each.series
        axes.plot(*projected(each.curve).T, color=series.color, linewidth=width, zorder=2)
        if satellites:
            axes.plot(*projected(each.satellites).T, zorder=5, **series.point_kwargs(3.2))
    line = projected([place for place, _ in shown.values()])
    axes.plot(*line.T, color=GRAY, linewidth=0.5, linestyle=DOTTED, zorder=1.5)
    for place, color in shown.values():
        dot = {"marker": "o", "markersize": 3.4, "markeredgecolor": "white"}
        axes.plot(*projected(place), color=color, markeredgewidth=0.4, zorder=6, **dot)
    points = [projected(each.curve) for each in orbits]
    points += [projected(each.curve * (1.0, 1.0, 0.0)) for each in orbits]
    points += [projected(place)[None] for place, _ in shown.values()]
    _fit(axes, np.concatenate(points), length_unit_km)


def _fit(axes: Axes, points: Array, length_unit_km: float) -> None:
    """Set limits around all points with the proportions of the axes; draw the scale bar below."""
    box = axes.get_position()
    page = axes.get_figure().get_size_inches()
    shape = np.array([box.width * page[0], box.height * page[1]])
    low, high = points.min(axis=0), points.max(axis=0)
    # the lowest part is for the scale bar
    scale = max(np.max((high - low) / (shape * (1.0, 0.8))) * _MARGIN, _SHORTEST / shape[0])
    middle = 0.5 * (low + high) - (0.0, 0.1 * scale * shape[1])
    ends = np.column_stack((middle - 0.5 * scale * shape, middle + 0.5 * scale * shape))
    axes.set(xlim=ends[0], ylim=ends[1])
    length_km = _round_below(0.5 * scale * shape[0] * length_unit_km)
    half = 0.5 * length_km / length_unit_km
    height = ends[1, 0] + 0.12 * scale * shape[1]
    axes.plot([middle[0] - half, middle[0] + half], [height] * 2, color=GRAY, lw=1.0, zorder=4)
    axes.annotate(f"{thousands(length_km)} km", (middle[0], height), xytext=(0, -2), ha="center",
                  va="top", textcoords="offset points", fontsize=5.2, color="#555555")  # fmt: skip


def _round_below(value: float) -> float:
    """Greatest of 1, 2 or 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(digit for digit in (1.0, 2.0, 5.0) if digit * power <= value))
