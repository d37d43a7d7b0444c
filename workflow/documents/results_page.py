"""The page of results: every number and claim of the paper beside this library's."""

import json
import textwrap
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import pandas as pd
import xarray as xr
import yaml

from cislunar.figures.labels import estimator_label

from .claims.judges import (
    BEYOND,
    CALIBRATED,
    COULD_FAIL,
    INPUT,
    NOT_REPRODUCED,
    PARTLY,
    REPRODUCED,
    VERDICTS,
)
from .columns import COLUMNS, Tables, by_cell, only_shown, shown
from .markdown import DASH, fill_blocks, markdown_table, render

STRIP = "images/verdicts.svg"
"""The diagram of the verdicts, in the folder of the documents."""

_OWN = "Further comparisons"


def results_page(tables: Tables, datasets: Iterable[xr.Dataset], config: Mapping[str, Any]) -> str:
    """The page of results, from the tables ``paper_vs_ours``, ``architecture`` and ``tracking``.

    The attributes of the data sets give version, revision and seed.
    """
    attributes = [dataset.attrs for dataset in datasets]

    def origin(key: str, otherwise: str = "") -> str:
        found = [str(each[key]) for each in attributes if str(each.get(key, ""))]
        return ", ".join(dict.fromkeys(found)) or otherwise

    page = render(
        "results-page.md",
        source=origin("source"),
        revision=origin("git_revision", "unknown"),
        seed=origin("seed", "none"),
        settings=yaml.safe_dump(json.loads(json.dumps(config)), sort_keys=True, width=100),
    )
    makers = {name: partial(block, name, make, tables) for name, make in RESULTS_BLOCKS.items()}
    return fill_blocks(page, makers, "docs/results.md")


def block(name: str, make: Callable[[Tables], Mapping[str, Any]], tables: Tables) -> str:
    """The text of a block: the values that are made from tables, in the block's template."""
    paragraphs = render(f"{name}.md", **make(tables)).strip("\n").split("\n\n")
    return "\n\n".join(map(_wrapped, paragraphs)) + "\n"


def _wrapped(text: str) -> str:
    """A paragraph in lines of up to 120 characters; a table, heading or picture as it is."""
    if text.lstrip().startswith(("|", "#", "<", "!")):
        return text
    return textwrap.fill(" ".join(text.split()), 120, break_on_hyphens=False)


def _verdicts(tables: Tables) -> dict[str, Any]:
    """How many claims of the paper got which verdict."""
    claims = tables["paper_vs_ours"].fillna("")
    counts = claims["verdict"].value_counts()
    predicted = claims["rule"].str.contains("prediction interval")
    return {"counts": {verdict: counts.get(verdict, 0) for verdict in VERDICTS},
            "total": counts.reindex(COULD_FAIL, fill_value=0).sum(),
            "predicted": (predicted & (claims["verdict"] == REPRODUCED)).sum()}  # fmt: skip


def _results(tables: Tables) -> dict[str, Any]:
    """Verdicts, claims, architectures and every cell of tracking."""
    claims = tables["paper_vs_ours"].fillna("-")
    places = {where: claims[claims["where"] == where] for where in _places(claims)}
    return {
        "counts": verdict_counts(claims),
        "sections": [
            {"heading": _heading(where), "claims": _claims_table(own, _SHORT),
             "details": _claims_table(own, _IN_FULL)}
            for where, own in places.items()
        ],
        "architectures": architecture_list(tables["architecture"]),
        "tracking": tracking_list(tables["tracking"]),
    }  # fmt: skip


def _places(claims: pd.DataFrame) -> list[str]:
    """Places in the paper in order; claims without one come last."""
    return sorted(claims["where"].unique(), key=lambda where: (where == "-", where))


def _heading(where: str) -> str:
    return _OWN if where == "-" else where[0].upper() + where[1:]


def verdict_counts(claims: pd.DataFrame) -> str:
    """How often each verdict was reached: a row for each place in the paper, then the sum."""
    counts = pd.crosstab(claims["where"], claims["verdict"]).reindex(
        index=_places(claims), columns=list(VERDICTS), fill_value=0
    )
    rows = [[_OWN if where == "-" else where, *row] for where, row in counts.iterrows()]
    return markdown_table(["Place in the paper", *VERDICTS], [*rows, ["all", *counts.sum(axis=0)]])


