"""What a light curve tells of a body nobody has measured: from the prior to what is known then."""

import json

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cislunar.errors import InputFileError
from cislunar.evaluation.metrics import NEVER_OBSERVED
from cislunar.figures.axes import Array, Grid, legend_below
from cislunar.figures.panels import Row, draw_rows
from cislunar.figures.style import (
    BLUE,
    DASHED,
    SOLID,
    VERMILION,
    SeriesStyle,
    house_style,
    new_figure,
)

_WIDTH, _HEIGHT, _LEFT, _FOOT, _HEAD, _GAP = 1.32, 1.9, 0.62, 0.92, 0.42, 0.1

LABELS = {
    "log_albedo": "albedo",
    "log_slope": "slope",
    "logit_reflectance": "reflectance",
    "logit_specular_share": "specular share",
    "log_scale": "all light",
    "log_stretch": "lengths",
    "log_facets": "single facets",
    "log_inertia": "inertia",
    "angular_acceleration_deg_h2": "torque",
}
"""What the unknowns are called."""

_CLAIMED = SeriesStyle("claimed standard deviation, median and 10 % to 90 %", BLUE, SOLID, "")
_TRUE = SeriesStyle("68 % of the errors are below", VERMILION, DASHED, "")


def shares_of_prior(cell: xr.Dataset) -> dict[str, tuple[Array, Array]]:
    """Standard deviations and absolute errors of the unknowns over their prior deviations.

    Of all observed targets of all realizations of a cell with `departure_sigma`: by the key of
    `task2.batch.unknowns` arrays of shape (epoch, value). An `InputFileError` if it has none.
    """
    if "departure_sigma" not in cell:
        raise InputFileError(
            "the tracking cell has no unknowns: give a variant with task2.batch.unknowns numbers "
            "of targets, or leave the figure out"
        )
    prior = json.loads(cell.attrs["settings"])["batch"]["unknowns"]
    observed = cell["status"].values != NEVER_OBSERVED
    names = cell["unknown"].values.astype(str)
    found = {}
    for key in (key for key in LABELS if prior.get(key)):
        own = [i for i, name in enumerate(names) if name == key or name.startswith(f"{key}_")]
        sigma, error = (
            np.moveaxis(cell[f"departure_{name}"].values[..., own], 1, 0)[:, observed]
            for name in ("sigma", "error")
        )
        found[key] = tuple(
            np.abs(each).reshape(each.shape[0], -1) / prior[key] for each in (sigma, error)
        )
    return found


@house_style()
def learned_figure(cell: xr.Dataset) -> Figure:
    """Claimed and true knowledge of each kind of unknown over its prior, against time."""
    shares = shares_of_prior(cell)
    hours = cell["epoch"].values / 3600.0
    hours = hours + hours[1] if hours.size > 1 else hours  # known after the interval
    grid = Grid(1, len(shares), _WIDTH, _HEIGHT, _LEFT, _FOOT, _GAP)
    figure = new_figure(_HEAD + grid.size[1] + _FOOT, _LEFT + grid.size[0] + 0.12)

    def draw(axes: Axes, _: Row, column: int) -> Array:
        sigma, error = list(shares.values())[column]
        low, middle, high = np.nanpercentile(sigma, [10.0, 50.0, 90.0], axis=1)
        axes.fill_between(hours, low, high, color=_CLAIMED.color, alpha=0.2, linewidth=0)
        axes.plot(hours, middle, color=_CLAIMED.color, linestyle=_CLAIMED.line)
        lines = [low, high]
        if np.isfinite(error).any():
            lines.append(np.nanpercentile(error, 100.0 * 0.6827, axis=1))
            axes.plot(hours, lines[-1], color=_TRUE.color, linestyle=_TRUE.line)
        axes.set_xlabel("time, h")
        return np.concatenate(lines)

    row = Row("share of the prior's\nstandard deviation", (), log=True)
    draw_rows(figure, grid, [row], [LABELS[key] for key in shares], draw)
    legend_below(figure, [each.legend_handle() for each in (_CLAIMED, _TRUE)], 0.2)
    return figure
