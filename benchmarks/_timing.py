"""Measure the time of an action, in the same way for all benchmarks."""

import argparse
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from subprocess import Popen
from time import perf_counter, process_time

HERE = Path(__file__).resolve().parents[1]


def revision_options(description: str) -> argparse.ArgumentParser:
    """Parser of the options of a benchmark that can compare two revisions of the project."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--other", type=Path, help="folder of another revision of the project")
    parser.add_argument("--rounds", type=int, default=1, help="rounds, of which the least counts")
    return parser


def revisions(options: argparse.Namespace) -> dict[str, Path]:
    """Folders of the revisions to compare: of another one, if there is one, and of this one."""
    return ({"other": options.other.resolve()} if options.other else {}) | {"here": HERE}


def best_time(action: Callable[[], object], repeats: int = 3) -> float:
    """Least wall time of an action, s; a first call is not counted."""
    action()
    times = []
    for _ in range(repeats):
        start = perf_counter()
        action()
        times.append(perf_counter() - start)
    return min(times)


def alternated(actions: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Least processor time of each action, s; every round runs all actions in turn.

    Other load on the machine then affects all actions alike. A first round is not counted.
    """
    times = dict.fromkeys(actions, float("inf"))
    for counted in range(rounds + 1):
        for name, action in actions.items():
            start = process_time()
            action()
            if counted:
                times[name] = min(times[name], process_time() - start)
    return times


def process_time_of(command: list[str], environment: Mapping[str, str], folder: str) -> float:
    """Processor time of a command that runs in a folder, s; ends the program if it fails."""
    process = Popen(command, env=environment, cwd=folder)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"{' '.join(command)}: exit code {process.returncode}")
    return used.ru_utime + used.ru_stime
