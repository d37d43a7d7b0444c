"""The tables of surveys without a catalog, from the studies that consist of surveys."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import pandas as pd

from .columns import Column as TableColumn
from .columns import Tables, by_cell, numbers
from .markdown import markdown_table

STUDIES = ("catalog", "survey")
"""Studies: ``config/NAME.yaml``; their tables in ``docs/tables``, figures in ``docs/images``."""

TABLE = "catalog"
"""Name of table and figure in the results of each."""


class Column(NamedTuple):
    """A column: its head, the quantity of the table, the format of its numbers, the factor that
    multiplies them, and an explanation for the caption."""

    title: str
    quantity: str
    format: str
    factor: float = 1.0
    terms: str = ""


_COLUMNS = {
    "catalog": (
        Column("Findable", "findable", ".0f",
               terms="An object is findable if at least three tracklets have detections of this "
               "object alone, and no two of them have a common detection."),
        Column("Linked (% of findable)", "linked_share", ".1f", 100.0,
               terms="An object is linked if most detections of some orbit, confirmed or not, are "
               "detections of the object."),
        Column("Correct (% of findable)", "completeness", ".1f", 100.0),
        Column("Correct, inside of the families (% of findable objects inside)",
               "completeness_inside", ".1f", 100.0,
               terms="Objects inside of the families are on orbits of the moving targets. Objects "
               "outside are on no orbit of the moving targets or of the observers."),
        Column("Correct, outside of the families (% of findable objects outside)",
               "completeness_outside", ".1f", 100.0),
        Column("Correct orbits", "right", ".0f",
               terms="A confirmed orbit belongs to the object that caused more of the orbit's "
               "detections than any other object, if these outnumber the orbit's false alarms. The "
               "orbit is correct if its position error at its last detection is at most 500 km. "
               "One correct orbit of each object counts."),
        Column("Correct orbits, difference from the survey of the first row", "right_difference",
               "+z.1f",
               terms="The difference is the mean of the paired differences over the same "
               "realizations. It is stated only if both surveys have the same objects."),
        Column("Duplicates", "duplicate", ".1f",
               terms="A duplicate is any further correct orbit of the same object."),
        Column("Wrong (% of confirmed)", "wrong_share", ".2f", 100.0,
               terms="A wrong orbit is confirmed, and has a larger error or belongs to no object."),
        Column("Purity (%)", "purity", ".2f", 100.0,
               terms="Purity is the share of the detections in confirmed orbits that are of the "
               "object of the orbit."),
        Column("Correct, maneuvered (% of findable maneuvered objects)",
               "completeness_maneuvering", ".1f", 100.0,
               terms="Maneuvered objects have maneuvered before the end of the stated days."),
        Column("In custody (% of findable)", "custody", ".1f", 100.0,
               terms="An object is in custody if a confirmed orbit predicts its position at the "
               "end of the stated days within 10 km."),
        Column("Findable objects in custody", "in_custody", ".0f"),
        Column("Error of known objects (km)", "error_known_km", ".2f",
               terms="The error of known objects is the geometric mean of the position errors, at "
               "the end of the stated days, of the objects that had a correct orbit a day before; "
               "an object without a confirmed orbit, or with a larger error, counts with 500 km."),
        Column("Increase of the error of known objects due to the search (%)", "search_cost",
               "+z.1f", 100.0,
               terms="The increase due to the search is the relative difference of this mean from "
               "that of the same realizations of the survey whose search ends after one day."),
        Column("Hours to catalog", "hours_to_catalog", ".1f",
               terms="Hours to catalog are the median time from the first detection of an object "
               "to the linking run since which it has had a correct orbit; objects without a "
               "correct orbit at the end are left out."),
    ),
    "consistency": (
        Column("NEES", "nees", ".3g",
               terms="The NEES is the mean normalized estimation error squared of correct orbits "
               "at their last detections; six is expected for the six components of a state."),
        Column("Coverage of the 95 % region (%)", "covered", ".1f", 100.0,
               terms="Coverage is the share of the correct orbits whose 95 % covariance ellipsoid "
               "contains the true state at the last detection."),
        Column("NEES, averaged state and covariance", "nees_averaged", ".3g",
               terms="Averaged states and covariances are those of a mixture over the number of "
               "maneuvers that the object made before its last detection."),
        Column("Coverage, averaged state and covariance (%)", "covered_averaged", ".1f", 100.0),
        Column("NEES, unmaneuvered objects", "nees_ballistic", ".3g",
               terms="Unmaneuvered objects have not maneuvered before the end of the stated days."),
        Column("Predicted NEES, unmaneuvered objects", "nees_now_ballistic", ".3g",
               terms="The predicted NEES is that of orbits predicted to the end of the stated "
               "days, within 500 km of the object."),
    ),
    "characterization": (
        Column("Characterized orbits", "bright", ".0f",
               terms="Characterized orbits are those with enough detections of sufficiently small "
               "noise."),
        Column("Spin period determined (%)", "period_determined", ".1f", 100.0,
               terms="Shares of periods that are determined, and of amplitudes and areas times "
               "albedo, are of the characterized orbits; coverage is the share of the 95 % "
               "intervals that contain the true value."),
        Column("Coverage of periods (%)", "period_covered", ".1f", 100.0),
        Column("Half width of the intervals of periods (%)", "period_half_width", ".1f", 100.0,
               terms="Coverage and median half width of periods are those of the determined ones."),
        Column("Coverage of amplitudes (%)", "amplitude_covered", ".1f", 100.0),
        Column("Coverage of areas times albedo (%)", "area_albedo_covered", ".1f", 100.0),
    ),
}  # fmt: skip
"""Columns of each table, from left to right."""

_HEADLINE_SURVEYS = (
    "everything", "three-days", "week", "without-follow-up", "published-observers",
    "uniform-sweep", "published-sweep",
)  # fmt: skip
"""Surveys of the headline, from top to bottom, each at its end."""

_HEADLINE = (
    "findable", "right", "custody", "in_custody", "duplicate", "wrong_share", "nees_ballistic",
    "covered",
)  # fmt: skip
"""Quantities of the columns of the headline."""


def _headline(tables: Tables) -> dict[str, object]:
    """Quality of the catalogs with all effects and of the baselines, at the end."""
    table = tables["survey"]
    ends = [own[own["day"] == own["day"].max()]
            for own in (table[table["survey"] == name] for name in _HEADLINE_SURVEYS)]  # fmt: skip
    columns = [each for group in _COLUMNS.values() for each in group if each.quantity in _HEADLINE]
    return _table(pd.concat(ends), columns)


def _observers(tables: Tables) -> dict[str, str]:
    """Correct orbits and custody after a day, by the numbers of observers and objects."""
    table = tables["survey"]
    counted = table["survey"].str.fullmatch(r"everything|(observers|objects)(-\d+)+")
    table = table[counted & (table["day"] == 1.0)]
    table = table.assign(observers=table["architecture"].str.extract(r"(\d+)$")[0].astype(int))
    rows = []
    for observers, own in table.groupby("observers"):
        right, custody = (own[own["quantity"] == name].sort_values("targets").itertuples()
                          for name in ("right", "in_custody"))  # fmt: skip
        rows.append([
            observers,
            *(f"{row.mean:.0f} ({row.smallest:.0f} to {row.largest:.0f}; {row.seeds})"
              if row.seeds > 1 else f"{row.mean:.0f}" for row in (*right, *custody)),
        ])  # fmt: skip
    numbers = [f"{targets:,d}" for targets in sorted(table["targets"].unique())]
    header = ["Observers", *(f"Correct orbits of {each} objects" for each in numbers),
              *(f"In custody of {each} objects" for each in numbers)]  # fmt: skip
    return {"table": markdown_table(header, rows)}


def _surveys(study: str, tables: Tables) -> dict[str, object]:
    """Quality of the catalog of every survey, by days, in a table for each subject."""
    there = {*tables[study]["quantity"]}
    groups = ([each for each in group if each.quantity in there] for group in _COLUMNS.values())
    return {"tables": [_table(tables[study], columns) for columns in groups if columns]}


def _table(table: pd.DataFrame, columns: Sequence[Column]) -> dict[str, str]:
    """A table of the surveys that have one of the quantities, and the terms of its columns."""
    own = table[table["quantity"].isin([each.quantity for each in columns])]
    shown = [TableColumn(each.quantity, "", "1", each.format, each.factor, interval=True)
             for each in columns]  # fmt: skip
    rows = [
        [label, f"{day:g}", int(max(row["seeds"] for row in cell.values())), *numbers(cell, shown)]
        for (label, day), cell in by_cell(own, ["label", "day"]).items()
    ]
    titles = [each.title for each in columns]
    return {
        "table": markdown_table(["Survey", "Days", "Realizations", *titles], rows),
        "terms": " ".join(each.terms for each in columns if each.terms),
    }


CATALOG_BLOCKS: dict[str, dict[str, Callable[[Tables], dict[str, object]]]] = {
    study: {study: partial(_surveys, study)} for study in STUDIES
}
CATALOG_BLOCKS["survey"] |= {"survey-headline": _headline, "survey-observers": _observers}
"""What makes each block, by study and name."""
