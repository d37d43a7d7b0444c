"""The tables of the pipelines under ephemeris dynamics, from the study ``config/real.yaml``."""

import re
from collections.abc import Callable, Iterable
from pathlib import Path

import pandas as pd

from cislunar.figures.labels import PIPELINES

from .columns import COLUMNS, Cell, Tables, by_cell, numbers, only_shown, shown
from .labels import (
    PAPER,
    PAPER_EPHEMERIS,
    PAPER_WEEK,
    RECOMMENDED,
    RECOMMENDED_WEEK,
)
from .markdown import DASH, markdown_table
from .studies import read_study

STUDY = "real"
"""Name of the study's table in ``docs/tables``, and of its figure in ``docs/images``."""

SHOWN = COLUMNS[STUDY]
_HEADLINE = dict(list(SHOWN.items())[:5])

_SATELLITES = ["Satellites", "Realizations"]
_KEYS = ["architecture", "estimator", "variant", "observers", "targets"]
Cells = dict[tuple[tuple[str, str, str], int, int], Cell]


def study_table(results: str | Path) -> pd.DataFrame:
    """The quantities shown of a finished study, from its folder of results."""
    kept = [*_KEYS, "quantity", "part", "unit", "mean", "low", "high", "seeds"]
    return only_shown(read_study(STUDY, results, "pooled"), SHOWN.values())[kept]


def _cells(tables: Tables) -> Cells:
    """Cells by pipeline, number of satellites and number of targets."""
    return {
        ((re.sub(r"-?\d+$", "", name), *rest), observers, targets): cell
        for (name, *rest, observers, targets), cell in by_cell(tables[STUDY], _KEYS).items()
    }


def _row(cell: Cell, columns: Iterable[str] = SHOWN) -> list[object]:
    """Number of realizations and some numbers of a cell."""
    seeds = next(iter(cell.values()))["seeds"]
    return [seeds, *numbers(cell, (SHOWN[name] for name in columns))]


def _number(tables: Tables) -> dict[str, str]:
    """The three pipelines by number of targets and of satellites."""
    cells, ways = _cells(tables), (RECOMMENDED, PAPER_EPHEMERIS, PAPER)
    places = sorted((targets, ways.index(way), n) for way, n, targets in cells if way in ways)
    rows = [
        [targets, PIPELINES[ways[k]], n, *_row(cells[ways[k], n, targets])]
        for targets, k, n in places
    ]
    return {"table": markdown_table(["Targets", "Pipeline", *_SATELLITES, *SHOWN], rows)}


def _parts(tables: Tables) -> dict[str, str]:
    """One part removed from the recommended pipeline, or added to the paper's."""
    cells = _cells(tables)
    rows = [
        [name, *_row(cells[way, 20, 100])]
        for way, name in PIPELINES.items()
        if (way, 20, 100) in cells
    ]
    return {"table": markdown_table(["Pipeline", "Realizations", *SHOWN], rows)}


def _lengths(tables: Tables) -> dict[str, str]:
    """One day and seven days of either pipeline."""
    cells = _cells(tables)
    rows = [
        [PIPELINES[way], days, *_row(cells[way, 20, 50])]
        for way, days in ((RECOMMENDED, 1), (RECOMMENDED_WEEK, 7), (PAPER_EPHEMERIS, 1),
                          (PAPER_WEEK, 7))
        if (way, 20, 50) in cells
    ]  # fmt: skip
    return {"table": markdown_table(["Pipeline", "Days", "Realizations", *SHOWN], rows)}


_COMPARED = ((RECOMMENDED, 20), (PAPER_EPHEMERIS, 43), (PAPER, 43))
"""Pipelines and numbers of satellites of the headline."""


def _headline(columns: Iterable[str]) -> Callable[[Tables], dict[str, str]]:
    """Twenty satellites of the recommended pipeline beside the paper's 43, at 100 targets."""
    columns = list(columns)

    def values(tables: Tables) -> dict[str, str]:
        cells = _cells(tables)
        rows = [
            [f"{PIPELINES[way]}, {n} satellites", *_row(cells[way, n, 100], columns)[1:]]
            for way, n in _COMPARED
            if (way, n, 100) in cells
        ]
        return {"table": markdown_table(["Pipeline", *columns], rows)}

    return values


_AIMS = {"custody_share": True, "final_error_geometric_all": False}
"""Quantities in which the pipelines are compared, and whether a larger value is better."""

_LIMITS = {
    "missed": ("at most 1 target never observed but observable", (-1.0, 1.0)),
    "coverage": ("3-sigma coverage of at least 0.97", (0.97, 2.0)),
    "anees_mean": ("ANEES between 0.8 and 1.5", (0.8, 1.5)),
}
"""What every cell of the recommended pipeline is to satisfy."""


def _verdict(tables: Tables) -> dict[str, str]:
    """Requirements on the recommended pipeline, and whether they are met."""
    cells = _cells(tables)
    rows = [
        _against(*(cells[way, n, 100] for way, n in _COMPARED[:2]), title)
        for title, column in _HEADLINE.items()
        if column.quantity in _AIMS
    ]
    own = {at: cell for at, cell in cells.items() if at[0] in (RECOMMENDED, RECOMMENDED_WEEK)}
    for quantity, (requirement, (least, most)) in _LIMITS.items():
        found = [
            (row["mean"], row["part"], way, n, targets)
            for (way, n, targets), cell in own.items()
            for row in cell.values()
            if row["quantity"] == quantity
        ]
        if not found:
            continue
        outside = "; ".join(
            f"{part or 'targets'} {mean:.3g} ({n} satellites, {targets} targets"
            f"{', seven days' if way == RECOMMENDED_WEEK else ''})"
            for mean, part, way, n, targets in found
            if not least <= mean <= most
        )
        means = [each[0] for each in found]
        span = f"{min(means):.3g} to {max(means):.3g}"
        result = f"not met: {outside}" if outside else "met"
        rows.append([f"recommended pipeline, every cell: {requirement}", span, DASH, result])
    header = ["Requirement", "Recommended pipeline", "Paper's pipeline, ephemeris filter", "Result"]
    return {"table": markdown_table(header, rows)}


def _against(own: Cell, paper: Cell, title: str) -> list[str]:
    """Twenty satellites of the recommended pipeline beside the paper's 43 in a column."""
    column = _HEADLINE[title]
    larger = _AIMS[column.quantity]
    better, worse = (each[column.measure] for each in ((own, paper) if larger else (paper, own)))
    if better["low"] > worse["high"]:
        result = "better: the intervals do not overlap"
    elif better["high"] >= worse["low"]:
        result = "no difference shown: the intervals overlap"
    else:
        result = "worse: the intervals do not overlap"
    return [f"{title}: as good with 20 as with 43 satellites, 100 targets",
            *(shown(each, column) for each in (own, paper)), result]  # fmt: skip


REAL_BLOCKS = {
    "real-verdict": _verdict,
    "real-number": _number,
    "real-parts": _parts,
    "real-lengths": _lengths,
    "real-headline": _headline(list(_HEADLINE)[:3]),
    "real-figure": _headline(_HEADLINE),
}
"""What makes the values of each block of the study, by the block's name."""
