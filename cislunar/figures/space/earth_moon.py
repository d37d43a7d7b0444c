"""The Earth-Moon system in figures: bodies, bounds and axes, in space and in projection."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from cislunar.figures.axes import Array
from cislunar.figures.labels import AXES
from cislunar.figures.style import EARTH_COLOR, MOON_COLOR

EYE_DEG = (22.0, -58.0)
"""Elevation and azimuth of the viewing direction of every view in space."""

_CLOSE = 0.6
"""Greatest distance from the Moon of an orbit around it, nondimensional."""


def thousands(value: float) -> str:
    """A number with thin spaces between its thousands."""
    return f"{value:,.0f}".replace(",", "\N{THIN SPACE}")


def bodies(mu: float) -> Mapping[str, tuple[Array, str]]:
    """Positions, nondimensional, and colors of the Earth and the Moon."""
    return {
        "Earth": (np.array([-mu, 0.0, 0.0]), EARTH_COLOR),
        "Moon": (np.array([1.0 - mu, 0.0, 0.0]), MOON_COLOR),
    }


_SIZES = {"Earth": 5.0, "Moon": 5.0 * 0.67}
"""Diameters of the markers, points."""


def draw_bodies(
    axes: Axes, mu: float, plane: Sequence[int], bounds: Array, scale: float = 1.0
) -> None:
    """Mark the Earth (blue) and the Moon (black) if they are within bounds, not to scale. `plane`
    holds the coordinates shown, e.g. (0, 2) for x and z; `scale` is the unit of length in that of
    the axes."""
    for name, (place, color) in bodies(mu).items():
        if np.any(place < bounds[:, 0]) or np.any(place > bounds[:, 1]):
            continue
        drawn = {"linestyle": "none", "marker": "o", "markersize": _SIZES[name]}
        drawn |= {"markeredgecolor": "white", "markeredgewidth": 0.4}
        axes.plot(*([scale * place[k]] for k in plane), color=color, zorder=10, label=name, **drawn)


def body_handles() -> list[Line2D]:
    """Legend entries of the Earth and the Moon."""
    dot = {"linestyle": "none", "marker": "o"}
    return [
        Line2D([], [], markersize=_SIZES[name], color=color, label=name, **dot)
        for name, (_, color) in bodies(0.0).items()
    ]


def projected(points: ArrayLike, eye_deg: tuple[float, float] = EYE_DEG) -> Array:
    """Orthographic projection of points (..., 3) to (..., 2), seen from elevation and azimuth."""
    elevation, azimuth = np.radians(eye_deg)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    flat = np.cos(elevation)
    towards = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    return np.asarray(points) @ np.column_stack((right, np.cross(towards, right)))


def limits(points: Sequence[ArrayLike], margin: float = 0.06) -> Array:
    """Bounds of sets of points (..., 3), widened by a share of the largest extent.

    They are the least and greatest value on each axis, shape (3, 2). No axis is shorter than half
    of the longest, so that its labels have room.
    """
    stacked = np.concatenate([np.asarray(p, dtype=float).reshape(-1, 3) for p in points])
    low, high = stacked.min(axis=0), stacked.max(axis=0)
    largest = float(np.max(high - low))
    pad = margin * largest + np.maximum(0.0, 0.25 * largest - 0.5 * (high - low))
    return np.column_stack((low - pad, high + pad))


def stays_around_moon(curve: Array, mu: float) -> bool:
    """Whether an orbit (samples, 3) stays close enough to the Moon for a view of its vicinity."""
    return bool(np.linalg.norm(curve - (1.0 - mu, 0.0, 0.0), axis=1).max() < _CLOSE)


def around_moon(mu: float, curves: Sequence[Array]) -> Array:
    """Bounds (3, 2) of the vicinity of the Moon with the orbits (samples, 3) around it."""
    moon = np.array([1.0 - mu, 0.0, 0.0])
    close = [curve for curve in curves if stays_around_moon(curve, mu)]
    return limits([*close, moon + 0.15, moon - 0.15])


def space_axes(
    figure: Figure, place: tuple, bounds: Array, length_unit_km: float, *, zoom: float = 1.0
) -> Axes:
    """Axes in space, with equal scales, a light grid, and labels in units of 1000 km.

    `place` is left, bottom, width and height relative to the figure, `zoom` the size of the box.
    Data and `bounds` are nondimensional.
    """
    axes = figure.add_axes(place, projection="3d", computed_zorder=False)
    axes.set_proj_type("ortho")
    axes.view_init(*EYE_DEG)
    axes.set(xlim=bounds[0], ylim=bounds[1], zlim=bounds[2])
    axes.set_box_aspect(np.diff(bounds, axis=1)[:, 0], zoom=zoom)
    axes.patch.set_visible(False)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.line.set_color("#555555")
        ends = axis.get_view_interval() * length_unit_km / 1000.0
        ticks = MaxNLocator(nbins=4, steps=[1, 2, 5, 10]).tick_values(*ends)
        ticks = ticks[(ticks >= ends[0]) & (ticks <= ends[1])]
        names = [f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks]
        axis.set_ticks(ticks * 1000.0 / length_unit_km, names)
        axis._axinfo["grid"].update(color="#DDDDDD", linewidth=0.4)
    axes.tick_params(pad=-2, labelsize=6.5)
    axes.tick_params(axis="z", pad=1)
    for name, put in zip(AXES, (axes.set_xlabel, axes.set_ylabel, axes.set_zlabel), strict=True):
        put(f"{name}, 1000 km", fontsize=7.0, labelpad=-3)
    return axes
