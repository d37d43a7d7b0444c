"""Statistics over the targets of every cell, one value per realization: ``task2/summary.nc``.

Averages are over the targets with at least one measurement used. A target that is never observed
keeps its wide initial bounds and is trivially within them; such targets are counted separately.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.association.tracks import DELETED, LOST
from cislunar.campaign.settings.cells import Cell
from cislunar.constants import SECONDS_PER_DAY
from cislunar.errors import InputFileError
from cislunar.estimation.light_curves.model_selection.characterization import (
    ATTITUDE_STATUS_NAMES,
)
from cislunar.evaluation.characterization import CharacterizedTargets, within_intervals
from cislunar.evaluation.metrics import FINAL_HOURS, INCONSISTENT, NEVER_OBSERVED, PARTS, TRACKED
from cislunar.runtime import Array, read_dataset, variable
from cislunar.runtime.provenance import provenance
from cislunar.tasking.detection_outcomes import OBSERVATION_OUTCOMES, count_outcomes, outcome_shares
from cislunar.tasking.histories import HISTORIES, OBSERVATION_COLUMNS

_PART_UNITS = ("1", "rad s-1", "1", "1")
"""Units of the errors of the parts; those of the paper."""

PER_PART = {
    "coverage": "share of the time within 3 sigma, mean over targets and axes",
    "final_coverage": "share of the final hours within 3 sigma, mean over targets and axes",
    "anees_median": "component-wise ANEES, median over targets and axes",
    "anees_mean": "component-wise ANEES, mean over targets and axes",
    "anees_mean_periodic": "component-wise ANEES, mean over targets on periodic orbits and axes",
    "bound_ratio_median": "final-hours error over Cramer-Rao bound, median over targets",
    "bound_ratio_90": "final-hours error over Cramer-Rao bound, 90th percentile over targets",
    "rmse_median": "root mean square error, median over targets and axes",
    "rmse_90": "root mean square error, 90th percentile over targets and axes",
    "rmse_median_all": "root mean square error, median over all targets, observed or not, and axes",
    "rmse_geometric_all": "root mean square error, geometric mean over all targets and axes",
    "final_error_geometric_all": (
        "length of the error in the final hours, root mean square over the recorded times, "
        "geometric mean over all targets; NaN where no histories of errors are kept"
    ),
}
"""Quantities of every part, over observed targets."""

ERRORS = (
    *("rmse_median", "rmse_90", "rmse_median_all", "rmse_geometric_all"),
    "final_error_geometric_all",
)
"""Quantities of `PER_PART` that have the unit of the part's errors."""

PER_CELL = {
    "final_attitude_error_median": ("degree", "attitude error of the final hours, median"),
    "final_attitude_error_90": ("degree", "attitude error of the final hours, 90th percentile"),
    "bound_attitude_median": ("degree", "Cramer-Rao bound of that error, median"),
    "bound_attitude_90": ("degree", "Cramer-Rao bound of that error, 90th percentile"),
    "never_observed": ("1", "targets never observed"),
    "inconsistent_rotation": ("1", "observed targets whose rotation is inconsistent"),
    "inconsistent_translation": ("1", "observed targets whose translation is inconsistent"),
    "inconsistent_translation_lunar": ("1", "of those, on low lunar polar trajectories"),
    "inconsistent_rotation_only": ("1", "targets with inconsistent rotation, tracked translation"),
    "inconsistent_rotation_share": ("1", "share of observed targets with inconsistent rotation"),
    "inconsistent_translation_share": (
        "1", "share of observed targets with inconsistent translation"),
    "translation_outside_share": (
        "1", "share of observed targets whose translation is outside the band"),
    "custody_share": ("1", "share of all targets in custody at the end, task2.custody"),
    "tracked_share": ("1", "share of all targets tracked in all states"),
    "valid_fraction": ("1", "share of targets and steps with a measurement used"),
    "information": ("nat", "mutual information of a tasking, mean over epochs"),
    "out_of_field": ("1", "measurements outside the field of view"),
    "undetectable_sigma_points": ("1", "undetectable sigma points"),
    "cholesky_failures": ("1", "failed Cholesky factorizations"),
    "failed": ("1", "targets whose estimate ended"),
    **{
        name: ("1", f"share of the observations of tasked targets: {name[:-6]}")
        for name in OBSERVATION_OUTCOMES
    },
}  # fmt: skip
"""Quantities of a cell with their units."""

