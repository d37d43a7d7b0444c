"""Figures of the orbit library: orbits with static targets, and characteristics of its members."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cislunar.constants import SECONDS_PER_DAY
from cislunar.figures import style
from cislunar.figures.axes import Array, Grid, legend_below, panel_title
from cislunar.figures.space import earth_moon
from cislunar.figures.space.orbit_tracks import orbit_curve
from cislunar.figures.space.tiles import TileOrbit, draw_tile

_JACOBI = "Jacobi constant, nondimensional"
_PERIOD = "period, days"
_STABILITY = "stability index, dimensionless"
_CLOSE_UP = 2.7
"""Jacobi constant from which most families have their members."""


class _View(NamedTuple):
    """A part of the Earth-Moon system with its orbits."""

    title: str
    bounds: Array
    curves: list[tuple[Array, str]]


def families_present(orbits: xr.Dataset) -> list[str]:
    """Families of the library, in the order of their styles."""
    present = set(orbits["family"].values.astype(str))
    known = [name for name in style.FAMILY_STYLE if name in present]
    return known + sorted(present - set(known))


def halves(families: Sequence[str]) -> dict[str, list[str]]:
    """Families by their common name, northern and southern halves together."""
    found: dict[str, list[str]] = {}
    for name in families:
        found.setdefault(re.sub("_[NS]$", "", name), []).append(name)
    return found


@style.house_style()
def orbit_library_figure(orbits: xr.Dataset, targets: xr.Dataset) -> Figure:
    """Draw every candidate observer orbit with the static targets of a scenario.

    The upper panels show the whole system and the vicinity of the Moon, the lower ones the families
    with their halves in two tones. The data are ``orbits/families.nc`` and
    ``targets/static_{scenario}.nc``.
    """
    mu, unit = float(orbits.attrs["mu"]), float(orbits.attrs["length_unit_km"])
    family = orbits["family"].values.astype(str)
    curves = [orbit_curve(orbits, index) for index in range(len(family))]
    points = targets["position"].values
    drawn = list(zip(curves, family, strict=True))
    close = [(curve, name) for curve, name in drawn if earth_moon.stays_around_moon(curve, mu)]
    whole = _View("Earth-Moon system", earth_moon.limits([*curves, points], margin=0.02), drawn)
    near = _View("vicinity of the Moon", earth_moon.around_moon(mu, curves), close)
    groups = halves(families_present(orbits))
    grid = Grid(-(-len(groups) // 4), 4, 1.66, 1.4, 0.1, 0.3, 0.12, 0.22)
    figure = style.new_figure(grid.foot + grid.size[1] + _SPACE_IN)
    height = figure.get_size_inches()[1]
    for column, view in enumerate((whole, near)):
        box = (-0.02 + 0.49 * column, 1.0 - (_SPACE_IN - 0.42) / height, 0.53)
        box = (*box, (_SPACE_IN - 0.55) / height)
        axes = earth_moon.space_axes(figure, box, view.bounds, unit, zoom=0.95)
        _draw(axes, view, points, mu)
        title = f"{style.panel_letter(column)} {view.title}"
        figure.text(0.02 + 0.5 * column, 1.0 - 0.1 / height, title, fontsize=8.5, va="top")
    for number, names in enumerate(groups.values()):
        axes = grid.place(figure, *divmod(number, grid.columns))
        own = [
            TileOrbit(c, style.family_style(name)) for name in names for c, f in drawn if f == name
        ]
        draw_tile(axes, own, mu, unit, width=0.5)
        counts = ", ".join(_count(name, int(np.sum(family == name))) for name in names)
        text = f"{re.sub(' [NS]$', '', style.family_style(names[0]).label)}: {counts}"
        panel_title(axes, number + 2, text, fontsize=7.0, pad=2.0)
    tones = ("#707070", "N, northern half"), (style.BLACK, "S, southern half: darker")
    tones += (("#B8B8B8", "planar: lighter"),)
    handles = [Line2D([], [], color=tone, label=label) for tone, label in tones]
    label = f"static targets ({earth_moon.thousands(len(points))})"
    handles.append(Line2D([], [], label=label, **_TARGETS | {"markersize": 3.0}))
    legend_below(figure, [*handles, *earth_moon.body_handles()], 0.06)
    return figure


_TARGETS = {"linestyle": "none", "marker": ".", "markersize": 2.4, "markeredgewidth": 0,
            "color": style.BLACK}  # fmt: skip
_SPACE_IN = 3.65
"""Height of the views in space, inches."""


def _count(name: str, count: int) -> str:
    """Number of orbits of a family or of its half."""
    return f"{count} {name[-1]}" if name.endswith(("_N", "_S")) else f"{count}"


def _draw(axes: Axes, view: _View, points: Array, mu: float) -> None:
    """Draw orbits, targets and bodies in space."""
    bounds = view.bounds
    for curve, name in view.curves:
        color = style.family_style(name).color
        axes.plot(*curve.T, color=color, linewidth=0.4, alpha=0.6, rasterized=True, zorder=1)
    inside = points[np.all((points >= bounds[:, 0]) & (points <= bounds[:, 1]), axis=1)]
    axes.plot(*inside.T, rasterized=True, zorder=2, **_TARGETS)
    earth_moon.draw_bodies(axes, mu, (0, 1, 2), bounds)


@style.house_style()
def family_map_figure(orbits: xr.Dataset) -> Figure:
    """Draw Jacobi constant, period and stability index of the members of ``orbits/families.nc``.

    The halves of a family are mirror images with the same values, so that they share a curve.
    """
    family = orbits["family"].values.astype(str)
    days = orbits["period"].values * float(orbits.attrs["time_unit_s"]) / SECONDS_PER_DAY
    jacobi, stability = orbits["jacobi"].values, orbits["stability_index"].values
    figure = style.new_figure(6.4)
    drawn_panels = figure.subplots(
        2, 2, gridspec_kw={"left": 0.085, "right": 0.985, "bottom": 0.155, "top": 0.96,
                           "hspace": 0.34, "wspace": 0.24}
    )  # fmt: skip
    everywhere = np.full(len(family), True)
    near = jacobi >= _CLOSE_UP if np.any(jacobi >= _CLOSE_UP) else everywhere
    detail = f"period, Jacobi constant from {_CLOSE_UP} on"
    views = (
        (jacobi, days, everywhere, _JACOBI, _PERIOD, "period, all members"),
        (jacobi, days, near, _JACOBI, _PERIOD, detail),
        (jacobi, stability, everywhere, _JACOBI, _STABILITY, "stability by Jacobi constant"),
        (days, stability, everywhere, _PERIOD, _STABILITY, "stability by period"),
    )
    groups = halves(families_present(orbits))
    for number, (x, y, kept, x_name, y_name, title) in enumerate(views):
        axes = drawn_panels.flat[number]
        for names in groups.values():
            series = style.family_style(names[0])
            for name in names:
                members = np.flatnonzero((family == name) & kept)
                # many members are close to each other: a few markers tell the families apart
                drawn_as = {"linestyle": series.line, "linewidth": 1.0, "color": series.color}
                drawn_as |= {"markevery": max(1, len(members) // 12)} | series.marker_kwargs(4.6)
                axes.plot(x[members], y[members], **drawn_as)
        axes.set(xlabel=x_name, ylabel=y_name)
        if y_name == _STABILITY:
            axes.set_yscale("log")
            axes.axhline(1.0, color=style.GRAY, linewidth=0.8, zorder=1)
        panel_title(axes, number, title)
    handles = [
        style.family_style(names[0]).legend_handle(_both(names)) for names in groups.values()
    ]
    handles.append(Line2D([], [], color=style.GRAY, linewidth=0.8, label="linearly stable orbit"))
    legend_below(figure, handles, 0.08, 3, handlelength=3)
    return figure


def _both(names: Sequence[str]) -> str:
    """Label of a family with the halves that are present."""
    label = re.sub(" [NS]$", "", style.family_style(names[0]).label)
    found = " and ".join(name[-1] for name in names if name.endswith(("_N", "_S")))
    return f"{label} {found}".strip()
