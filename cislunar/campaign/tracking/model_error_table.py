"""What it costs when the truth is not what the estimators believe: ``tables/model_error.csv``."""

from collections.abc import Iterator, Sequence
from typing import Any

import pandas as pd
import xarray as xr

from cislunar.campaign.tracking.model_errors import NONE, ModelError
from cislunar.campaign.tracking.realizations import MEASURE, by_measure, realizations, select
from cislunar.campaign.tracking.statistics import interval_of
from cislunar.campaign.tracking.tables import compared

QUANTITIES = (
    ("coverage", "attitude", "1"),
    ("final_attitude_error_median", "", "degree"),
    ("final_attitude_error_90", "", "degree"),
    ("inconsistent_rotation", "", "1"),
    ("rmse_median", "position", "km"),
)
"""Quantities with part and unit."""

_CELL = ["scenario", "architecture", "estimator", "targets", "interval_minutes"]

COLUMNS = [
    *("scenario", "architecture", "estimator", "variant", "targets", "interval_minutes"),
    *("kind", "size", "size_unit", "also", "quantity", "part", "unit"),
    *("mean", "low", "high", "usual", "difference", "difference_low", "difference_high", "seeds"),
]


def model_error_rows(summary: xr.Dataset, errors: Sequence[ModelError]) -> pd.DataFrame:
    """Rows of ``tables/model_error.csv``, from ``task2/summary.nc`` and `model_errors`.

    For every cell of these variants, for the cell without the error (kind `NONE`, size 0), and for
    every quantity: mean over the realizations with its 95 % confidence interval (as in
    ``tables/tracking.csv``), and the difference to the cell without the error, realization by
    realization, with its interval (Student's t). Estimators, errors and cells that the summary
    lacks are left out.
    """
    frame = realizations(summary).set_index(MEASURE, drop=False)
    frame = frame.loc[frame.index.isin(QUANTITIES)].reset_index(drop=True)
    rows: list[dict[str, Any]] = []
    compared_with: set[tuple] = set()
    for error in errors:
        for place, own in select(frame, variant=error.variant).groupby(_CELL, sort=False):
            identity = dict(zip(_CELL, place, strict=True))
            usual = select(frame, variant="", **identity)
            if usual.empty:
                continue
            if place not in compared_with:
                compared_with.add(place)
                rows += _rows(usual, usual, ModelError("", NONE, 0.0, "", ""))
            rows += _rows(own, usual, error)
    return pd.DataFrame(rows, columns=COLUMNS)


def _rows(own: pd.DataFrame, usual: pd.DataFrame, error: ModelError) -> Iterator[dict[str, Any]]:
    """One row for each quantity of a cell, in their order."""
    described = error._asdict()
    described["size_unit"] = described.pop("unit")
    heads, pairs = compared(own, usual, "variant")
    found = {
        tuple(head[key] for key in MEASURE): (head, each, values)
        for head, each, values in zip(
            heads.to_dict("records"), pairs, by_measure(own)[1], strict=True
        )
    }
    for head, each, values in map(found.get, QUANTITIES):
        mean = interval_of(head["quantity"], values, head["targets"])
        yield {
            **head,
            **described,
            **{"mean": mean.mean, "low": mean.low, "high": mean.high, "usual": each.first},
            "difference": each.difference.mean,
            "difference_low": each.difference.low,
            "difference_high": each.difference.high,
            "seeds": each.difference.count,
        }
