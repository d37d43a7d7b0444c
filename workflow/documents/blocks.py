"""The generated blocks of the documents: each a template with values made from tables."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import pandas as pd

from cislunar.campaign.readings.photometry import BRIGHTER, RANGE, RETURNED
from cislunar.campaign.tracking.comparisons import certain

from . import (
    association_block,
    benchmark_block,
    catalog_block,
    maneuver_block,
    objectives_block,
    real_block,
)
from .columns import COLUMNS, Tables, by_cell, shown
from .estimator_blocks import AWARE, ESTIMATOR_BLOCKS
from .labels import ORBIT_LABELS, label
from .markdown import DASH, markdown_table
from .results_page import CELL, RESULTS_BLOCKS, architecture_list, block
from .studies import DYNAMICS, STUDY_BLOCKS

NOT_RUN = "The study has not been run yet.\n"

_FILES = (
    ("Figure 1, facet geometry", "figures/fig01_facet_geometry.png", ()),
    ("Figure 2, orbit library and targets", "figures/fig02_orbit_library.png",
     ("ephemeris", "orbit library", "static targets")),
    ("Figure 3, orbits chosen by TPE", "figures/fig03_tpe_orbits.png",
     ("visibility", "searches by TPE")),
    ("Figure 4, orbits chosen by random search", "figures/fig04_random_orbits.png",
     ("searches at random",)),
    ("Table 2, architectures", "tables/architecture.csv",
     ("proofs of the optimum", "published architectures", "table of architectures")),
    ("Figure 5, consistency and errors of every target by the number of targets, with the cells "
     "beyond the paper",
     "figures/fig05_target_counts.png", ("cells of tracking",)),
    ("Figure 6, errors of selected targets over time",
     "figures/fig06_selected_targets.png", ()),
    ("Figure 6, errors of selected targets by component",
     "figures/fig06_components.png", ()),
    ("Figure 7, consistency and errors of every target by the tasking interval",
     "figures/fig07_intervals.png", ()),
    ("Figure 8, consistency and errors of more targets than observers by the tasking interval",
     "figures/fig08_intervals_high_load.png", ()),
    ("Figure 8, errors of a representative target over time",
     "figures/fig08_representative_target.png", ()),
    ("Every number and claim, with a verdict", "tables/paper/paper_vs_ours.csv",
     ("comparisons of tasking",)),
)  # fmt: skip
"""Figure or table, file, and the kinds of jobs it needs besides those of the lines above it."""

_CORES = 2

Values = dict[str, Any]


def _clock(seconds: float) -> str:
    return "seconds" if seconds < 45.0 else f"{max(1, round(seconds / 60.0))} min"


def _files(tables: Tables) -> Values:
    """Figures and tables of the paper with their files and the time that each takes."""
    times = tables["run_times"].set_index("jobs")

    def time(kinds: Sequence[str]) -> str:
        needed = times.reindex(kinds).dropna(how="all")
        if needed.empty:
            return _clock(0.0)
        return _clock(max(needed["longest_s"].max(), needed["total_s"].sum() / _CORES))

    rows = [(name, f"`{path}`", time(kinds)) for name, path, kinds in _FILES]
    return {"table": markdown_table(["Figure or table", "File in `results/`", "Time"], rows)}


def _times(tables: Tables) -> Values:
    """Jobs by kind with their times and memory."""
    rows = [
        (row.jobs, row.count, _clock(row.total_s), f"{row.median_s:.1f}", f"{row.longest_s:.1f}",
         f"{row.largest_mb:.0f}")
        for row in tables["run_times"].itertuples(index=False)
    ]  # fmt: skip
    header = ["Jobs", "Number", "Total time", "Median (s)", "Longest (s)", "Memory (MB)"]
    return {"table": markdown_table(header, rows)}


def _readings_architecture(tables: Tables) -> Values:
    """J under each reading of the paper."""
    rows = [
        (row.reading, DASH if pd.isna(row.J_published) else f"{row.J_published:.3e}",
         f"{row.J_random:.2e}", f"{row.J_coordinate_search:.3e}")
        for row in tables["readings_architecture"].itertuples(index=False)
    ]  # fmt: skip
    header = ["Reading", "J, paper's families", "J, best random architecture"]
    return {"table": markdown_table([*header, "J, coordinate search"], rows)}


def _labels(tables: Tables) -> Values:
    """J of TPE by the labels of the orbits."""
    rows = [
        (f"{ORBIT_LABELS.get(name, name)} (`{name}`)", len(J), f"{J.median():.2e}",
         f"{J.min():.2e}", f"{J.max():.2e}")
        for name, J in tables["label_comparison"].groupby("labels", sort=True)["J"]
    ]  # fmt: skip
    header = ["Label of an orbit", "Runs", "Median J", "Smallest J", "Largest J"]
    return {"table": markdown_table(header, rows)}


_READ = COLUMNS["readings"]


def _readings_tracking(tables: Tables) -> Values:
    """What each changed setting does to tracking.

    An asterisk marks a difference that is significant, with all of the block judged together.
    """
    readings = tables["readings_tracking"]
    # wrong models and tasking by all states have tables of their own
    others = {*AWARE, *tables["model_error"]["variant"].dropna()}
    readings = readings[
        (readings["estimator"] == readings["estimator"].iloc[0]) & ~readings["variant"].isin(others)
    ]
    measures = {column.measure for column in _READ.values()}
    cells = by_cell(readings, [*CELL, "variant"])
    judged = [
        row
        for cell in cells.values()
        for measure, row in cell.items()
        if measure in measures and not pd.isna(row["changed"])
    ]
    columns = ([row[key] for row in judged] for key in ("difference", "low", "high", "seeds"))
    for row, significant in zip(judged, certain(*columns), strict=True):
        row["mark"] = "*" if significant else ""
    parts: dict[str, list] = {}
    for (scenario, architecture, _, targets, minutes, variant), cell in cells.items():
        place = f"Scenario {scenario}, {architecture}, tasking every {minutes} min:"
        usual = [
            "default settings",
            targets,
            *(shown(cell, each, "usual") for each in _READ.values()),
        ]
        changed = [
            shown(cell, each, "changed") + cell.get(each.measure, {}).get("mark", "")
            for each in _READ.values()
        ]
        parts.setdefault(place, []).append((usual, [label(variant), targets, *changed]))
    return {"tables": {place: _with_usual(lines) for place, lines in parts.items()}}


def _with_usual(lines: Sequence[tuple[list, list]]) -> str:
    """A table of changed settings that begins with the default ones, once for each number."""
    usual = {line[1]: line for line, _ in reversed(lines)}
    rows = [*(usual[count] for count in sorted(usual)), *(changed for _, changed in lines)]
    return markdown_table(["Setting", "Targets", *_READ], rows)


def _photometry(tables: Tables, quantity: str) -> pd.DataFrame:
    table = tables["photometry"]
    chosen = table[table["quantity"] == quantity]
    return chosen.pivot_table(index="angle_deg", columns="model", values="value", sort=False)


def _ranges(tables: Tables) -> Values:
    """Ranges at the limiting magnitude, and the two Fresnel terms, by phase angle."""
    ranges = _photometry(tables, RANGE)
    brighter = _photometry(tables, BRIGHTER)["printed"]
    rows = [
        (f"{angle:g}", *(f"{value:.0f}" for value in row), f"{brighter[angle]:.2f}")
        for angle, row in zip(ranges.index, ranges.to_numpy(), strict=True)
    ]
    header = ["Phase angle (deg)", *(f"Range, {model} (1000 km)" for model in ranges.columns)]
    header.append("Printed Fresnel term brighter by (mag)")
    return {"table": markdown_table(header, rows)}


def _returned(tables: Tables) -> Values:
    """How much of its light a facet of the configured material returns."""
    share = _photometry(tables, RETURNED)["sqrt"]
    return {"share": share, "angle": share.index}


_NEEDED = {
    real_block.STUDY: "by_day",
    objectives_block.STUDY: "days",
    association_block.STUDY: "largest",
    **dict.fromkeys(catalog_block.STUDIES, "largest"),
    DYNAMICS: "largest",
    "tracking": "average",
}
"""A column that tables of earlier versions lack. Their means of ANEES were geometric over
realizations, and the realizations of a day counted as independent."""


def outdated_tables(tables: Tables) -> list[str]:
    """Tables of earlier versions, which cannot fill the blocks that rest on them."""
    return [
        name for name, column in _NEEDED.items() if name in tables and column not in tables[name]
    ]


def _text(
    name: str, make: Callable[[Tables], Values], study: str | None, tables: Tables
) -> str | None:
    """The text of a block, which may need a study that has not been run; None if its table is of an
    earlier version, so that the block stays as it is."""
    if study is not None and study not in tables:
        return "" if name.endswith("-headline") else NOT_RUN
    if (study or ("tracking" if name == "results" else "")) in outdated_tables(tables):
        return None
    return block(name, make, tables)


_MAKERS = {
    None: RESULTS_BLOCKS
    | ESTIMATOR_BLOCKS
    | {
        "architectures": lambda tables: {"table": architecture_list(tables["architecture"])},
        "files": _files,
        "times": _times,
        "readings-architecture": _readings_architecture,
        "labels": _labels,
        "readings-tracking": _readings_tracking,
        "photometry": _ranges,
        "returned-light": _returned,
    },
    objectives_block.STUDY: objectives_block.OBJECTIVE_BLOCKS,
    real_block.STUDY: real_block.REAL_BLOCKS,
    association_block.STUDY: association_block.ASSOCIATION_BLOCKS,
    maneuver_block.STUDY: maneuver_block.MANEUVER_BLOCKS,
    benchmark_block.STUDY: benchmark_block.BENCHMARK_BLOCKS,
    **catalog_block.CATALOG_BLOCKS,
    **STUDY_BLOCKS,
}

BLOCKS: Mapping[str, Callable[[Tables], str | None]] = {
    name: partial(_text, name, make, study)
    for study, makers in _MAKERS.items()
    for name, make in makers.items()
}
"""What makes each block, by the name in its opening line."""
