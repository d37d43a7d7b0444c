"""Scores of the references of the benchmark, from the folders of ``cislunar benchmark score``."""

from pathlib import Path

import pandas as pd

from cislunar.errors import InputFileError

from .columns import Tables
from .markdown import DASH, markdown_table

STUDY = "benchmark"
"""Name of the table in ``docs/tables``, and of its folder of results."""

_REFERENCES = [
    (size, method)
    for size in ("small", "medium")
    for method in ("survey-catalog", "nearest-neighbor")
]
"""Scores of the page, from left to right: size of the benchmark and reference."""

_ROWS = (
    ("objects, findable", "{objects:.0f}, {findable:.0f}"),
    ("catalog objects, assigned", "{catalog:.0f}, {assigned:.0f}"),
    ("completeness (%)", "{completeness:.0%}"),
    ("completeness outside of the families (%)", "{completeness_outside:.0%}"),
    ("completeness of objects that maneuver (%)", "{completeness_maneuvering:.0%}"),
    ("custody at 10 km (%)", "{custody:.0%}"),
    ("GOSPA distance (km)", "{gospa_km:.0f}"),
    ("GOSPA part by localization (km²)", "{gospa_localization_km2:,.0f}"),
    ("GOSPA part by missed objects (km²)", "{gospa_missed_km2:,.0f}"),
    ("GOSPA part by false objects (km²)", "{gospa_false_km2:,.0f}"),
    (
        "position error, median and 95th percentile (km)",
        "{position_median_km:.2g}, {position_95_km:.2g}",
    ),
    (
        "velocity error, median and 95th percentile (m/s)",
        "{velocity_median_m_s:.2g}, {velocity_95_m_s:.2g}",
    ),
    ("NEES divided by six", "{anees:.3g}"),
    ("NEES divided by six, without maneuvers", "{anees_ballistic:.3g}"),
    ("purity", "{purity:.3g}"),
    ("catalog objects for each object that has one", "{fragments:.2f}"),
    ("latency, median (h)", "{latency_median_h:.1f}"),
)
"""Rows of the page from top to bottom, with their format."""


def study_table(results: str | Path) -> pd.DataFrame:
    """The last row of every score, from ``RESULTS/SIZE/REFERENCE/score.csv``."""
    found = []
    for size, method in _REFERENCES:
        path = Path(results) / size / method / "score.csv"
        if not path.is_file():
            raise InputFileError(f"{path}: no such score; make it as docs/benchmark.md describes")
        last = pd.read_csv(path).iloc[[-1]]
        found.append(last.assign(size=size, reference=method))
    return pd.concat(found, ignore_index=True)


def _scores(tables: Tables) -> dict[str, str]:
    """Scores at the last epoch, a column for each reference."""
    table = tables[STUDY].set_index(["size", "reference"])
    header = ["Score at the last epoch", *(f"`{size}`, `{method}`" for size, method in _REFERENCES)]
    rows = [
        [title, *(_stated(table.loc[each].to_dict(), form) for each in _REFERENCES)]
        for title, form in _ROWS
    ]
    return {"table": markdown_table(header, rows)}


def _stated(score: dict[str, float], form: str) -> str:
    return form.format(**score).replace("nan", DASH).replace("%", "")


BENCHMARK_BLOCKS = {"benchmark": _scores}
"""What makes each block, by name."""
