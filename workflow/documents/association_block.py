"""The tables of the association of detections, from the study ``config/association.yaml``."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cislunar.campaign.tracking.association_table import PLACE, TASKED
from cislunar.figures.labels import ASSOCIATORS, ESTIMATORS

from .columns import Tables
from .markdown import DASH, markdown_table
from .studies import read_study

STUDY = "association"
"""Name of the study's table in ``docs/tables``, and of its figure in ``docs/images``."""

_QUANTITIES = {
    "Wrong associations per day": ("wrong_associations_per_day", ".2f"),
    "Tracks lost by wrong associations": ("lost_tracks", ".2f"),
    "Tracks switched": ("switched_tracks", ".2f"),
    "Targets beyond 10 km": ("beyond_custody", ".1f"),
    "GOSPA (km)": ("gospa", ".1f"),
    "GOSPA ratio": ("gospa_ratio", ".3f"),
    "ANEES": ("anees", ".2f"),
    "ANEES, worst realization": ("anees", ".2f", "largest"),
    "Position error (km)": ("position_km", ".3g"),
}
"""Columns of the tables: quantity, format and the statistic if it is not the mean."""

_KEYS = ["associator", *PLACE]

_MODES = {
    "paper": "paper's",
    "paper, field counted": "paper's, all tracks in the field counted",
    "recommended": "recommended",
    "recommended, field counted": "recommended, all tracks in the field counted",
}
_DYNAMICS = {"cr3bp": "CR3BP", "ephemeris": "ephemeris"}

_USUAL = {
    "field_deg": 3.0,
    "targets": 100,
    "mode": "paper",
    "population": "A",
    "estimator": "mukf",
    "dynamics": "cr3bp",
}


def study_table(results: str | Path) -> pd.DataFrame:
    """The table of a finished study, from its folder of results."""
    return read_study(STUDY, results, STUDY)


def _rows(
    tables: Tables, same: Mapping[str, Any], heads: Mapping[str, Callable[[dict], object]]
) -> list[list[object]]:
    """Rows of the cells with these settings: heads, then quantities with their intervals."""
    table = tables[STUDY]
    for key, value in same.items():
        own = table[key]
        table = table[np.isclose(own, value) if isinstance(value, float) else own == value]
    found = []
    for place, cell in table.groupby(_KEYS, sort=False):
        values = dict(zip(_KEYS, place, strict=True))
        rows = cell.set_index("quantity")
        numbers = [_number(rows, *column) for column in _QUANTITIES.values()]
        found.append([*(head(values) for head in heads.values()), *numbers])
    return found


def _number(rows: pd.DataFrame, name: str, form: str, of: str = "mean") -> str:
    if name not in rows.index:
        return DASH
    if of != "mean":
        return f"{rows.loc[name, of]:{form}}"
    mean, low, high = rows.loc[name, ["mean", "low", "high"]]
    if not np.isfinite(low):
        return f"{mean:{form}}"
    return f"{mean:{form}} [{low:{form}}, {high:{form}}]"


def _associator(values: dict) -> str:
    return ASSOCIATORS[values["associator"]]


def _clutter(values: dict) -> str:
    return DASH if values["associator"] in (TASKED, "known-identity") else f"{values['clutter']:g}"


def _table(
    same: Mapping[str, Any], **heads: Callable[[dict], object]
) -> Callable[[Tables], dict[str, str]]:
    columns = {name.replace("_", " "): head for name, head in heads.items()}

    def values(tables: Tables) -> dict[str, str]:
        header = [*columns, *_QUANTITIES]
        return {"table": markdown_table(header, _rows(tables, same, columns))}

    return values


def _without(place: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    return {key: value for key, value in place.items() if key not in keys}


ASSOCIATION_BLOCKS = {
    STUDY: _table(_USUAL, False_alarms_per_exposure=_clutter, Association=_associator),
    f"{STUDY}-numbers": _table(
        _without(_USUAL, "targets"),
        Targets=lambda values: values["targets"],
        False_alarms_per_exposure=_clutter,
        Association=_associator,
    ),
    f"{STUDY}-fields": _table(
        _without(_USUAL, "field_deg"),
        Field_of_view_in_degrees=lambda values: f"{values['field_deg']:g}",
        False_alarms_per_exposure=_clutter,
        Association=_associator,
    ),
    f"{STUDY}-cells": _table(
        {"targets": 100, "field_deg": 3.0, "population": "A"},
        Tasking=lambda values: _MODES[values["mode"]],
        Estimator=lambda values: ESTIMATORS[values["estimator"]],
        Dynamics=lambda values: _DYNAMICS[values["dynamics"]],
        False_alarms_per_exposure=_clutter,
        Association=_associator,
    ),
    f"{STUDY}-counted": _table(
        {"targets": 202, "population": "A"},
        Tasking=lambda values: _MODES[values["mode"]],
        False_alarms_per_exposure=_clutter,
        Association=_associator,
    ),
    f"{STUDY}-pairs": _table(
        {"population": "B"}, False_alarms_per_exposure=_clutter, Association=_associator
    ),
}
"""What makes each block of the study, by name."""
