"""The tables of the pipelines under ephemeris dynamics, from the study ``config/real.yaml``."""

import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cislunar.campaign.tracking.comparisons import non_inferiority
from cislunar.evaluation import NOMINAL_COVERAGE, Interval, contrast_interval
from cislunar.figures.labels import BODY_TRUTHS, OBSERVER_ERRORS, PIPELINES

from .columns import COLUMNS, Cell, Column, Tables, by_cell, numbers, only_shown, shown
from .labels import (
    PAPER,
    PAPER_BATCH,
    PAPER_EPHEMERIS,
    PAPER_STRONGEST,
    PAPER_WEEK,
    RECOMMENDED,
    RECOMMENDED_WEEK,
)
from .markdown import DASH, markdown_table
from .studies import read_study

STUDY = "real"
"""Name of the study's table in ``docs/tables``, and of its figure in ``docs/images``."""

SHOWN = COLUMNS[STUDY]
_BODIES, _OBSERVERS = COLUMNS["real_bodies"], COLUMNS["real_observers"]
_HEADLINE = dict(list(SHOWN.items())[:7])

_SATELLITES = ["Satellites", "Realizations"]
_KEYS = ["architecture", "estimator", "variant", "observers", "targets"]
Cells = dict[tuple[tuple[str, str, str], int, int], Cell]


def study_table(results: str | Path) -> pd.DataFrame:
    """The quantities shown of a finished study, from its folder of results."""
    kept = [*_KEYS, "quantity", "part", "unit", "mean", "low", "high", "largest", "seeds", "days"]
    kept.append("by_day")
    columns = (*SHOWN.values(), *_BODIES.values(), *_OBSERVERS.values())
    return only_shown(read_study(STUDY, results, "pooled"), columns)[kept]


def _cells(tables: Tables) -> Cells:
    """Cells by pipeline, number of satellites and number of targets."""
    return {
        ((re.sub(r"-?\d+$", "", name), *rest), observers, targets): cell
        for (name, *rest, observers, targets), cell in by_cell(tables[STUDY], _KEYS).items()
    }


def _row(cell: Cell, columns: Mapping[str, Column] = SHOWN) -> list[object]:
    """Number of realizations and some numbers of a cell."""
    seeds = max(row["seeds"] for row in cell.values())
    return [seeds, *numbers(cell, columns.values())]


def _number(tables: Tables) -> dict[str, str]:
    """The pipelines by number of targets and of satellites."""
    cells, ways = _cells(tables), (RECOMMENDED, PAPER_STRONGEST, PAPER_EPHEMERIS, PAPER)
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
        if (way, 20, 100) in cells and way[2] not in {*BODY_TRUTHS, *OBSERVER_ERRORS}
    ]
    return {"table": markdown_table(["Pipeline", "Realizations", *SHOWN], rows)}


def _bodies(tables: Tables) -> dict[str, str]:
    """Truths that differ from the assumed model of bodies, by number of targets."""
    cells = _cells(tables)
    rows = [
        [*texts, targets, *_row(cells[way, 20, targets], _BODIES)]
        for targets in (20, 100)
        for name, texts in BODY_TRUTHS.items()
        if ((way := ("information", "batch", name)), 20, targets) in cells
    ]
    header = ["Bodies", "Model", "Targets", "Realizations", *_BODIES]
    return {"table": markdown_table(header, rows)}


def _observers(tables: Tables) -> dict[str, str]:
    """Errors of observers and how they are treated."""
    cells = _cells(tables)
    named = {"": ("none", DASH)} | OBSERVER_ERRORS
    rows = [
        [*texts, *_row(cells[way, 20, 100], _OBSERVERS)]
        for name, texts in named.items()
        if ((way := ("information", "mukf", name)), 20, 100) in cells
    ]
    header = ["Errors of observers", "Treatment", "Realizations", *_OBSERVERS]
    return {"table": markdown_table(header, rows)}


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


_COMPARED = ((RECOMMENDED, 20), (PAPER_BATCH, 20), (PAPER_BATCH, 43), (PAPER_STRONGEST, 43),
             (PAPER_EPHEMERIS, 43), (PAPER, 43))  # fmt: skip
"""Pipelines and numbers of satellites of the headline."""


def _headline(columns: Mapping[str, Column]) -> Callable[[Tables], dict[str, str]]:
    """Twenty satellites of the recommended pipeline beside the paper's 43, at 100 targets."""

    def values(tables: Tables) -> dict[str, str]:
        cells = _cells(tables)
        rows = [
            [f"{PIPELINES[way]}, {n} satellites", *_row(cells[way, n, 100], columns)[1:]]
            for way, n in _COMPARED
            if (way, n, 100) in cells
        ]
        return {"table": markdown_table(["Pipeline", *columns], rows)}

    return values


