"""Body parameters estimated from light curves, over their prior, and characterization of objects
whose body may differ from the assumed one, compared with the truth."""

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cislunar.campaign.tracking.summary import BRIGHT_ROWS, characterized_in
from cislunar.errors import InputFileError
from cislunar.evaluation import NEVER_OBSERVED, CharacterizedTargets, spin_axis_error_deg
from cislunar.figures import style
from cislunar.figures.axes import (
    Array,
    Grid,
    legend_below,
    log_ticks,
    note_below,
    panel_title,
    reach,
)
from cislunar.figures.labels import BODY_PARAMETERS
from cislunar.figures.panels import Row, draw_rows

_WIDTH, _HEIGHT, _LEFT, _FOOT, _HEAD, _GAP = 1.32, 1.9, 0.62, 0.92, 0.42, 0.1

_LABEL = "estimated standard deviation: median, and 10 % to 90 % of the targets"
_ESTIMATED = style.SeriesStyle(_LABEL, style.BLUE, style.SOLID, "")
_TRUE = style.SeriesStyle("68th percentile of the true error", style.VERMILION, style.DASHED, "")


def shares_of_prior(cell: xr.Dataset) -> dict[str, tuple[Array, Array]]:
    """Standard deviations and absolute errors of estimated parameters over those of the prior.

    Arrays of shape (epoch, value) by the key of `task2.batch.estimated_parameters`, of all observed
    targets of all realizations of a cell. An `InputFileError` if it has no `parameter_sigma`.
    """
    if "parameter_sigma" not in cell:
        raise InputFileError(
            "the tracking cell estimates no body parameters: give a variant with "
            "task2.batch.estimated_parameters numbers of targets, or leave the figure out"
        )
    prior = json.loads(cell.attrs["settings"])["batch"]["estimated_parameters"]
    observed = cell["status"].values != NEVER_OBSERVED
    names = cell["parameter"].values.astype(str)
    found = {}
    for key in (key for key in BODY_PARAMETERS if prior.get(key)):
        own = [i for i, name in enumerate(names) if name == key or name.startswith(f"{key}_")]
        sigma, error = (
            np.moveaxis(cell[f"parameter_{name}"].values[..., own], 1, 0)[:, observed]
            for name in ("sigma", "error")
        )
        found[key] = tuple(
            np.abs(each).reshape(each.shape[0], -1) / prior[key] for each in (sigma, error)
        )
    return found


@style.house_style()
def learned_figure(cell: xr.Dataset) -> Figure:
    """Draw estimated deviation and true error of each kind of parameter over the prior."""
    shares = shares_of_prior(cell)
    hours = cell["epoch"].values / 3600.0
    hours = hours + hours[1] if hours.size > 1 else hours  # estimated at the end of the interval
    grid = Grid(1, len(shares), _WIDTH, _HEIGHT, _LEFT, _FOOT, _GAP)
    figure = style.new_figure(_HEAD + grid.size[1] + _FOOT, _LEFT + grid.size[0] + 0.12)

    def draw(axes: Axes, _: Row, column: int) -> Array:
        sigma, error = list(shares.values())[column]
        low, middle, high = np.nanpercentile(sigma, [10.0, 50.0, 90.0], axis=1)
        axes.fill_between(hours, low, high, color=_ESTIMATED.color, alpha=0.2, linewidth=0)
        axes.plot(hours, middle, **_ESTIMATED.line_kwargs())
        lines = [low, high]
        if np.isfinite(error).any():
            lines.append(np.nanpercentile(error, 100.0 * 0.6827, axis=1))
            axes.plot(hours, lines[-1], **_TRUE.line_kwargs())
        axes.set_xlabel("time, h")
        return np.concatenate(lines)

    row = Row("ratio to the prior standard\ndeviation, dimensionless", (), log=True)
    draw_rows(figure, grid, [row], [BODY_PARAMETERS[key] for key in shares], draw)
    legend_below(figure, [each.legend_handle() for each in (_ESTIMATED, _TRUE)], 0.2)
    return figure


