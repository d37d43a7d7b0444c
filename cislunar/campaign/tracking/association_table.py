"""Table of a study of association: ``tables/association.csv``.

Every cell is compared, realization by realization, with the cell of the same settings in which the
identity of every detection is known.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.association.model import KNOWN, MULTIPLE_FRAMES, AssociationModel
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.summary import seed_statistics
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.evaluation import PARTS, count_interval, t_interval
from cislunar.runtime import Array

TASKED = "tasked target"
"""Associator of cells whose observations measure their own targets alone."""

PLACE = ("clutter", "field_deg", "targets", "mode", "population", "estimator", "dynamics")
ASSOCIATION_COLUMNS = ("associator", *PLACE, "quantity", "mean", "low", "high", "largest", "seeds")
"""Columns of the table. `clutter`: mean number of false alarms per exposure."""

UNCONFIRMED = "multiple-frames-unconfirmed"
"""Associator of cells that ask for a single detection as confirmation."""

_COUNTS = ("wrong_associations_per_day", "switched_tracks", "lost_tracks", "never_observed")
_COUNTS += ("beyond_custody",)


def association_rows(cells: Sequence[tuple[Cell, xr.Dataset]], custody_km: float) -> pd.DataFrame:
    """Rows of the table, from cells with the metrics of `read_cell_metrics`. A target is beyond
    custody if its position error, root mean square over the final hours, is above `custody_km`. A
    track is lost by association if its target is, but not with known identities, and it has taken a
    wrong detection."""
    found = [_described(cell, data, custody_km) for cell, data in cells]
    known = {_reference(place): values for place, values in found if place["associator"] == KNOWN}
    rows = []
    for place, values in found:
        quantities = {key: each for key, each in values.items() if key not in ("beyond", "wrong")}
        same = known.get(_reference(place))
        if same is not None and place["associator"] != TASKED:
            quantities["gospa_ratio"] = values["gospa"] / same["gospa"]
            lost = values["beyond"] & ~same["beyond"] & values["wrong"]
            quantities["lost_tracks"] = lost.sum(axis=1)
        if same is not None:
            quantities["position_ratio"] = values["position_km"] / same["position_km"]
        for name, each in quantities.items():
            interval = (count_interval if name in _COUNTS else t_interval)(each)
            low = np.maximum(interval.low, 0.0)
            rows.append({**place, "quantity": name, "mean": interval.mean, "low": low,
                         "high": interval.high, "largest": np.max(each),
                         "seeds": interval.count})  # fmt: skip
    return pd.DataFrame(rows, columns=list(ASSOCIATION_COLUMNS))


def _reference(place: Mapping[str, Any]) -> tuple:
    """What a cell and that of known identities have in common, whatever the clutter."""
    return tuple(place[name] for name in PLACE if name != "clutter")


def _associator(given: AssociationModel) -> str:
    if not given.in_field:
        return TASKED
    return (
        UNCONFIRMED
        if given.method == MULTIPLE_FRAMES and given.confirmations == 1
        else given.method
    )


def _described(
    cell: Cell, data: xr.Dataset, custody_km: float
) -> tuple[dict[str, Any], dict[str, Array]]:
    """Settings of a cell, and the quantities of each realization; `beyond` (seed, target) marks
    targets with a larger position error than `custody_km`, `wrong` those whose track has taken a
    wrong detection."""
    settings = json.loads(data.attrs["settings"])
    given = AssociationModel(**settings.get("association", {}))
    field_deg = float(settings["sensor"]["field_of_view_deg"])
    slots = settings["tasking"].get("slot_minutes") is not None
    mode = "recommended" if slots else "paper"
    place = {
        "associator": _associator(given),
        "clutter": round(given.false_alarms_deg2 * field_deg**2, 1) if given.in_field else 0.0,
        "field_deg": field_deg,
        "targets": cell.targets,
        "mode": mode + (", field counted" if given.in_field and given.count_neighbors else ""),
        "population": cell.scenario,
        "estimator": cell.estimator,
        "dynamics": settings.get("dynamics", {}).get("truth", "cr3bp"),
    }
    statistics = seed_statistics(data)
    part = PARTS.index("position")
    error = data["final_error"].values[..., part] * LENGTH_UNIT_KM
    values = {
        "position_km": statistics["final_error_geometric_all"][:, part] * LENGTH_UNIT_KM,
        "anees": statistics["anees_mean"][:, [part, part + 1]].mean(axis=1),
        "inconsistent": statistics["inconsistent_translation"],
        "never_observed": statistics["never_observed"],
        "beyond_custody": (~(error <= custody_km)).sum(axis=1),
        "beyond": ~(error <= custody_km),
    }
    if "wrong_associations" in data:
        values["wrong"] = data["wrong_associations"].values.any(axis=1)
        values["associations_per_day"] = statistics["associations_per_day"]
    for name in ("gospa", "wrong_associations_per_day", "switched_tracks"):
        if name in statistics:
            values[name] = statistics[name]
    return place, values
