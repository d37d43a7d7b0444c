"""Labels in words for what the campaign names by identifiers: those of the figures, and more."""

from pathlib import Path

import yaml

from cislunar.figures import labels

_MORE = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))

DYNAMICS, ORBIT_LABELS = _MORE["dynamics"], _MORE["orbit_labels"]
_VALUES = labels.VALUES | _MORE["values"]

OBJECTIVES = {
    column: labels.OBJECTIVES[name]
    for column, name in (
        ("information_nat", "information"),
        ("attitude_nat", "attitude"),
        ("J", "J"),
        ("union_coverage", "coverage"),
        ("target_days", "target-days"),
    )
}
"""Objectives by their column in ``tables/objective_ranks.csv``."""

RECOMMENDED, PAPER = ("information", "batch", ""), ("published", "mukf", "paper")
PAPER_EPHEMERIS = ("published", "mukf", "paper-ephemeris")
PAPER_STRONGEST = ("published", "mukf", "filter-strongest")
PAPER_BATCH = ("published", "batch", "with-batch")
RECOMMENDED_WEEK, PAPER_WEEK = ("information", "batch", "week"), ("published", "mukf", "week-paper")


def label(name: str) -> str:
    """A variant or value in words with its name; of a truth with estimated parameters, both."""
    words = _VALUES.get(name)
    truth, joint, more = name.partition("-joint")
    if words is None and joint and truth in _VALUES:
        words = f"{_VALUES[truth]}; {_VALUES['joint' + more]}"
    if not name or words is None:
        return words or f"`{name}`"
    return f"{words} (`{name}`)"
