"""Processor time and cache files of the kernels of an estimator, from an empty cache.

    python benchmarks/compilation.py [--sets tracking-mukf tracking-batch] [--other FOLDER]

A minimal tracking problem is run in a fresh process, first with an empty cache and then with the
cache of the first run. With `--other`, the folder of another revision, both revisions take turns.
"""

import os
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from _timing import process_time_of, revision_options, revisions

LOAD = "from cislunar.campaign.kernels import KERNEL_SETS; KERNEL_SETS[{!r}].load()"


class Cost(NamedTuple):
    """What the kernels of a set cost."""

    compiled_s: float
    """Processor time of the process that compiles them, s."""
    loaded_s: float
    """Processor time of a process that finds them in the cache, s."""
    files: int
    """Files of the cache."""
    megabytes: float
    """Their size, MB."""


def processor_time(folder: Path, name: str, cache: str) -> float:
    """Processor time of a process that loads a set of kernels of the library in a folder, s."""
    environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": cache}
    # outside of the folder of this script, which Python would search first
    return process_time_of([sys.executable, "-c", LOAD.format(name)], environment, cache)


def cost(folder: Path, name: str) -> Cost:
    """The cost of a set of kernels of the library in a folder."""
    with tempfile.TemporaryDirectory() as cache:
        times = [processor_time(folder, name, cache) for _ in range(2)]
        sizes = [path.stat().st_size for path in Path(cache).rglob("*.nb[ic]")]
    return Cost(*times, len(sizes), sum(sizes) / 1e6)


def main() -> None:
    parser = revision_options(__doc__.splitlines()[0])
    parser.add_argument("--sets", nargs="+", default=["tracking-mukf", "tracking-batch"])
    options = parser.parse_args()
    folders = revisions(options)
    for name in options.sets:
        costs: dict[str, list[Cost]] = {which: [] for which in folders}
        for _ in range(options.rounds):
            for which, folder in folders.items():
                costs[which].append(cost(folder, name))
        least = {which: Cost(*map(min, zip(*each, strict=True))) for which, each in costs.items()}
        for which, each in least.items():
            print(
                f"{name}, {which}: compiled in {each.compiled_s:.0f} s of processor time, "
                f"{each.files} files with {each.megabytes:.1f} MB, loaded in {each.loaded_s:.1f} s",
                flush=True,
            )
        if options.other:
            ratio = least["here"].compiled_s / least["other"].compiled_s
            print(f"{name}: time ratio {ratio:.2f}", flush=True)


if __name__ == "__main__":
    main()
