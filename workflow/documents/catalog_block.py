"""The tables of surveys without a catalog, from the studies that consist of surveys."""

from collections.abc import Callable
from functools import partial

from .columns import Tables, stated
from .markdown import markdown_table

STUDIES = ("catalog", "survey")
"""Studies: ``config/NAME.yaml``; their tables in ``docs/tables``, figures in ``docs/images``."""

TABLE = "catalog"
"""Name of table and figure in the results of each."""

_QUANTITIES = {
    "Findable": ("findable", ".0f", 1.0),
    "Linked of findable (%)": ("linked_share", ".1f", 100.0),
    "Right of findable (%)": ("completeness", ".1f", 100.0),
    "inside of the families (%)": ("completeness_inside", ".1f", 100.0),
    "outside (%)": ("completeness_outside", ".1f", 100.0),
    "Right orbits": ("right", ".0f", 1.0),
    "Right orbits, difference to the first survey": ("right_difference", "+.0f", 1.0),
    "Duplicates": ("duplicate", ".1f", 1.0),
    "Wrong of confirmed (%)": ("wrong_share", ".2f", 100.0),
    "Purity (%)": ("purity", ".2f", 100.0),
    "Maneuvering (%)": ("completeness_maneuvering", ".1f", 100.0),
    "In custody (%)": ("custody", ".1f", 100.0),
    "NEES": ("nees", ".2f", 1.0),
    "True state within the region of 95 % (%)": ("covered", ".1f", 100.0),
    "NEES, no maneuver so far": ("nees_ballistic", ".2f", 1.0),
    "NEES now, no maneuver so far": ("nees_now_ballistic", ".2f", 1.0),
    "Error of known objects (km)": ("error_known_km", ".2f", 1.0),
    "Error of known objects, increase by the search (%)": ("search_cost", "+.1f", 100.0),
    "Hours to catalog": ("hours_to_catalog", ".1f", 1.0),
    "Characterized orbits": ("bright", ".0f", 1.0),
    "Spin period determined (%)": ("period_determined", ".1f", 100.0),
    "True spin period within its interval (%)": ("period_covered", ".1f", 100.0),
    "Half width of that interval (%)": ("period_half_width", ".1f", 100.0),
    "True amplitude within (%)": ("amplitude_covered", ".1f", 100.0),
    "True area times albedo within (%)": ("area_albedo_covered", ".1f", 100.0),
}
"""Columns: quantity, format and factor."""

_TERMS = {
    "Findable": "Findable: objects with at least three tracklets.",
    "Linked of findable (%)": "Linked: findable objects for which most detections of some orbit, "
    "confirmed or not, are detections of the object.",
    "inside of the families (%)": "Inside and outside of the families: right orbits of the "
    "findable objects of each group.",
    "Right orbits": "Right orbits: confirmed, within 500 km of the object at the last detection.",
    "Duplicates": "Duplicates: further confirmed orbits of an object with a right orbit.",
    "Wrong of confirmed (%)": "Wrong orbits: confirmed, with a larger error, or with false alarms "
    "as most of their detections.",
    "Purity (%)": "Purity: share of the detections in confirmed orbits that belong to the object "
    "of the orbit.",
    "Maneuvering (%)": "Maneuvering: right orbits of the findable objects that have maneuvered.",
    "In custody (%)": "In custody: findable objects with a confirmed orbit within 10 km of the "
    "object at the time of the table.",
    "NEES": "NEES: normalized estimation error squared of right orbits, with six degrees of "
    "freedom, at the last detection.",
    "True state within the region of 95 % (%)": "True state within the region of 95 %: share of "
    "the right orbits, at the last detection.",
    "NEES, no maneuver so far": "No maneuver so far: of the objects that have not maneuvered.",
    "NEES now, no maneuver so far": "NEES now: at the time of the table.",
    "Error of known objects (km)": "Error of known objects: geometric mean of the position errors, "
    "at the time of the table, of the objects that had a right orbit a day before; objects lost "
    "since count with 500 km.",
    "Error of known objects, increase by the search (%)": "Increase by the search: that of this "
    "mean over that of the survey that stops searching.",
    "Hours to catalog": "Hours to catalog: median time from the first detection of an object to "
    "its confirmed orbit.",
    "Characterized orbits": "Characterized orbits: those with enough detections of sufficiently "
    "small noise.",
    "Spin period determined (%)": "Spin period determined: share of the characterized orbits.",
    "Half width of that interval (%)": "True spin period within its interval, and half width: of "
    "the determined periods.",
    "True area times albedo within (%)": "True amplitude and area times albedo within: share of "
    "the characterized orbits whose 95 % interval contains the true value.",
}
"""Explanation of a column, by its title."""


def _surveys(study: str, tables: Tables) -> dict[str, str]:
    """Quality of the catalog of every survey, by days."""
    rows, there = [], {*tables[study]["quantity"]}
    columns = {title: each for title, each in _QUANTITIES.items() if each[0] in there}
    for (label, day), own in tables[study].groupby(["label", "day"], sort=False):
        found = own.set_index("quantity")
        rows.append([
            label, f"{day:g}", int(own["seeds"].max()),
            *(stated(found, *column) for column in columns.values()),
        ])  # fmt: skip
    terms = " ".join(_TERMS[title] for title in columns if title in _TERMS)
    table = markdown_table(["Survey", "Days", "Realizations", *columns], rows)
    return {"table": table, "terms": terms}


CATALOG_BLOCKS: dict[str, dict[str, Callable[[Tables], dict[str, str]]]] = {
    study: {study: partial(_surveys, study)} for study in STUDIES
}
"""What makes each block, by study and name."""
