"""Processor time of a catalog from detections without identity.

    python benchmarks/linking.py [--size medium] [--other FOLDER] [--rounds 1]

The detections of a benchmark (docs/benchmark.md) are linked from nothing by the method of the
library, and by the nearest neighbor as the obvious alternative, each in a fresh process with
compiled kernels. With `--other`, the folder of another revision, both revisions take turns.
"""

import os
import sys
import tempfile
from pathlib import Path

from _timing import process_time_of, revision_options, revisions

from cislunar.benchmark import REFERENCE_METHODS, make_benchmark

LINK = "from cislunar.benchmark import write_reference; write_reference({!r}, {!r}, {!r})"


def linked(folder: Path, scenario: str, method: str) -> float:
    """Processor time in which the library in a folder makes a catalog of a scenario, s."""
    with tempfile.TemporaryDirectory() as output:
        code = LINK.format(scenario, output, method)
        environment = os.environ | {"PYTHONPATH": str(folder)}
        return process_time_of([sys.executable, "-c", code], environment, output)


def main() -> None:
    parser = revision_options(__doc__.splitlines()[0])
    parser.add_argument("--size", default="medium", help="size of the benchmark")
    options = parser.parse_args()
    folders = revisions(options)
    with tempfile.TemporaryDirectory() as temporary:
        scenario = f"{temporary}/scenario"
        make_benchmark(scenario, options.size)
        tried = [(method, which) for method in REFERENCE_METHODS for which in folders]
        times = dict.fromkeys(tried, float("inf"))
        for counted in range(options.rounds + 1):  # the first round compiles
            for method, which in tried:
                used = linked(folders[which], scenario, method)
                if counted:
                    times[method, which] = min(times[method, which], used)
        for (method, which), used in times.items():
            ratio = used / times[method, next(iter(folders))]
            print(f"{method}, {which}: {used:.1f} s of processor time, ratio {ratio:.2f}")


if __name__ == "__main__":
    main()
