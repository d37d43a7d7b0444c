"""Figures of the orbit library: the orbits with the static targets, and the map of the members."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cislunar.constants import SECONDS_PER_DAY
from cislunar.figures.axes import Array, Grid, legend_below, panel_title
from cislunar.figures.space.earth_moon import (
    around_moon,
    body_handles,
    draw_bodies,
    limits,
    space_axes,
    stays_around_moon,
    thousands,
)
from cislunar.figures.space.orbit_tracks import orbit_curve
from cislunar.figures.space.tiles import TileOrbit, draw_tile
from cislunar.figures.style import (
    BLACK,
    FAMILY_STYLE,
    GRAY,
    family_style,
    house_style,
    new_figure,
    panel_letter,
)

_JACOBI = "Jacobi constant, nondimensional"
_PERIOD = "period, days"
_STABILITY = "stability index, dimensionless"
_CLOSE_UP = 2.7
"""Most families crowd above this Jacobi constant."""


class _View(NamedTuple):
    """Part of the Earth-Moon system with the orbits drawn in it."""

    title: str
    bounds: Array
    curves: list[tuple[Array, str]]


def families_present(orbits: xr.Dataset) -> list[str]:
    """Families of the library, in the order of the styles."""
    present = set(orbits["family"].values.astype(str))
    return [name for name in FAMILY_STYLE if name in present] + sorted(present - set(FAMILY_STYLE))


def halves(families: Sequence[str]) -> dict[str, list[str]]:
    """Families by their common name, northern and southern halves together."""
    found: dict[str, list[str]] = {}
    for name in families:
        found.setdefault(re.sub("_[NS]$", "", name), []).append(name)
    return found


@house_style()
def orbit_library_figure(orbits: xr.Dataset, targets: xr.Dataset) -> Figure:
    """Every candidate observer orbit with the static targets of a scenario.

    Above, the whole system and the surroundings of the Moon in space; below, a tile for each
    family with its halves in two tones. From ``orbits/families.nc`` and
    ``targets/static_{scenario}.nc``.
    """
    mu, unit = float(orbits.attrs["mu"]), float(orbits.attrs["length_unit_km"])
    family = orbits["family"].values.astype(str)
    curves = [orbit_curve(orbits, index) for index in range(len(family))]
    points = targets["position"].values
    drawn = list(zip(curves, family, strict=True))
    close = [(curve, name) for curve, name in drawn if stays_around_moon(curve, mu)]
    whole = _View("the whole system", limits([*curves, points], margin=0.02), drawn)
    near = _View("orbits around the Moon", around_moon(mu, curves), close)
    groups = halves(families_present(orbits))
    grid = _tiles(len(groups))
    figure = new_figure(grid.foot + grid.size[1] + _SPACE_IN)
    height = figure.get_size_inches()[1]
    for column, view in enumerate((whole, near)):
        box = (-0.02 + 0.49 * column, 1.0 - (_SPACE_IN - 0.42) / height, 0.53)
        axes = space_axes(figure, (*box, (_SPACE_IN - 0.55) / height), view.bounds, unit, zoom=0.95)
        _draw(axes, view, points, mu)
        title = f"{panel_letter(column)} {view.title}"
        figure.text(0.02 + 0.5 * column, 1.0 - 0.1 / height, title, fontsize=8.5, va="top")
    for number, names in enumerate(groups.values()):
        axes = grid.place(figure, *divmod(number, grid.columns))
        own = [TileOrbit(c, family_style(name)) for name in names for c, f in drawn if f == name]
        draw_tile(axes, own, mu, unit, width=0.5)
        counts = ", ".join(_count(name, int(np.sum(family == name))) for name in names)
        text = f"{re.sub(' [NS]$', '', family_style(names[0]).label)}: {counts}"
        panel_title(axes, number + 2, text, fontsize=7.0, pad=2.0)
    handles = [
        Line2D([], [], color=tone, label=label)
        for tone, label in (
            ("#707070", "N, northern half"),
            (BLACK, "S, southern half: darker"),
            ("#B8B8B8", "planar: lighter"),
        )
    ]
    handles += [
        Line2D(
            [],
            [],
            label=f"static targets ({thousands(len(points))})",
            **_TARGETS | {"markersize": 3.0},
        ),
    ]
    legend_below(figure, [*handles, *body_handles()], 0.06)
    return figure


_TARGETS = {"linestyle": "none", "marker": ".", "markersize": 2.4, "markeredgewidth": 0,
            "color": BLACK}  # fmt: skip
_SPACE_IN = 3.65
"""Height of the views in space, inches."""


def _tiles(number: int) -> Grid:
    columns = 4
    width, gap = 1.66, 0.12
    return Grid(-(-number // columns), columns, width, 1.4, 0.1, 0.3, gap, 0.22)


def _count(name: str, count: int) -> str:
    """Orbits of a family, or of a half of it."""
    return f"{count} {name[-1]}" if name.endswith(("_N", "_S")) else f"{count}"


def _draw(axes: Axes, view: _View, points: Array, mu: float) -> None:
    """Orbits, targets, then bodies, in space."""
    bounds = view.bounds
    for curve, name in view.curves:
        color = family_style(name).color
        axes.plot(*curve.T, color=color, linewidth=0.4, alpha=0.6, rasterized=True, zorder=1)
    inside = points[np.all((points >= bounds[:, 0]) & (points <= bounds[:, 1]), axis=1)]
    axes.plot(*inside.T, rasterized=True, zorder=2, **_TARGETS)
    draw_bodies(axes, mu, (0, 1, 2), bounds)


@house_style()
def family_map_figure(orbits: xr.Dataset) -> Figure:
    """The members of ``orbits/families.nc`` by Jacobi constant, period and stability index."""
    family = orbits["family"].values.astype(str)
    days = orbits["period"].values * float(orbits.attrs["time_unit_s"]) / SECONDS_PER_DAY
    jacobi, stability = orbits["jacobi"].values, orbits["stability_index"].values
    figure = new_figure(6.4)
    panels = figure.subplots(
        2, 2, gridspec_kw={"left": 0.075, "right": 0.985, "bottom": 0.17, "top": 0.96,
                           "hspace": 0.32, "wspace": 0.22}
    )  # fmt: skip
    everywhere = np.full(len(family), True)
    near = jacobi >= _CLOSE_UP if np.any(jacobi >= _CLOSE_UP) else everywhere
    views = (
        (jacobi, days, everywhere, _JACOBI, _PERIOD, "period by Jacobi constant"),
        (jacobi, stability, everywhere, _JACOBI, _STABILITY, "stability by Jacobi constant"),
        (jacobi, days, near, _JACOBI, _PERIOD, f"as (a), Jacobi constant from {_CLOSE_UP}"),
        (days, stability, everywhere, _PERIOD, _STABILITY, "stability by period"),
    )
    for number, (x, y, kept, x_name, y_name, title) in enumerate(views):
        axes = panels.flat[number]
        for name in families_present(orbits):
            members = np.flatnonzero((family == name) & kept)
            style = family_style(name)
            axes.plot(
                x[members],
                y[members],
                color=style.color,
                linestyle=style.line,
                linewidth=0.6,
                # northern halves lie over their southern mirror images
                zorder=2.1 if style.filled else 2.0,
                **style.marker_kwargs(2.8 if style.filled else 4.8),
            )
        axes.set(xlabel=x_name, ylabel=y_name)
        if y_name == _STABILITY:
            axes.set_yscale("log")
            axes.axhline(1.0, color=GRAY, linewidth=0.8, zorder=1)
        panel_title(axes, number, title)
    figure.legend(
        handles=[family_style(name).legend_handle() for name in families_present(orbits)],
        loc="lower center",
        ncols=5,
        handlelength=3,
    )
    return figure
