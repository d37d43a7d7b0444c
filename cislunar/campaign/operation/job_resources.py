"""What a cluster is asked for: memory and time of each rule, from the benchmarks of a campaign.

    python -m cislunar.campaign.operation.job_resources [--results results]

takes the largest memory and the longest time of each rule's jobs from ``results/benchmarks``,
writes them to ``profiles/slurm/measured.csv``, and puts twice the memory and four times the time
(other nodes are slower, and may be busy) into ``profiles/slurm/config.yaml``.
"""

import argparse
import math
import re
import sys
from pathlib import Path

import pandas as pd

from cislunar.campaign.data.netcdf import write_text
from cislunar.campaign.operation.run_times import job_times
from cislunar.errors import CislunarError, InputFileError

MEMORY_FACTOR, TIME_FACTOR = 2.0, 4.0
MEMORY_STEP_MB, TIME_STEP_MIN = 250, 5
"""Requests are rounded up to multiples of these."""

BEGIN, END = "# begin: from measured.csv\n", "# end: from measured.csv\n"

_RULE = re.compile(r"^(?:use rule (\w+) as (\w+) with|rule (\w+)):$", re.MULTILINE)
_BENCHMARK = re.compile(r'benchmark_of\("([^"]+)"\)')


def benchmark_patterns(rules: str | Path) -> dict[str, str]:
    """Which benchmark files belong to which rule.

    Parameters
    ----------
    rules : str or Path
        Folder of the rules.

    Returns
    -------
    dict of str to str
        Regular expression of the path without ending, by rule; rules that are used under another
        name lend it their benchmark. Rules without one are left out.
    """
    found: dict[str, str] = {}
    for path in sorted(Path(rules).glob("*.smk")):
        text = path.read_text(encoding="utf-8")
        heads = list(_RULE.finditer(text))
        ends = [*(head.start() for head in heads[1:]), len(text)]
        for head, end in zip(heads, ends, strict=False):
            base, new, plain = head.groups()
            name = plain or new
            own = _BENCHMARK.search(text, head.end(), end)
            if own:
                found[name] = _expression(own[1])
            elif base in found:
                found[name] = found[base]
    return found


def _expression(pattern: str) -> str:
    """Regular expression of a path with wildcards."""
    numbers = {"n", "minutes", "run"}
    parts = re.split(r"\{(\w+)\}", pattern)
    for i in range(1, len(parts), 2):
        parts[i] = r"\d+" if parts[i] in numbers else "[^/]+"
    for i in range(0, len(parts), 2):
        parts[i] = re.escape(parts[i])
    return "".join(parts)


def measured_resources(benchmarks: str | Path, rules: str | Path) -> pd.DataFrame:
    """Largest memory and longest time of the jobs of each rule.

    Parameters
    ----------
    benchmarks : str or Path
        ``results/benchmarks``.
    rules : str or Path
        Folder of the rules.

    Returns
    -------
    DataFrame
        Columns rule, jobs, largest_mb, longest_s; rules without a job are left out.
    """
    jobs = job_times(benchmarks)
    rows = []
    for rule, expression in benchmark_patterns(rules).items():
        own = jobs[jobs["job"].str.fullmatch(expression)]
        if len(own):
            rows.append((rule, len(own), own["megabytes"].max(), own["seconds"].max()))
    table = pd.DataFrame(rows, columns=["rule", "jobs", "largest_mb", "longest_s"])
    return table.sort_values("rule").round(1)


def requested(measured: pd.DataFrame) -> str:
    """The part of the profile that asks for them.

    Parameters
    ----------
    measured : DataFrame
        Of `measured_resources`.

    Returns
    -------
    str
        YAML.
    """
    lines = ["set-resources:"]
    for row in measured.itertuples():
        memory = math.ceil(MEMORY_FACTOR * row.largest_mb / MEMORY_STEP_MB) * MEMORY_STEP_MB
        minutes = math.ceil(TIME_FACTOR * row.longest_s / 60.0 / TIME_STEP_MIN) * TIME_STEP_MIN
        lines += [f"  {row.rule}:", f"    mem_mb: {memory}", f"    runtime: {minutes}"]
    return "\n".join(lines) + "\n"


def with_requests(profile: str, measured: pd.DataFrame) -> str:
    """The profile with its requests made anew.

    Parameters
    ----------
    profile : str
        Its text.
    measured : DataFrame
        Of `measured_resources`.

    Returns
    -------
    str

    Raises
    ------
    InputFileError
        If the lines that enclose the requests are missing.
    """
    if BEGIN not in profile or END not in profile:
        raise InputFileError(f"the profile lacks the line {BEGIN.strip()!r} or {END.strip()!r}")
    before, after = profile.split(BEGIN)[0], profile.split(END)[1]
    return before + BEGIN + requested(measured) + END + after


def main(arguments: list[str] | None = None) -> int:
    """Renew the requests of ``profiles/slurm`` in the current folder.

    Parameters
    ----------
    arguments : list of str, optional
        Of the command line.

    Returns
    -------
    int
        0, or 1 if something is missing.
    """
    parser = argparse.ArgumentParser(prog="python -m cislunar.campaign.operation.job_resources")
    parser.add_argument("--results", default="results", help="results folder")
    chosen = parser.parse_args(arguments)
    folder = Path("profiles/slurm")
    try:
        measured = measured_resources(Path(chosen.results) / "benchmarks", "workflow/rules")
        profile = (folder / "config.yaml").read_text(encoding="utf-8")
        write_text(with_requests(profile, measured), folder / "config.yaml")
        write_text(measured.to_csv(index=False), folder / "measured.csv")
    except (CislunarError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