BRIGHT_ROWS = 100
"""Least number of measurements used of a target whose characterization is judged."""

CHARACTERIZED = {
    "spin_period": "spin period",
    "spin_axis": "spin axis",
    "amplitude": "amplitude of the light curve",
    "area_albedo": "area times albedo",
}
"""Estimated properties of targets whose models are chosen."""

WHERE_KEPT = {
    "position_custody_share": ("1", "share of all targets with the last position in custody"),
    "attitude_custody_share": ("1", "share of all targets with the last attitude in custody"),
    "accurate_attitude_share": (
        "1", "share of all targets with the last attitude error within task2.custody, reported as "
        "known or not"),
    "planning_gap": (
        "1", "relative amount by which schedules may fall short of the best, largest over epochs"),
    "never_visible": (
        "1", "targets that no observer could have detected, task2.record: visibility"),
    "missed": ("1", "targets never observed that an observer could have detected"),
    "associations_per_day": ("d-1", "detections that tracks have taken, per day"),
    "wrong_associations_per_day": (
        "d-1", "detections of another target or false alarms that tracks have taken, per day"),
    "switched_tracks": ("1", "tracks that end with the detections of another target"),
    "lost_tracks": ("1", "tracks with status lost or deleted at the end"),
    "gospa": ("km", "GOSPA metric of the positions, mean over the final hours"),
    **{
        f"{name}_attitude_share": (
            "1", f"share of observed targets whose attitude has the status {name} at the end")
        for name in ATTITUDE_STATUS_NAMES
    },
    "anees_unique": (
        "1", "component-wise ANEES of attitudes with status unique, mean over axes and time"),
    "bright": ("1", f"targets with at least {BRIGHT_ROWS} measurements used"),
    **{
        f"{name}_within_share": (
            "1", f"share of these with the true {meaning} within its 95 % interval")
        for name, meaning in CHARACTERIZED.items()
    },
    **{
        f"{name}_width_median": (
            unit, f"half-width of the 95 % interval of the {CHARACTERIZED[name]}, median of these")
        for name, unit in (("spin_period", "%"), ("spin_axis", "degree"))
    },
}  # fmt: skip
"""Quantities of cells that record the necessary histories, in a summary with any such cell."""

_BAND_COVERAGE, _BAND_ANEES = 0.9, 3.0
"""The translation of a target is outside the band if position or velocity is within 3 sigma for
less than this share of the time, or has a larger ANEES, as means over the axes, or if the
translation is inconsistent."""

_LUNAR = "Polar_"
"""Prefix of the orbit classes that are no periodic orbits: the low lunar polar trajectories."""

_HISTORIES = ("valid", "assignment", "observer_position", *OBSERVATION_COLUMNS)
_HISTORIES += tuple(name for name, each in HISTORIES.items() if each.along == "time")
_NEEDED = ("coverage", "custody", "outcome", "status", "updates", "bound_ratio", "bound_attitude")
_ID = ("scenario", "architecture", "estimator", "variant")


def read_cell_metrics(path: str | Path) -> xr.Dataset:
    """Read the metrics of a cell, with `observations` and `final_error` instead of its histories.

    Raises `InputFileError` if it has none.
    """
    cell = read_dataset(path, without=_HISTORIES)
    lacking = [name for name in _NEEDED if name not in cell]
    if lacking:
        raise InputFileError(
            f"data set {path} lacks {', '.join(lacking)}: it is no tracking cell, or one of an "
            "earlier version; delete it and run snakemake again"
        )
    # counted here: the outcomes of all cells together are too large to keep
    cell = cell.drop_vars("outcome").assign(
        observations=(("seed", "outcome"), _observation_counts(cell))
    )
    with xr.open_dataset(path, engine="netcdf4") as histories:
        return cell.assign(final_error=(("seed", "target", "part"), _final_error(histories)))


