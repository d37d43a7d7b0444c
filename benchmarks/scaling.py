"""How the cost of tracking grows with targets, observers, realizations and length.

    python -m benchmarks.scaling [--redraw | --memory | --threads | --month | --largest]

Processor time and memory of closed loops are measured around a usual size, each in a process of its
own, with one size varied at a time. The results go to ``docs/scaling.csv`` and
``docs/images/scaling.png``; exponents and the estimate for a large campaign go to
``docs/scaling.md``. ``--memory`` measures only the memory of long runs, day by day
(``docs/memory.csv``). ``--threads`` measures the time of a day of the large campaign against the
number of cores that share its targets (``docs/threads.csv``). ``--month`` runs an entire month of
it on all cores, each day in a process that continues from the checkpoint of the day before
(``docs/month.csv``); an interrupted run continues. ``--largest`` measures the first tasking
intervals of a day of 100,000 targets and 1,000 observers (``docs/largest.csv``). ``--redraw``
omits the measurements. The problem needs no file. Everything else runs on one thread; compilation
is not counted.
"""

import argparse
import multiprocessing
import os
import resource
import shutil
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import numpy as np
import pandas as pd

from cislunar.campaign.tracking.checkpoint import Checkpoint
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.registry import estimator_named
from cislunar.figures.style import estimator_style, house_style, new_figure, save_figure
from cislunar.photometry.materials import PRINTED
from cislunar.runtime.netcdf import write_text
from cislunar.runtime.threads import allow_threads
from cislunar.tasking import realization
from cislunar.tasking.closed_loop import ClosedLoop
from cislunar.tasking.demonstration import tracking_problem
from workflow.documents.markdown import markdown_table, replace_between

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs/scaling.csv"
MEMORY_TABLE = ROOT / "docs/memory.csv"
THREADS_TABLE = ROOT / "docs/threads.csv"
MONTH_TABLE = ROOT / "docs/month.csv"
LARGEST_TABLE = ROOT / "docs/largest.csv"
MONTH_FOLDER = ROOT / "build/month"
DOCUMENT = ROOT / "docs/scaling.md"
IMAGE = ROOT / "docs/images/scaling"
BEGIN, END = "<!-- begin measured -->\n", "<!-- end measured -->\n"

USUAL = {"targets": 100, "observers": 20, "seeds": 1, "hours": 6}
VARIED = {
    "targets": [25, 50, 100, 200, 400, 800],
    "observers": [5, 10, 20, 40, 80, 160],
    "seeds": [1, 2, 4, 8],
    "hours": [6, 12, 24, 48, 96, 192],
}
NAMES = {
    "targets": "targets",
    "observers": "observers",
    "seeds": "realizations",
    "hours": "length of the run, h",
}
LARGE = {"targets": 10_000, "observers": 100, "seeds": 1, "hours": 2}
"""The size of the large campaign, with the length that is measured."""

LARGE_HOURS = 30 * 24

LARGEST = {"targets": 100_000, "observers": 1000, "seeds": 1, "hours": 24}
"""The largest size, of which the setup and `LARGEST_INTERVALS` tasking intervals are measured."""

LARGEST_INTERVALS = 2

LONG_RUNS = (
    {"targets": 100, "observers": 20, "days": 8, "worked_through": 8},
    {"targets": 10_000, "observers": 100, "days": 30, "worked_through": 1},
)
"""Runs whose memory is measured after every day; the large one ends after its first day."""

LONG_HOURS = 6.0
"""Data window of the batch estimator for long campaigns."""

ESTIMATORS = {
    "mukf": estimator_named("mukf"),
    "batch": estimator_named("batch"),
    "window-6h": estimator_named("batch", batch_settings=BatchSettings(window_hours=LONG_HOURS)),
}


ESTIMATOR_NAMES = {
    "mukf": "paper's filter",
    "batch": "batch",
    "window-6h": "batch, window of 6 h",
}
"""Labels of the estimators in figure and tables."""


