"""The tables of what each objective is worth in tracking, from ``config/objectives.yaml``."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.campaign.data.netcdf import read_dataset
from cislunar.campaign.documents.markdown import DASH, markdown_table
from cislunar.campaign.documents.studies import read_study
from cislunar.campaign.tracking.statistics import Interval, log_interval
from cislunar.constants import LENGTH_UNIT_KM

STUDY = "objectives"
"""Name of the study's table in ``docs/tables``."""

_COMPARED_WITH = {
    10: ("A", "exact"),
    20: ("A", "published"),
    33: ("B", "published"),
    43: ("C", "published"),
}
"""Scenario and architecture that those of as many satellites are compared with."""

_DAYS = {
    "A": ("", "day10", "day20"),
    "B": ("", "day10-b", "day20-b"),
    "C": ("", "day10-c", "day20-c"),
}
"""Variants of the three days."""

_CHOSEN_BY = {
    "exact": "J, its optimum",
    "published": "published (J by TPE)",
    "J": "J",
    "coverage": "coverage",
    "information": "orbit information, orbits up to 10 m/s a year",
    "stable": "orbit information, stability index up to 2",
    "half-days": "the same, windows of 12 h on all 202 targets",
    "attitude": "attitude information, stability index up to 2",
    "tpe-coverage": "coverage, by TPE",
    "tpe-information": "orbit information, index up to 2, by TPE",
    "random-information": "orbit information, index up to 2, by random search",
}
"""What an architecture was chosen by, by its name without the number of satellites."""

_OBJECTIVES = {
    "information_nat": "orbit information",
    "attitude_nat": "attitude information",
    "J": "J",
    "union_coverage": "union coverage",
    "target_days": "target-days",
}
_RANKED = {"position": "km", "attitude": "degree"}
_POSITION, _ATTITUDE = 2, 0
_COLUMNS = ["kind", "estimator", "variant", "observers", "name", "quantity", "mean", "low", "high"]


def study_table(results: str | Path) -> pd.DataFrame:
    """What the documents show of a finished study, from its folder of results."""
    names = ("objective_ranks", "objectives_A", "objectives_elsewhere_A")
    ranks, designs, elsewhere = (read_study(STUDY, results, name) for name in names)
    rows = [
        *_tracking_rows(read_dataset(Path(results) / "task2/summary.nc")),
        *_rank_rows(ranks),
        *_design_rows(designs),
        *_elsewhere_rows(elsewhere),
    ]
    return pd.DataFrame(rows, columns=_COLUMNS)


def _tracking_rows(summary: xr.Dataset) -> Iterator[tuple]:
    """Of each architecture: means over days and realizations, and ratios to those compared with."""
    keys = ("scenario", "architecture", "estimator", "variant")
    place = {cell: k for k, cell in enumerate(zip(*(summary[k].values for k in keys), strict=True))}

    def days(name: str, scenario: str, architecture: str, estimator: str) -> np.ndarray:
        cells = [place[scenario, architecture, estimator, day] for day in _DAYS[scenario]]
        return summary[name].values[cells].reshape(-1, *summary[name].shape[2:])

    for n, compared in _COMPARED_WITH.items():
        named = [compared[1], *(f"{stem}-{n}" for stem in _CHOSEN_BY)]
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
                never = days("never_observed", *own, estimator).mean()
                yield *head, "never_observed", never, np.nan, np.nan
                for quantity, values in (
                    ("position_all_km", LENGTH_UNIT_KM * error[:, _POSITION]),
                    ("position_observed_km", LENGTH_UNIT_KM * seen),
                    ("attitude_observed_deg", final),
                    ("position_ratio", error[:, _POSITION] / other[:, _POSITION]),
                    ("attitude_ratio", error[:, _ATTITUDE] / other[:, _ATTITUDE]),
                ):
                    yield *head, quantity, *log_interval(values)[:3]


def _rank_rows(ranks: pd.DataFrame) -> Iterator[tuple]:
    """Rank correlation of each objective with errors of all targets, by day and estimator."""
    chosen = ranks[(ranks["quantity"] == "rmse_geometric_all") & (ranks["scenario"] == "A")]
    for row in chosen.itertuples():
        if _RANKED.get(row.part) == row.unit:
            day = row.variant if isinstance(row.variant, str) else ""
            head = ("rank", row.estimator, day, row.observers, row.objective, row.part)
            yield *head, row.correlation, row.low, row.high


