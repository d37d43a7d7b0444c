"""What it costs when the truth is not what the estimators believe: ``tables/model_error.csv``."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.campaign.settings.model_error import NONE, ModelError
from cislunar.campaign.tracking.statistics import t_interval
from cislunar.campaign.tracking.summary import cell_index, seed_values
from cislunar.constants import LENGTH_UNIT_KM

QUANTITIES = (
    ("coverage", "attitude", "1", 1.0),
    ("final_attitude_error_median", "", "degree", 1.0),
    ("final_attitude_error_90", "", "degree", 1.0),
    ("diverged_rotation", "", "1", 1.0),
    ("rmse_median", "position", "km", LENGTH_UNIT_KM),
)
"""Quantities of the summary with part, unit and the factor to it."""

_CELL = ("scenario", "architecture", "estimator", "targets", "interval_minutes")

COLUMNS = [
    *("scenario", "architecture", "estimator", "variant", "targets", "interval_minutes"),
    *("kind", "size", "size_unit", "also", "quantity", "part", "unit"),
    *("mean", "low", "high", "usual", "difference", "difference_low", "difference_high", "seeds"),
]


def model_error_rows(summary: xr.Dataset, errors: Sequence[ModelError]) -> pd.DataFrame:
    """Rows of ``tables/model_error.csv``.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.
    errors : sequence of ModelError
        Of `model_errors`.

    Returns
    -------
    DataFrame
        For every cell of these variants, for the cell without the error (kind `NONE`, size 0), and
        for every quantity: mean over the realizations with its 95 % confidence interval (Student's
        t), and the difference to the cell without the error, realization by realization, with its
        interval. Estimators, errors and cells that the summary lacks are left out.
    """
    rows: list[dict[str, Any]] = []
    compared: set[int] = set()
    for error in errors:
        for index in cell_index(summary, variant=error.variant):
            identity = {key: summary[key].values[index].item() for key in _CELL}
            usual = cell_index(summary, variant="", **identity)
            if not usual.size:
                continue
            if usual[0] not in compared:
                compared.add(usual[0])
                none = ModelError("", NONE, 0.0, "", "")
                rows += _rows(summary, usual[0], usual[0], identity, none)
            rows += _rows(summary, index, usual[0], identity, error)
    return pd.DataFrame(rows, columns=COLUMNS)


def _rows(
    summary: xr.Dataset, index: int, usual: int, identity: Mapping[str, Any], error: ModelError
) -> Iterator[dict[str, Any]]:
    """One row for each quantity of a cell."""
    described = error._asdict()
    described["size_unit"] = described.pop("unit")
    for name, part, unit, factor in QUANTITIES:
        before, after = (
            factor * seed_values(summary, cell, name, part or None) for cell in (usual, index)
        )
        own = t_interval(after)
        both = np.isfinite(before) & np.isfinite(after)
        changed = t_interval((after - before)[both])
        yield {
            **identity,
            **described,
            "quantity": name,
            "part": part,
            "unit": unit,
            "mean": own.mean,
            "low": own.low,
            "high": own.high,
            "usual": before[both].mean() if both.any() else np.nan,
            "difference": changed.mean,
            "difference_low": changed.low,
            "difference_high": changed.high,
            "seeds": changed.count,
        }