_STATUS = (
    style.SeriesStyle("attitude unique", style.BLUE, style.SOLID, "o"),
    style.SeriesStyle("attitude ambiguous", style.ORANGE, style.SOLID, "s"),
    style.SeriesStyle("shape or law not as assumed", style.VERMILION, style.SOLID, "^"),
)
_EQUAL = style.SeriesStyle("estimate equals truth", style.BLACK, style.DASHED, "")
_INTERVALS = {
    "spin_period": ("spin period", "h", False),
    "amplitude": ("amplitude", "mag", False),
    "area_albedo": ("area times albedo", "m$^2$", True),
}
"""Title, unit, and whether the axes are logarithmic."""


def _bright(cells: Sequence[xr.Dataset]) -> tuple[CharacterizedTargets, NDArray[np.int64]]:
    """Characterization and last attitude status of the bright targets of all realizations."""
    found, status = [], []
    for cell in cells:
        if "spin_period" not in cell:
            raise InputFileError(
                "the tracking cell chooses no models of bodies: give a variant with "
                "task2.batch.model_selection.effort numbers of targets, or leave the figure out"
            )
        bright = cell["updates"].values >= BRIGHT_ROWS
        found.append([each[bright] for each in characterized_in(cell)])
        status.append(cell["attitude_status"].values[:, -1][bright].astype(np.int64))
    joined = (np.concatenate(each) for each in zip(*found, strict=True))
    return CharacterizedTargets(*joined), np.concatenate(status)


@style.house_style()
def characterization_figure(cells: Sequence[xr.Dataset]) -> Figure:
    """Draw the characterization of the bright targets of some cells against the truth."""
    found, status = _bright(cells)
    grid = Grid(1, 4, 1.38, 1.38, 0.45, 0.95, 0.5)
    figure = style.new_figure(0.3 + grid.size[1] + grid.foot, grid.left + grid.size[0] + 0.12)

    def panel(number: int, title: str, x: Array, y: Array, ends: Array, log: bool) -> Axes:
        axes = grid.place(figure, 0, number)
        for own, series in enumerate(_STATUS):
            of = status == own
            spans = np.abs(ends[of].T - y[of]) if ends.size else None
            axes.errorbar(
                x[of], y[of], spans, elinewidth=0.6, ecolor=(series.color, 0.6),
                **series.point_kwargs(2.8),
            )  # fmt: skip
        panel_title(axes, number, title)
        limits = reach(np.concatenate([x, y]), log=log)
        scale = {"xscale": "log", "yscale": "log"} if log else {}
        axes.set(xlim=limits, ylim=limits, **scale)
        for axis in (axes.xaxis, axes.yaxis) if log else ():
            log_ticks(axis, *limits)
        axes.plot(limits, limits, zorder=1, **_EQUAL.line_kwargs())
        return axes

    for number, (name, (title, unit, log)) in enumerate(_INTERVALS.items()):
        value, true = getattr(found, name), getattr(found, f"true_{name}")
        axes = panel(number, title, true, value[:, 0], value[:, 1:], log)
        axes.set(xlabel=f"truth, {unit}", ylabel=f"estimate, {unit}")
    error = spin_axis_error_deg(found)
    axes = panel(3, "spin axis", found.spin_axis_radius, error, np.empty(0), True)
    axes.set(xlabel="angle of 95 %, deg", ylabel="error, deg")
    note = (
        f"{status.size} targets with at least {BRIGHT_ROWS} measurements; bars: intervals of 95 %; "
        "(d): errors below the line are within the angle that contains 95 %"
    )
    bottom = note_below(figure, note)
    legend_below(
        figure, [*(each.legend_handle(line=False) for each in _STATUS), _EQUAL.legend_handle()],
        bottom,
    )  # fmt: skip
    return figure