def _final_error(cell: xr.Dataset) -> Array:
    """Root mean square length of each part's error at the recorded times of the final hours, shape
    (seed, target, part); NaN without errors."""
    if "final_error" in cell:
        return cell["final_error"].values
    if "error" not in cell:
        return np.full((*cell["status"].shape, len(PARTS)), np.nan)
    final = cell["time"].values > cell["time"].values[-1] - 3600.0 * FINAL_HOURS
    error = cell["error"].isel(time=final).transpose("seed", "target", "time", "component").values
    parts = np.square(error, dtype=float).reshape(*error.shape[:3], len(PARTS), -1).sum(axis=-1)
    # of an estimate that has ended, the finite values
    finite = np.isfinite(parts)
    count = finite.sum(axis=2)
    total = np.where(finite, parts, 0.0).sum(axis=2)
    return np.sqrt(np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0))


def _observation_counts(cell: xr.Dataset) -> NDArray[np.int64]:
    """Number of observations of each outcome, shape (seed, outcome)."""
    if "observations" in cell:
        return cell["observations"].values
    return np.array([count_outcomes(outcome) for outcome in cell["outcome"].values])


def _over_targets(values: Array, counted: NDArray[np.bool_], reduce) -> Array:
    """Reduce (seed, target, ...) to (seed,) over some targets; NaN if there are none."""
    finite = [own[of][np.isfinite(own[of])] for own, of in zip(values, counted, strict=True)]
    return np.array([float(reduce(each)) if each.size else np.nan for each in finite])


def _percentile_90(values: Array) -> float:
    return np.percentile(values, 90.0)


def _geometric_mean(values: Array) -> float:
    """Geometric mean of errors, which no large one dominates."""
    return np.exp(np.mean(np.log(values)))


_OF_TARGETS = {
    "coverage": ("coverage", np.mean),
    "final_coverage": ("final_coverage", np.mean),
    "anees_median": ("anees", np.median),
    "anees_mean": ("anees", np.mean),
    "rmse_median": ("rmse", np.median),
    "rmse_90": ("rmse", _percentile_90),
    "bound_ratio_median": ("bound_ratio", np.median),
    "bound_ratio_90": ("bound_ratio", _percentile_90),
    "final_attitude_error_median": ("final_attitude_error", np.median),
    "final_attitude_error_90": ("final_attitude_error", _percentile_90),
    "bound_attitude_median": ("bound_attitude", np.median),
    "bound_attitude_90": ("bound_attitude", _percentile_90),
}
"""Statistics over observed targets: of which variable of a cell, and how."""


