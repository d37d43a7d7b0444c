"""The tables of targets that maneuver, from the study ``config/maneuvers.yaml``."""

from collections.abc import Callable, Mapping

import pandas as pd

from cislunar.campaign.tracking.maneuvers.table import PLACE
from cislunar.figures.labels import ESTIMATORS

from .columns import Tables, stated
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

_OF_SIZES = {
    "Detected within 24 h (%)": ("detected", ".0f", 100.0),
    "Median time to alarm (h)": ("latency_h", ".1f", 1.0),
    "In custody after 6 h, of targets observed by then (%)": ("custody_6_h_observed", ".0f", 100.0),
    "In custody after 24 h (%)": ("custody_24_h", ".0f", 100.0),
    "Position error after 24 h (km)": ("error_24_h_km", ".3g", 1.0),
    "Median normalized squared error after 24 h": ("anees_24_h", ".2g", 1.0),
    "Error of the estimated time (h)": ("time_error_h", ".2g", 1.0),
    "Error of the estimated change of velocity (m/s)": ("velocity_error_m_s", ".2g", 1.0),
    "Components of the estimated change within 3 sigma (%), 99.7 if consistent": (
        "velocity_coverage",
        ".0f",
        100.0,
    ),
}
_OF_CELLS = {
    "Change of velocity detected with a probability of 90 % (m/s)": ("detectable_m_s", ".2f", 1.0),
    "False alarms per target-day": ("false_alarms_per_day", ".4f", 1.0),
    "In custody at the end (%)": ("custody_end", ".1f", 100.0),
    "Median normalized squared error at the end": ("anees_end", ".2f", 1.0),
    "Position error at the end of targets without a maneuver (km)": (
        "coasting_error_km",
        ".3g",
        1.0,
    ),
}


def _numbers(cell: pd.DataFrame, columns: Mapping[str, tuple]) -> list[str]:
    """Values of a cell with their intervals."""
    return [stated(cell.set_index("quantity"), *each, "value") for each in columns.values()]


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
    rows = [
        [*_heads(place), *_numbers(cell, _OF_CELLS)]
        for place, cell in table.groupby(list(PLACE), sort=False)
    ]
    return {"table": markdown_table([*_HEADS, *_OF_CELLS], rows)}


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
        rows = []
        for (low, high, response), own in table.groupby(
            ["smallest_m_s", "largest_m_s", "response"], sort=True
        ):
            number = int(own.set_index("quantity").loc["detected", "number"])
            head = [f"{low:g} to {high:g}", _RESPONSES[response], number]
            rows.append([*head, *_numbers(own, _OF_SIZES)])
        header = ["Change of velocity (m/s)", "Response to alarms", "Maneuvers", *_OF_SIZES]
        return {"table": markdown_table(header, rows)}

    return values


MANEUVER_BLOCKS = {
    STUDY: _sizes("recommended"),
    f"{STUDY}-hours": _sizes("paper"),
    f"{STUDY}-clutter": _sizes("paper", 1.0),
    f"{STUDY}-cells": _cells,
}
"""What makes each block of the study, by name."""
