"""Numbers of a finished campaign into the documents: README, docs and the page of results.

From the folder of the repository, after the campaign::

    python -m workflow.documents.update

copies the tables that the documents rest on from ``results/`` to ``docs/tables`` and the page of
results to ``docs/results.md``, and generates every block between the lines
``<!-- begin generated: NAME -->`` and ``<!-- end generated -->`` from these tables, in whichever
documents it stands. ``--results FOLDER`` takes another results folder. ``--study NAME`` takes only
the tables of the study ``config/NAME.yaml``, or of the benchmark (docs/benchmark.md), from
``results/NAME`` unless another folder is named.
``--from-tables`` needs no campaign: it fills all blocks from ``docs/tables`` as they are.
``--check`` changes nothing and fails where a document differs from its tables.
"""

import argparse
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path

import pandas as pd

from cislunar.errors import CislunarError, InputFileError
from cislunar.runtime.netcdf import write_text

from . import (
    association_block,
    benchmark_block,
    catalog_block,
    maneuver_block,
    objectives_block,
    real_block,
)
from .blocks import BLOCKS, outdated_tables
from .markdown import fill_blocks, generated_blocks
from .results_page import STRIP, shown_quantities, verdicts_svg
from .run_times import run_times
from .settings_tables import SETTINGS_BLOCKS
from .studies import STUDIES, TASKING, read_study, study_table

RESULTS_PAGE = "results.md"
TABLES = (
    "paper_vs_ours",
    "architecture",
    "label_comparison",
    "readings_architecture",
    "readings_tracking",
    "tracking",
    "model_error",
    "photometry",
    "run_times",
)
"""Tables of ``docs/tables``; the last is made of the benchmarks, the others by the campaign."""

_STUDIES = {name: partial(study_table, name) for name in STUDIES}
_STUDIES |= {
    each.STUDY: each.study_table for each in (real_block, objectives_block, benchmark_block)
}
_STUDIES |= {
    name: partial(read_study, name, table=table)
    for name, table in (
        (association_block.STUDY, association_block.STUDY),
        (maneuver_block.STUDY, maneuver_block.STUDY),
        *((name, catalog_block.TABLE) for name in catalog_block.STUDIES),
    )
}
"""What makes the table of each study from its folder of results."""

_FIGURES = {
    real_block.STUDY: "pooled",
    TASKING: "sweep_tasking",
    objectives_block.STUDY: objectives_block.STUDY,
    association_block.STUDY: association_block.STUDY,
    maneuver_block.STUDY: maneuver_block.STUDY,
    **dict.fromkeys(catalog_block.STUDIES, catalog_block.TABLE),
}
"""Figure of a study's results that ``docs/images`` holds under the study's name."""

_THINNED = ("readings_tracking", "tracking")


def read_tables(folder: str | Path) -> dict[str, pd.DataFrame]:
    """The tables that the documents rest on, from ``docs/tables``, by name.

    All tables of the campaign must exist; tables of studies may be missing.
    """
    folder = Path(folder)
    own = [name for name in _STUDIES if (folder / f"{name}.csv").is_file()]
    return {name: _read(folder / f"{name}.csv") for name in (*TABLES, *own)}


def _read(path: Path) -> pd.DataFrame:
    if not path.is_file():
        raise InputFileError(
            f"{path}: no such table; run the whole campaign, then "
            "python -m workflow.documents.update"
        )
    claims = path.stem == "paper_vs_ours"
    table = pd.read_csv(path, dtype=str if claims else None)
    if claims and "result" not in table:
        raise InputFileError(
            f"{path} lacks the column result: an earlier version made it; run the campaign again"
        )
    return table


def campaign_tables(results: str | Path) -> dict[str, str]:
    """The text of every table for the documents, from the results of a finished campaign.

    Long tables keep only the quantities shown. A missing table raises `InputFileError`.
    """
    results = Path(results)
    found = {}
    for name in TABLES[:-1]:
        path = results / "tables" / f"{name}.csv"
        table = _read(path)
        if name in _THINNED:
            found[name] = shown_quantities(table).to_csv(index=False)
        else:
            found[name] = path.read_text(encoding="utf-8")
    found[TABLES[-1]] = run_times(results / "benchmarks").to_csv(index=False)
    return found


def documents(root: str | Path) -> list[Path]:
    """Documents of the repository with generated blocks."""
    root = Path(root)
    every = [root / "README.md", root / "config/README.md", *sorted((root / "docs").rglob("*.md"))]
    return [p for p in every if p.is_file() and generated_blocks(p.read_text(encoding="utf-8"))]


