"""The table of what the CR3BP costs, from the study ``config/dynamics.yaml``."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from cislunar.campaign.documents.markdown import markdown_table
from cislunar.errors import InputFileError

STUDY = "dynamics"
"""Name of the study's table in ``docs/tables``."""

SWEEPS = ("apogee", "perigee", "batch", "one-gaussian")
"""Sweeps of the study, whose tables the block is made from."""

_PAIRS = {
    "cr3bp": "CR3BP, CR3BP",
    "real": "real, real",
    "real-cr3bp": "real, CR3BP",
    "real-cr3bp-noise": "real, CR3BP with q = 3·10⁻⁵ m²/s³",
    "real-no-light": "real, without radiation",
    "real-no-light-noise": "real, without radiation, q = 10⁻¹⁰ m²/s³",
    "real-light-20": "real, radiation 20 % too strong",
}
"""What is true and what is believed, by the end of a value's name."""

_ESTIMATORS = {"mukf": "filter", "batch": "batch"}

SHOWN = {
    "position coverage": ("coverage", "position", "1", ".3f"),
    "velocity coverage": ("coverage", "velocity", "1", ".3f"),
    "ANEES of position": ("anees_mean", "position", "1", ".3g"),
    "of velocity": ("anees_mean", "velocity", "1", ".3g"),
    "RMSE, km": ("rmse_median", "position", "km", ".3g"),
    "orbits inconsistent": ("inconsistent_translation", "", "1", ".1f"),
    "attitude coverage": ("coverage", "attitude", "1", ".3f"),
    "rotation inconsistent": ("inconsistent_rotation", "", "1", ".1f"),
}
"""Quantity, part, unit and form of each column of numbers."""

_KEYS = ["value", "estimator", "targets"]


def study_table(results: str | Path) -> pd.DataFrame:
    """The shown quantities of every cell of a finished study, from its folder of results."""
    found = []
    for name in SWEEPS:
        path = Path(results) / f"tables/sweep_{name}.csv"
        if not path.is_file():
            raise InputFileError(
                f"{path}: no such table; run the study first, with --configfile "
                "config/dynamics.yaml"
            )
        found.append(pd.read_csv(path))
    table = pd.concat(found, ignore_index=True)
    shown = {(quantity, part, unit) for quantity, part, unit, _ in SHOWN.values()}
    keys = zip(table["quantity"], table["part"].fillna(""), table["unit"], strict=True)
    return table[[key in shown for key in keys]][[*_KEYS, "quantity", "part", "unit", "mean"]]


def dynamics_section(tables: Mapping[str, pd.DataFrame]) -> str:
    """The section of the page of results; empty without the study's table."""
    if STUDY not in tables:
        return ""
    return (
        "## What the CR3BP costs\n\n"
        "The paper, and all above, moves targets by the CR3BP and lets estimators believe in it. "
        "Here targets move among Earth, Moon and Sun where they are, and observers fly paths "
        "refined there ([dynamics.md](dynamics.md) derives it): cells of the published "
        "architecture of scenario A, tasking every hour, means over realizations. Each row has "
        "what moves targets, and what is believed.\n\n" + dynamics_block(tables)
    )


def dynamics_block(tables: Mapping[str, pd.DataFrame]) -> str:
    """Pairs of truth and belief by estimator and number of targets."""
    table = tables[STUDY].fillna({"part": ""})
    rows = []
    for (value, estimator, targets), own in table.groupby(_KEYS, sort=False):
        means = own.set_index(["quantity", "part", "unit"])["mean"]
        numbers = [f"{means[tuple(key)]:{form}}" for *key, form in SHOWN.values()]
        rows.append([*_told(value), _ESTIMATORS.get(estimator, estimator), targets, *numbers])
    header = ["Moon near", "truth, belief", "estimator", "targets", *SHOWN]
    return markdown_table(header, rows)


def _told(value: str) -> tuple[str, str]:
    """Epoch, and truth and belief."""
    pair = value
    for prefix in ("batch-", "one-gaussian-", "perigee-"):
        pair = pair.removeprefix(prefix)
    single = ", one Gaussian" if value.startswith("one-gaussian-") else ""
    return "perigee" if "perigee" in value else "apogee", _PAIRS[pair] + single
