"""The tidy table of realizations: a value for each cell, measure and seed.

A measure is a quantity of ``task2/summary.nc`` with a part of the state and a unit. The seeds of a
measure of a cell are consecutive, and so are the measures of a cell.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.summary import (
    ERRORS,
    PARTS,
    PER_CELL,
    PER_PART,
    WHERE_KEPT,
    read_cell_metrics,
)
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.runtime import Array, each, read_dataset

CELL = ["scenario", "architecture", "estimator", "variant", "targets", "interval_minutes"]
"""Labels that identify a cell."""

MEASURE = ["quantity", "part", "unit"]

PRACTICAL_UNITS = {
    "attitude": ("degree", np.rad2deg(1.0)),
    "angular_velocity": ("degree h-1", np.rad2deg(3600.0)),
    "position": ("km", LENGTH_UNIT_KM),
    "velocity": ("m s-1", 1000.0 * LENGTH_UNIT_KM / TIME_UNIT_S),
}
"""Unit and factor of the errors; a small GRP of the attitude error is the angle in rad."""


def read_cells(
    labels: Sequence[tuple], paths: Sequence[str | Path], *, metrics: bool = False
) -> list[tuple[Cell, xr.Dataset]]:
    """Cells, given by their labels, with their data sets or with their metrics alone."""
    read = read_cell_metrics if metrics else read_dataset
    labeled = zip(labels, each(paths, "cells"), strict=True)
    return [(Cell(*cell), read(path)) for cell, path in labeled]


def realizations(summary: xr.Dataset) -> pd.DataFrame:
    """The realizations of all cells of ``task2/summary.nc``.

    Columns `CELL`, observers, `MEASURE`, seed, value. Errors come in the paper's units, then in
    practical ones; NaN where a cell does not have a realization.
    """
    measures, values = [], []
    for name in PER_PART:
        for p, part in enumerate(PARTS):
            own = summary[name].values[..., p]
            if name not in ERRORS:
                measures.append((name, part, "1"))
                values.append(own)
                continue
            unit, factor = PRACTICAL_UNITS[part]
            measures += [(name, part, str(summary["part_unit"].values[p])), (name, part, unit)]
            values += [own, factor * own]
    for name, (unit, _) in (PER_CELL | WHERE_KEPT).items():
        if name not in summary:
            continue
        measures.append((name, "", unit))
        values.append(summary[name].values)
    stacked = np.stack(values, axis=1)
    cells, kinds, seeds = stacked.shape
    labels = {key: summary[key].values.tolist() for key in (*CELL, "observers")}
    columns = {
        key: np.repeat(
            np.array(own, dtype=object if isinstance(own[0], str) else int), kinds * seeds
        )
        for key, own in labels.items()
    }
    for key, own in zip(MEASURE, zip(*measures, strict=True), strict=True):
        columns[key] = np.tile(np.repeat(np.array(own, dtype=object), seeds), cells)
    seed = np.tile(np.arange(seeds), cells * kinds)
    return pd.DataFrame(columns | {"seed": seed, "value": stacked.ravel()})


def select(frame: pd.DataFrame, **labels: Any) -> pd.DataFrame:
    """The rows with the labels given (columns of the frame), by targets and interval."""
    chosen = np.logical_and.reduce([frame[key].to_numpy() == own for key, own in labels.items()])
    return frame[chosen].sort_values(["targets", "interval_minutes"], kind="stable")


def cells_of(frame: pd.DataFrame) -> pd.DataFrame:
    """One row per cell, in the order of the frame: `CELL` and observers."""
    return frame[[*CELL, "observers"]].drop_duplicates(ignore_index=True)


def by_measure(frame: pd.DataFrame, column: str = "value") -> tuple[pd.DataFrame, Array]:
    """A row per measure of a cell without its seeds, and the values, shape (row, seed)."""
    seeds = frame["seed"].nunique()
    heads = frame.iloc[:: max(seeds, 1)].reset_index(drop=True)
    return heads, frame[column].to_numpy().reshape(len(heads), seeds)


def values_of(
    frame: pd.DataFrame, quantity: str, part: str | None = None, unit: str | None = None
) -> Array:
    """Values of one measure, shape (seed, cell); by default in the paper's unit."""
    own = frame[
        (frame["quantity"].to_numpy() == quantity) & (frame["part"].to_numpy() == (part or ""))
    ]
    if len(own):
        own = own[own["unit"].to_numpy() == (unit or own["unit"].iloc[0])]
    return by_measure(own)[1].T


def usual_interval(frame: pd.DataFrame) -> int:
    """The most frequent tasking interval, min."""
    values, counts = np.unique(frame["interval_minutes"], return_counts=True)
    return int(values[np.argmax(counts)])