COLORS = {
    REPRODUCED: "#0072B2",
    PARTLY: "#E69F00",
    NOT_REPRODUCED: "#D55E00",
    INPUT: "#56B4E9",
    CALIBRATED: "#CC79A7",
    BEYOND: "#BBBBBB",
}
"""Colors of the verdicts, distinguishable by the color-blind too."""


def verdicts_svg(claims: pd.DataFrame) -> str:
    """The diagram of the verdicts: a square for each claim, a row for each place in the paper.

    A square shows its claim and verdict when pointed at.
    """
    claims = claims.fillna("-")
    counts = claims["verdict"].value_counts()
    legend, x = [], 8
    for verdict in VERDICTS:
        text = f"{verdict} ({counts.get(verdict, 0)})"
        legend.append({"x": x, "text": text, "color": COLORS[verdict]})
        x += 42 + 7 * len(text)
    rows = [
        (_heading(where), [
            (f"{row.claim}: {row.verdict}", COLORS[row.verdict])
            for row in claims[claims["where"] == where].itertuples()
        ])
        for where in _places(claims)
    ]  # fmt: skip
    width = max(x, *(208 + 18 * len(squares) for _, squares in rows))
    return render("verdicts.svg", legend=legend, rows=rows, width=width)


_SHORT = {"claim": "Number or claim", "paper": "Paper", "value": "This library",
          "verdict": "Verdict"}  # fmt: skip
_IN_FULL = {"claim": "Number or claim", "result": "Result in full",
            "rule": "Statistic and rule of comparison", "budget": "Search budget"}  # fmt: skip
"""Columns of the table of claims, and of that of their results in full."""


def _claims_table(claims: pd.DataFrame, columns: Mapping[str, str]) -> str:
    """A line for each claim."""
    rows = claims[list(columns)].replace("-", DASH)
    return markdown_table(list(columns.values()), rows.itertuples(index=False))


def architecture_list(architecture: pd.DataFrame) -> str:
    """Every architecture in a line, from ``tables/architecture.csv``."""
    rows = []
    for (scenario, optimizer), slots in architecture.groupby(["scenario", "optimizer"], sort=False):
        families = slots.groupby("family", sort=False)["satellites"].agg(list)
        chosen = ", ".join(f"{f} ({'+'.join(map(str, n))})" for f, n in families.items())
        whole = slots.iloc[0]
        rows.append(
            [
                scenario,
                optimizer,
                whole["total_satellites"],
                f"{whole['J']:.4e}",
                f"{whole['union_coverage']:.1%}",
                whole["never_seen"],
                chosen.replace("_", " "),
            ]
        )
    header = ["Scenario", "Architecture", "Satellites", "J", "Target-hours covered",
              "Targets never covered", "Families (satellites on each orbit)"]  # fmt: skip
    return markdown_table(header, rows)


LISTED = COLUMNS["listed"]
CELL = ["scenario", "architecture", "estimator", "targets", "interval_minutes"]


def shown_quantities(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of ``tracking.csv`` or ``readings_tracking.csv`` that the documents show."""
    return only_shown(table, LISTED.values())


def tracking_list(tracking: pd.DataFrame) -> str:
    """Every cell at the usual settings in a line, from ``tables/tracking.csv``."""
    cells = by_cell(tracking, [*CELL, "variant"])
    rows = [
        [scenario, architecture, estimator_label(estimator), targets, minutes]
        + [shown(cell, column) for column in LISTED.values()]
        for (scenario, architecture, estimator, targets, minutes, variant), cell in cells.items()
        if not variant
    ]
    header = ["Scenario", "Architecture", "Estimator", "Targets", "Tasking interval (min)"]
    return markdown_table([*header, *LISTED], rows)


RESULTS_BLOCKS = {"verdicts": _verdicts, "results": _results}
"""What makes the values of each block of the page, by the block's name."""