def seed_statistics(cell: xr.Dataset) -> dict[str, Array]:
    """Statistics of a cell for each realization: those of `PER_PART`, shape (seed, part), of
    `PER_CELL` and, if the cell has the necessary histories, `WHERE_KEPT`, shape (seed,)."""
    status = cell["status"].values
    observed = status != NEVER_OBSERVED
    seen = np.maximum(observed.sum(axis=1), 1)
    rotation = cell["status_rotation"].values == INCONSISTENT
    translation = cell["status_translation"].values == INCONSISTENT
    periodic = observed & ~np.char.startswith(cell["family"].values.astype(str), _LUNAR)

    def reduced(source: str, reduce, counted: NDArray[np.bool_]) -> Array:
        values = cell[source].values
        if values.ndim == 2:
            return _over_targets(values, counted, reduce)
        parts = np.split(values, len(PARTS), axis=-1)
        return np.stack([_over_targets(part, counted, reduce) for part in parts], axis=-1)

    def of_translation(name: str) -> Array:
        """Means over the axes of position and velocity, shape (seed, target, 2)."""
        values = cell[name].values[..., 6:]
        return values.reshape(*values.shape[:2], 2, 3).mean(axis=-1)

    outside = (of_translation("coverage") < _BAND_COVERAGE).any(axis=-1)
    outside |= (of_translation("anees") > _BAND_ANEES).any(axis=-1)
    outside = observed & (outside | translation)
    final = [
        _over_targets(part, np.ones_like(observed), _geometric_mean)
        for part in np.moveaxis(_final_error(cell), -1, 0)
    ]
    found = {name: reduced(*how, observed) for name, how in _OF_TARGETS.items()}
    found |= {
        "anees_mean_periodic": reduced("anees", np.mean, periodic),
        "never_observed": (~observed).sum(axis=1),
        "inconsistent_rotation": rotation.sum(axis=1),
        "inconsistent_translation": translation.sum(axis=1),
        "inconsistent_translation_lunar": (translation & observed & ~periodic).sum(axis=1),
        "inconsistent_rotation_only": (rotation & ~translation).sum(axis=1),
        "inconsistent_rotation_share": rotation.sum(axis=1) / seen,
        "inconsistent_translation_share": translation.sum(axis=1) / seen,
        "translation_outside_share": outside.sum(axis=1) / seen,
        "rmse_median_all": reduced("rmse", np.median, np.ones_like(observed)),
        "rmse_geometric_all": reduced("rmse", _geometric_mean, np.ones_like(observed)),
        "final_error_geometric_all": np.stack(final, axis=-1),
        "custody_share": cell["custody"].values.mean(axis=1),
        "tracked_share": (status == TRACKED).mean(axis=1),
        "valid_fraction": cell["updates"].values.mean(axis=1) / cell.sizes["step"],
        "information": cell["information"].values.mean(axis=1),
        "failed": (cell["failed"].values != 0).sum(axis=1),
    }
    found |= outcome_shares(_observation_counts(cell))
    for part in ("position", "attitude"):
        if f"custody_{part}" in cell:
            found[f"{part}_custody_share"] = cell[f"custody_{part}"].values.mean(axis=1)
    if "accurate_attitude" in cell:
        found["accurate_attitude_share"] = cell["accurate_attitude"].values.mean(axis=1)
    if "planning_gap" in cell:
        found["planning_gap"] = cell["planning_gap"].values.max(axis=1)
    if "visible" in cell:
        visible = cell["visible"].values.any(axis=1)
        found["never_visible"] = (~visible).sum(axis=1)
        found["missed"] = (visible & ~observed).sum(axis=1)
    if "gospa" in cell:
        found |= _associated(cell)
    if "attitude_status" in cell:
        found |= _with_status(cell, observed)
    if "spin_period" in cell:
        found |= _characterized(cell)
    for name in ("out_of_field", "undetectable_sigma_points", "cholesky_failures"):
        found[name] = cell[name].values.sum(axis=1)
    return {name: np.asarray(values, dtype=float) for name, values in found.items()}


def _associated(cell: xr.Dataset) -> dict[str, Array]:
    """Quantities of tracks and associations of each realization."""
    days = (cell["step"].values[-1] - cell["step"].values[0]) / SECONDS_PER_DAY
    origin = cell["association_origin"].values
    switched = np.zeros(origin.shape[::2], dtype=bool)
    for row in origin.swapaxes(0, 1):  # the last interval with a detection decides
        switched = np.where(row == -2, switched, row != np.arange(row.shape[1]))
    final = cell["epoch"].values > cell["epoch"].values[-1] - 3600.0 * FINAL_HOURS
    status = cell["track_status"].values[:, -1]
    return {
        "associations_per_day": cell["associations"].values.sum(axis=(1, 2)) / days,
        "wrong_associations_per_day": cell["wrong_associations"].values.sum(axis=(1, 2)) / days,
        "switched_tracks": switched.sum(axis=1),
        "lost_tracks": np.isin(status, (LOST, DELETED)).sum(axis=1),
        "gospa": cell["gospa"].values[:, final, 0].mean(axis=1),
    }