def _design_rows(designs: pd.DataFrame) -> Iterator[tuple]:
    """Objective and bound of each design, the bound as the upper end; a gap where one is known."""
    for row in designs[designs["front"].isna()].itertuples():
        head = ("design", "", "", row.satellites, row.architecture, row.objective)
        yield *head, row.value, np.nan, row.bound


def _elsewhere_rows(elsewhere: pd.DataFrame) -> Iterator[tuple]:
    """Information about other targets, by what the architecture was chosen on."""
    for row in elsewhere.itertuples():
        head = ("elsewhere", "", f"{row.targets_by} {row.targets_of}", row.satellites)
        yield *head, row.chosen_on, "information", row.information_nat, np.nan, np.nan


def _of(tables: Mapping[str, pd.DataFrame], kind: str) -> pd.DataFrame:
    table = tables[STUDY]
    return table[table["kind"] == kind].fillna({"variant": "", "estimator": ""})


def tracking_block(tables: Mapping[str, pd.DataFrame]) -> str:
    """Architectures by number of satellites, with errors by the filter and ratios by both."""
    table = _of(tables, "tracking").set_index(["estimator", "observers", "name", "quantity"])
    places = dict.fromkeys((n, name) for _, n, name, _ in table.index)
    rows = []
    for n, name in places:

        def told(estimator: str, quantity: str, form: str, key=(n, name)) -> str:
            if (estimator, *key, quantity) not in table.index:
                return DASH
            row = table.loc[(estimator, *key, quantity)]
            interval = Interval(row["mean"], row["low"], row["high"], 2)
            return f"{interval if quantity.endswith('ratio') else row['mean']:{form}}"

        rows.append(
            [
                n,
                _CHOSEN_BY[name.removesuffix(f"-{n}")],
                told("mukf", "never_observed", ".1f"),
                told("mukf", "position_all_km", ".2f"),
                told("mukf", "position_observed_km", ".2f"),
                told("mukf", "attitude_observed_deg", ".2f"),
                *(
                    told(estimator, f"{part}_ratio", ".2f")
                    for estimator in ("mukf", "batch")
                    for part in _RANKED
                ),
            ]
        )
    header = ["N", "chosen by", "never observed of 50", "km, all", "km, observed", "deg, observed"]
    header += ["ratio, km", "ratio, deg of all", "batch: ratio, km", "batch: ratio, deg of all"]
    return markdown_table(header, rows)


def ranks_block(tables: Mapping[str, pd.DataFrame]) -> str:
    """Rank correlations: ranges over days and estimators."""
    groups = _of(tables, "rank").groupby(["name", "observers", "quantity"])
    rows = []
    for objective, title in _OBJECTIVES.items():
        for n in sorted({n for name, n, _ in groups.groups if name == objective}):
            told = []
            for part in _RANKED:
                own = groups.get_group((objective, n, part))
                ends = own["low"].min(), own["high"].max()
                told.append(
                    f"{own['mean'].min():.2f} to {own['mean'].max():.2f} "
                    f"[{ends[0]:.2f}, {ends[1]:.2f}]"
                )
            rows.append([title, n, *told])
    return markdown_table(["Objective", "N", "position RMSE", "attitude RMSE"], rows)


def designs_block(tables: Mapping[str, pd.DataFrame]) -> str:
    """Value, bound and gap of the designs that have a bound."""
    table = _of(tables, "design").dropna(subset=["high"])
    return markdown_table(
        ["design", "N", "objective", "found", "bound", "gap, %"],
        [
            [f"`{row.name}`", row.observers, row.quantity, f"{row.mean:.4g}", f"{row.high:.4g}",
             f"{100.0 * (row.high / row.mean - 1.0):.2f}"]
            for row in table.itertuples(index=False)
        ],
    )  # fmt: skip


def elsewhere_block(tables: Mapping[str, pd.DataFrame]) -> str:
    """Information about other sets and single classes of targets, by what was chosen on."""
    groups = _of(tables, "elsewhere").groupby(["variant", "observers"], sort=False)
    rows = []
    for (targets, n), own in groups:
        found = own.set_index("name")["mean"]
        chosen = [
            f"{found[on]:.2f}" if on in found else DASH
            for on in ("these", "the campaign's", "others")
        ]
        rows.append([targets, n, *chosen])
    header = ["targets", "N", "chosen on these", "on the campaign's", "on all but these"]
    return markdown_table(header, rows)


OBJECTIVE_BLOCKS = {
    f"{STUDY}-tracking": tracking_block,
    f"{STUDY}-ranks": ranks_block,
    f"{STUDY}-designs": designs_block,
    f"{STUDY}-elsewhere": elsewhere_block,
}
"""What makes each block, by the name in its opening line."""
