"""Tables of the studies with a configuration and a folder of results of their own."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from cislunar.campaign.documents.markdown import DASH, markdown_table
from cislunar.campaign.tracking.statistics import Interval
from cislunar.errors import InputFileError

DYNAMICS, TASKING = "dynamics", "tasking"
"""Studies: ``config/NAME.yaml``, in ``docs/tables`` as ``NAME.csv``."""

_PAIRS = {
    "cr3bp": "CR3BP, CR3BP",
    "real": "real, real",
    "real-cr3bp": "real, CR3BP",
    "real-cr3bp-noise": "real, CR3BP with q = 3·10⁻⁵ m²/s³",
    "real-no-light": "real, without radiation",
    "real-no-light-noise": "real, without radiation, q = 10⁻¹⁰ m²/s³",
    "real-light-20": "real, radiation 20 % too strong",
}
"""What is true and what is believed, by the end of a value's name."""

_ESTIMATORS = {"mukf": "filter", "batch": "batch"}


class Shown(NamedTuple):
    """A column of numbers: quantity, part and unit of the table, and how it is written."""

    quantity: str
    part: str
    unit: str
    form: str


_TRUTHS = {
    "position coverage": Shown("coverage", "position", "1", ".3f"),
    "velocity coverage": Shown("coverage", "velocity", "1", ".3f"),
    "ANEES of position": Shown("anees_mean", "position", "1", ".3g"),
    "of velocity": Shown("anees_mean", "velocity", "1", ".3g"),
    "error at the end, km": Shown("final_error_geometric_all", "position", "km", ".3g"),
    "orbits inconsistent": Shown("inconsistent_translation", "", "1", ".1f"),
    "attitude coverage": Shown("coverage", "attitude", "1", ".3f"),
    "rotation inconsistent": Shown("inconsistent_rotation", "", "1", ".1f"),
}

_NEVER = Shown("never_observed", "", "1", ".1f")
_POSITION = Shown("final_error_geometric_all", "position", "km", ".2f")
_ATTITUDE = Shown("final_attitude_error_median", "", "degree", ".3g")
_FAINT = Shown("faint_share", "", "1", ".0%")


class Study(NamedTuple):
    """Sweeps of a study whose tables the documents rest on, and what they show of them."""

    sweeps: tuple[str, ...]
    shown: tuple[Shown, ...]


STUDIES = {
    DYNAMICS: Study(("apogee", "perigee", "batch", "one-gaussian"), tuple(_TRUTHS.values())),
    TASKING: Study(
        ("tasking", "planning", "communication", "horizon", "fusion", "telescopes"),
        (_NEVER, _POSITION, _ATTITUDE, _FAINT),
    ),
}

_KEYS = ["value", "estimator", "targets"]
_MEASURE = ["quantity", "part", "unit"]


def read_study(name: str, results: str | Path, table: str) -> pd.DataFrame:
    """A table of the study ``config/NAME.yaml``; an `InputFileError` if it has not been run."""
    path = Path(results) / f"tables/{table}.csv"
    if not path.is_file():
        raise InputFileError(
            f"{path}: no such table; run the study first, with --configfile config/{name}.yaml"
        )
    return pd.read_csv(path)


def only_shown(table: pd.DataFrame, shown: Iterable[tuple]) -> pd.DataFrame:
    """The rows of some quantities, each given by a tuple that begins with quantity, part, unit."""
    wanted = {each[:3] for each in shown}
    measures = table[_MEASURE].astype(object).fillna("").astype(str)
    return table[[tuple(measure) in wanted for measure in measures.itertuples(index=False)]]


def study_table(name: str, results: str | Path) -> pd.DataFrame:
    """The shown quantities of every cell of a finished study, from its folder of results."""
    study = STUDIES[name]
    found = [read_study(name, results, f"sweep_{sweep}") for sweep in study.sweeps]
    columns = ["sweep", *_KEYS, *_MEASURE, "mean", "low", "high"]
    return only_shown(pd.concat(found, ignore_index=True), study.shown)[columns]


def dynamics_section(tables: Mapping[str, pd.DataFrame]) -> str:
    """The section of the page of results; empty without the study's table."""
    if DYNAMICS not in tables:
        return ""
    return (
        "## What the CR3BP costs\n\n"
        "The paper, and all above, moves targets by the CR3BP and lets estimators believe in it. "
        "Here targets move among Earth, Moon and Sun where they are, and observers fly paths "
        "refined there ([dynamics.md](dynamics.md) derives it): cells of the published "
        "architecture of scenario A, tasking every hour, means over realizations; the error at the "
        "end is that of the position of all targets over the final four hours, a geometric mean. "
        "Each row has what moves targets, and what is believed.\n\n" + dynamics_block(tables)
    )


def dynamics_block(tables: Mapping[str, pd.DataFrame]) -> str:
    """Pairs of truth and belief by estimator and number of targets."""
    table = tables[DYNAMICS].fillna({"part": ""})
    rows = []
    for (value, estimator, targets), own in table.groupby(_KEYS, sort=False):
        means = own.set_index(_MEASURE)["mean"]
        numbers = [f"{means[each[:3]]:{each.form}}" for each in _TRUTHS.values()]
        rows.append([*_told(value), _ESTIMATORS.get(estimator, estimator), targets, *numbers])
    header = ["Moon near", "truth, belief", "estimator", "targets", *_TRUTHS]
    return markdown_table(header, rows)


def tasking_block(tables: Mapping[str, pd.DataFrame], *sweeps: str) -> str:
    """What the values of some sweeps reach, with intervals; by the paper's filter but as said."""
    table = tables[TASKING].fillna({"part": ""})
    table = table[table["sweep"].isin(sweeps)].set_index([*_KEYS, *_MEASURE])
    columns = {
        "never observed": ("mukf", _NEVER),
        "position, km": ("mukf", _POSITION),
        "attitude, deg: filter": ("mukf", _ATTITUDE),
        "batch": ("batch", _ATTITUDE),
        "too faint": ("mukf", _FAINT),
    }
    places = {(int(targets), value) for value, _, targets, *_ in table.index}
    order = list(dict.fromkeys(table.index.get_level_values("value")))
    rows = [
        [targets, f"`{value}`"]
        + [
            _with_interval(table, (value, estimator, targets, *each[:3]), each.form)
            for estimator, each in columns.values()
        ]
        for targets, value in sorted(places, key=lambda place: (place[0], order.index(place[1])))
    ]
    return markdown_table(["targets", "value", *columns], rows)


def _with_interval(table: pd.DataFrame, key: tuple, form: str) -> str:
    """Mean and interval of a row, or a dash if there is none."""
    if key not in table.index:
        return DASH
    return f"{Interval(*(table.loc[key, end] for end in ('mean', 'low', 'high')), 2):{form}}"


def _told(value: str) -> tuple[str, str]:
    """Epoch, and truth and belief."""
    pair = value
    for prefix in ("batch-", "one-gaussian-", "perigee-"):
        pair = pair.removeprefix(prefix)
    single = ", one Gaussian" if value.startswith("one-gaussian-") else ""
    return "perigee" if "perigee" in value else "apogee", _PAIRS[pair] + single


STUDY_BLOCKS = {
    DYNAMICS: dynamics_block,
    TASKING: lambda tables: tasking_block(tables, "tasking", "planning"),
    **{
        f"{TASKING}-{name}": lambda tables, name=name: tasking_block(tables, name)
        for name in ("communication", "horizon", "fusion", "telescopes")
    },
}
"""What makes each block, by the name in its opening line."""
