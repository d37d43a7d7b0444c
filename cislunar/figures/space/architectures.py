"""Figures of the chosen architectures: their orbits, with the satellites on them."""

from collections.abc import Mapping

import xarray as xr
from matplotlib.figure import Figure

from cislunar.campaign.architectures.variables import phases_of
from cislunar.constants import SECONDS_PER_DAY
from cislunar.figures.axes import Grid, legend_below, place
from cislunar.figures.space.earth_moon import (
    body_handles,
    stays_around_moon,
    thousands,
)
from cislunar.figures.space.orbit_tracks import orbit_curve, satellite_tracks
from cislunar.figures.space.tiles import TileOrbit, draw_tile
from cislunar.figures.style import (
    family_style,
    house_style,
    new_figure,
    panel_letter,
)

_WHOLE_IN, _NEAR_IN, _HEAD_IN, _FOOT_IN = 1.95, 1.1, 0.24, 0.3
_COLUMNS = 5
_TILE_IN = (0.72, 0.86)
_GAP_IN, _TEXT_IN = 0.06, 0.36
_SMALL = {"fontsize": 6.2, "pad": 2.0, "linespacing": 1.15}


def power_of_ten(value: float, digits: int = 3) -> str:
    """A number as mathematical text, e.g. 1.51 x 10^-4."""
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return rf"${mantissa}\times10^{{{int(exponent)}}}$"


@house_style()
def selected_orbits_figure(
    orbits: xr.Dataset, architectures: Mapping[str, xr.Dataset], targets: Mapping[str, int]
) -> Figure:
    """The orbits of one optimizer's architectures by scenario, with the satellites at the epoch.

    A row for each scenario: the whole system, the orbits around the Moon together, and a tile for
    each orbit with its number, family, satellites and period. From ``orbits/families.nc`` and
    ``architecture/{scenario}/{optimizer}.nc`` by scenario; `targets` is the number of static
    targets of each.
    """
    mu, unit = float(orbits.attrs["mu"]), float(orbits.attrs["length_unit_km"])
    scenes = {scenario: _scene(orbits, each) for scenario, each in architectures.items()}
    lines = -(-max(len(drawn) for drawn in scenes.values()) // _COLUMNS)
    row_in = _HEAD_IN + max(lines, 2) * (_TILE_IN[1] + _TEXT_IN)
    figure = new_figure(row_in * len(scenes) + _FOOT_IN)
    height = figure.get_size_inches()[1]
    for row, (scenario, drawn) in enumerate(scenes.items()):
        foot = _FOOT_IN + (len(scenes) - 1 - row) * row_in
        title = _title(scenario, architectures[scenario], targets[scenario])
        above = (0.015, (foot + row_in - 0.06) / height)
        figure.text(*above, f"{panel_letter(row)} {title}", fontsize=8.5, va="top")
        close = [each for each in drawn if stays_around_moon(each.curve, mu)]
        views = (
            (drawn, "the whole system", 0.1, _WHOLE_IN, True),
            (close, "around the Moon", 0.1 + _WHOLE_IN + _GAP_IN, _NEAR_IN, False),
        )
        for chosen, text, left, wide, whole in views:
            if chosen:
                tile = place(figure, left, foot, wide, row_in - _HEAD_IN - 0.5 * _TEXT_IN)
                draw_tile(tile, chosen, mu, unit, satellites=False, whole=whole)
                tile.set_title(text, **_SMALL)
        left = 0.1 + _WHOLE_IN + _NEAR_IN + 3.0 * _GAP_IN
        grid = Grid(lines, _COLUMNS, *_TILE_IN, left, foot, _GAP_IN, _TEXT_IN)
        for number, (each, text) in enumerate(
            zip(drawn, _names(orbits, architectures[scenario]), strict=True)
        ):
            tile = grid.place(figure, *divmod(number, _COLUMNS))
            draw_tile(tile, [each], mu, unit)
            tile.set_title(text, **_SMALL)
    legend_below(figure, body_handles(), 0.06)
    return figure


def _title(scenario: str, architecture: xr.Dataset, targets: int) -> str:
    total = int(architecture["satellites"].sum())
    value = power_of_ten(float(architecture["J"]))
    return f"Scenario {scenario}: {thousands(targets)} targets, {total} satellites, J = {value}"


def _scene(orbits: xr.Dataset, architecture: xr.Dataset) -> list[TileOrbit]:
    """Every chosen orbit with its satellites."""
    family = orbits["family"].values.astype(str)
    return [
        TileOrbit(
            orbit_curve(orbits, int(index)),
            family_style(family[index]),
            satellite_tracks(orbits, int(index), int(count), phase=float(phase)),
        )
        for index, count, phase in zip(
            architecture["orbit"].values,
            architecture["satellites"].values,
            phases_of(architecture),
            strict=True,
        )
    ]


def _names(orbits: xr.Dataset, architecture: xr.Dataset) -> list[str]:
    """Number, family, satellites and period of every chosen orbit, in two lines."""
    index = architecture["orbit"].values
    days = orbits["period"].values[index] * float(orbits.attrs["time_unit_s"]) / SECONDS_PER_DAY
    family = orbits["family"].values.astype(str)[index]
    counts = architecture["satellites"].values
    return [
        f"{number}. {family_style(name).label}\n{count} sat., {period:.1f} d"
        for number, (name, count, period) in enumerate(
            zip(family, counts, days, strict=True), start=1
        )
    ]
