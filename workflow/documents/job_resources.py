"""Resources requested from a cluster: memory and time of each rule, from a campaign's benchmarks.

    python -m workflow.documents.job_resources [--results results]

reads the largest memory and the longest time of each rule's jobs from ``results/benchmarks``,
writes them to ``profiles/slurm/measured.csv``, and requests twice the memory and four times the
time in ``profiles/slurm/config.yaml``, because other nodes may be slower or busy.
"""

import argparse
import math
import sys
from pathlib import Path

import pandas as pd

from cislunar.errors import CislunarError
from cislunar.runtime.netcdf import write_text

from .markdown import replace_between
from .run_times import job_times

MEMORY_FACTOR, TIME_FACTOR = 2.0, 4.0
MEMORY_STEP_MB, TIME_STEP_MIN = 250, 5
"""Requests are rounded up to multiples of these."""

BEGIN, END = "# begin: from measured.csv\n", "# end: from measured.csv\n"

LIKE = {"tracking_realization": "tracking_cell_variant"}
"""Rules that a campaign may lack, each with a rule whose jobs are at least as large."""

_ALIKE = {other: rule for rule, other in LIKE.items()}


def measured_resources(benchmarks: str | Path) -> pd.DataFrame:
    """Largest memory and longest time of the jobs of each rule, from ``results/benchmarks``.

    Columns rule, jobs, largest_mb, longest_s.
    """
    measured = (
        job_times(benchmarks)
        .groupby("rule")
        .agg(jobs=("job", "size"), largest_mb=("megabytes", "max"), longest_s=("seconds", "max"))
    )
    return measured.reset_index().round(1)


def requested(measured: pd.DataFrame) -> str:
    """The part of the profile that requests the measured resources, in YAML."""
    lines = ["set-resources:"]
    alike = measured[measured["rule"].isin(LIKE.values())].replace({"rule": _ALIKE})
    for row in pd.concat([measured, alike]).itertuples():
        memory = math.ceil(MEMORY_FACTOR * row.largest_mb / MEMORY_STEP_MB) * MEMORY_STEP_MB
        minutes = math.ceil(TIME_FACTOR * row.longest_s / 60.0 / TIME_STEP_MIN) * TIME_STEP_MIN
        lines += [f"  {row.rule}:", f"    mem_mb: {memory}", f"    runtime: {minutes}"]
    return "\n".join(lines) + "\n"


def with_requests(profile: str, measured: pd.DataFrame) -> str:
    """The text of the profile with new requests; it must have the lines around them."""
    return replace_between(profile, BEGIN, END, requested(measured), "the profile")


def main(arguments: list[str] | None = None) -> int:
    """The command: update ``profiles/slurm`` here; exit code 1 if something is missing."""
    parser = argparse.ArgumentParser(prog="python -m workflow.documents.job_resources")
    parser.add_argument("--results", default="results", help="results folder")
    chosen = parser.parse_args(arguments)
    folder = Path("profiles/slurm")
    try:
        measured = measured_resources(Path(chosen.results) / "benchmarks")
        profile = (folder / "config.yaml").read_text(encoding="utf-8")
        write_text(with_requests(profile, measured), folder / "config.yaml")
        write_text(measured.to_csv(index=False), folder / "measured.csv")
    except (CislunarError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
