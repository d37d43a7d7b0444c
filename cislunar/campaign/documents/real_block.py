"""The tables of both pipelines in the real world, from the study ``config/real.yaml``."""

import re
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from cislunar.campaign.documents.markdown import DASH, markdown_table
from cislunar.campaign.documents.studies import only_shown, read_study
from cislunar.campaign.tracking.statistics import Interval

STUDY = "real"
"""Name of the study's table in ``docs/tables``, and of its figure in ``docs/images``."""

FIGURE = f"images/{STUDY}.png"
"""The figure, relative to ``docs``."""

_FROM_ROOT = f"docs/{FIGURE}"

_LEGEND = """`information, batch` is ours; `published, mukf, paper` the paper's as printed,
`paper-ephemeris` with a filter that knows where the bodies are, and `published, mukf` with our
tasking and mixtures besides."""

NOT_RUN = "The study has not been run yet.\n"

_OURS, _PAPER = ("information", "batch", ""), ("published", "mukf", "paper")
_OURS_FOR_A_WEEK = ("information", "batch", "week")
_PAPER_EPHEMERIS = ("published", "mukf", "paper-ephemeris")

_BY_NUMBER = {
    _OURS: "ours",
    _PAPER_EPHEMERIS: "the paper's, filter of the ephemeris",
    _PAPER: "the paper's as printed",
}
_PARTS = {
    _OURS: "ours",
    ("published", "batch", ""): "ours, the paper's satellites",
    ("information", "mukf", ""): "ours, attitudes by the paper's filter",
    ("information", "batch", "without-unknowns"): "ours, bodies taken for known",
    ("information", "batch", "without-learning"): "ours, detection not learned",
    ("information", "batch", "without-slots"): "ours, no slots",
    ("information", "batch", "without-both"): "ours, the paper's tasking",
    ("information", "batch", "without-mixtures"): "ours, one Gaussian for each orbit",
    ("information", "batch", "without-noise"): "ours, no process noise",
    ("information", "batch", "without-ephemeris"): "ours, filter of the CR3BP",
    ("information", "batch", "without-credit"): "ours, looks under way not credited",
    _PAPER: "the paper's as printed",
    _PAPER_EPHEMERIS: "the paper's, filter of the ephemeris",
    ("information", "mukf", "with-orbits"): "and our satellites",
    ("published", "mukf", "with-tasking"): "and our tasking",
    ("published", "mukf", "with-mixtures"): "and mixtures for orbits",
    ("published", "batch", "with-batch"): "and batch estimates of attitudes and bodies",
    ("published", "mukf", ""): "and our tasking and mixtures",
}
"""Ways of working: names of designs without their number, estimator and variant."""

_LENGTHS = {
    _OURS: "ours, a day",
    _OURS_FOR_A_WEEK: "ours, seven days",
    _PAPER_EPHEMERIS: "the paper's, filter of the ephemeris, a day",
    ("published", "mukf", "week-paper"): "the same, seven days",
}

SHOWN = {
    "in custody, %": ("custody_share", "", "1", 100.0, ".0f"),
    "position, km": ("final_error_geometric_all", "position", "km", 1.0, ".3g"),
    "attitude, degree": ("final_error_geometric_all", "attitude", "degree", 1.0, ".3g"),
    "never observed": ("never_observed", "", "1", 1.0, ".1f"),
    "of them visible": ("missed", "", "1", 1.0, ".1f"),
    "coverage of attitude": ("coverage", "attitude", "1", 1.0, ".3f"),
    "of position": ("coverage", "position", "1", 1.0, ".3f"),
    "of velocity": ("coverage", "velocity", "1", 1.0, ".3f"),
    "ANEES of attitude": ("anees_mean", "attitude", "1", 1.0, ".3g"),
    "of position ": ("anees_mean", "position", "1", 1.0, ".3g"),
    "of velocity ": ("anees_mean", "velocity", "1", 1.0, ".3g"),
}
"""Quantity, part, unit, factor and form of each column of numbers."""

_WITH_INTERVAL = 5
"""The first columns have their intervals."""

_KEYS = ["architecture", "estimator", "variant", "observers", "targets"]


def study_table(results: str | Path) -> pd.DataFrame:
    """The shown quantities of a finished study, from its folder of results."""
    kept = [*_KEYS, "quantity", "part", "unit", "mean", "low", "high", "seeds"]
    return only_shown(read_study(STUDY, results, "pooled"), SHOWN.values())[kept]


def _ways(table: pd.DataFrame) -> pd.DataFrame:
    """The table with the way of working of each row."""
    table = table.fillna({"part": "", "variant": ""})
    stem = [re.sub(r"-?\d+$", "", name) for name in table["architecture"]]
    way = list(zip(stem, table["estimator"], table["variant"], strict=True))
    return table.assign(way=way)


def _interval(rows: pd.DataFrame, column: str) -> tuple[Interval, str]:
    """A quantity of a cell, and how it is written."""
    quantity, part, unit, factor, form = SHOWN[column]
    own = rows[
        (rows["quantity"] == quantity) & (rows["part"] == part) & (rows["unit"] == unit)
    ].iloc[0]
    mean, low, high = (factor * own[key] for key in ("mean", "low", "high"))
    return Interval(mean, low, high, int(own["seeds"])), form


def _numbers(rows: pd.DataFrame) -> list[str]:
    """What a row of a table shows of a cell."""
    found = []
    for place, column in enumerate(SHOWN):
        interval, form = _interval(rows, column)
        found.append(f"{interval if place < _WITH_INTERVAL else interval.mean:{form}}")
    return found


