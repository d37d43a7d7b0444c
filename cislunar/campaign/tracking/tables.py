"""Tables of tracking: every cell with confidence intervals, and what a changed setting does."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from cislunar.campaign.tracking.statistics import log_interval, t_interval
from cislunar.campaign.tracking.summary import (
    PARTS,
    PER_CELL,
    PER_PART,
    cell_index,
    seed_values,
)
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S

_LABELS = ("scenario", "architecture", "estimator", "variant")
_NUMBERS = ("observers", "targets", "interval_minutes")

_SPANS_DECADES = ("anees", "bound_ratio")

PRACTICAL_UNITS = {
    "attitude": ("degree", np.rad2deg(1.0)),
    "angular_velocity": ("degree h-1", np.rad2deg(3600.0)),
    "position": ("km", LENGTH_UNIT_KM),
    "velocity": ("m s-1", 1000.0 * LENGTH_UNIT_KM / TIME_UNIT_S),
}
"""Unit and factor of the errors; a small GRP of the attitude error is the angle in rad."""


def _decades(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Decimal logarithms; those of zeros are infinite, and left out of means."""
    with np.errstate(divide="ignore"):
        return np.log10(values)


def _quantities(summary: xr.Dataset) -> Iterator[tuple[str, str, str, float]]:
    """Every (quantity, part, unit, factor) of the tables."""
    units = dict(zip(PARTS, summary["part_unit"].values.astype(str), strict=True))
    for name in PER_PART:
        error = name.startswith("rmse")
        for part in PARTS:
            yield name, part, units[part] if error else "1", 1.0
            if error:
                yield name, part, *PRACTICAL_UNITS[part]
    for name, (unit, _) in PER_CELL.items():
        yield name, "", unit, 1.0


def _largest_possible(name: str) -> float:
    """Largest value a quantity may have; none is negative."""
    is_share = name == "coverage" or name.endswith(("_share", "_fraction"))
    return 1.0 if is_share else np.inf


def _identity(summary: xr.Dataset, index: int) -> dict[str, str | int]:
    row = {key: str(summary[key].values[index]) for key in _LABELS}
    return row | {key: int(summary[key].values[index]) for key in _NUMBERS}


def tracking_rows(summary: xr.Dataset) -> pd.DataFrame:
    """Rows of ``tables/tracking.csv``.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    DataFrame
        For every cell and quantity, with every part of the state and unit: mean over the
        realizations with its 95 % confidence interval (Student's t; of the logarithm for ANEES
        and error over bound, which span decades) as far as it is possible, smallest and largest.
        Quantity `rmse_*` appears
        in the paper's units and in practical ones.
    """
    rows = []
    for index in range(summary.sizes["cell"]):
        identity = _identity(summary, index)
        for name, part, unit, factor in _quantities(summary):
            values = factor * seed_values(summary, index, name, part or None)
            finite = values[np.isfinite(values)]
            interval = (log_interval if name.startswith(_SPANS_DECADES) else t_interval)(values)
            # a mean of shares of 1 may round to a little more
            largest = max(_largest_possible(name), interval.mean)
            rows.append(
                identity
                | {
                    "quantity": name,
                    "part": part,
                    "unit": unit,
                    "mean": interval.mean,
                    "low": np.maximum(interval.low, 0.0),
                    "high": np.minimum(interval.high, largest),
                    "smallest": finite.min() if finite.size else np.nan,
                    "largest": finite.max() if finite.size else np.nan,
                    "seeds": interval.count,
                }
            )
    return pd.DataFrame(rows)


_READING_COLUMNS = [
    *_LABELS,
    *_NUMBERS,
    *("quantity", "part", "unit", "usual", "changed", "difference", "low", "high", "seeds"),
]


def reading_rows(summary: xr.Dataset) -> pd.DataFrame:
    """Rows of ``tables/readings_tracking.csv``.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    DataFrame
        For every variant and quantity: means over the common realizations of the usual and of
        the changed cell, and their difference, realization by realization, with its 95 %
        confidence interval (Student's t). ANEES and error over bound as decimal logarithms.
    """
    rows = []
    for index in range(summary.sizes["cell"]):
        identity = _identity(summary, index)
        if not identity["variant"]:
            continue
        keys = ("scenario", "architecture", "estimator", "targets", "interval_minutes")
        usual = cell_index(summary, variant="", **{key: identity[key] for key in keys})
        for name, part, unit, factor in _quantities(summary) if usual.size else ():
            before = factor * seed_values(summary, usual[0], name, part or None)
            after = factor * seed_values(summary, index, name, part or None)
            if name.startswith(_SPANS_DECADES):
                before, after, name = _decades(before), _decades(after), f"log10_{name}"
            both = np.isfinite(before) & np.isfinite(after)
            interval = t_interval(after[both] - before[both])
            rows.append(
                identity
                | {
                    "quantity": name,
                    "part": part,
                    "unit": unit,
                    "usual": before[both].mean() if both.any() else np.nan,
                    "changed": after[both].mean() if both.any() else np.nan,
                    "difference": interval.mean,
                    "low": interval.low,
                    "high": interval.high,
                    "seeds": interval.count,
                }
            )
    return pd.DataFrame(rows, columns=_READING_COLUMNS)


def estimator_rows(summary: xr.Dataset) -> pd.DataFrame:
    """Rows of ``tables/estimators.csv``.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    DataFrame
        For every cell that both the first estimator and another one ran, and every quantity: means
        over the common realizations of the first and of the other, largest value of each, and the
        difference, realization by realization, with its 95 % confidence interval (Student's t).
        ANEES and error over bound as their decimal logarithms.
    """
    first = str(summary["estimator"].values[0])
    rows = []
    for index in range(summary.sizes["cell"]):
        identity = _identity(summary, index)
        keys = ("scenario", "architecture", "variant", "targets", "interval_minutes")
        if identity["estimator"] == first:
            continue
        usual = cell_index(summary, estimator=first, **{key: identity[key] for key in keys})
        for name, part, unit, factor in _quantities(summary) if usual.size else ():
            of_first = factor * seed_values(summary, usual[0], name, part or None)
            of_other = factor * seed_values(summary, index, name, part or None)
            if name.startswith(_SPANS_DECADES):
                of_first, of_other, name = _decades(of_first), _decades(of_other), f"log10_{name}"
            both = np.isfinite(of_first) & np.isfinite(of_other)
            difference = t_interval(of_other[both] - of_first[both])
            pair = {"first": of_first[both], "other": of_other[both]}
            rows.append(
                {key: identity[key] for key in ("scenario", "architecture", "observers")}
                | {key: identity[key] for key in ("targets", "interval_minutes", "variant")}
                | {"first_estimator": first, "other_estimator": identity["estimator"]}
                | {"quantity": name, "part": part, "unit": unit}
                | {key: values.mean() if both.any() else np.nan for key, values in pair.items()}
                | {
                    f"{key}_largest": values.max() if both.any() else np.nan
                    for key, values in pair.items()
                }
                | {
                    "difference": difference.mean,
                    "low": difference.low,
                    "high": difference.high,
                    "seeds": difference.count,
                }
            )
    return pd.DataFrame(rows, columns=_ESTIMATOR_COLUMNS)


_ESTIMATOR_COLUMNS = [
    *("scenario", "architecture", "observers", "targets", "interval_minutes", "variant"),
    *("first_estimator", "other_estimator", "quantity", "part", "unit", "first", "other"),
    *("first_largest", "other_largest", "difference", "low", "high", "seeds"),
]
