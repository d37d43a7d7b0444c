"""The tables of the objectives of architectures, from the study ``config/objectives.yaml``."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.evaluation.intervals import Interval, interval_of, log_interval
from cislunar.figures.labels import ARCHITECTURES, ESTIMATORS
from cislunar.runtime.netcdf import read_dataset

from .columns import Tables, with_text
from .labels import OBJECTIVES
from .markdown import DASH, markdown_table
from .studies import read_study

STUDY = "objectives"
"""Name of the study's table in ``docs/tables``."""

_COMPARED_WITH = {
    10: ("A", "exact"),
    20: ("A", "published"),
    33: ("B", "published"),
    43: ("C", "published"),
}
"""Scenario and architecture that others with as many satellites are compared with."""

_UNITS = {
    "information": "orbit information (nat)",
    "attitude": "attitude information (nat)",
    "coverage": "coverage (share of target-hours)",
}
_TARGETS = 50
_COUNTED = {
    "never_observed": "never_observed",
    "position_custody": "position_custody_share",
    "custody": "custody_share",
}
"""Quantities with arithmetic means by their names in the summary."""

_RANKED = {"position": "km", "attitude": "degree"}
_POSITION, _ATTITUDE = 2, 0
_COLUMNS = ["kind", "estimator", "variant", "observers", "name", "quantity", "mean", "low", "high"]
_COLUMNS.append("days")  # number of days of an interval, otherwise empty


def study_table(results: str | Path) -> pd.DataFrame:
    """The quantities shown of a finished study, from its folder of results."""
    names = ("objective_ranks", "objectives_A", "objectives_generalization_A")
    ranks, designs, others = (read_study(STUDY, results, name) for name in names)
    rows = [
        *_tracking_rows(read_dataset(Path(results) / "task2/summary.nc")),
        *_rank_rows(ranks),
        *_design_rows(designs),
        *_generalization_rows(others),
    ]
    rows = [(*row, *[np.nan] * (len(_COLUMNS) - len(row))) for row in rows]
    return pd.DataFrame(rows, columns=_COLUMNS)


def _tracking_rows(summary: xr.Dataset) -> Iterator[tuple]:
    """Of each architecture: means over days and realizations, and ratios to those compared with;
    intervals are those of the means of the days, each of which is a variant."""
    keys = ("scenario", "architecture", "estimator", "variant")
    place = {cell: k for k, cell in enumerate(zip(*(summary[k].values for k in keys), strict=True))}
    variants = dict.fromkeys(summary["variant"].values.tolist())

    def days(name: str, scenario: str, architecture: str, estimator: str) -> np.ndarray:
        cells = [place[scenario, architecture, estimator, day] for day in variants]
        return summary[name].values[cells].reshape(-1, *summary[name].shape[2:])

    day = np.repeat(np.arange(len(variants)), summary.sizes["seed"])

    for n, compared in _COMPARED_WITH.items():
        named = [compared[1], *(f"{stem}-{n}" for stem in ARCHITECTURES)]
        for estimator in ("mukf", "batch"):
            for name in named:
                own = compared if name == compared[1] else ("A", name)
                if (*own, estimator, "") not in place:
                    continue
                head = ("tracking", estimator, "", n, name)
                error = days("rmse_geometric_all", *own, estimator)
                other = days("rmse_geometric_all", *compared, estimator)
                seen = days("rmse_median", *own, estimator)[:, _POSITION]
                final = days("final_attitude_error_median", *own, estimator)
                for quantity, name_of in _COUNTED.items():
                    values = days(name_of, *own, estimator)
                    yield *head, quantity, *interval_of(name_of, values, _TARGETS, day)
                for quantity, values in (
                    ("position_all_km", LENGTH_UNIT_KM * error[:, _POSITION]),
                    ("position_observed_km", LENGTH_UNIT_KM * seen),
                    ("attitude_observed_deg", final),
                    ("position_ratio", error[:, _POSITION] / other[:, _POSITION]),
                    ("attitude_ratio", error[:, _ATTITUDE] / other[:, _ATTITUDE]),
                ):
                    yield *head, quantity, *log_interval(values, day)


def _rank_rows(ranks: pd.DataFrame) -> Iterator[tuple]:
    """Rank correlation of each objective with errors of all targets over the days, by estimator."""
    chosen = ranks[(ranks["quantity"] == "rmse_geometric_all") & (ranks["scenario"] == "A")]
    for row in chosen.itertuples():
        if _RANKED.get(row.part) == row.unit:
            head = ("rank", row.estimator, "", row.observers, row.objective, row.part)
            yield *head, row.correlation, row.low, row.high


def _design_rows(designs: pd.DataFrame) -> Iterator[tuple]:
    """Objective and bound of each design, the bound as the upper end; a gap where one is known."""
    for row in designs[designs["front"].isna()].itertuples():
        head = ("design", "", "", row.satellites, row.architecture, row.objective)
        yield *head, row.value, np.nan, row.bound


