"""Tables of sweeps over a key of a scenario: ``tables/sweep_{name}.csv``."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.campaign.architectures import architecture_coverage, phases_of
from cislunar.campaign.settings.families import SweepPoint
from cislunar.campaign.tracking.tables import tracking_rows

SWEEP_COLUMNS = (
    *("sweep", "key", "label", "value", "scenario", "architecture", "estimator", "variant"),
    *("observers", "targets", "interval_minutes", "quantity", "part", "unit"),
    *("mean", "low", "high", "smallest", "largest", "seeds", "average"),
)
"""Columns of the table; unused ones are empty."""


def architecture_values(
    architecture: xr.Dataset,
    orbits: xr.Dataset,
    targets: xr.Dataset,
    sun: xr.Dataset,
    settings: Mapping[str, Any],
) -> dict[str, float]:
    """J, satellites in all, share of target-hours seen and static targets never seen.

    `settings` are the configuration keys `propagator` and `visibility` of the scenario.
    """
    orbit, satellites = architecture["orbit"].values, architecture["satellites"].values
    flown = orbit, satellites, orbits, targets, sun, settings
    covered = architecture_coverage(*flown, phases_of(architecture))
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
    """Rows of ``tables/sweep_{name}.csv``: results of architecture and tracking for every value.

    `sweep` is the configuration key `sweeps.{name}`; `architectures` are those of
    `architecture_values`, one for each value, or none if all values share one; `summary`, of the
    sweep's cells if it has any, gives every quantity as in ``tables/tracking.csv``.
    """
    points = [
        # several keys at once are labeled by the name of the value
        point._replace(value=point.variant or point.scenario)
        if isinstance(point.value, Mapping)
        else point
        for point in points
    ]
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
        cells = zip(tracked["scenario"], tracked["variant"], strict=True)
        tracked["value"] = [value_of[place] for place in cells]
        table = tracked if table.empty else pd.concat([table, tracked], ignore_index=True)
    label = sweep.get("label", sweep["key"].removeprefix("settings."))
    table = table.assign(sweep=name, key=sweep["key"], label=label).reindex(
        columns=list(SWEEP_COLUMNS)
    )
    for column in ("observers", "targets", "interval_minutes", "seeds"):
        table[column] = table[column].astype("Int64")
    return table


def plotted_values(table: pd.DataFrame) -> tuple[list[str], np.ndarray | None]:
    """The values of a sweep's table in their order, and as numbers where all are."""
    names = list(dict.fromkeys(table["value"].astype(str)))
    numbers = pd.to_numeric(pd.Series(names), errors="coerce").to_numpy(float)
    return names, numbers if np.isfinite(numbers).all() else None
