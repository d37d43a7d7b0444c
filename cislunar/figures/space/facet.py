"""Drawing of the reflection geometry of one facet (Paul & Fan, section 2.2)."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from cislunar.figures import style
from cislunar.figures.axes import Array
from cislunar.figures.space.earth_moon import projected

_SUN = "#B87F00"
"""A darker tone of the orange, for text."""
_EYE = (24.0, 38.0)
_FACET = np.array([[-1.05, -0.97, 0.0], [1.35, -0.75, 0.0], [-0.05, 1.55, 0.0]])
_NORMAL = np.array([0.0, 0.0, 1.0])


def half_vector(light: Array, view: Array) -> Array:
    """Unit bisector of two unit vectors, shape (3,)."""
    bisector = light + view
    return bisector / np.linalg.norm(bisector)


def direction(zenith_deg: float, azimuth_deg: float) -> Array:
    """Unit vector in the facet frame by zenith angle and azimuth from x^B towards y^B."""
    zenith, azimuth = np.radians([zenith_deg, azimuth_deg])
    flat = np.sin(zenith)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.cos(zenith)])


def arc_between(first: Array, second: Array, radius: float) -> Array:
    """Circular arc between two unit vectors, shape (40, 3)."""
    angle = np.arccos(np.clip(first @ second, -1.0, 1.0))
    share = np.linspace(0.0, 1.0, 40)[:, None]
    arc = np.sin((1 - share) * angle) * first + np.sin(share * angle) * second
    return radius * arc / np.sin(angle)


def _flat(points: Array) -> Array:
    """Projection of points (..., 3) to (..., 2)."""
    return projected(points, _EYE)


@style.house_style()
def facet_geometry_figure() -> Figure:
    """Draw the facet frame, the directions to Sun and observer, their bisector, and its angle."""
    figure = style.new_figure(2.9, 4.4)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_aspect("equal")
    light, view = direction(28.0, -52.0), direction(76.0, 128.0)
    half = half_vector(light, view)
    corners = _flat(_FACET)
    axes.add_patch(
        Polygon(corners, facecolor="#E8E8E8", edgecolor=style.BLACK, linewidth=0.9, zorder=1)
    )
    for tip, name, color, line, shift in (
        (direction(90.0, 0.0) * 0.62, r"$\mathbf{x}^B$", style.BLACK, "-", (-0.1, 0.06)),
        (direction(90.0, 90.0) * 0.7, r"$\mathbf{y}^B$", style.BLACK, "-", (0.12, 0.02)),
        (_NORMAL * 1.3, r"$\mathbf{N}^B$", style.BLACK, "-", (0.02, 0.13)),
        (light * 1.4, r"$\mathbf{L}^I$", _SUN, "-", (-0.14, 0.0)),
        (view * 1.4, r"$\mathbf{V}^I$", style.BLUE, "-", (0.0, 0.14)),
        (half * 1.3, r"$\mathbf{H}_{LV}$", style.VERMILION, (0, (4, 1.6)), (0.13, 0.06)),
    ):
        _arrow(axes, tip, name, color, line, shift)
    _angle(axes, arc_between(_NORMAL, half, 0.72), r"$\phi$", style.GREEN)
    for one in (light, view):
        arc = _flat(arc_between(one, half, 0.36))
        axes.plot(*arc.T, color=style.GRAY, linewidth=0.8, zorder=2)
        _tick(axes, arc)
    _glyphs(axes, light, view)
    axes.set_xlim(-1.6, 2.3)
    axes.set_ylim(-0.6, 1.97)
    return figure


def _arrow(axes: Axes, tip: Array, name: str, color: str, line, shift) -> None:
    """Draw a vector from the middle of the facet, with its name at the tip."""
    end = _flat(tip)
    drawn = {"arrowstyle": "-|>,head_width=0.16,head_length=0.36", "linestyle": line}
    drawn |= {"color": color, "linewidth": 1.3, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=end, xytext=(0.0, 0.0), arrowprops=drawn, zorder=4)
    axes.text(*(end + shift), name, color=color, fontsize=11, ha="center", va="center", zorder=5)


def _angle(axes: Axes, arc: Array, name: str, color: str) -> None:
    """Draw an arc with its name."""
    drawn = _flat(arc)
    axes.plot(*drawn.T, color=color, linewidth=1.2, zorder=3)
    middle = drawn[len(drawn) // 2]
    axes.text(*(middle * 1.16), name, color=color, fontsize=11, ha="center", va="center")


def _tick(axes: Axes, arc: Array) -> None:
    """Draw a stroke across an arc; arcs with a stroke are equal angles."""
    middle = arc[len(arc) * 2 // 3]
    out = middle / np.linalg.norm(middle)
    axes.plot(*(middle + np.outer((-0.05, 0.05), out)).T, color=style.GRAY, linewidth=0.8, zorder=2)


def _glyphs(axes: Axes, light: Array, view: Array) -> None:
    """Draw the Sun and the observer beyond the tips of their vectors, with labels."""
    sun, observer = _flat(light * 1.85), _flat(view * 1.9)
    axes.add_patch(Circle(sun, 0.09, facecolor=style.ORANGE, edgecolor=style.BLACK, linewidth=0.5))
    for ray in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        unit = np.array([np.cos(ray), np.sin(ray)])
        axes.plot(*(sun + np.outer((0.12, 0.18), unit)).T, color=style.ORANGE, linewidth=1.0)
    axes.text(sun[0] - 0.36, sun[1], "Sun", ha="center", va="center")
    body = observer + np.array([[-0.08, -0.06], [0.08, -0.06], [0.08, 0.06], [-0.08, 0.06]])
    axes.add_patch(Polygon(body, facecolor=style.BLUE, edgecolor=style.BLACK, linewidth=0.5))
    for side in (-1.0, 1.0):
        wing = np.array([[0.11, -0.045], [0.3, -0.045], [0.3, 0.045], [0.11, 0.045]])
        panel = observer + wing * (side, 1.0)
        axes.add_patch(Polygon(panel, facecolor="white", edgecolor=style.BLACK, lw=0.5))
    axes.text(observer[0], observer[1] - 0.2, "observer", ha="center", va="center")
