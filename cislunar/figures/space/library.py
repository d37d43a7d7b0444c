"""Figures of the orbit library: the orbits with the static targets, and the map of the members."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cislunar.constants import SECONDS_PER_DAY
from cislunar.figures.axes import Array, panel_title
from cislunar.figures.space.earth_moon import (
    AXES,
    around_moon,
    body_handles,
    draw_bodies,
    limits,
    plane_axes,
    space_axes,
    stays_around_moon,
    thousands,
)
from cislunar.figures.space.orbit_tracks import orbit_curve
from cislunar.figures.style import (
    FAMILY_STYLE,
    GRAY,
    family_style,
    house_style,
    new_figure,
    panel_letter,
)

_TARGET_COLOR = "#6E6E6E"
_SPACE = (0, 1, 2)
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


@house_style()
def orbit_library_figure(orbits: xr.Dataset, targets: xr.Dataset) -> Figure:
    """Every candidate observer orbit with the static targets of a scenario.

    Above, the whole system and the surroundings of the Moon in space; below, their projections.
    From ``orbits/families.nc`` and ``targets/static_{scenario}.nc``.
    """
    mu, unit = float(orbits.attrs["mu"]), float(orbits.attrs["length_unit_km"])
    family = orbits["family"].values.astype(str)
    curves = [orbit_curve(orbits, index) for index in range(len(family))]
    points = targets["position"].values
    drawn = list(zip(curves, family, strict=True))
    close = [(curve, name) for curve, name in drawn if stays_around_moon(curve, mu)]
    whole = _View("the whole system", limits([*curves, points], margin=0.02), drawn)
    near = _View("orbits around the Moon", around_moon(mu, curves), close)
    figure = new_figure(7.1)
    for column, view in enumerate((whole, near)):
        place = (-0.02 + 0.49 * column, 0.49, 0.53, 0.47)
        axes = space_axes(figure, place, view.bounds, unit, zoom=0.92)
        _draw(axes, view, points, _SPACE, mu)
        title = f"{panel_letter(column)} {view.title}"
        figure.text(0.02 + 0.5 * column, 0.965, title, fontsize=8.5, va="top")
    for column, (plane, view) in enumerate((((0, 1), whole), ((0, 2), whole), ((0, 2), near))):
        axes = figure.add_axes((0.07 + 0.33 * column, 0.165, 0.25, 0.27))
        plane_axes(axes, plane, view.bounds, unit)
        _draw(axes, view, points, plane, mu)
        pair = f"{AXES[plane[0]]}\N{EN DASH}{AXES[plane[1]]}"
        axes.set_title(f"{panel_letter(column + 2)} {pair}, {view.title}", fontsize=7.5)
    handles = [_line_handle(name, int(np.sum(family == name))) for name in families_present(orbits)]
    handles.append(
        Line2D([], [], linestyle="none", marker=".", markersize=3, color=_TARGET_COLOR,
               label=f"static targets ({thousands(len(points))})")
    )  # fmt: skip
    figure.legend(handles=[*handles, *body_handles()], loc="lower center", ncols=5, handlelength=3)
    return figure


def _line_handle(name: str, count: int) -> Line2D:
    style = family_style(name)
    return Line2D([], [], color=style.color, linestyle=style.line, label=f"{style.label} ({count})")


def _draw(axes, view: _View, points: Array, shown: Sequence[int], mu: float) -> None:
    """Targets, then orbits, then bodies, in the given coordinates."""
    bounds = view.bounds
    inside = points[np.all((points >= bounds[:, 0]) & (points <= bounds[:, 1]), axis=1)]
    axes.plot(
        *inside[:, shown].T,
        linestyle="none",
        marker=".",
        markersize=1.4,
        markeredgewidth=0,
        color=_TARGET_COLOR,
        alpha=0.8,
        rasterized=True,
        zorder=1,
    )
    for curve, name in view.curves:
        style = family_style(name)
        axes.plot(
            *curve[:, shown].T,
            color=style.color,
            linestyle=style.line,
            linewidth=0.45,
            alpha=0.75,
            rasterized=True,
            zorder=2,
        )
    draw_bodies(axes, mu, shown, bounds)


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
