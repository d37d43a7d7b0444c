"""The table of surveys without a catalog, from the study ``config/catalog.yaml``."""

from pathlib import Path

import numpy as np
import pandas as pd

from .columns import Tables
from .markdown import DASH, markdown_table
from .studies import read_study

STUDY = "catalog"
"""Name of the study's table in ``docs/tables``, and of its figure in ``docs/images``."""

_QUANTITIES = {
    "Findable": ("findable", "{:.0f}", 1.0),
    "Linked of findable (%)": ("linked_share", "{:.1f}", 100.0),
    "Right of findable (%)": ("completeness", "{:.1f}", 100.0),
    "inside of the families (%)": ("completeness_inside", "{:.1f}", 100.0),
    "outside (%)": ("completeness_outside", "{:.1f}", 100.0),
    "Right orbits": ("right", "{:.0f}", 1.0),
    "Duplicates": ("duplicate", "{:.1f}", 1.0),
    "Wrong of confirmed (%)": ("wrong_share", "{:.2f}", 100.0),
    "Purity (%)": ("purity", "{:.2f}", 100.0),
    "NEES": ("nees", "{:.2f}", 1.0),
    "Hours to catalog": ("hours_to_catalog", "{:.1f}", 1.0),
}
"""Columns: quantity, format and factor."""


def study_table(results: str | Path) -> pd.DataFrame:
    """The table of a finished study, from its folder of results."""
    return read_study(STUDY, results, STUDY)


def _surveys(tables: Tables) -> dict[str, str]:
    """Quality of the catalog of every survey, by days."""
    rows = []
    for (name, day), own in tables[STUDY].groupby(["survey", "day"], sort=False):
        found = own.set_index("quantity")
        rows.append([
            name.replace("-", " "), f"{day:g}", int(own["seeds"].max()),
            *(_number(found, *column) for column in _QUANTITIES.values()),
        ])  # fmt: skip
    return {"table": markdown_table(["Survey", "Days", "Realizations", *_QUANTITIES], rows)}


def _number(found: pd.DataFrame, quantity: str, form: str, factor: float) -> str:
    """A mean with its interval."""
    if quantity not in found.index:
        return DASH
    mean, low, high = factor * found.loc[quantity, ["mean", "low", "high"]].to_numpy(dtype=float)
    if not np.isfinite(low):
        return form.format(mean)
    return f"{form.format(mean)} [{form.format(max(low, 0.0))}, {form.format(high)}]"


CATALOG_BLOCKS = {STUDY: _surveys}
"""What makes each block of the study, by name."""
