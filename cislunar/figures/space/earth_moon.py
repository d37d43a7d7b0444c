"""The Earth-Moon system as drawn: bodies, bounds and axes, in space and in projection."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from cislunar.figures.axes import Array
from cislunar.figures.style import EARTH_COLOR, MOON_COLOR

AXES = ("x", "y", "z")
EYE_DEG = (22.0, -58.0)
"""Elevation and azimuth of the eye in every view in space."""

_CLOSE = 0.6
"""An orbit that stays this near to the Moon counts as one around it, nondimensional."""


def thousands(value: float) -> str:
    """A number with thin spaces between its thousands."""
    return f"{value:,.0f}".replace(",", "\N{THIN SPACE}")


def axis_label(axis: int, length_unit_km: float, gap: str = " ") -> str:
    """Label of a coordinate axis, 0, 1 or 2 for x, y or z, with its unit behind a gap."""
    return f"{AXES[axis]}, nondimensional{gap}({thousands(length_unit_km)} km)"


def bodies(mu: float) -> Mapping[str, tuple[Array, str]]:
    """Place and color of the Earth and the Moon."""
    return {
        "Earth": (np.array([-mu, 0.0, 0.0]), EARTH_COLOR),
        "Moon": (np.array([1.0 - mu, 0.0, 0.0]), MOON_COLOR),
    }


def draw_bodies(
    axes: Axes, mu: float, plane: Sequence[int], bounds: Array, size: float = 5.0
) -> None:
    """Mark the Earth (blue) and the Moon (black) where within bounds, not to scale.

    `plane` holds the coordinates shown, e.g. (0, 2) for x and z; `size` is the diameter of the
    Earth's marker, points.
    """
    for (name, (place, color)), scale in zip(bodies(mu).items(), (1.0, 0.67), strict=True):
        if np.any(place < bounds[:, 0]) or np.any(place > bounds[:, 1]):
            continue
        axes.plot(
            *([place[axis]] for axis in plane),
            linestyle="none",
            marker="o",
            markersize=size * scale,
            color=color,
            markeredgecolor="white",
            markeredgewidth=0.4,
            zorder=10,
            label=name,
        )


def body_handles(size: float = 5.0) -> list[Line2D]:
    """Legend entries of the Earth and the Moon."""
    return [
        Line2D([], [], linestyle="none", marker="o", markersize=size * scale, color=color, label=n)
        for n, color, scale in (("Earth", EARTH_COLOR, 1.0), ("Moon", MOON_COLOR, 0.67))
    ]


def projected(points: ArrayLike, eye_deg: tuple[float, float] = EYE_DEG) -> Array:
    """Orthographic projection of points (..., 3) to (..., 2) for an eye at elevation, azimuth."""
    elevation, azimuth = np.radians(eye_deg)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    flat = np.cos(elevation)
    towards = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    return np.asarray(points) @ np.column_stack((right, np.cross(towards, right)))


def limits(points: Sequence[ArrayLike], margin: float = 0.06) -> Array:
    """Bounds of sets of points (..., 3), widened by a share of the largest extent.

    Least and greatest value on each axis, shape (3, 2); no axis is shorter than half the longest,
    so that its labels have room.
    """
    stacked = np.concatenate([np.asarray(p, dtype=float).reshape(-1, 3) for p in points])
    low, high = stacked.min(axis=0), stacked.max(axis=0)
    largest = float(np.max(high - low))
    pad = margin * largest + np.maximum(0.0, 0.25 * largest - 0.5 * (high - low))
    return np.column_stack((low - pad, high + pad))


def stays_around_moon(curve: Array, mu: float) -> bool:
    """Whether an orbit (samples, 3) stays so near to the Moon that a close-up shows all of it."""
    return bool(np.linalg.norm(curve - (1.0 - mu, 0.0, 0.0), axis=1).max() < _CLOSE)


def around_moon(mu: float, curves: Sequence[Array]) -> Array:
    """Bounds (3, 2) of a close-up of the Moon with the orbits (samples, 3) that stay around it."""
    moon = np.array([1.0 - mu, 0.0, 0.0])
    close = [curve for curve in curves if stays_around_moon(curve, mu)]
    return limits([*close, moon + 0.15, moon - 0.15])


def space_axes(
    figure: Figure, place: tuple, bounds: Array, length_unit_km: float, *, zoom: float = 1.0
) -> Axes:
    """Axes in space, with equal scales, a light grid and labels in two lines.

    `place` is left, bottom, width and height as shares of the figure, `zoom` the size of the box.
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
        axis.set_major_locator(_ticks())
        axis._axinfo["grid"].update(color="#DDDDDD", linewidth=0.4)
    axes.tick_params(pad=-2, labelsize=6.5)
    for axis, put in enumerate((axes.set_xlabel, axes.set_ylabel, axes.set_zlabel)):
        put(axis_label(axis, length_unit_km, "\n"), fontsize=6.3, labelpad=-1, linespacing=1.0)
    return axes


def _ticks() -> MaxNLocator:
    return MaxNLocator(nbins=4, steps=[1, 2, 5, 10])


def plane_axes(axes: Axes, plane: tuple[int, int], bounds: Array, length_unit_km: float) -> None:
    """Bounds, equal scales and labels of a projection to two coordinates."""
    horizontal, vertical = plane
    axes.set(xlim=bounds[horizontal], ylim=bounds[vertical])
    axes.set_aspect("equal", adjustable="box", anchor="S")
    axes.set_xlabel(axis_label(horizontal, length_unit_km), labelpad=2)
    axes.set_ylabel(axis_label(vertical, length_unit_km), labelpad=2)
    axes.xaxis.set_major_locator(_ticks())
    axes.yaxis.set_major_locator(_ticks())