def start_realization(
    estimator: str, targets: int, observers: int, seeds: int, hours: float
) -> ClosedLoop:
    """A closed loop with hourly records."""
    problem = tracking_problem(
        observers, targets, PRINTED, duration_hours=float(hours), record_every=60
    )
    return ClosedLoop(*problem[:4], range(seeds), problem.loop, estimator=ESTIMATORS[estimator])


def run(estimator: str, targets: int, observers: int, seeds: int, hours: float) -> None:
    """Run one closed loop with a checkpoint, as a cell is run."""
    loop = start_realization(estimator, targets, observers, seeds, hours)
    with TemporaryDirectory() as folder:
        Checkpoint(Path(folder) / "kept", loop, {}).run()


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _cost(estimator: str, size: dict[str, int]) -> list[tuple[float, ...]]:
    """Processor time (s) and growth of memory (MB) of a loop."""
    before_mb, start = _peak_mb(), process_time()
    run(estimator, **size)
    return [(process_time() - start, _peak_mb() - before_mb)]


def _days(estimator: str, size: dict[str, int]) -> list[tuple[float, ...]]:
    """Day, processor time so far (s) and peak memory (MB) of the entire process after each day.

    Every day is written to disk before the next one.
    """
    start, found = process_time(), []
    loop = start_realization(estimator, size["targets"], size["observers"], 1, 24.0 * size["days"])
    with TemporaryDirectory() as folder:
        kept = Checkpoint(Path(folder) / "kept", loop, {}, least_s=0.0)
        for day in range(1, size["worked_through"] + 1):
            kept.run(pieces=1)
            found.append((day, process_time() - start, _peak_mb()))
    return found


def in_a_fork(measured: Callable, *given: object) -> list[tuple[float, ...]]:
    """Result of a function in a fork of this process, in which the kernels are loaded."""
    fork = multiprocessing.get_context("fork")
    parent_end, child_end = fork.Pipe()
    child = fork.Process(target=lambda: child_end.send(measured(*given)))
    child.start()
    found = parent_end.recv()
    child.join()
    return found


def measure(estimator: str, size: dict[str, int]) -> dict[str, object]:
    """Processor time and growth of memory of a loop.

    Parameters
    ----------
    estimator : str
        Its name.
    size : dict
        Keys of `USUAL`.

    Returns
    -------
    dict
        A row of the table; time in s, memory in MB.
    """
    ((cpu_s, memory_mb),) = in_a_fork(_cost, estimator, size)
    row = {"estimator": estimator, **size, "cpu_s": round(cpu_s, 4), "memory_mb": round(memory_mb)}
    print(row, flush=True)
    return row


def measure_days(estimator: str, size: dict[str, int]) -> list[dict[str, object]]:
    """Rows of the table of memory, one for each day of a run of `LONG_RUNS`."""
    rows = [
        {"estimator": estimator, **size, "day": day, "cpu_s": round(cpu_s, 1), "peak_mb": round(mb)}
        for day, cpu_s, mb in in_a_fork(_days, estimator, size)
    ]
    print(*rows, sep="\n", flush=True)
    return rows


def _elapsed(estimator: str, size: dict[str, int], threads: int) -> list[tuple[float, ...]]:
    """Time and processor time (s) of a loop whose targets are shared among threads."""
    allow_threads(threads)
    start, start_cpu = perf_counter(), process_time()
    run(estimator, **size)
    return [(perf_counter() - start, process_time() - start_cpu)]


def measure_threads(estimator: str, size: dict[str, int]) -> list[dict[str, object]]:
    """Rows of the table of threads: 1, 2, 4 ... up to the cores of the machine."""
    rows, threads = [], 1
    while threads <= os.cpu_count():
        ((elapsed_s, cpu_s),) = in_a_fork(_elapsed, estimator, size, threads)
        took = {"elapsed_s": round(elapsed_s, 1), "cpu_s": round(cpu_s, 1)}
        rows.append({"estimator": estimator, **size, "threads": threads, **took})
        print(rows[-1], flush=True)
        threads *= 2
    return rows


