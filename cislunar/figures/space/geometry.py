"""Orbits of user-defined observers and targets over a run, in the rotating frame."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.figures import style
from cislunar.figures.axes import Array, legend_below, title_above
from cislunar.figures.labels import plain
from cislunar.figures.space import earth_moon

_PLANES = ((0, 1), (0, 2))
_KM = LENGTH_UNIT_KM / 1000.0
"""Unit of length, 1000 km."""
_TARGET = "#555555"
_COLORS = (style.BLUE, style.VERMILION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY)


@style.house_style()
def geometry_figure(
    observers: Mapping[str, tuple[Array, Array]], targets: Mapping[str, tuple[Array, Array]]
) -> Figure:
    """Draw orbits of observers and targets in space and in two projections.

    Parameters
    ----------
    observers, targets : mapping of str to (ndarray, ndarray)
        By name, the position at the epoch, shape (3,), and the path, shape (time, 3),
        nondimensional, rotating frame.
    """
    figure = style.new_figure(4.5)
    every = [each for both in (observers, targets) for pair in both.values() for each in pair]
    moon = [1.0 - MU, 0.0, 0.0]
    bounds = earth_moon.limits([*every, np.array([moon])])
    counts = f"{len(observers)} observer{'s' * (len(observers) > 1)} and {len(targets)} target"
    title_above(figure, f"Orbits of {counts}{'s' * (len(targets) > 1)}, rotating frame")
    space = earth_moon.space_axes(figure, (0.0, 0.13, 0.52, 0.8), bounds, LENGTH_UNIT_KM)
    _draw(space, observers, targets, bounds, (0, 1, 2))
    for row, plane in enumerate(_PLANES):
        axes = figure.add_axes((0.62, 0.585 - 0.435 * row, 0.36, 0.345))
        _draw(axes, observers, targets, bounds, plane, _KM)
        axes.set_aspect("equal", adjustable="box", anchor="W")
        axes.set(xlim=_KM * bounds[plane[0]], ylim=_KM * bounds[plane[1]])
        axes.xaxis.set_major_locator(MaxNLocator(5))
        axes.yaxis.set_major_locator(MaxNLocator(4))
        names = [f"{earth_moon.AXES[k]}, 1000 km" for k in plane]
        axes.set(xlabel=names[0] if row else "", ylabel=names[1])
    handles = [
        Line2D(
            [], [], color=_COLORS[k % len(_COLORS)], marker="s", markersize=3.5, label=plain(name)
        )
        for k, name in enumerate(observers)
    ]
    label = plain(next(iter(targets))) if len(targets) == 1 else f"targets ({len(targets)})"
    handles.append(Line2D([], [], color=_TARGET, linewidth=0.6, marker="o", markersize=2.5,
                          label=label))  # fmt: skip
    drawn = space.get_legend_handles_labels()[1]
    handles += [each for each in earth_moon.body_handles() if each.get_label() in drawn]
    legend_below(figure, handles, 0.06, min(len(handles), 6))
    return figure


def _draw(
    axes: Axes,
    observers: Mapping[str, tuple[Array, Array]],
    targets: Mapping[str, tuple[Array, Array]],
    bounds: Array,
    plane: tuple[int, ...],
    scale: float = 1.0,
) -> None:
    """Draw paths, with a mark at the epoch, and the bodies."""
    for start, path in _scaled(targets, scale):
        axes.plot(*path.T[list(plane)], color=_TARGET, linewidth=0.5, alpha=0.8, zorder=1)
        axes.plot(*start[list(plane), None], color=_TARGET, marker="o", markersize=2.2, zorder=2)
    for number, (start, path) in enumerate(_scaled(observers, scale)):
        color = _COLORS[number % len(_COLORS)]
        axes.plot(*path.T[list(plane)], color=color, linewidth=1.2, zorder=3)
        axes.plot(*start[list(plane), None], color=color, marker="s", markersize=4.0, zorder=4)
    earth_moon.draw_bodies(axes, MU, plane, bounds, scale=scale)


def _scaled(objects: Mapping[str, tuple[Array, Array]], scale: float) -> list[tuple[Array, Array]]:
    return [(scale * start, scale * path) for start, path in objects.values()]
