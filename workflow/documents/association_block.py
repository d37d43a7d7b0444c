"""The tables of the association of detections, from the study ``config/association.yaml``."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cislunar.campaign.tracking.association_table import PLACE, TASKED
from cislunar.figures.labels import ASSOCIATORS, ESTIMATORS

from .columns import COLUMNS, Tables, by_cell, numbers
from .markdown import DASH, markdown_table

STUDY = "association"
"""Name of the study's table in ``docs/tables``, and of its figure in ``docs/images``."""

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


def _rows(
    tables: Tables, same: Mapping[str, Any], heads: Mapping[str, Callable[[dict], object]]
) -> list[list[object]]:
    """Rows of the cells with these settings: heads, then quantities with their intervals."""
    table = tables[STUDY]
    for key, value in same.items():
        own = table[key]
        table = table[np.isclose(own, value) if isinstance(value, float) else own == value]
    found = []
    for place, cell in by_cell(table, _KEYS).items():
        values = dict(zip(_KEYS, place, strict=True))
        first = [head(values) for head in heads.values()]
        found.append([*first, *numbers(cell, COLUMNS[STUDY].values())])
    return found


def _clutter(values: dict) -> str:
    return DASH if values["associator"] in (TASKED, "known-identity") else f"{values['clutter']:g}"


_HEADS: Mapping[str, Callable[[dict], object]] = {
    "Targets": lambda values: values["targets"],
    "Field of view in degrees": lambda values: f"{values['field_deg']:g}",
    "Tasking": lambda values: _MODES[values["mode"]],
    "Estimator": lambda values: ESTIMATORS[values["estimator"]],
    "Dynamics": lambda values: _DYNAMICS[values["dynamics"]],
    "False alarms per exposure": _clutter,
    "Association": lambda values: ASSOCIATORS[values["associator"]],
}


def _table(same: Mapping[str, Any], *heads: str) -> Callable[[Tables], dict[str, str]]:
    columns = {name: _HEADS[name] for name in (*heads, *list(_HEADS)[-2:])}

    def values(tables: Tables) -> dict[str, str]:
        header = [*columns, *COLUMNS[STUDY]]
        return {"table": markdown_table(header, _rows(tables, same, columns))}

    return values


def _without(key: str) -> dict[str, Any]:
    return {other: value for other, value in _USUAL.items() if other != key}


ASSOCIATION_BLOCKS = {
    STUDY: _table(_USUAL),
    f"{STUDY}-numbers": _table(_without("targets"), "Targets"),
    f"{STUDY}-fields": _table(_without("field_deg"), "Field of view in degrees"),
    f"{STUDY}-cells": _table(
        {"targets": 100, "field_deg": 3.0, "population": "A"}, "Tasking", "Estimator", "Dynamics"
    ),
    f"{STUDY}-counted": _table({"targets": 202, "population": "A"}, "Tasking"),
    f"{STUDY}-pairs": _table({"population": "B"}),
}
"""What makes each block of the study, by name."""