def _block(tables: Mapping[str, pd.DataFrame], ways: Mapping[tuple, str], targets: list) -> str:
    """Cells of some ways of working, by number of targets, way and number of satellites."""
    if STUDY not in tables:
        return NOT_RUN
    table = _ways(tables[STUDY])
    rows = []
    for count in targets or sorted(table["targets"].unique()):
        for way, told in ways.items():
            here = (table["targets"] == count) & (table["way"].map(way.__eq__))
            for observers, own in table[here].groupby("observers"):
                rows.append([count, told, observers, *_numbers(own)])
    return markdown_table(["targets", "pipeline", "satellites", *SHOWN], rows)


def number_block(tables: Mapping[str, pd.DataFrame]) -> str:
    """Both pipelines by number of targets and of satellites."""
    return _block(tables, _BY_NUMBER, [])


def _of_twenty(tables: Mapping[str, pd.DataFrame], ways: Mapping[tuple, str], count: int) -> str:
    """Some ways of working of twenty satellites, for a number of targets."""
    if STUDY not in tables:
        return NOT_RUN
    twenty = tables[STUDY][tables[STUDY]["observers"] == 20]
    return _block({STUDY: twenty}, ways, [count])


def parts_block(tables: Mapping[str, pd.DataFrame]) -> str:
    """One part left out of ours, or added to the paper's: 100 targets."""
    return _of_twenty(tables, _PARTS, 100)


def lengths_block(tables: Mapping[str, pd.DataFrame]) -> str:
    """A day and seven days of either pipeline: 50 targets."""
    return _of_twenty(tables, _LENGTHS, 50)


def headline_block(tables: Mapping[str, pd.DataFrame], figure: str = _FROM_ROOT) -> str:
    """The figure, and twenty satellites of ours beside the paper's 43 at 100 targets."""
    if STUDY not in tables:
        return ""
    table = _ways(tables[STUDY])
    told = []
    for way, observers in ((_OURS, 20), (_PAPER_EPHEMERIS, 43), (_PAPER, 43)):
        here = (table["targets"] == 100) & (table["observers"] == observers)
        own = table[here & table["way"].map(way.__eq__)]
        told.append([f"{_BY_NUMBER[way]}, {observers} satellites", *_numbers(own)[:_WITH_INTERVAL]])
    return (
        f"![Custody and errors against the number of satellites]({figure})\n\n"
        + _LEGEND
        + "\n\nAt 100 targets, means with 95 % intervals over days and realizations:\n\n"
        + markdown_table(["pipeline", *list(SHOWN)[:_WITH_INTERVAL]], told)
    )


_AIM = {"custody_share": True, "final_error_geometric_all": False}
"""What ours is to do as well with fewer satellites, and whether more of it is better."""

_MOST_MISSED, _LEAST_COVERAGE, _ANEES = 1.0, 0.97, (0.8, 1.5)
"""What is asked of every cell of ours."""


def verdict_block(tables: Mapping[str, pd.DataFrame]) -> str:
    """What was aimed at, and whether it came out: intervals decide, those of every cell of ours."""
    if STUDY not in tables:
        return NOT_RUN
    table = _ways(tables[STUDY])
    rows = [_against(table, column) for column in SHOWN if _aimed(column) is not None]
    ours = table[table["way"].isin([_OURS, _OURS_FOR_A_WEEK])]
    for asked, quantity, within in (
        (f"at most {_MOST_MISSED:g} missed that could be seen", "missed", (-1.0, _MOST_MISSED)),
        (f"coverage from {_LEAST_COVERAGE:g}", "coverage", (_LEAST_COVERAGE, 2.0)),
        (f"ANEES within {_ANEES[0]:g} and {_ANEES[1]:g}", "anees_mean", _ANEES),
    ):
        own = ours[ours["quantity"] == quantity]
        outside = own[~own["mean"].between(*within)]
        span = f"{own['mean'].min():.3g} to {own['mean'].max():.3g}"
        cells = [
            f"{part or 'targets'} {mean:.3g} ({observers} satellites, {targets} targets"
            f"{', seven days' if way == _OURS_FOR_A_WEEK else ''})"
            for part, mean, observers, targets, way in outside[
                ["part", "mean", "observers", "targets", "way"]
            ].itertuples(index=False)
        ]
        verdict = "yes" if not cells else "not in " + "; ".join(cells)
        rows.append([f"every cell of ours: {asked}", span, DASH, verdict])
    return markdown_table(["asked", "ours", "the paper's", "came out"], rows)


def _aimed(column: str) -> bool | None:
    """Whether more of a column is better; None for one that was not aimed at."""
    return _AIM.get(SHOWN[column][0])


def _against(table: pd.DataFrame, column: str) -> list[str]:
    """Twenty satellites of ours beside the paper's 43 in a column."""
    both = []
    for way, observers in ((_OURS, 20), (_PAPER_EPHEMERIS, 43)):
        here = (table["targets"] == 100) & (table["observers"] == observers)
        both.append(_interval(table[here & table["way"].map(way.__eq__)], column))
    (ours, form), (paper, _) = both
    better, worse = (ours, paper) if _aimed(column) else (paper, ours)
    if better.low > worse.high:
        verdict = "better: intervals are apart"
    else:
        verdict = "not worse: intervals overlap" if better.high >= worse.low else "worse"
    asked = f"20 of ours do at least what 43 of the paper's do, 100 targets: {column}"
    return [asked, f"{ours:{form}}", f"{paper:{form}}", verdict]


REAL_BLOCKS = {
    "real-verdict": verdict_block,
    "real-number": number_block,
    "real-parts": parts_block,
    "real-lengths": lengths_block,
    "real-headline": headline_block,
    "real-figure": lambda tables: headline_block(tables, FIGURE),
}
"""What makes each block of the study, by the name in its opening line."""
