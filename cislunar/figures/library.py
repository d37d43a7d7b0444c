"""Figures of the orbit library: the orbits with the static targets, and the map of the members."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cislunar.constants import SECONDS_PER_DAY
from cislunar.figures.scene import (
    AXES,
    around_moon,
    body_handles,
    clip,
    draw_bodies,
    limits,
    orbit_curve,
    plane_axes,
    space_axes,
    thousands,
)
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


def families_present(orbits: xr.Dataset) -> list[str]:
    """Families of the library, in the order of the styles."""
    present = set(orbits["family"].values.astype(str))
    return [name for name in FAMILY_STYLE if name in present] + sorted(present - set(FAMILY_STYLE))


@house_style()
def orbit_library_figure(orbits: xr.Dataset, targets: xr.Dataset) -> Figure:
    """Every candidate observer orbit with the static targets of a scenario.

    Above, the whole system and the surroundings of the Moon in space; below, their projections.

    Parameters
    ----------
    orbits, targets : xarray.Dataset
        ``orbits/families.nc`` and ``targets/static_{scenario}.nc``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    mu, unit = float(orbits.attrs["mu"]), float(orbits.attrs["length_unit_km"])
    family = orbits["family"].values.astype(str)
    curves = [orbit_curve(orbits, index) for index in range(len(family))]
    points = targets["position"].values
    whole = limits([*curves, points], margin=0.02)
    near = around_moon(mu, curves)
    figure = new_figure(7.1)
    places = ((-0.02, 0.49, 0.53, 0.47), (0.47, 0.49, 0.53, 0.47))
    titles = ("the whole system", "around the Moon")
    for column, (place, bounds, title) in enumerate(
        zip(places, (whole, near), titles, strict=True)
    ):
        axes = figure.add_axes(place, projection="3d", computed_zorder=False)
        space_axes(axes, bounds, unit, zoom=0.92)
        _draw(axes, curves, family, points, bounds, _SPACE, mu)
        figure.text(
            0.02 + 0.5 * column, 0.965, f"{panel_letter(column)} {title}", fontsize=8.5, va="top"
        )
    planes = (((0, 1), whole), ((0, 2), whole), ((0, 2), near))
    for column, (plane, bounds) in enumerate(planes):
        axes = figure.add_axes((0.07 + 0.33 * column, 0.165, 0.25, 0.27))
        plane_axes(axes, plane, bounds, unit)
        _draw(axes, curves, family, points, bounds, plane, mu)
        where = titles[1 if bounds is near else 0]
        pair = f"{AXES[plane[0]]}\N{EN DASH}{AXES[plane[1]]}"
        axes.set_title(f"{panel_letter(column + 2)} {pair}, {where}")
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


def _draw(axes, curves, family, points, bounds, shown, mu) -> None:
    """Targets, then orbits, then bodies, in the given coordinates."""
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
    for curve, name in zip(curves, family, strict=True):
        style = family_style(name)
        axes.plot(
            *clip(curve, bounds)[:, shown].T,
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
    """The members of every family by Jacobi constant, period and stability index.

    Parameters
    ----------
    orbits : xarray.Dataset
        ``orbits/families.nc``.

    Returns
    -------
    matplotlib.figure.Figure
    """
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
        axes.set_title(f"{panel_letter(number)} {title}", loc="left")
    figure.legend(
        handles=[family_style(name).legend_handle() for name in families_present(orbits)],
        loc="lower center",
        ncols=5,
        handlelength=3,
    )
    return figure
