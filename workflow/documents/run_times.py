"""Times and memory of the jobs of a campaign, from Snakemake's benchmark files."""

from pathlib import Path

import pandas as pd

from cislunar.errors import InputFileError

KINDS = {
    "ephemeris": "ephemeris(_of_scenario)?",
    "orbit library": "families",
    "moving targets": "(own_)?tracked_targets",
    "static targets": "zvs_points(_of_scenario)?|(own_)?static_targets",
    "visibility": "visibility",
    "searches by TPE": "search_run/tpe",
    "searches at random": "search_run/random",
    "proofs of the optimum": "exact",
    "published architectures": "published",
    "fronts": "front",
    "table of architectures": "architecture_table",
    "readings of the paper": "readings",
    "cells of tracking": r"tracking_cell_\w+",
    "comparisons of tasking": "tasking_comparison_cell",
    "figures": r"\w+_figure|orbits_page",
}
"""Kinds of jobs: a pattern of the rules, or of a part of a rule, whose jobs they are."""

COLUMNS = {
    "count": ("seconds", "size"),
    "total_s": ("seconds", "sum"),
    "median_s": ("seconds", "median"),
    "longest_s": ("seconds", "max"),
    "largest_mb": ("megabytes", "max"),
}
"""Columns of the table after the kind of jobs: measured quantity, and how it is aggregated."""


def job_times(folder: str | Path) -> pd.DataFrame:
    """Time and memory of every job in ``results/benchmarks``; an `InputFileError` if there is none.

    Columns rule (the first folder of the job's path), job (path without suffix), seconds (wall
    clock), megabytes (largest resident set).
    """
    rows = []
    for path in sorted(Path(folder).rglob("*.tsv")):
        table = pd.read_csv(path, sep="\t", na_values="-")
        job = path.relative_to(folder).with_suffix("")
        seconds, megabytes = float(table["s"].mean()), float(table["max_rss"].max())
        rows.append((job.parts[0], job.as_posix(), seconds, megabytes))
    if not rows:
        raise InputFileError(f"{folder}: no benchmark of any job; run the campaign first")
    return pd.DataFrame(rows, columns=["rule", "job", "seconds", "megabytes"])


def run_times(folder: str | Path) -> pd.DataFrame:
    """Times of the jobs by kind, and of all, from ``results/benchmarks``.

    This is ``docs/tables/run_times.csv``: number, total, median and longest wall-clock time in s,
    largest memory in MB.
    """
    times = job_times(folder).assign(jobs="others")
    for kind, rules in KINDS.items():
        times.loc[times["job"].str.match(f"(?:{rules})(?:/|$)"), "jobs"] = kind
    everything = pd.concat([times, times.assign(jobs="all")])
    table = everything.groupby("jobs").agg(**COLUMNS)
    order = [kind for kind in (*KINDS, "others", "all") if kind in table.index]
    return table.loc[order].reset_index().round(1)
