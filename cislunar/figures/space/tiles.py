"""Tiles: orbits seen from the eye of the views in space, without axes but with a scale bar."""

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
    """An orbit of a tile: one period (samples, 3), its look, its satellites (count, 3)."""

    curve: Array
    look: SeriesStyle
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
    """Draw orbits over their shadows on the plane of the primaries, with lines of a width.

    Scales are equal, and the bar below has a round length. Orbits that stay around the Moon fill
    the tile with it unless it shows the `whole` system; others with the Earth, too, and a line to
    the Moon.
    """
    axes.set_axis_off()
    around_moon = not whole and all(stays_around_moon(each.curve, mu) for each in orbits)
    shown = {k: v for k, v in bodies(mu).items() if k == "Moon" or not around_moon}
    for each in orbits:
        axes.plot(*projected(each.curve * (1.0, 1.0, 0.0)).T, color=_SHADOW, lw=width, zorder=1)
    for each in orbits:
        look = each.look
        axes.plot(*projected(each.curve).T, color=look.color, linewidth=width, zorder=2)
        if satellites:
            marks = {"linestyle": "none", "color": look.color} | look.marker_kwargs(3.2)
            axes.plot(*projected(each.satellites).T, zorder=5, **marks)
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
    """Limits around all points with the axes' own proportions, and a bar below."""
    box = axes.get_position()
    page = axes.get_figure().get_size_inches()
    shape = np.array([box.width * page[0], box.height * page[1]])
    low, high = points.min(axis=0), points.max(axis=0)
    # The lowest part is the bar's.
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
    """1, 2 or 5 times a power of ten, at most a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(digit for digit in (1.0, 2.0, 5.0) if digit * power <= value))
