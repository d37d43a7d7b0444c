"""Figures of the chosen architectures: their orbits, with the satellites on them."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cislunar.constants import SECONDS_PER_DAY
from cislunar.figures.axes import Array
from cislunar.figures.space.earth_moon import (
    around_moon,
    body_handles,
    draw_bodies,
    limits,
    space_axes,
    stays_around_moon,
    thousands,
)
from cislunar.figures.space.orbit_tracks import orbit_curve, satellite_tracks
from cislunar.figures.style import family_style, house_style, new_figure, panel_letter

ROW_HEIGHT_IN = 3.0
_SPACE = (0, 1, 2)


class _ChosenOrbit(NamedTuple):
    """An orbit of an architecture: family, one period, satellites at the epoch."""

    family: str
    curve: Array
    satellites: Array


def power_of_ten(value: float, digits: int = 3) -> str:
    """A number as mathematical text, e.g. 1.51 x 10^-4."""
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return rf"${mantissa}\times10^{{{int(exponent)}}}$"


@house_style()
def selected_orbits_figure(
    orbits: xr.Dataset, architectures: Mapping[str, xr.Dataset], targets: Mapping[str, int]
) -> Figure:
    """The orbits of one optimizer's architectures by scenario, with the satellites at the epoch.

    A row for each scenario: the whole system, the surroundings of the Moon, the list of orbits.
    From ``orbits/families.nc`` and ``architecture/{scenario}/{optimizer}.nc`` by scenario;
    `targets` is the number of static targets of each.
    """
    rows = len(architectures)
    figure = new_figure(ROW_HEIGHT_IN * rows)
    scenes = {scenario: _scene(orbits, each) for scenario, each in architectures.items()}
    mu = float(orbits.attrs["mu"])
    earth, moon = np.array([-mu, 0.0, 0.0]), np.array([1.0 - mu, 0.0, 0.0])
    everything = [each.curve for drawn in scenes.values() for each in drawn]
    whole = limits([*everything, earth, moon], margin=0.03)
    near = around_moon(mu, everything)
    for row, (scenario, architecture) in enumerate(architectures.items()):
        top, height = 1.0 - row / rows, 1.0 / rows
        figure.text(
            0.015,
            top - 0.03 * height,
            f"{panel_letter(row)} {_title(scenario, architecture, targets[scenario])}",
            fontsize=8.5,
            va="top",
        )
        drawn = scenes[scenario]
        close = [each for each in drawn if stays_around_moon(each.curve, mu)]
        for left, bounds, within in ((-0.025, whole, drawn), (0.345, near, close)):
            place = (left, top - 0.92 * height, 0.38, 0.86 * height)
            axes = space_axes(
                figure, place, bounds, float(orbits.attrs["length_unit_km"]), zoom=0.88
            )
            _draw(axes, within)
            draw_bodies(axes, mu, _SPACE, bounds)
        figure.legend(
            handles=[*_handles(orbits, architecture), *body_handles()],
            loc="center left",
            bbox_to_anchor=(0.745, top - 0.52 * height),
            handlelength=3.2,
            fontsize=6.8,
            labelspacing=0.45,
        )
    return figure


def _title(scenario: str, architecture: xr.Dataset, targets: int) -> str:
    total = int(architecture["satellites"].sum())
    value = power_of_ten(float(architecture["J"]))
    return f"Scenario {scenario}: {thousands(targets)} targets, {total} satellites, J = {value}"


def _scene(orbits: xr.Dataset, architecture: xr.Dataset) -> list[_ChosenOrbit]:
    """Every chosen orbit with its satellites."""
    return [
        _ChosenOrbit(
            str(orbits["family"].values[index]),
            orbit_curve(orbits, int(index)),
            satellite_tracks(orbits, int(index), int(count)),
        )
        for index, count in zip(
            architecture["orbit"].values, architecture["satellites"].values, strict=True
        )
    ]


def _handles(orbits: xr.Dataset, architecture: xr.Dataset) -> list[Line2D]:
    """Legend entry of every chosen orbit: family, satellites, period."""
    index = architecture["orbit"].values
    days = orbits["period"].values[index] * float(orbits.attrs["time_unit_s"]) / SECONDS_PER_DAY
    handles = []
    for name, count, period in zip(
        orbits["family"].values.astype(str)[index],
        architecture["satellites"].values,
        days,
        strict=True,
    ):
        style = family_style(name)
        label = f"{style.label} \N{MULTIPLICATION SIGN} {count}, {period:.1f} d"
        handles.append(style.legend_handle(label))
    return handles


def _draw(axes, drawn: list[_ChosenOrbit]) -> None:
    """Orbits, and their satellites at the epoch."""
    for each in drawn:
        style = family_style(each.family)
        axes.plot(*each.curve.T, color=style.color, linestyle=style.line, linewidth=0.9, zorder=2)
        marks = {"linestyle": "none", "color": style.color} | style.marker_kwargs(3.6)
        axes.plot(*each.satellites.T, zorder=5, **marks)
