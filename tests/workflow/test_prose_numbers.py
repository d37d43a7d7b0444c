"""Intervals in the sentences of the documents are those of the tables."""

import re

import numpy as np
import pandas as pd
from campaign_folder import ROOT

NUMBER = r"[-+]?\d[\d,]*(?:\.\d+)?"
INTERVAL = re.compile(rf"({NUMBER})(?:\s+%)?\s+\[({NUMBER}),\s+({NUMBER})\]")

RATIOS = {
    "README.md": {"1.15 [1.02, 1.30]", "1.54 [1.35, 1.75]", "2.2 [0.6, 3.8]"},
    "real.md": {
        "1.15 [1.02, 1.30]", "1.18 [1.05, 1.33]", "0.16 [0.13, 0.20]", "0.60 [0.53, 0.67]",
        "0.57 [0.52, 0.63]", "16 [10, 22]", "5 [2, 8]", "1.09 [1.01, 1.18]", "1.08 [1.02, 1.15]",
        "1.19 [1.12, 1.27]", "1.03 [0.94, 1.12]", "1.02 [0.97, 1.07]", "1.01 [0.97, 1.05]",
        "1.06 [1.00, 1.13]", "1.24 [1.13, 1.37]", "1.36 [1.17, 1.59]", "1.9 [0.5, 3.3]",
        "2.2 [0.6, 3.8]", "1.54 [1.35, 1.75]", "10.5 [2.3, 18.7]",
        "39.5 [31.3, 47.7]", "1.05 [1.00, 1.10]",
    },
    "catalog.md": {"151 [146, 156]"},
}  # fmt: skip
"""Intervals of ratios of pairs of realizations, and of one timed run, which no table contains."""


def sentences(text):
    """A page without its tables."""
    return "\n".join(line for line in text.split("\n") if not line.startswith("|"))


def intervals_of_tables():
    """Means with their limits (n, 3) of all tables."""
    found = []
    for path in sorted((ROOT / "docs/tables").glob("*.csv")):
        table = pd.read_csv(path)
        middle = "mean" if "mean" in table else "value"
        if {middle, "low", "high"} <= set(table):
            each = table[[middle, "low", "high"]].apply(pd.to_numeric, errors="coerce").to_numpy()
            found.append(each[np.isfinite(each).all(axis=1)])
    return np.concatenate(found)


def is_of_a_table(given, tables):
    """Whether rounded numbers are a mean and its limits, as a share, in percent, or without the
    sign of a difference."""
    value = np.array([float(each.replace(",", "")) for each in given])
    unit = np.array([10.0 ** -len(each.partition(".")[2]) for each in given])
    return any(
        np.any(np.all(np.abs(each - value) <= 0.501 * unit, axis=1))
        for each in (tables, 100.0 * tables, -tables[:, [0, 2, 1]])
    )


def test_intervals_in_sentences_are_those_of_the_tables():
    tables = intervals_of_tables()
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        other = {
            " ".join(match.group().split()).replace(" %", "")
            for match in INTERVAL.finditer(sentences(path.read_text(encoding="utf-8")))
            if not is_of_a_table(match.groups(), tables)
        }
        assert other <= RATIOS.get(path.name, set()), path.name


def test_a_changed_interval_is_found():
    tables = np.array([[0.914, 0.887, 0.942], [-119.6, -130.2, -109.1]])
    assert is_of_a_table(("91", "89", "94"), tables)
    assert is_of_a_table(("120", "109", "130"), tables)
    assert not is_of_a_table(("92", "89", "94"), tables)
