"""What light curves reveal about body parameters: deviations and errors over the prior."""

import json

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cislunar.errors import InputFileError
from cislunar.evaluation.metrics import NEVER_OBSERVED
from cislunar.figures import style
from cislunar.figures.axes import Array, Grid, legend_below
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
