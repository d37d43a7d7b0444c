"""Compares two results folders: ``python tests/slurm/compare.py ONE OTHER``.

Every data set must hold the same variables, values and attributes, and every table the same lines;
measured times and the revision of the sources are let differ. Figures follow from these.
"""

import re
import sys
from pathlib import Path

import xarray as xr

MEASURED = ("elapsed", "seconds", "evaluations_per_second", "git_revision")
"""Parts of names of variables and attributes that are not results: measured times, provenance."""

TIMES_IN_TEXT = re.compile(rb"; time of [^;\"]*")
"""Measured times in the lines of a table."""


def is_measured(name: object) -> bool:
    """Whether a variable or attribute is a measured time or provenance."""
    return any(part in str(name) for part in MEASURED)


def plain(dataset: xr.Dataset) -> xr.Dataset:
    """A data set without measured times and provenance."""
    kept = dataset.drop_vars([name for name in dataset.variables if is_measured(name)])
    kept.attrs = {name: value for name, value in kept.attrs.items() if not is_measured(name)}
    return kept


def differences(one: Path, other: Path) -> list[str]:
    """Names of results that differ, or that one folder lacks."""
    found = []
    names = {
        path.relative_to(folder)
        for folder in (one, other)
        for ending in ("*.nc", "*.csv")
        for path in folder.rglob(ending)
    }
    for name in sorted(names):
        if not ((one / name).is_file() and (other / name).is_file()):
            found.append(f"{name}: only in one folder")
        elif name.suffix == ".csv":
            ours, theirs = (
                TIMES_IN_TEXT.sub(b"", (folder / name).read_bytes()) for folder in (one, other)
            )
            if ours != theirs:
                found.append(f"{name}: differs")
        else:
            with xr.open_dataset(one / name) as ours, xr.open_dataset(other / name) as theirs:
                if not plain(ours).identical(plain(theirs)):
                    found.append(f"{name}: differs")
    print(f"{len(names)} data sets and tables compared, {len(found)} differ")
    return found


if __name__ == "__main__":
    unequal = differences(Path(sys.argv[1]), Path(sys.argv[2]))
    sys.exit("\n".join(unequal) if unequal else 0)
