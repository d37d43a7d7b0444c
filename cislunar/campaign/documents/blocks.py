"""The generated blocks of README and docs: each a piece of Markdown made from tables."""

from collections.abc import Callable, Mapping, Sequence

import pandas as pd

from cislunar.campaign.documents.estimator_blocks import AWARE, ESTIMATOR_BLOCKS
from cislunar.campaign.documents.markdown import DASH, markdown_table
from cislunar.campaign.documents.objectives_block import OBJECTIVE_BLOCKS
from cislunar.campaign.documents.real_block import REAL_BLOCKS
from cislunar.campaign.documents.results_page import (
    LISTED,
    Tables,
    architecture_list,
    quantity_rows,
    results_body,
    verdicts_sentence,
)
from cislunar.campaign.documents.studies import STUDY_BLOCKS
from cislunar.campaign.readings.photometry import BRIGHTER, RANGE, RETURNED
from cislunar.campaign.tracking.statistics import certain

_FILES = (
    ("fig. 1, facet geometry", "figures/fig01_facet_geometry.png", ()),
    ("fig. 2, orbit library and targets", "figures/fig02_orbit_library.png",
     ("ephemeris", "orbit library", "static targets")),
    ("fig. 3, orbits chosen by TPE", "figures/fig03_tpe_orbits.png",
     ("visibility", "searches by TPE")),
    ("fig. 4, orbits chosen by random search", "figures/fig04_random_orbits.png",
     ("searches at random",)),
    ("table 2, architectures", "tables/architecture.csv",
     ("proofs of the optimum", "published architectures", "table of architectures")),
    ("figs. 5 to 8, tracking", "figures/fig05_target_counts.png", ("cells of tracking",)),
    ("every number and claim, with a verdict", "tables/paper_vs_ours.csv",
     ("comparisons of tasking",)),
    ("all of it in space, interactive", "figures/orbits_3d.html", ()),
)  # fmt: skip
"""What the README lists: figure or table, file, and the kinds of jobs it needs besides those of
the lines above it."""

_CORES = 2


def _clock(seconds: float) -> str:
    return "seconds" if seconds < 45.0 else f"{max(1, round(seconds / 60.0))} min"


def files_block(tables: Tables) -> str:
    """Figures and tables of the paper with their files and the time each takes."""
    times = tables["run_times"].set_index("jobs")

    def time(kinds: Sequence[str]) -> str:
        needed = times.reindex(kinds).dropna(how="all")
        if needed.empty:
            return _clock(0.0)
        return _clock(max(needed["longest_s"].max(), needed["total_s"].sum() / _CORES))

    return markdown_table(
        ["figure or table of the paper", "file in `results/`", "time"],
        [(name, f"`{path}`", time(kinds)) for name, path, kinds in _FILES],
    )


def times_block(tables: Tables) -> str:
    """Jobs by kind with their times and memory."""
    rows = [
        (row.jobs, row.count, _clock(row.total_s), f"{row.median_s:.1f}", f"{row.longest_s:.1f}",
         f"{row.largest_mb:.0f}")
        for row in tables["run_times"].itertuples(index=False)
    ]  # fmt: skip
    return markdown_table(
        ["jobs", "number", "time in all", "median, s", "longest, s", "memory, MB"], rows
    )


def readings_architecture_block(tables: Tables) -> str:
    """J under each reading of the paper."""
    return markdown_table(
        ["reading", "published", "random", "best"],
        [
            (
                row.reading,
                DASH if pd.isna(row.J_published) else f"{row.J_published:.3e}",
                f"{row.J_random:.2e}",
                f"{row.J_coordinate_search:.3e}",
            )
            for row in tables["readings_architecture"].itertuples(index=False)
        ],
    )


def labels_block(tables: Tables) -> str:
    """J of TPE by the way orbits are labelled."""
    found = tables["label_comparison"].groupby("labels", sort=True)["J"]
    return markdown_table(
        ["labels", "runs", "median J", "smallest", "largest"],
        [
            (f"`{name}`", len(J), f"{J.median():.2e}", f"{J.min():.2e}", f"{J.max():.2e}")
            for name, J in found
        ],
    )


_READING_COLUMNS = tuple(
    name
    for name, (quantity, *_) in LISTED.items()
    if not quantity.startswith(
        ("anees", "bound_ratio", "final_attitude_error_90", "final_coverage")
    )
)