def rule_graph(root: str | Path) -> str:
    """The graph of the rules at the shipped configuration in alphabetical order, for Mermaid."""
    command = [sys.executable, "-m", "snakemake", "--forceall", "--rulegraph", "mermaid-js"]
    command.append("everything")
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputFileError(f"{root}: snakemake --rulegraph failed: {done.stderr[-1000:]}")
    names = dict(re.findall(r"^\s*(id\d+)\[(\w+)\]", done.stdout, flags=re.MULTILINE))
    found = re.findall(r"^\s*(id\d+) --> (id\d+)", done.stdout, flags=re.MULTILINE)
    edges = sorted((names[before], names[after]) for before, after in found)
    # The last rule takes everything and would hide the rest.
    lines = [f"    {before} --> {after}\n" for before, after in edges if after != "everything"]
    return f"```mermaid\nflowchart LR\n{''.join(lines)}```"


def block_makers(
    root: str | Path, tables: Mapping[str, pd.DataFrame]
) -> dict[str, Callable[[], str | None]]:
    """What makes each block of the repository's documents, as functions without arguments."""
    makers = {name: cache(partial(make, tables)) for name, make in BLOCKS.items()}
    return makers | {"rule-graph": cache(partial(rule_graph, root)), **SETTINGS_BLOCKS}


def outdated(root: str | Path) -> dict[Path, str]:
    """Documents that differ from their tables, and the diagram, with the text they should have.

    An `InputFileError` if a table is missing or a block malformed.
    """
    root = Path(root)
    tables = read_tables(root / "docs/tables")
    for name in outdated_tables(tables):
        print(
            f"docs/tables/{name}.csv is of an earlier version: the blocks that rest on it stay as "
            "they are until it is made again",
            file=sys.stderr,
        )
    makers = block_makers(root, tables)
    wanted = {
        path: fill_blocks(_text(path), makers, path.relative_to(root).as_posix())
        for path in documents(root)
    }
    wanted[root / "docs" / STRIP] = verdicts_svg(tables["paper_vs_ours"])
    return {path: text for path, text in wanted.items() if text != _text(path)}


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def refresh(root: str | Path, results: str | Path) -> list[Path]:
    """Update the documents from a finished campaign; returns those that changed, but no tables.

    An `InputFileError`, and nothing changed, if the campaign is not finished.
    """
    root, results = Path(root), Path(results)
    source, page = results / "tables" / RESULTS_PAGE, root / "docs" / RESULTS_PAGE
    if not source.is_file():
        raise InputFileError(f"{source}: no such file; run the whole campaign first")
    for name, text in campaign_tables(results).items():
        write_text(text, root / "docs/tables" / f"{name}.csv")
    before = {path: _text(path) for path in (*documents(root), page, root / "docs" / STRIP)}
    write_text(_text(source), page)
    _write_outdated(root)
    return [path for path, text in before.items() if text != _text(path)]


def _take_study(name: str, results: Path, docs: Path) -> None:
    """Copy the table of a study from its folder of results, and its figure if it has one."""
    table = _STUDIES[name](results)
    if name in _FIGURES:
        drawn = results / f"figures/{_FIGURES[name]}.png"
        if not drawn.is_file():
            raise InputFileError(f"{drawn}: no such figure; let snakemake draw it")
        shutil.copyfile(drawn, docs / f"images/{name}.png")
    write_text(table.to_csv(index=False), docs / f"tables/{name}.csv")


def _write_outdated(root: str | Path) -> list[Path]:
    """Generate again what differs from the tables in ``docs/tables``; returns what changed."""
    stale = outdated(root)
    for path, text in stale.items():
        write_text(text, path)
    return list(stale)


def _run(chosen: argparse.Namespace) -> int:
    """What the command was asked to do; its exit code."""
    if chosen.check:
        stale = outdated(chosen.root)
        for path in stale:
            print(f"{path} differs from docs/tables", file=sys.stderr)
        return int(bool(stale))
    if chosen.study is not None:
        results = Path(chosen.results or f"results/{chosen.study}")
        _take_study(chosen.study, results, Path(chosen.root) / "docs")
    if chosen.study is not None or chosen.from_tables:
        changed = _write_outdated(chosen.root)
    else:
        changed = refresh(chosen.root, chosen.results or "results")
    print("\n".join(map(str, changed)) or "nothing has changed")
    return 0


def main(arguments: list[str] | None = None) -> int:
    """The command; its exit code is 1 if something is missing or a document is outdated."""
    parser = argparse.ArgumentParser(
        prog="python -m workflow.documents.update",
        description="Fill the documents with the numbers of a finished campaign.",
    )
    parser.add_argument("--results", help="results folder (default: results, or results/NAME)")
    parser.add_argument("--root", default=".", help="folder of the repository (default: here)")
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--study", choices=_STUDIES, help="take only the tables of this study")
    mode.add_argument(
        "--from-tables", action="store_true", help="fill all blocks from docs/tables as they are"
    )
    mode.add_argument(
        "--check", action="store_true", help="change nothing; fail where a document is outdated"
    )
    try:
        return _run(parser.parse_args(arguments))
    except CislunarError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
