"""The tables of targets that maneuver, from the study ``config/maneuvers.yaml``."""

from collections.abc import Callable

from cislunar.campaign.tracking.maneuvers.table import PLACE
from cislunar.figures.labels import ESTIMATORS

from .columns import COLUMNS, Tables, by_cell, numbers
from .markdown import markdown_table

STUDY = "maneuvers"
"""Name of the study's table in ``docs/tables``, and of its figure in ``docs/images``."""

_MODES = {"paper": "every hour", "recommended": "slots of 20 min"}
_DYNAMICS = {"cr3bp": "CR3BP", "ephemeris": "ephemeris"}
_RESPONSES = {
    "none": "detected only",
    "recovery": "estimated",
    "search": "estimated, with a search",
}

_CLASS = ["smallest_m_s", "largest_m_s", "response"]


def _heads(place: tuple) -> list[object]:
    own = dict(zip(PLACE, place, strict=True))
    return [
        _MODES[own["mode"]],
        own["targets"],
        own["observers"],
        ESTIMATORS[own["estimator"]],
        _DYNAMICS[own["dynamics"]],
        f"{own['clutter']:g}",
        f"{own['delay_minutes']:g}",
        f"{own['days']:g}",
        _RESPONSES[own["response"]],
    ]


_HEADS = ["Tasking", "Targets", "Observers", "Estimator", "Dynamics",
          "False alarms per exposure", "Delay of measurements (min)", "Days",
          "Response to alarms"]  # fmt: skip


def _cells(tables: Tables) -> dict[str, str]:
    """One row for each cell."""
    table = tables[STUDY]
    table = table[table["smallest_m_s"].isna()]
    columns = COLUMNS["maneuver_cells"]
    rows = [
        [*_heads(place), *numbers(cell, columns.values())]
        for place, cell in by_cell(table, list(PLACE)).items()
    ]
    return {"table": markdown_table([*_HEADS, *columns], rows)}


def _sizes(mode: str, clutter: float = 0.0) -> Callable[[Tables], dict[str, str]]:
    """One row for each class of changes of velocity, of 100 targets and the usual cell with a
    number of false alarms in each exposure."""

    def values(tables: Tables) -> dict[str, str]:
        same = {"mode": mode, "targets": 100, "observers": 20, "estimator": "mukf",
                "dynamics": "cr3bp", "clutter": clutter, "delay_minutes": 0.0}  # fmt: skip
        table = tables[STUDY]
        for key, value in same.items():
            table = table[table[key] == value]
        table = table[table["smallest_m_s"].notna()]
        columns, cells = COLUMNS["maneuver_sizes"], by_cell(table, _CLASS)
        rows = []
        for (low, high, response), cell in sorted(cells.items(), key=lambda item: item[0]):
            number = int(cell["detected", "", "1"]["number"])
            head = [f"{low:g} to {high:g}", _RESPONSES[response], number]
            rows.append([*head, *numbers(cell, columns.values())])
        header = ["Δv (m/s)", "Response to alarms", "Maneuvers", *columns]
        return {"table": markdown_table(header, rows)}

    return values


MANEUVER_BLOCKS = {
    STUDY: _sizes("recommended"),
    f"{STUDY}-hours": _sizes("paper"),
    f"{STUDY}-clutter": _sizes("paper", 1.0),
    f"{STUDY}-cells": _cells,
}
"""What makes each block of the study, by name."""
