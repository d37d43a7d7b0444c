"""Tables of sweeps over a key of a scenario: ``tables/sweep_{name}.csv``."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.campaign.architectures.visibility import architecture_coverage
from cislunar.campaign.settings.families import SweepPoint
from cislunar.campaign.tracking.tables import tracking_rows

COLUMNS = (
    *("sweep", "key", "label", "value", "scenario", "architecture", "estimator", "variant"),
    *("observers", "targets", "interval_minutes", "quantity", "part", "unit"),
    *("mean", "low", "high", "smallest", "largest", "seeds"),
)
"""Columns of the table; those that a row has no use for are empty."""


def architecture_values(
    architecture: xr.Dataset,
    orbits: xr.Dataset,
    targets: xr.Dataset,
    sun: xr.Dataset,
    settings: Mapping[str, Any],
) -> dict[str, float]:
    """What an architecture costs and covers.

    Parameters
    ----------
    architecture, orbits, targets, sun : xarray.Dataset
        Its data set, the orbit library, and static targets and ephemeris of its scenario.
    settings : mapping
        Configuration keys `propagator` and `visibility` of its scenario.

    Returns
    -------
    dict
        J, satellites in all, share of target-hours seen, static targets never seen.
    """
    orbit, satellites = architecture["orbit"].values, architecture["satellites"].values
    covered = architecture_coverage(orbit, satellites, orbits, targets, sun, settings)
    return {
        "J": float(architecture["J"]),
        "satellites": float(satellites.sum()),
        "union_coverage": covered.union_coverage,
        "static_never_seen": float(covered.never_seen),
    }


def sweep_rows(
    name: str,
    sweep: Mapping[str, Any],
    points: Sequence[SweepPoint],
    architectures: Sequence[Mapping[str, float]],
    summary: xr.Dataset | None,
) -> pd.DataFrame:
    """Rows of the table of a sweep.

    Parameters
    ----------
    name : str
        Name of the sweep.
    sweep : mapping
        Configuration key `sweeps.{name}`.
    points : sequence of SweepPoint
        Its values.
    architectures : sequence of mapping
        Of `architecture_values`, one for each value; empty where all values share one.
    summary : xarray.Dataset or None
        Statistics of the sweep's cells, of `cislunar.campaign.tracking.summary`, if it has any.

    Returns
    -------
    DataFrame
        For every value: what the architecture reaches, then every quantity of the cells as in
        ``tables/tracking.csv``.
    """
    rows = [
        {
            "value": point.value,
            "scenario": point.scenario,
            "architecture": sweep["architecture"],
            "observers": int(reached["satellites"]),
            "quantity": quantity,
            "unit": "1",
            "mean": value,
        }
        for point, reached in zip(points, architectures, strict=False)
        for quantity, value in reached.items()
    ]
    table = pd.DataFrame(rows)
    if summary is not None:
        value_of = {(point.scenario, point.variant): point.value for point in points}
        tracked = tracking_rows(summary)
        places = zip(tracked["scenario"], tracked["variant"], strict=True)
        tracked["value"] = [value_of[place] for place in places]
        table = tracked if table.empty else pd.concat([table, tracked], ignore_index=True)
    label = sweep.get("label", sweep["key"].removeprefix("settings."))
    table = table.assign(sweep=name, key=sweep["key"], label=label).reindex(columns=list(COLUMNS))
    for column in ("observers", "targets", "interval_minutes", "seeds"):
        table[column] = table[column].astype("Int64")
    return table


def plotted_values(table: pd.DataFrame) -> tuple[list[str], np.ndarray | None]:
    """The values of a sweep in its order, and as numbers where all are.

    Parameters
    ----------
    table : DataFrame
        Table of a sweep, as read from its file.

    Returns
    -------
    names : list of str
    numbers : ndarray or None
    """
    names = list(dict.fromkeys(table["value"].astype(str)))
    numbers = pd.to_numeric(pd.Series(names), errors="coerce").to_numpy(float)
    return names, numbers if np.isfinite(numbers).all() else None
