"""Tables of the studies with a configuration and a folder of results of their own."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from cislunar.errors import InputFileError
from cislunar.figures.labels import ESTIMATORS

from .columns import COLUMNS, Tables, by_cell, numbers, only_shown, shown
from .labels import DYNAMICS as DYNAMICS_LABELS
from .labels import label
from .markdown import markdown_table

DYNAMICS, TASKING = "dynamics", "tasking"
"""Studies: ``config/NAME.yaml``, in ``docs/tables`` as ``NAME.csv``."""


STUDIES = {
    DYNAMICS: ("apogee", "perigee", "batch", "one-gaussian"),
    TASKING: ("tasking", "planning", "communication", "horizon", "fusion", "telescopes"),
}
"""Sweeps of each study whose tables the documents rest on."""

_KEYS = ["value", "estimator", "targets"]


def read_study(name: str, results: str | Path, table: str) -> pd.DataFrame:
    """A table of the study ``config/NAME.yaml``; an `InputFileError` if it has not been run."""
    path = Path(results) / f"tables/{table}.csv"
    if not path.is_file():
        raise InputFileError(
            f"{path}: no such table; run the study first, with --configfile config/{name}.yaml"
        )
    return pd.read_csv(path)


def study_table(name: str, results: str | Path) -> pd.DataFrame:
    """The quantities shown of every cell of a finished study, from its folder of results."""
    found = [read_study(name, results, f"sweep_{sweep}") for sweep in STUDIES[name]]
    kept = ["sweep", *_KEYS, "quantity", "part", "unit", "mean", "low", "high", "largest"]
    return only_shown(pd.concat(found, ignore_index=True), COLUMNS[name].values())[kept]


def _dynamics(tables: Tables) -> dict[str, str]:
    """Truth and assumed model, by estimator and number of targets."""
    columns = COLUMNS[DYNAMICS]
    rows = [
        [*_models(value), ESTIMATORS[estimator], targets, *numbers(cell, columns.values())]
        for (value, estimator, targets), cell in by_cell(tables[DYNAMICS], _KEYS).items()
    ]
    header = ["Moon near", "Truth", "Assumed model", "Estimator", "Targets", *columns]
    return {"table": markdown_table(header, rows)}


def _models(value: str) -> tuple[str, str, str]:
    """Position of the Moon, truth and assumed model of a value's name."""
    pair = value
    for prefix in ("batch-", "one-gaussian-", "perigee-"):
        pair = pair.removeprefix(prefix)
    truth, assumed = DYNAMICS_LABELS[pair]
    single = ", one Gaussian for each orbit" if value.startswith("one-gaussian-") else ""
    return "perigee" if "perigee" in value else "apogee", truth, assumed + single


def _estimator(title: str) -> str:
    """The estimator that a column's title names, or the paper's filter."""
    return "batch" if ESTIMATORS["batch"] in title else "mukf"


def _tasking(*sweeps: str) -> Callable[[Tables], dict[str, str]]:
    """What the values of some sweeps reach, with intervals."""

    def values(tables: Tables) -> dict[str, str]:
        table = tables[TASKING]
        cells = by_cell(table[table["sweep"].isin(sweeps)], _KEYS)
        places = dict.fromkeys((targets, value) for value, _, targets in cells)
        rows = [
            [targets, label(value)]
            + [
                shown(cells.get((value, _estimator(title), targets), {}), column)
                for title, column in COLUMNS[TASKING].items()
            ]
            for targets, value in sorted(places, key=lambda place: place[0])
        ]
        return {"table": markdown_table(["Targets", "Setting", *COLUMNS[TASKING]], rows)}

    return values


STUDY_BLOCKS = {
    DYNAMICS: {DYNAMICS: _dynamics},
    TASKING: {TASKING: _tasking("tasking", "planning")}
    | {
        f"{TASKING}-{name}": _tasking(name)
        for name in ("communication", "horizon", "fusion", "telescopes")
    },
}
"""What makes the values of each block of a study, by study and name."""