def _next_day() -> list[tuple[float, ...]]:
    """Day, wall and processor time (s) and peak memory (MB) of one more day of the month."""
    start, start_cpu = perf_counter(), process_time()
    allow_threads(os.cpu_count())
    loop = start_realization("mukf", LARGE["targets"], LARGE["observers"], 1, LARGE_HOURS)
    kept = Checkpoint(MONTH_FOLDER, loop, {}, least_s=0.0)
    kept.run(pieces=1)
    day = len(list(MONTH_FOLDER.rglob("pieces-*.pickle")))
    return [(day, perf_counter() - start, process_time() - start_cpu, _peak_mb())]


def measure_month() -> None:
    """Run the remaining days of the month; the table has every finished day."""
    rows = pd.read_csv(MONTH_TABLE).to_dict("records") if MONTH_FOLDER.is_dir() else []
    while not rows or rows[-1]["day"] < LARGE_HOURS // 24:
        ((day, elapsed_s, cpu_s, peak_mb),) = in_a_fork(_next_day)
        took = {"elapsed_s": round(elapsed_s, 1), "cpu_s": round(cpu_s, 1)}
        rows.append({"day": day, "threads": os.cpu_count(), **took, "peak_mb": round(peak_mb)})
        print(rows[-1], flush=True)
        write_text(pd.DataFrame(rows).to_csv(index=False), MONTH_TABLE)
    shutil.rmtree(MONTH_FOLDER)


def _intervals(estimator: str, size: dict[str, int]) -> list[tuple[float, ...]]:
    """Processor time (s) of the setup and of each of the first tasking intervals of a run, and peak
    memory (MB) of the entire process after it."""
    found, start = [], process_time()
    loop = start_realization(estimator, **size)
    own = realization.start_realization(loop.inputs, 0, 0)
    for number in range(LARGEST_INTERVALS + 1):
        if number > 0:
            realization.advance_interval(loop.inputs, own, number - 1)
        found.append((number, process_time() - start, _peak_mb()))
        print(*found[-1], flush=True)
        start = process_time()
    return found


def measure_largest() -> list[dict[str, object]]:
    """Rows of the table of the largest size: the setup, and the first intervals."""
    rows = [
        {"estimator": "mukf", **LARGEST, "interval": n, "cpu_s": round(s, 1), "peak_mb": round(mb)}
        for n, s, mb in in_a_fork(_intervals, "mukf", LARGEST)
    ]
    return rows


def sizes() -> list[dict[str, int]]:
    """The usual size with one number changed at a time, without repetition, and the large size."""
    found = [{**USUAL, name: value} for name, values in VARIED.items() for value in values]
    distinct = {tuple(size.values()): size for size in [*found, LARGE]}
    return list(distinct.values())


def along(table: pd.DataFrame, estimator: str, name: str) -> pd.DataFrame:
    """Rows of an estimator in which only one number differs from the usual size, sorted by it."""
    others = [other for other in USUAL if other != name]
    same = (table[others] == [USUAL[other] for other in others]).all(axis=1)
    return table[same & (table["estimator"] == estimator)].sort_values(name)


