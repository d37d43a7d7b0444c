"""Times and memory of the jobs of a campaign, from Snakemake's benchmark files."""

from pathlib import Path

import numpy as np
import pandas as pd

from cislunar.errors import InputFileError

COLUMNS = ["jobs", "count", "total_s", "median_s", "longest_s", "largest_mb"]


def job_times(folder: str | Path) -> pd.DataFrame:
    """Time and memory of every job.

    Parameters
    ----------
    folder : str or Path
        ``results/benchmarks``.

    Returns
    -------
    DataFrame
        Columns job (path without suffix), seconds (wall clock), megabytes (largest resident set).

    Raises
    ------
    InputFileError
        If there is no benchmark.
    """
    rows = []
    for path in sorted(Path(folder).rglob("*.tsv")):
        table = pd.read_csv(path, sep="\t", na_values="-")
        name = path.relative_to(folder).with_suffix("").as_posix()
        rows.append((name, float(table["s"].mean()), float(table["max_rss"].max())))
    if not rows:
        raise InputFileError(f"{folder}: no benchmark of any job; run the campaign first")
    return pd.DataFrame(rows, columns=["job", "seconds", "megabytes"])


KINDS = {
    "ephemeris": "ephemeris/",
    "orbit library": "orbits/families",
    "moving targets": "orbits/tracked",
    "static targets": "targets/",
    "visibility": "visibility/",
    "searches by TPE": r"architecture/[^/]+/tpe_",
    "searches at random": r"architecture/[^/]+/random_",
    "proofs of the optimum": r"architecture/[^/]+/exact$",
    "published architectures": r"architecture/[^/]+/published$",
    "fronts": r"architecture/[^/]+/front$",
    "table of architectures": "tables/architecture$",
    "readings of the paper": "tables/readings_architecture$",
    "cells of tracking": r"task2/[^/]+/[^/]+/[^/]+/nt",
    "comparisons of tasking": "task2/tasking/",
    "figures": "figures/",
}
"""Groups of jobs: what their benchmark's path begins with."""


def run_times(folder: str | Path) -> pd.DataFrame:
    """Times of the jobs by kind: ``docs/tables/run_times.csv``.

    Parameters
    ----------
    folder : str or Path
        ``results/benchmarks``.

    Returns
    -------
    DataFrame
        For each kind of job and for all of them: number, total, median and longest wall-clock
        time in s, largest memory in MB.
    """
    jobs = job_times(folder)
    groups = {kind: jobs[jobs["job"].str.match(begin)] for kind, begin in KINDS.items()}
    taken = np.logical_or.reduce([jobs["job"].str.match(begin) for begin in KINDS.values()])
    groups |= {"others": jobs[~taken], "all": jobs}
    rows = [
        (
            kind,
            len(found),
            found["seconds"].sum(),
            found["seconds"].median(),
            found["seconds"].max(),
            found["megabytes"].max(),
        )
        for kind, found in groups.items()
        if len(found)
    ]
    return pd.DataFrame(rows, columns=COLUMNS).round(1)
