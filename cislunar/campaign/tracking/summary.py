"""Statistics over the targets of every cell, one value per realization: ``task2/summary.nc``.

Averages are over the targets with at least one measurement used. A target that is never observed
keeps the wide bounds it began with and is trivially within them; such targets are counted apart.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.campaign.data.netcdf import read_dataset, variable
from cislunar.campaign.data.provenance import provenance
from cislunar.campaign.settings.cells import Cell
from cislunar.errors import InputFileError
from cislunar.evaluation.metrics import DIVERGED, NEVER_OBSERVED, PARTS, TRACKED

Array = NDArray[np.float64]

PART_UNITS = ("1", "rad s-1", "1", "1")
"""Units of the errors of the parts; those of the paper."""

PER_PART = {
    "coverage": "share of the time within 3 sigma, mean over targets and axes",
    "anees_median": "component-wise ANEES, median over targets and axes",
    "anees_mean": "component-wise ANEES, mean over targets and axes",
    "anees_mean_periodic": "component-wise ANEES, mean over targets on periodic orbits and axes",
    "bound_ratio_median": "final-hours error over Cramer-Rao bound, median over targets",
    "bound_ratio_90": "final-hours error over Cramer-Rao bound, 90th percentile over targets",
    "rmse_median": "root mean square error, median over targets and axes",
    "rmse_90": "root mean square error, 90th percentile over targets and axes",
}
"""Quantities of every part, over observed targets."""

PER_CELL = {
    "final_attitude_error_median": ("degree", "attitude error of the final hours, median"),
    "final_attitude_error_90": ("degree", "attitude error of the final hours, 90th percentile"),
    "bound_attitude_median": ("degree", "Cramer-Rao bound of that error, median"),
    "bound_attitude_90": ("degree", "Cramer-Rao bound of that error, 90th percentile"),
    "never_observed": ("1", "targets never observed"),
    "diverged_rotation": ("1", "observed targets whose rotation diverged"),
    "diverged_translation": ("1", "observed targets whose translation diverged"),
    "diverged_translation_lunar": ("1", "of those, on low lunar polar trajectories"),
    "diverged_rotation_only": ("1", "targets with diverged rotation and tracked translation"),
    "diverged_rotation_share": ("1", "share of observed targets whose rotation diverged"),
    "diverged_translation_share": ("1", "share of observed targets whose translation diverged"),
    "tracked_share": ("1", "share of all targets tracked in all states"),
    "valid_fraction": ("1", "share of targets and steps with a measurement used"),
    "information": ("nat", "mutual information of a tasking, mean over epochs"),
    "out_of_field": ("1", "measurements outside the field of view"),
    "dark_sigma_points": ("1", "sigma points without reflected light"),
    "cholesky_failures": ("1", "failed Cholesky factorizations"),
    "failed": ("1", "targets whose estimate came to an end"),
}
"""Quantities of a cell with their units."""

LUNAR = "Polar_"
"""Prefix of the orbit classes that are no periodic orbits: the low lunar polar trajectories."""

_HISTORIES = ("error", "sigma", "bound", "fate", "valid", "assignment")
_NEEDED = ("coverage", "status", "updates", "bound_ratio", "bound_attitude")
_ID = ("scenario", "architecture", "estimator", "variant")


def read_cell_metrics(path: str | Path) -> xr.Dataset:
    """Read the metrics of a cell without its time histories.

    Parameters
    ----------
    path : str or Path
        Data set of a cell.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    InputFileError
        If the file is no data set of a cell.
    """
    cell = read_dataset(path, without=_HISTORIES)
    lacking = [name for name in _NEEDED if name not in cell]
    if lacking:
        raise InputFileError(
            f"data set {path} lacks {', '.join(lacking)}: it is no tracking cell, or one of an "
            "earlier version; delete it and run snakemake again"
        )
    return cell


def _over_targets(values: Array, counted: NDArray[np.bool_], reduce) -> Array:
    """Reduce (seed, target, ...) to (seed,) over some targets; NaN if there are none."""
    found = [values[s][counted[s]] for s in range(values.shape[0])]
    finite = [each[np.isfinite(each)] for each in found]
    return np.array([float(reduce(each)) if each.size else np.nan for each in finite])


def _percentile_90(values: Array) -> float:
    return np.percentile(values, 90.0)


def seed_statistics(cell: xr.Dataset) -> dict[str, Array]:
    """Statistics of a cell, one value per realization.

    Parameters
    ----------
    cell : xarray.Dataset
        Data set of a cell; its time histories are not needed.

    Returns
    -------
    dict
        Names of `PER_PART` to arrays of shape (seed, part), those of `PER_CELL` to (seed,).
    """
    status = cell["status"].values
    observed = status != NEVER_OBSERVED
    seen = np.maximum(observed.sum(axis=1), 1)
    rotation = cell["status_rotation"].values == DIVERGED
    translation = cell["status_translation"].values == DIVERGED
    periodic = observed & ~np.char.startswith(cell["family"].values.astype(str), LUNAR)
    of_part = {
        "coverage": ("coverage", np.mean, observed),
        "anees_median": ("anees", np.median, observed),
        "anees_mean": ("anees", np.mean, observed),
        "anees_mean_periodic": ("anees", np.mean, periodic),
        "rmse_median": ("rmse", np.median, observed),
        "rmse_90": ("rmse", _percentile_90, observed),
    }
    found = {
        name: np.stack(
            [
                _over_targets(cell[source].values[..., 3 * p : 3 * p + 3], counted, reduce)
                for p in range(len(PARTS))
            ],
            axis=-1,
        )
        for name, (source, reduce, counted) in of_part.items()
    }
    ratio = cell["bound_ratio"].values
    for name, reduce in (("bound_ratio_median", np.median), ("bound_ratio_90", _percentile_90)):
        found[name] = np.stack(
            [_over_targets(ratio[..., p], observed, reduce) for p in range(len(PARTS))], axis=-1
        )
    final, least = cell["final_attitude_error"].values, cell["bound_attitude"].values
    found |= {
        "final_attitude_error_median": _over_targets(final, observed, np.median),
        "final_attitude_error_90": _over_targets(final, observed, _percentile_90),
        "bound_attitude_median": _over_targets(least, observed, np.median),
        "bound_attitude_90": _over_targets(least, observed, _percentile_90),
        "never_observed": (~observed).sum(axis=1),
        "diverged_rotation": rotation.sum(axis=1),
        "diverged_translation": translation.sum(axis=1),
        "diverged_translation_lunar": (translation & observed & ~periodic).sum(axis=1),
        "diverged_rotation_only": (rotation & ~translation).sum(axis=1),
        "diverged_rotation_share": rotation.sum(axis=1) / seen,
        "diverged_translation_share": translation.sum(axis=1) / seen,
        "tracked_share": (status == TRACKED).mean(axis=1),
        "valid_fraction": cell["updates"].values.mean(axis=1) / cell.sizes["step"],
        "information": cell["information"].values.mean(axis=1),
        "failed": (cell["failed"].values != 0).sum(axis=1),
    }
    for name in ("out_of_field", "dark_sigma_points", "cholesky_failures"):
        found[name] = cell[name].values.sum(axis=1)
    return {name: np.asarray(values, dtype=float) for name, values in found.items()}


def summary_dataset(
    cells: Sequence[tuple[Cell, xr.Dataset]], settings: Mapping[str, Any], seed: int
) -> xr.Dataset:
    """Statistics of all cells.

    Parameters
    ----------
    cells : sequence of (Cell, xarray.Dataset)
        The cells and their data sets.
    settings : mapping
        Configuration slice, for provenance.
    seed : int
        Seed of the campaign.

    Returns
    -------
    xarray.Dataset
        ``task2/summary.nc``; NaN for realizations a cell does not have.
    """
    found = [seed_statistics(data) for _, data in cells]
    n_seeds = max(data.sizes["seed"] for _, data in cells)

    def stacked(name: str) -> Array:
        shape = (len(found), n_seeds, *found[0][name].shape[1:])
        values = np.full(shape, np.nan)
        for row, statistics in zip(values, found, strict=True):
            row[: len(statistics[name])] = statistics[name]
        return values

    data = {
        name: variable(("cell", "seed", "part"), stacked(name), "1", meaning)
        for name, meaning in PER_PART.items()
    }
    for name in ("rmse_median", "rmse_90"):
        data[name].attrs["units"] = "see part_unit"
    data |= {
        name: variable(("cell", "seed"), stacked(name), unit, meaning)
        for name, (unit, meaning) in PER_CELL.items()
    }
    labels = {key: [getattr(cell, key) for cell, _ in cells] for key in _ID}
    numbers = {
        "observers": ([each.sizes["observer"] for _, each in cells], "1", "observers"),
        "targets": ([cell.targets for cell, _ in cells], "1", "monitored targets"),
        "interval_minutes": (
            [cell.interval_minutes for cell, _ in cells],
            "min",
            "time between tasking epochs",
        ),
    }
    coords = {key: variable("cell", values, "1", key) for key, values in labels.items()}
    coords |= {key: variable("cell", *described) for key, described in numbers.items()}
    coords |= {
        "seed": variable("seed", np.arange(n_seeds), "1", "realization"),
        "part": variable("part", list(PARTS), "1", "part of the state"),
        "part_unit": variable("part", list(PART_UNITS), "1", "unit of the errors of the part"),
    }
    attributes = provenance("Statistics of the tracking cells", settings=settings, seed=seed)
    return xr.Dataset(data, coords=coords, attrs=attributes)


def cell_index(summary: xr.Dataset, **wanted: Any) -> NDArray[np.intp]:
    """Cells with the wanted labels.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.
    **wanted
        Labels: `scenario`, `architecture`, `estimator`, `variant`, `targets`,
        `interval_minutes`.

    Returns
    -------
    ndarray of int
        Indices, in rising order of the number of targets and of the interval.
    """
    match = np.ones(summary.sizes["cell"], dtype=bool)
    for key, value in wanted.items():
        match &= summary[key].values == value
    found = np.flatnonzero(match)
    order = np.lexsort(
        (summary["interval_minutes"].values[found], summary["targets"].values[found])
    )
    return found[order]


def seed_values(summary: xr.Dataset, index: Any, quantity: str, part: str | None = None) -> Array:
    """One value per realization of some cells.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.
    index : int or ndarray of int
        Cells.
    quantity : str
        Name of the variable.
    part : str, optional
        Part of the state, for the quantities that have them.

    Returns
    -------
    ndarray, shape (seed,) for one cell, (seed, cell) for several
    """
    values = summary[quantity].values[index]
    if part is not None:
        values = values[..., PARTS.index(part)]
    return values.T
