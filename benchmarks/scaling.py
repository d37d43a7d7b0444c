"""How the cost of tracking grows with targets, observers, realizations and length.

    python benchmarks/scaling.py [--redraw]

measures processor time and memory of closed loops about a usual size, each in a process of its
own, one size varied at a time; writes them to ``docs/scaling.csv``, draws
``docs/images/scaling.png``, and puts exponents and the estimate for a large campaign into
``docs/scaling.md``. ``--redraw`` leaves out the measuring. The scene needs no file. Everything runs
on one thread; compilation is not counted.
"""

import argparse
import multiprocessing
import resource
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd

from cislunar.campaign.data.netcdf import write_text
from cislunar.campaign.documents.markdown import markdown_table, replace_between
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.registry import estimator_named
from cislunar.figures.style import estimator_style, house_style, new_figure, save_figure
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs/scaling.csv"
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
    "hours": "length, h",
}
LARGE = {"targets": 10_000, "observers": 100, "seeds": 1, "hours": 2}
"""The size asked about, for as long as it takes to measure it."""

LARGE_HOURS = 30 * 24

LONG_HOURS = 6.0
"""Data window of the batch estimator for long campaigns."""

ESTIMATORS = {
    "mukf": estimator_named("mukf"),
    "batch": estimator_named("batch"),
    "window-6h": estimator_named("batch", batch_settings=BatchSettings(window_hours=LONG_HOURS)),
}


def run(estimator: str, targets: int, observers: int, seeds: int, hours: float) -> None:
    """One closed loop, recorded hourly."""
    problem = tracking_problem(observers, targets, duration_hours=float(hours), record_every=60)
    run_closed_loop(*problem[:4], list(range(seeds)), problem[4], estimator=ESTIMATORS[estimator])


def _measure_here(pipe, estimator: str, size: dict[str, int]) -> None:
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = process_time()
    run(estimator, **size)
    cpu_s = process_time() - start
    grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    pipe.send((cpu_s, grown_kb / 1024.0))


def measure(estimator: str, size: dict[str, int]) -> dict[str, object]:
    """Processor time and growth of memory of a loop, in a fork of this warm process.

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
    fork = multiprocessing.get_context("fork")
    ours, theirs = fork.Pipe()
    child = fork.Process(target=_measure_here, args=(theirs, estimator, size))
    child.start()
    cpu_s, memory_mb = ours.recv()
    child.join()
    row = {"estimator": estimator, **size, "cpu_s": round(cpu_s, 4), "memory_mb": round(memory_mb)}
    print(row, flush=True)
    return row


def sizes() -> list[dict[str, int]]:
    """The usual size with one number changed at a time, each once, and the large one."""
    found = [{**USUAL, name: value} for name, values in VARIED.items() for value in values]
    distinct = {tuple(size.values()): size for size in [*found, LARGE]}
    return list(distinct.values())


def along(table: pd.DataFrame, estimator: str, name: str) -> pd.DataFrame:
    """Rows of an estimator in which only one number differs from the usual, rising."""
    others = [other for other in USUAL if other != name]
    same = (table[others] == [USUAL[other] for other in others]).all(axis=1)
    return table[same & (table["estimator"] == estimator)].sort_values(name)


def exponent(rows: pd.DataFrame, name: str) -> float:
    """Slope of time against a number, both logarithmic, over the upper half of the range."""
    upper = rows.tail(max(3, (len(rows) + 1) // 2))
    return float(np.polyfit(np.log(upper[name]), np.log(upper["cpu_s"]), 1)[0])


def draw(table: pd.DataFrame) -> None:
    """Processor time against each number, all estimators."""
    with house_style():
        figure = new_figure(2.6)
        figure.set_layout_engine("constrained")
        axes = figure.subplots(1, len(VARIED), sharey=True)
        for axis, name in zip(axes, VARIED, strict=True):
            for estimator in table["estimator"].unique():
                rows, style = along(table, estimator, name), estimator_style(estimator)
                label = f"{estimator}: {exponent(rows, name):.2f}"
                line = {"color": style.color, "linestyle": style.line, "label": label}
                axis.loglog(rows[name], rows["cpu_s"], **line, **style.marker_kwargs())
            axis.set_xticks(VARIED[name], map(str, VARIED[name]))
            axis.minorticks_off()
            axis.set_xlabel(NAMES[name])
            axis.legend(loc="upper left", title="exponent")
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
        rows.append([estimator, f"{usual['cpu_s']:.2f}", *cells])
    return markdown_table(["estimator", "usual size, s", *VARIED], rows)


def large_table(table: pd.DataFrame) -> str:
    """What the large campaign would take, in proportion to its length, in Markdown."""
    header = [
        *("estimator", "2 h, measured, s", "2 h, measured, MB"),
        *("30 days, one core a realization, h", "30 days, memory of each job, GB"),
    ]
    rows = []
    for estimator in table["estimator"].unique():
        own = table[table["estimator"] == estimator]
        row = own[(own[list(LARGE)] == list(LARGE.values())).all(axis=1)]
        if row.empty:
            continue
        measured = row.iloc[0]
        longer = LARGE_HOURS / LARGE["hours"]
        hours = measured["cpu_s"] * longer / 3600.0
        memory = measured["memory_mb"] / 1024.0 * longer
        figures = (f"{measured['cpu_s']:.1f}", measured["memory_mb"], f"{hours:.1f}")
        rows.append([estimator, *figures, f"{memory:.0f}"])
    return markdown_table(header, rows)


def describe(table: pd.DataFrame) -> None:
    """Put the figures into the document."""
    text = DOCUMENT.read_text(encoding="utf-8")
    block = f"\n{exponents_table(table)}\n{large_table(table)}\n"
    write_text(replace_between(text, BEGIN, END, block, str(DOCUMENT)), DOCUMENT)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--redraw", action="store_true", help="from the table, without measuring")
    options = parser.parse_args()
    if not options.redraw:
        rows = []
        for estimator in ESTIMATORS:
            run(estimator, 5, 5, 1, 1.0)  # compiles
            rows += [measure(estimator, size) for size in sizes()]
        write_text(pd.DataFrame(rows).to_csv(index=False), TABLE)
    table = pd.read_csv(TABLE)
    draw(table)
    describe(table)


if __name__ == "__main__":
    main()
