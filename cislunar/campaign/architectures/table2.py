"""Table 2 of Paul & Fan beside this library's architectures, and near-optimal architectures."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.architecture.published import PUBLISHED
from cislunar.campaign.architectures.variables import phases_of
from cislunar.campaign.architectures.visibility import architecture_coverage
from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S


def architecture_rows(
    scenario: str,
    optimizer: str,
    architecture: xr.Dataset,
    orbits: xr.Dataset,
    targets: xr.Dataset,
    sun: xr.Dataset,
    settings: Mapping[str, Any],
) -> pd.DataFrame:
    """Rows of ``tables/architecture.csv`` for one architecture, one for each slot.

    Each row has family, member and satellites of a slot beside the paper's family and count, then
    the values of the whole architecture, repeated on each row. The slots of "published" are the
    paper's, row by row; those of other optimizers have no corresponding order. `settings` has the
    configuration keys `propagator` and `visibility`.
    """
    orbit = architecture["orbit"].values
    satellites = architecture["satellites"].values
    flown = orbit, satellites, orbits, targets, sun, settings
    covered = architecture_coverage(*flown, phases_of(architecture))
    paper = PUBLISHED.get(scenario, ())
    paper_at = [paper[slot] if slot < len(paper) else ("", "") for slot in range(len(orbit))]
    return pd.DataFrame(
        {
            "scenario": scenario,
            "optimizer": optimizer,
            "slot": np.arange(1, len(orbit) + 1),
            "family": orbits["family"].values[orbit],
            "orbit": orbit,
            "satellites": satellites,
            "paper_family": [family for family, _ in paper_at],
            "paper_satellites": [count for _, count in paper_at],
            "period_days": orbits["period"].values[orbit] * TIME_UNIT_S / SECONDS_PER_DAY,
            "jacobi": orbits["jacobi"].values[orbit],
            "stability_index": orbits["stability_index"].values[orbit],
            "total_satellites": int(satellites.sum()),
            "J": float(architecture["J"]),
            "union_coverage": covered.union_coverage,
            "target_days": covered.target_days,
            "never_seen": covered.never_seen,
            "observers_per_covered_target_hour": covered.observers_per_covered,
        }
    )


def near_optimal_rows(scenario: str, exact: xr.Dataset, orbits: xr.Dataset) -> pd.DataFrame:
    """Rows of ``tables/near_optimal.csv``: every architecture close to the optimum.

    Rank, J, its share of the optimum, and the orbits with their satellites.
    """
    family = orbits["family"].values
    orbit, satellites = exact["near_orbit"].values, exact["near_satellites"].values
    value = exact["near_J"].values
    return pd.DataFrame(
        {
            "scenario": scenario,
            "rank": np.arange(1, len(value) + 1),
            "J": value,
            "share_of_optimum": value / (float(exact["J"]) or np.nan),  # none of nothing
            "total_satellites": satellites.sum(axis=1),
            "orbits": [
                "; ".join(f"{family[i]}[{i}] x {n}" for i, n in zip(*pair, strict=True))
                for pair in zip(orbit, satellites, strict=True)
            ],
        }
    )