def exponent(rows: pd.DataFrame, name: str) -> float:
    """Slope of the logarithm of time against that of a number, over the upper half of the range."""
    upper = rows.tail(max(3, (len(rows) + 1) // 2))
    return float(np.polyfit(np.log(upper[name]), np.log(upper["cpu_s"]), 1)[0])


def draw(table: pd.DataFrame) -> None:
    """Draw processor time against each number for all estimators."""
    with house_style():
        figure = new_figure(2.6)
        figure.set_layout_engine("constrained")
        axes = figure.subplots(1, len(VARIED), sharey=True)
        for axis, name in zip(axes, VARIED, strict=True):
            for estimator in table["estimator"].unique():
                rows, style = along(table, estimator, name), estimator_style(estimator)
                label = f"{exponent(rows, name):.2f}"
                line = {"color": style.color, "linestyle": style.line, "label": label}
                axis.loglog(rows[name], rows["cpu_s"], **line, **style.marker_kwargs())
            axis.set_xticks(VARIED[name], map(str, VARIED[name]))
            axis.minorticks_off()
            axis.set_xlabel(NAMES[name])
            axis.legend(loc="upper left", title="exponent of time")
        names = [ESTIMATOR_NAMES[each] for each in table["estimator"].unique()]
        figure.legend(axes[0].get_lines(), names, loc="outside upper center", ncols=len(names))
        axes[0].set_ylabel("processor time, s")
        bottom, top = axes[0].get_ylim()
        axes[0].set_ylim(bottom, 5.0 * top)
        save_figure(figure, f"{IMAGE}.png", f"{IMAGE}.pdf")
    Path(f"{IMAGE}.pdf").unlink()


def exponents_table(table: pd.DataFrame) -> str:
    """Exponents of time in Markdown."""
    rows = []
    for estimator in table["estimator"].unique():
        usual = along(table, estimator, "targets").set_index("targets").loc[USUAL["targets"]]
        cells = [f"{exponent(along(table, estimator, name), name):.2f}" for name in VARIED]
        rows.append([ESTIMATOR_NAMES[estimator], f"{usual['cpu_s']:.2f}", *cells])
    size = "{targets} targets, {observers} observers, {hours} h".format(**USUAL)
    exponents = [f"exponent of {name.partition(',')[0]}" for name in NAMES.values()]
    return markdown_table(["estimator", f"{size}: processor time, s", *exponents], rows)


def large_table(table: pd.DataFrame) -> str:
    """Time of the large campaign, in proportion to its length, in Markdown."""
    header = ["estimator", "processor time of 2 h, s", "processor time of 30 days in proportion, h"]
    rows = []
    for estimator in table["estimator"].unique():
        own = table[table["estimator"] == estimator]
        row = own[(own[list(LARGE)] == list(LARGE.values())).all(axis=1)]
        if row.empty:
            continue
        cpu_s = row.iloc[0]["cpu_s"]
        hours = cpu_s * LARGE_HOURS / LARGE["hours"] / 3600.0
        rows.append([ESTIMATOR_NAMES[estimator], f"{cpu_s:.1f}", f"{hours:.1f}"])
    return markdown_table(header, rows)


def memory_table(table: pd.DataFrame) -> str:
    """Peak memory after each day, in Markdown."""
    days = sorted(table["day"].unique())
    rows = []
    for key, own in table.groupby(["targets", "observers", "days", "estimator"], sort=False):
        targets, observers, length, estimator = key
        peaks = own.set_index("day")["peak_mb"]
        cells = [str(peaks[day]) if day in peaks.index else "" for day in days]
        rows.append([f"{targets:,} x {observers}", str(length), ESTIMATOR_NAMES[estimator], *cells])
    header = ["targets x observers", "days of the run", "estimator"]
    return markdown_table([*header, *(f"day {day}, MB" for day in days)], rows)


def threads_table(table: pd.DataFrame) -> str:
    """Time of a day by number of threads, and the speedup relative to one thread, in Markdown."""
    rows = []
    for (estimator, targets, observers), some in table.groupby(
        ["estimator", "targets", "observers"], sort=False
    ):
        for row in some.itertuples():
            speedup = some.elapsed_s.iloc[0] / row.elapsed_s
            size, name = f"{targets:,} x {observers}", ESTIMATOR_NAMES[estimator]
            rows.append([size, name, str(row.threads), f"{row.elapsed_s:.0f}", f"{speedup:.2f}"])
    head = ["targets x observers", "estimator", "threads", "elapsed time of a day, s", "speedup"]
    return markdown_table(head, rows)


def month_table(table: pd.DataFrame) -> str:
    """Time and memory of a month of the large campaign, in Markdown."""
    size = f"{LARGE['targets']:,} x {LARGE['observers']}"
    days, minutes = table["elapsed_s"], table["elapsed_s"].sum() / 60.0
    row = [
        size,
        ESTIMATOR_NAMES["mukf"],
        str(table["threads"].iloc[0]),
        str(len(table)),
        f"{minutes:.0f}",
    ]
    row += [f"{days.min():.0f} to {days.max():.0f}", str(table["peak_mb"].max())]
    head = ["targets x observers", "estimator", "threads", "days", "total elapsed time, min"]
    return markdown_table([*head, "elapsed time of a day, s", "peak memory, MB"], [row])


def largest_table(table: pd.DataFrame) -> str:
    """Time and memory of the largest size, and the time of a day in proportion, in Markdown."""
    first, setup, *intervals = table.iloc[0], *table["cpu_s"]
    day = setup + first["hours"] * sum(intervals) / len(intervals)
    row = [f"{first['targets']:,} x {first['observers']:,}", ESTIMATOR_NAMES[first["estimator"]]]
    row += [f"{setup:.0f}", ", ".join(f"{each:.0f}" for each in intervals), f"{day / 60.0:.0f}"]
    times = ["setup, s", f"hours 1 to {len(intervals)}, s", "24 h in proportion, min"]
    times = [f"processor time of {each}" for each in times]
    head = ["targets x observers", "estimator", *times, "peak memory, MB"]
    return markdown_table(head, [[*row, f"{table['peak_mb'].max():,}"]])


def describe(table: pd.DataFrame) -> None:
    """Write the tables into the document."""
    text = DOCUMENT.read_text(encoding="utf-8")
    parts = [exponents_table(table), large_table(table)]
    for path, made in (
        (MEMORY_TABLE, memory_table),
        (THREADS_TABLE, threads_table),
        (MONTH_TABLE, month_table),
        (LARGEST_TABLE, largest_table),
    ):
        parts += [made(pd.read_csv(path))] if path.is_file() else []
    block = "\n" + "".join(f"{part}\n" for part in parts)
    write_text(replace_between(text, BEGIN, END, block, str(DOCUMENT)), DOCUMENT)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    only = parser.add_mutually_exclusive_group()
    only.add_argument(
        "--redraw", action="store_true", help="use the existing tables without measuring"
    )
    only.add_argument("--memory", action="store_true", help="measure only the memory of long runs")
    only.add_argument(
        "--threads", action="store_true", help="measure only the cores that share targets"
    )
    only.add_argument(
        "--month", action="store_true", help="run only the month of the large campaign"
    )
    only.add_argument(
        "--largest", action="store_true", help="measure only hours of the largest size"
    )
    options = parser.parse_args()
    rows, days, shared, hours = [], [], [], []
    # a data window does not change how targets are shared
    large = options.month or options.largest
    asked = ("mukf", "batch") if options.threads else ("mukf",) if large else ESTIMATORS
    for estimator in () if options.redraw else asked:
        run(estimator, 5, 5, 1, 1.0)  # compiles the kernels
        if options.threads:
            shared += measure_threads(estimator, {**LARGE, "hours": 24})
            continue
        if options.month:
            measure_month()
            continue
        if options.largest:
            run(estimator, 300, 100, 1, 1.0)  # compiles those of many pairs
            hours = measure_largest()
            continue
        rows += [] if options.memory else [measure(estimator, size) for size in sizes()]
        days += [row for size in LONG_RUNS for row in measure_days(estimator, size)]
    for path, found in (
        (TABLE, rows),
        (MEMORY_TABLE, days),
        (THREADS_TABLE, shared),
        (LARGEST_TABLE, hours),
    ):
        if found:
            write_text(pd.DataFrame(found).to_csv(index=False), path)
    table = pd.read_csv(TABLE)
    draw(table)
    describe(table)


if __name__ == "__main__":
    main()