def characterized_in(cell: xr.Dataset) -> CharacterizedTargets:
    """Characterization of the targets of a cell, with a leading axis over realizations."""
    return CharacterizedTargets(*(cell[name].values for name in CharacterizedTargets._fields))


def _with_status(cell: xr.Dataset, observed: NDArray[np.bool_]) -> dict[str, Array]:
    """Quantities of the status of attitudes of each realization."""
    status = cell["attitude_status"].values[:, -1]
    found = {
        f"{name}_attitude_share": _over_targets(status == number, observed, np.mean)
        for number, name in enumerate(ATTITUDE_STATUS_NAMES)
    }
    squares, share = cell["anees_unique"].values, cell["unique_share"].values
    counted = observed & np.isfinite(squares)
    total = np.where(counted, share, 0.0).sum(axis=1)
    squares = np.where(counted, share * squares, 0.0).sum(axis=1)
    found["anees_unique"] = np.divide(
        squares, total, out=np.full(total.shape, np.nan), where=total > 0.0
    )
    return found


def _characterized(cell: xr.Dataset) -> dict[str, Array]:
    """Quantities of the characterization of each realization."""
    properties, bright = characterized_in(cell), cell["updates"].values >= BRIGHT_ROWS
    found = {"bright": bright.sum(axis=1)}
    for name, inside in within_intervals(properties).items():
        found[f"{name}_within_share"] = _over_targets(inside, bright, np.mean)
    value, low, high = np.moveaxis(properties.spin_period, -1, 0)
    half = {"spin_period": 50.0 * (high - low) / value, "spin_axis": properties.spin_axis_radius}
    for name, width in half.items():
        found[f"{name}_width_median"] = _over_targets(width, bright, np.median)
    return found


def summary_dataset(
    cells: Sequence[tuple[Cell, xr.Dataset]], settings: Mapping[str, Any], seed: int
) -> xr.Dataset:
    """Statistics of all cells: ``task2/summary.nc``; NaN for realizations a cell does not have.

    `settings` and `seed` of the campaign are for provenance.
    """
    found = [seed_statistics(data) for _, data in cells]
    n_seeds = max(data.sizes["seed"] for _, data in cells)

    def stacked(name: str) -> Array:
        first = next(each[name] for each in found if name in each)
        shape = (len(found), n_seeds, *first.shape[1:])
        values = np.full(shape, np.nan)
        for row, statistics in zip(values, found, strict=True):
            if name in statistics:
                row[: len(statistics[name])] = statistics[name]
        return values

    data = {
        name: variable(("cell", "seed", "part"), stacked(name), "1", meaning)
        for name, meaning in PER_PART.items()
    }
    for name in ERRORS:
        data[name].attrs["units"] = "see part_unit"
    data |= {
        name: variable(("cell", "seed"), stacked(name), unit, meaning)
        for name, (unit, meaning) in (PER_CELL | WHERE_KEPT).items()
        if any(name in each for each in found)
    }
    labels = {key: [getattr(cell, key) for cell, _ in cells] for key in _ID}
    intervals = [cell.interval_minutes for cell, _ in cells]
    numbers = {
        "observers": ([each.sizes["observer"] for _, each in cells], "1", "observers"),
        "targets": ([cell.targets for cell, _ in cells], "1", "monitored targets"),
        "interval_minutes": (intervals, "min", "time between tasking epochs"),
    }
    coords = {key: variable("cell", values, "1", key) for key, values in labels.items()}
    coords |= {key: variable("cell", *described) for key, described in numbers.items()}
    coords |= {
        "seed": variable("seed", np.arange(n_seeds), "1", "realization"),
        "part": variable("part", list(PARTS), "1", "part of the state"),
        "part_unit": variable("part", list(_PART_UNITS), "1", "unit of the errors of the part"),
    }
    attributes = provenance("Statistics of the tracking cells", settings=settings, seed=seed)
    return xr.Dataset(data, coords=coords, attrs=attributes)
