"""Figures of architectures: their orbits with the satellites on them."""

from collections.abc import Mapping

import xarray as xr
from matplotlib.figure import Figure

from cislunar.campaign.architectures.variables import phases_of
from cislunar.constants import SECONDS_PER_DAY
from cislunar.figures import style
from cislunar.figures.axes import Grid, legend_below, place
from cislunar.figures.space import earth_moon
from cislunar.figures.space.orbit_tracks import orbit_curve, satellite_tracks
from cislunar.figures.space.tiles import TileOrbit, draw_tile

_WHOLE_IN, _NEAR_IN, _HEAD_IN, _FOOT_IN = 1.95, 1.1, 0.24, 0.3
_COLUMNS = 5
_TILE_IN = (0.72, 0.86)
_GAP_IN, _TEXT_IN = 0.06, 0.36
_SMALL = {"fontsize": 6.2, "pad": 2.0, "linespacing": 1.15}


def power_of_ten(value: float) -> str:
    """A number as mathematical text, such as 1.51 x 10^-4."""
    mantissa, exponent = f"{value:.2e}".split("e")
    return rf"${mantissa}\times10^{{{int(exponent)}}}$"


@style.house_style()
def selected_orbits_figure(
    orbits: xr.Dataset, architectures: Mapping[str, xr.Dataset], targets: Mapping[str, xr.Dataset]
) -> Figure:
    """Draw the orbits of the architectures of one optimizer, with their satellites at the epoch.

    A row for each scenario shows the Earth-Moon system, the orbits around the Moon together, and a
    tile for each orbit with its number, family, satellites and period. The data are
    ``orbits/families.nc``, and ``architecture/{scenario}/{optimizer}.nc`` and
    ``targets/static_{scenario}.nc`` by scenario.
    """
    mu, unit = float(orbits.attrs["mu"]), float(orbits.attrs["length_unit_km"])
    scenes = {scenario: _scene(orbits, each) for scenario, each in architectures.items()}
    lines = -(-max(len(drawn) for drawn in scenes.values()) // _COLUMNS)
    row_in = _HEAD_IN + max(lines, 2) * (_TILE_IN[1] + _TEXT_IN)
    figure = style.new_figure(row_in * len(scenes) + _FOOT_IN)
    height = figure.get_size_inches()[1]
    for row, (scenario, named) in enumerate(scenes.items()):
        drawn = list(named.values())
        foot = _FOOT_IN + (len(scenes) - 1 - row) * row_in
        title = _title(scenario, architectures[scenario], targets[scenario].sizes["target"])
        above = (0.015, (foot + row_in - 0.06) / height)
        figure.text(*above, f"{style.panel_letter(row)} {title}", fontsize=8.5, va="top")
        close = [each for each in drawn if earth_moon.stays_around_moon(each.curve, mu)]
        views = (
            (drawn, "Earth-Moon system", 0.1, _WHOLE_IN, True),
            (close, "vicinity of the Moon", 0.1 + _WHOLE_IN + _GAP_IN, _NEAR_IN, False),
        )
        for chosen, text, left, wide, whole in views:
            if chosen:
                tile = place(figure, left, foot, wide, row_in - _HEAD_IN - 0.5 * _TEXT_IN)
                draw_tile(tile, chosen, mu, unit, satellites=False, whole=whole)
                tile.set_title(text, **_SMALL)
        left = 0.1 + _WHOLE_IN + _NEAR_IN + 3.0 * _GAP_IN
        grid = Grid(lines, _COLUMNS, *_TILE_IN, left, foot, _GAP_IN, _TEXT_IN)
        for number, (text, each) in enumerate(named.items()):
            tile = grid.place(figure, *divmod(number, _COLUMNS))
            draw_tile(tile, [each], mu, unit)
            tile.set_title(text, **_SMALL)
    legend_below(figure, earth_moon.body_handles(), 0.06)
    return figure


def _title(scenario: str, architecture: xr.Dataset, targets: int) -> str:
    total = int(architecture["satellites"].sum())
    value = power_of_ten(float(architecture["J"]))
    counts = f"{earth_moon.thousands(targets)} targets, {total} satellites"
    return f"Scenario {scenario}: {counts}, figure of merit J = {value}"


def _scene(orbits: xr.Dataset, architecture: xr.Dataset) -> dict[str, TileOrbit]:
    """Every orbit of an architecture with its satellites, by number, family and period."""
    chosen = (architecture["orbit"].values, architecture["satellites"].values)
    found = {}
    for orbit, count, phase in zip(*chosen, phases_of(architecture), strict=True):
        series = style.family_style(str(orbits["family"].values[orbit]))
        period = orbits["period"].values[orbit] * float(orbits.attrs["time_unit_s"])
        text = f"{len(found) + 1}. {series.label}\n{count} sat., {period / SECONDS_PER_DAY:.1f} d"
        satellites = satellite_tracks(orbits, int(orbit), int(count), phase=float(phase))
        found[text] = TileOrbit(orbit_curve(orbits, int(orbit)), series, satellites)
    return found