def _generalization_rows(others: pd.DataFrame) -> Iterator[tuple]:
    """Information about other targets, by what the architecture was chosen on."""
    for row in others.itertuples():
        head = ("generalization", "", f"{row.targets_by} {row.targets_of}", row.satellites)
        yield *head, row.chosen_on, "information", row.information_nat, np.nan, np.nan


def _of(tables: Tables, kind: str) -> pd.DataFrame:
    table = with_text(tables[STUDY])
    return table[table["kind"] == kind]


_MEANS = {
    "Targets of 50 never observed": ("mukf", "never_observed", ".1f", 1.0),
    "In custody by position, batch estimator (%)": ("batch", "position_custody", ".0f", 100.0),
    "In custody by position and attitude, batch estimator (%)": ("batch", "custody", ".0f", 100.0),
    "Position RMSE, all targets (km)": ("mukf", "position_all_km", ".2f", 1.0),
    "Position RMSE, observed targets (km)": ("mukf", "position_observed_km", ".2f", 1.0),
    "Final attitude error, observed targets (deg)": ("mukf", "attitude_observed_deg", ".2f", 1.0),
}
"""Columns of means: estimator, quantity, format and factor."""

_RATIOS = {
    f"Ratio of {part} RMSE, {name}": (estimator, f"{part}_ratio")
    for estimator, name in ESTIMATORS.items()
    for part in _RANKED
}


def _tracking(tables: Tables) -> dict[str, str]:
    """Architectures by number of satellites, with custody, errors and ratios."""
    table = _of(tables, "tracking").set_index(["estimator", "observers", "name", "quantity"])
    rows = []
    for n, name in dict.fromkeys((n, name) for _, n, name, _ in table.index):
        line = [n, ARCHITECTURES[name.removesuffix(f"-{n}")]]
        for estimator, quantity, form, factor in _MEANS.values():
            key = (estimator, n, name, quantity)
            if key not in table.index:
                line.append(DASH)
                continue
            ends = factor * table.loc[key, ["mean", "low", "high"]]
            shown = Interval(*ends, 2) if quantity in _COUNTED else ends["mean"]
            line.append(f"{shown:{form}}")
        for estimator, quantity in _RATIOS.values():
            key = (estimator, n, name, quantity)
            ends = table.loc[key, ["mean", "low", "high"]] if key in table.index else None
            line.append(DASH if ends is None else f"{Interval(*ends, 2):.2f}")
        rows.append(line)
    return {"table": markdown_table(["Satellites", "Chosen by", *_MEANS, *_RATIOS], rows)}


def _ranks(tables: Tables) -> dict[str, str]:
    """Rank correlations: ranges over estimators."""
    groups = _of(tables, "rank").groupby(["name", "observers", "quantity"])
    rows = []
    for objective, title in OBJECTIVES.items():
        for n in sorted({n for name, n, _ in groups.groups if name == objective}):
            of_parts = [groups.get_group((objective, n, part)) for part in _RANKED]
            ranges = [
                " to ".join(dict.fromkeys(f"{end:.2f}" for end in own["mean"].agg(["min", "max"])))
                + f" [{own['low'].min():.2f}, {own['high'].max():.2f}]"
                for own in of_parts
            ]
            rows.append([title, n, *ranges])
    header = ["Objective", "Satellites", *(f"Correlation, {part} RMSE" for part in _RANKED)]
    return {"table": markdown_table(header, rows)}


def _designs(tables: Tables) -> dict[str, str]:
    """Value, bound and gap of the designs that have a bound."""
    rows = [
        [f"`{row.name}`", row.observers, _UNITS.get(row.quantity, row.quantity),
         f"{row.mean:.4g}", f"{row.high:.4g}", f"{100.0 * (row.high / row.mean - 1.0):.2f}"]
        for row in _of(tables, "design").dropna(subset=["high"]).itertuples(index=False)
    ]  # fmt: skip
    header = ["Design", "Satellites", "Objective", "Value found", "Upper bound", "Gap (%)"]
    return {"table": markdown_table(header, rows)}


def _generalization(tables: Tables) -> dict[str, str]:
    """Information about other sets and single classes of targets, by the set chosen on."""
    groups = _of(tables, "generalization").groupby(["variant", "observers"], sort=False)
    rows = []
    for (targets, n), own in groups:
        found = own.set_index("name")["mean"]
        chosen = [
            f"{found[on]:.2f}" if on in found else DASH
            for on in ("these", "the campaign's", "others")
        ]
        rows.append([targets.replace("seed", "set"), n, *chosen])
    header = ["Targets", "Satellites"] + [
        f"Chosen on {on} (nat)"
        for on in ("these targets", "the campaign's targets", "all classes but this")
    ]
    return {"table": markdown_table(header, rows)}


OBJECTIVE_BLOCKS = {
    f"{STUDY}-tracking": _tracking,
    f"{STUDY}-ranks": _ranks,
    f"{STUDY}-designs": _designs,
    f"{STUDY}-generalization": _generalization,
}
"""What makes the values of each block, by the block's name."""