class _Aim(NamedTuple):
    """How the pipelines are compared in a quantity: by the ratio of errors, or by the difference of
    shares, of which more is better. `margin` is the loss that counts as none."""

    margin: float
    ratio: bool

    def judged(self, own: np.ndarray, paper: np.ndarray) -> str:
        """Verdict and interval from the means of the days."""
        found = contrast_interval(own, paper, logarithmic=self.ratio)
        if not self.ratio:
            points = Interval(*(100.0 * end for end in found[:3]), found.count)
            return f"{non_inferiority(found, self.margin)}: {points:+.1f} percentage points"
        gain = Interval(*(-math.log(end) for end in (found.mean, found.high, found.low)), 2)
        return f"{non_inferiority(gain, math.log1p(self.margin))}: ratio {found:.3g}"

    def __str__(self) -> str:
        percent = f"{100.0 * self.margin:.0f}"
        return f"{percent} % larger" if self.ratio else f"{percent} percentage points fewer"


_SHARE, _ERROR = _Aim(0.03, ratio=False), _Aim(0.10, ratio=True)
_AIMS = {"custody_share": _SHARE, "position_custody_share": _SHARE,
         "attitude_custody_share": _SHARE, "final_error_geometric_all": _ERROR}  # fmt: skip
"""Quantities in which the pipelines are compared."""


class _Limit(NamedTuple):
    """What every cell of the recommended pipeline is to satisfy in a quantity: its mean, or the
    interval of its mean, is between two ends. `of`: what a quantity without parts is of."""

    requirement: str
    least: float
    most: float
    by_interval: bool = False
    of: str = "targets"

    def met(self, row: Mapping[str, Any]) -> bool | None:
        """Whether it is met; None where the interval contains an end."""
        found = Interval(row["mean"], row["low"], row["high"], row["days"])
        low, high = (found.floor, found.ceiling) if self.by_interval else (found.mean, found.mean)
        if self.least <= low and high <= self.most:
            return True
        return False if high < self.least or low > self.most else None


_LIMITS = {
    "missed": _Limit("at most 1 target never observed but observable", -1.0, 1.0),
    "coverage": _Limit(
        f"3-sigma coverage of at least 0.97 (nominal {NOMINAL_COVERAGE:.4f}), by the interval of "
        "its day means", 0.97, 2.0, by_interval=True),
    "anees_mean": _Limit("ANEES between 0.8 and 1.5, arithmetic mean of the days", 0.8, 1.5),
    "anees_unique": _Limit(
        "ANEES between 0.8 and 1.5 while the attitude is unique, where its status is recorded",
        0.8, 1.5, of="attitude"),
}  # fmt: skip


def _verdict(tables: Tables) -> dict[str, str]:
    """Requirements on the recommended pipeline, and whether they are met."""
    cells = _cells(tables)
    pair = (RECOMMENDED, 20, 100), (PAPER_EPHEMERIS, 43, 100)
    compared = [cells[key] for key in pair if key in cells]
    rows = [
        _against(*compared, title)
        for title, column in _HEADLINE.items()
        if column.quantity in _AIMS and len(compared) == 2
    ]
    own = {at: cell for at, cell in cells.items() if at[0] in (RECOMMENDED, RECOMMENDED_WEEK)}
    for quantity, limit in _LIMITS.items():
        found = [
            (row, limit.met(row), f"{row['part'] or limit.of} {row['mean']:.3g} ({n} satellites, "
             f"{targets} targets{', seven days' if way == RECOMMENDED_WEEK else ''})")
            for (way, n, targets), cell in own.items()
            for row in cell.values()
            if row["quantity"] == quantity and row["days"]
        ]  # fmt: skip
        if not found:
            continue
        means = [row["mean"] for row, *_ in found]
        span = f"{min(means):.3g} to {max(means):.3g}"
        if quantity.startswith("anees"):
            span += f"; worst realization {max(row['largest'] for row, *_ in found):.3g}"
        result = "; ".join(
            f"{word}: {'; '.join(where)}"
            for word, verdict in (("not met", False), ("not decided", None))
            if (where := [text for _, met, text in found if met is verdict])
        )
        requirement = f"recommended pipeline, every cell: {limit.requirement}"
        rows.append([requirement, span, DASH, result or "met"])
    header = ["Requirement", "Recommended pipeline", "Paper's pipeline, ephemeris filter", "Result"]
    return {"table": markdown_table(header, rows)}


def _against(own: Cell, paper: Cell, title: str) -> list[str]:
    """Twenty satellites of the recommended pipeline beside the paper's 43 in a column."""
    column = _HEADLINE[title]
    aim = _AIMS[column.quantity]
    days = (np.array(str(each[column.measure]["by_day"]).split(), float) for each in (own, paper))
    return [f"{title}: at most {aim} with 20 than with 43 satellites, 100 targets",
            *(shown(each, column) for each in (own, paper)), aim.judged(*days)]  # fmt: skip


REAL_BLOCKS = {
    "real-verdict": _verdict,
    "real-number": _number,
    "real-parts": _parts,
    "real-lengths": _lengths,
    "real-bodies": _bodies,
    "real-observers": _observers,
    "real-headline": _headline(dict(list(_HEADLINE.items())[:5])),
    "real-figure": _headline(_HEADLINE),
}
"""What makes the values of each block of the study, by the block's name."""