def readings_tracking_block(tables: Tables) -> str:
    """What each changed setting does to tracking.

    An asterisk marks a difference that is sure, with all of the block judged together.
    """
    readings = tables["readings_tracking"]
    # what the estimators make of a wrong model, and of attitude in the tasking, is told elsewhere
    elsewhere = {*AWARE, *tables["model_error"]["variant"].dropna()}
    readings = readings[
        (readings["estimator"] == readings["estimator"].iloc[0])
        & ~readings["variant"].isin(elsewhere)
    ].reset_index(drop=True)
    shown = [quantity_rows(readings, name) for name in _READING_COLUMNS]
    places = pd.concat(shown).dropna(subset=["changed"])
    sure = certain(places["difference"], places["low"], places["high"], places["seeds"])
    readings = readings.assign(sure=pd.Series(sure, index=places.index))
    parts = []
    places = ["scenario", "architecture", "estimator", "interval_minutes"]
    groups = list(readings.groupby(places, sort=False))
    for place, rows in groups:
        if len(groups) > 1:
            parts.append("Scenario {}, {}, {}, tasking every {} min:\n".format(*place))
        parts.append(_readings_of_one(rows))
    return "\n".join(parts)


def _readings_of_one(rows: pd.DataFrame) -> str:
    usual: dict[tuple, str] = {}
    changed: dict[tuple, str] = {}
    for name in _READING_COLUMNS:
        form = LISTED[name][3]
        for row in quantity_rows(rows, name).itertuples():
            sure = "*" if row.sure is True else ""
            usual.setdefault((row.targets, name), f"{row.usual:{form}}")
            if not pd.isna(row.changed):
                changed[row.variant, row.targets, name] = f"{row.changed:{form}}{sure}"
    lines = [
        ["as configured", count, *(usual.get((count, name), DASH) for name in _READING_COLUMNS)]
        for count in sorted(rows["targets"].unique())
    ]
    lines += [
        [f"`{key[0]}`", key[1], *(changed.get((*key, name), DASH) for name in _READING_COLUMNS)]
        for key in dict.fromkeys(zip(rows["variant"], rows["targets"], strict=True))
    ]
    return markdown_table(["variant", "targets", *_READING_COLUMNS], lines)


def _photometry(tables: Tables, quantity: str) -> pd.DataFrame:
    table = tables["photometry"]
    chosen = table[table["quantity"] == quantity]
    return chosen.pivot_table(index="angle_deg", columns="model", values="value", sort=False)


def photometry_block(tables: Tables) -> str:
    """Ranges at the limiting magnitude, and the two Fresnel terms, by phase angle."""
    ranges = _photometry(tables, RANGE)
    brighter = _photometry(tables, BRIGHTER)["printed"]
    return markdown_table(
        ["phase angle", *ranges.columns, "printed Fresnel term brighter by"],
        [
            (f"{angle:g}°", *(f"{value:.0f}" for value in row), f"{brighter[angle]:.2f} mag")
            for angle, row in zip(ranges.index, ranges.to_numpy(), strict=True)
        ],
    )


def returned_light_block(tables: Tables) -> str:
    """One sentence: how much of its light a facet of the configured material returns."""
    share = _photometry(tables, RETURNED)["sqrt"]
    return (
        f"With the configured material a facet returns {share.min():.2f} to {share.max():.2f} of "
        f"what it receives, for angles of incidence from {share.index.min():g}° to "
        f"{share.index.max():g}°."
    )


BLOCKS: Mapping[str, Callable[[Tables], str]] = {
    "verdicts": lambda tables: verdicts_sentence(tables["paper_vs_ours"]),
    "results": results_body,
    "architectures": lambda tables: architecture_list(tables["architecture"]),
    "files": files_block,
    "times": times_block,
    "readings-architecture": readings_architecture_block,
    "labels": labels_block,
    "readings-tracking": readings_tracking_block,
    "photometry": photometry_block,
    "returned-light": returned_light_block,
    **STUDY_BLOCKS,
    **OBJECTIVE_BLOCKS,
    **REAL_BLOCKS,
    **ESTIMATOR_BLOCKS,
}
"""What makes each block, by the name in its opening line."""
