"""Columns of numbers: which quantity of a cell of the campaign a table shows, and how."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import yaml

from cislunar.evaluation.intervals import Interval

from .markdown import DASH

Tables = Mapping[str, pd.DataFrame]
Cell = Mapping[tuple[str, str, str], Mapping[str, Any]]
"""Rows of a table that belong to one cell, by quantity, part and unit."""

_MEASURE = ["quantity", "part", "unit"]
_LABELS = ("part", "variant", "estimator", "also", "error")
"""Columns of text that may be empty."""


class Column(NamedTuple):
    """A quantity with its part and unit, the format of its numbers, and what multiplies them.

    `of` is the statistic that is shown, and `interval` says whether the confidence interval stands
    beside it.
    """

    quantity: str
    part: str
    unit: str
    form: str
    factor: float = 1.0
    of: str = "mean"
    interval: bool = False

    @property
    def measure(self) -> tuple[str, str, str]:
        """Quantity, part and unit: what identifies a row of a cell."""
        return self.quantity, self.part, self.unit


def _columns(columns: Mapping[str, list], interval: int | str) -> dict[str, Column]:
    count = len(columns) if interval == "all" else interval
    found = {title: Column(*values) for title, values in columns.items()}
    return {
        title: column._replace(interval=k < count and column.of in ("mean", "value"))
        for k, (title, column) in enumerate(found.items())
    }


COLUMNS = {
    name: _columns(**table)
    for name, table in yaml.safe_load(
        Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
    ).items()
}
"""Columns of each kind of table by their titles, from ``columns.yaml``."""


def with_text(table: pd.DataFrame) -> pd.DataFrame:
    """A table as read from CSV, with empty text where a label is missing."""
    labels = dict.fromkeys((name for name in _LABELS if name in table), "")
    return table.astype(dict.fromkeys(labels, object)).fillna(labels)


def only_shown(table: pd.DataFrame, shown: Iterable[Column]) -> pd.DataFrame:
    """The rows of the quantities shown."""
    measures = table[_MEASURE].astype(object).fillna("").astype(str)
    wanted = {column.measure for column in shown}
    return table[[tuple(row) in wanted for row in measures.itertuples(index=False)]]


def by_cell(table: pd.DataFrame, keys: list[str]) -> dict[tuple, Cell]:
    """The rows of each cell, cells in the order of the table and named by their labels."""
    found: dict[tuple, dict] = {}
    for row in with_text(table).to_dict("records"):
        cell = found.setdefault(tuple(row[key] for key in keys), {})
        cell[row["quantity"], row.get("part", ""), str(row.get("unit", "1"))] = row
    return found


def shown(cell: Cell, column: Column, of: str | None = None) -> str:
    """A number of a cell, the statistic `of` or else that of the column, with its interval if the
    column has one; a dash if there is none."""
    row, of = cell.get(column.measure), of or column.of
    if row is None or not math.isfinite(row[of]):
        return DASH
    ends = (row["low"], row["high"]) if column.interval and math.isfinite(row["low"]) else ()
    values = [column.factor * value for value in (row[of], *ends)]
    return f"{Interval(*values, *[None] * (2 - len(ends)), 1 + bool(ends)):{column.form}}"


def numbers(cell: Cell, columns: Iterable[Column]) -> list[str]:
    """The numbers of a cell in some columns."""
    return [shown(cell, column) for column in columns]
