"""The tables of surveys without a catalog, from the studies that consist of surveys."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import pandas as pd

from .columns import Tables, stated
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


_COLUMNS = (
    Column("Findable", "findable", ".0f",
           terms="Findable: objects with at least three tracklets."),
    Column("Linked of findable (%)", "linked_share", ".1f", 100.0,
           terms="Linked: findable objects for which most detections of some orbit, confirmed or "
           "not, are detections of the object."),
    Column("Right of findable (%)", "completeness", ".1f", 100.0,
           terms="Right of findable: share of the findable objects that have a right orbit."),
    Column("Right of findable inside of the families (%)", "completeness_inside", ".1f", 100.0,
           terms="Inside of the families: share of the findable objects on orbits of the moving "
           "targets. Outside of the families: share of those on no orbit of the moving targets or "
           "of the observers."),
    Column("Right of findable outside of the families (%)", "completeness_outside", ".1f", 100.0),
    Column("Right orbits", "right", ".0f",
           terms="Right orbits: confirmed, within 500 km of the object at the last detection."),
    Column("Right orbits, difference to the survey of the first row", "right_difference", "+.0f",
           terms="Difference: in the same realizations, if both surveys have the same objects."),
    Column("Duplicates", "duplicate", ".1f",
           terms="Duplicates: further confirmed orbits of an object with a right orbit."),
    Column("Wrong of confirmed (%)", "wrong_share", ".2f", 100.0,
           terms="Wrong orbits: confirmed, with a larger error, or with false alarms as most of "
           "their detections."),
    Column("Purity (%)", "purity", ".2f", 100.0,
           terms="Purity: share of the detections in confirmed orbits that belong to the object "
           "of the orbit."),
    Column("Right of findable that have maneuvered (%)", "completeness_maneuvering", ".1f", 100.0,
           terms="Have maneuvered: before the time of the table."),
    Column("In custody (%)", "custody", ".1f", 100.0,
           terms="In custody: findable objects with a confirmed orbit within 10 km of the object "
           "at the time of the table."),
    Column("NEES", "nees", ".2f",
           terms="NEES: normalized estimation error squared of right orbits, with six degrees of "
           "freedom, at the last detection."),
    Column("True state within the region of 95 % (%)", "covered", ".1f", 100.0,
           terms="True state within the region of 95 %: share of the right orbits, at the last "
           "detection."),
    Column("NEES, no maneuver so far", "nees_ballistic", ".2f",
           terms="No maneuver so far: of the objects that have not maneuvered."),
    Column("NEES at the time of the table, no maneuver so far", "nees_now_ballistic", ".2f",
           terms="NEES at the time of the table: of predicted orbits within 500 km of the object."),
    Column("Error of known objects (km)", "error_known_km", ".2f",
           terms="Error of known objects: geometric mean of the position errors, at the time of "
           "the table, of the objects that had a right orbit a day before; objects lost "
           "since count with 500 km."),
    Column(
        "Error of known objects, increase by the search (%)",
        "search_cost", "+.1f", 100.0,
           terms="Increase by the search: that of this mean over that of the survey that stops "
           "searching."),
    Column("Hours to catalog", "hours_to_catalog", ".1f",
           terms="Hours to catalog: median time from the first detection of an object to its "
           "confirmed orbit."),
    Column("Characterized orbits", "bright", ".0f",
           terms="Characterized orbits: those with enough detections of sufficiently small noise."),
    Column("Spin period determined (%)", "period_determined", ".1f", 100.0,
           terms="Spin period determined: share of the characterized orbits."),
    Column("True spin period within its interval (%)", "period_covered", ".1f", 100.0),
    Column("Half width of the interval of the spin period (%)", "period_half_width", ".1f", 100.0,
           terms="True spin period within its interval, and half width: of the determined "
           "periods."),
    Column("True amplitude within its interval (%)", "amplitude_covered", ".1f", 100.0),
    Column("True area times albedo within its interval (%)", "area_albedo_covered", ".1f", 100.0,
           terms="True amplitude and area times albedo within their intervals: share of the "
           "characterized orbits whose 95 % interval contains the true value."),
)  # fmt: skip
"""Columns of the table, from left to right."""


_HEADLINE_SURVEYS = ("everything", "three-days", "week", "without-follow-up", "published-sweep")
"""Surveys of the headline, from top to bottom, each at its end."""

_HEADLINE = (
    "findable", "right", "custody", "duplicate", "wrong_share", "nees_ballistic", "covered",
)  # fmt: skip
"""Quantities of the columns of the headline."""


def _headline(tables: Tables) -> dict[str, str]:
    """Quality of the catalogs with all effects and of the baselines, at the end."""
    table = tables["survey"]
    ends = [own[own["day"] == own["day"].max()]
            for own in (table[table["survey"] == name] for name in _HEADLINE_SURVEYS)]  # fmt: skip
    kept = pd.concat(ends)
    return _surveys("survey", {"survey": kept[kept["quantity"].isin(_HEADLINE)]})


def _observers(tables: Tables) -> dict[str, str]:
    """Right orbits after a day, by the numbers of observers and objects."""
    table = tables["survey"]
    counted = table["survey"].str.fullmatch(r"everything|(observers|objects)(-\d+)+")
    table = table[counted & (table["day"] == 1.0)]
    table = table.assign(observers=table["architecture"].str.extract(r"(\d+)$")[0].astype(int))
    rows = []
    for observers, own in table.groupby("observers"):
        right, custody = (own[own["quantity"] == name].sort_values("targets").itertuples()
                          for name in ("right", "custody"))  # fmt: skip
        rows.append([
            observers,
            *(f"{row.mean:.0f}" + f" ({row.smallest:.0f} to {row.largest:.0f})" * (row.seeds > 1)
              for row in right),
            *(f"{100.0 * row.mean:.0f}" for row in custody),
        ])  # fmt: skip
    numbers = [f"{targets:,d}" for targets in sorted(table["targets"].unique())]
    header = ["Observers", *(f"Right orbits of {each} objects" for each in numbers),
              *(f"In custody of the findable of {each} (%)" for each in numbers)]  # fmt: skip
    return {"table": markdown_table(header, rows)}


def _surveys(study: str, tables: Tables) -> dict[str, str]:
    """Quality of the catalog of every survey, by days."""
    rows, there = [], {*tables[study]["quantity"]}
    columns = [column for column in _COLUMNS if column.quantity in there]
    for (label, day), own in tables[study].groupby(["label", "day"], sort=False):
        found = own.set_index("quantity")
        rows.append([
            label, f"{day:g}", int(own["seeds"].max()),
            *(stated(found, column.quantity, column.format, column.factor) for column in columns),
        ])  # fmt: skip
    terms = " ".join(column.terms for column in columns if column.terms)
    titles = [column.title for column in columns]
    table = markdown_table(["Survey", "Days", "Realizations", *titles], rows)
    return {"table": table, "terms": terms}


CATALOG_BLOCKS: dict[str, dict[str, Callable[[Tables], dict[str, str]]]] = {
    study: {study: partial(_surveys, study)} for study in STUDIES
}
CATALOG_BLOCKS["survey"] |= {"survey-headline": _headline, "survey-observers": _observers}
"""What makes each block, by study and name."""
