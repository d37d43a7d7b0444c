"""Tables of tracking: every cell with confidence intervals, effects of changed settings, and
ranks."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.campaign.settings.cells import FEWEST_RANKED, unpooled_variant
from cislunar.campaign.tracking.comparisons import Paired, paired, rank_correlation
from cislunar.campaign.tracking.model_errors import NONE, ModelError, model_errors
from cislunar.campaign.tracking.realizations import CELL, MEASURE, by_measure, realizations, select
from cislunar.campaign.tracking.summary import CHARACTERIZED
from cislunar.estimation.light_curves.model_selection.characterization import ATTITUDE_STATUS_NAMES
from cislunar.evaluation.intervals import GEOMETRIC_MEANS, SPANS_DECADES, group_means, interval_of
from cislunar.runtime import Array

_PLACE = ["scenario", "architecture", "estimator", "variant"]
_PLACE += ["observers", "targets", "interval_minutes"]


def tracking_rows(summary: xr.Dataset) -> pd.DataFrame:
    """Rows of ``tables/tracking.csv``, from ``task2/summary.nc``.

    For every cell and quantity, with every part of the state and unit: mean over the realizations
    with its 95 % confidence interval (Student's t; of the logarithm for quantities with geometric
    means, see `interval_of`; of counts and shares of targets no narrower than the exact ones),
    limited to possible values, smallest and largest, and in `average` whether the mean is
    `arithmetic` or `geometric`. The mean of ANEES is arithmetic, and its largest value is that of
    the worst realization. Quantity `rmse_*` appears in the paper's units
    and in practical ones.
    """
    heads, values = by_measure(realizations(summary))
    found = map(_statistics, heads["quantity"], heads["targets"], values)
    return heads[[*_PLACE, *MEASURE]].join(pd.DataFrame(found, columns=_STATISTICS))


_STATISTICS = ["mean", "low", "high", "smallest", "largest", "seeds", "average"]


def _statistics(quantity: str, targets: int, values: Array, days: Array | None = None) -> tuple:
    """Mean, interval, range and number of some realizations of a quantity, which may be grouped by
    their days, and which mean it is."""
    finite = values[np.isfinite(values)]
    mean, low, high, _ = interval_of(quantity, values, targets, days)
    ends = (finite.min(), finite.max()) if finite.size else (np.nan, np.nan)
    average = "geometric" if quantity.startswith(GEOMETRIC_MEANS) else "arithmetic"
    return mean, low, high, *ends, finite.size, average


MEASURES = (
    ("rmse_geometric_all", "position", "km", -1.0),
    ("rmse_geometric_all", "attitude", "degree", -1.0),
    ("rmse_median_all", "position", "km", -1.0),
    ("rmse_median", "position", "km", -1.0),
    ("rmse_median_all", "attitude", "degree", -1.0),
    ("final_attitude_error_median", "", "degree", -1.0),
    ("never_observed", "", "1", -1.0),
    ("tracked_share", "", "1", 1.0),
)
"""Quantities with part and unit that objectives are ranked by, and the sign that makes more
better."""

_POOLED_QUANTITIES = (
    *(measure[:3] for measure in MEASURES),
    ("custody_share", "", "1"),
    ("position_custody_share", "", "1"),
    ("attitude_custody_share", "", "1"),
    ("accurate_attitude_share", "", "1"),
    ("final_error_geometric_all", "position", "km"),
    ("final_error_geometric_all", "attitude", "degree"),
    *((name, "", "1") for name in ("never_visible", "missed")),
    *(("coverage", part, "1") for part in ("attitude", "position", "velocity")),
    *(("anees_mean", part, "1") for part in ("attitude", "position", "velocity")),
    ("inconsistent_rotation", "", "1"),
    ("inconsistent_translation", "", "1"),
    ("failed", "", "1"),
    *((f"{name}_attitude_share", "", "1") for name in ATTITUDE_STATUS_NAMES),
    ("anees_unique", "", "1"),
    ("bright", "", "1"),
    *((f"{name}_within_share", "", "1") for name in CHARACTERIZED),
    ("spin_period_width_median", "", "%"),
    ("spin_axis_width_median", "", "degree"),
)
"""Quantities with part and unit."""


def pooled_rows(summary: xr.Dataset, pooled: Sequence[str]) -> pd.DataFrame:
    """Rows of ``tables/pooled.csv``, from ``task2/summary.nc``: as `tracking_rows`, over days.

    Parameters
    ----------
    summary : xarray.Dataset
        Realizations of all cells.
    pooled : sequence of str
        Names of the configuration key `task2.variants.pooled`: the variants that repeat the
        unchanged cell on another day, and in ``{variant}-{name}`` a changed one. Realizations of a
        day share its geometry and its targets, and count as one group in the intervals.

    Returns
    -------
    pandas.DataFrame
        In addition, the number of `days`, and in `by_day` the mean of each day, first that of the
        day that is not repeated and then those of `pooled` in their order, separated by spaces
        (`nan` for a day without realizations). Days are geometric means where `mean` is.
    """
    frame = realizations(summary).set_index(MEASURE, drop=False)
    frame = frame.loc[frame.index.isin(_POOLED_QUANTITIES)].reset_index(drop=True)
    places = {name: unpooled_variant(name, pooled) for name in frame["variant"].unique()}
    days = frame["variant"].map({name: place[1] for name, place in places.items()})
    variants = frame["variant"].map({name: place[0] for name, place in places.items()})
    frame = frame.assign(variant=variants, day=days)
    heads, found = [], []
    for head, own in frame.groupby([*_PLACE, *MEASURE], sort=False):
        place = dict(zip([*_PLACE, *MEASURE], head, strict=True))
        quantity, values, day = place["quantity"], own["value"].to_numpy(float), own["day"]
        logarithmic = quantity.startswith(GEOMETRIC_MEANS)
        averaged = np.log(np.where(values > 0.0, values, np.nan)) if logarithmic else values
        means = group_means(averaged, day)
        each = np.array([means.get(name, np.nan) for name in ("", *pooled)])
        each = np.exp(each) if logarithmic else each
        heads.append(place)
        found.append(
            (
                *_statistics(quantity, place["targets"], values, day.to_numpy()),
                len(means),
                " ".join(f"{mean:.6g}" for mean in each),
            )
        )
    return pd.DataFrame(heads).join(pd.DataFrame(found, columns=[*_STATISTICS, "days", "by_day"]))


def compared(
    changed: pd.DataFrame, usual: pd.DataFrame, differing: str
) -> tuple[pd.DataFrame, list[Paired]]:
    """Cells beside those that differ from them in one label alone, realization by realization.

    Both are `realizations`; `differing` is the label of `CELL`; cells without a usual one are left
    out. Returns the rows of cell and measure, and a pair for each; for `SPANS_DECADES` of decimal
    logarithms, as the quantity then states.
    """
    keys = [key for key in (*CELL, *MEASURE, "seed") if key != differing]
    both = changed.merge(usual[[*keys, "value"]], on=keys, suffixes=("", "_usual"))
    heads, after = by_measure(both)
    _, before = by_measure(both, "value_usual")
    decades = heads["quantity"].str.startswith(SPANS_DECADES).to_numpy(bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        before, after = (
            np.where(decades[:, None], np.log10(each), each) for each in (before, after)
        )
    heads["quantity"] = np.where(decades, "log10_", "") + heads["quantity"]
    return heads, [paired(*each) for each in zip(before, after, strict=True)]


def reading_rows(summary: xr.Dataset) -> pd.DataFrame:
    """Rows of ``tables/readings_tracking.csv``, from ``task2/summary.nc``.

    For every variant and quantity: means over the common realizations of the usual and of the
    changed cell, and their difference, realization by realization, with its 95 % confidence
    interval (Student's t). ANEES and error over bound as decimal logarithms.
    """
    frame = realizations(summary)
    usual = frame["variant"] == ""
    heads, pairs = compared(frame[~usual], frame[usual], "variant")
    columns = ["usual", "changed", "difference", "low", "high", "seeds"]
    found = [(each.first, each.other, *each.difference) for each in pairs]
    return heads[[*_PLACE, *MEASURE]].join(pd.DataFrame(found, columns=columns))


def estimator_rows(summary: xr.Dataset) -> pd.DataFrame:
    """Rows of ``tables/estimators.csv``, from ``task2/summary.nc``.

    For every cell that both the first estimator and another one ran: as `reading_rows`, with the
    largest value of each.
    """
    frame = realizations(summary)
    first = frame["estimator"] == frame["estimator"].iloc[0]
    heads, pairs = compared(frame[~first], frame[first], "estimator")
    heads = heads.rename(columns={"estimator": "other_estimator"})
    heads["first_estimator"] = frame["estimator"].iloc[0]
    columns = ["first", "other", "first_largest", "other_largest", "difference", "low", "high"]
    found = [(*each[:4], *each.difference) for each in pairs]
    place = ["scenario", "architecture", "observers", "targets", "interval_minutes", "variant"]
    place += ["first_estimator", "other_estimator", *MEASURE]
    return heads[place].join(pd.DataFrame(found, columns=[*columns, "seeds"]))


ERROR_QUANTITIES = (
    ("coverage", "attitude", "1"),
    ("final_attitude_error_median", "", "degree"),
    ("final_attitude_error_90", "", "degree"),
    ("inconsistent_rotation", "", "1"),
    ("rmse_median", "position", "km"),
)
"""Quantities with part and unit."""

_OF_ERROR = ["scenario", "architecture", "estimator", "targets", "interval_minutes"]

ERROR_COLUMNS = [
    *("scenario", "architecture", "estimator", "variant", "targets", "interval_minutes"),
    *("error", "kind", "size", "size_unit", "also", "quantity", "part", "unit"),
    *("mean", "low", "high", "usual", "difference", "difference_low", "difference_high", "seeds"),
]


def model_error_rows(summary: xr.Dataset, settings: Mapping[str, Any]) -> pd.DataFrame:
    """Rows of ``tables/model_error.csv``, from ``task2/summary.nc`` and the `model_errors` of the
    configuration key `task2`.

    For every cell of their variants, for the cell without the error (kind `NONE`, size 0), and for
    every quantity: mean over the realizations with its 95 % confidence interval (as in
    ``tables/tracking.csv``), and the difference to the cell without the error, realization by
    realization, with its interval (Student's t). Estimators, errors and cells that the summary
    lacks are left out.
    """
    frame = realizations(summary).set_index(MEASURE, drop=False)
    frame = frame.loc[frame.index.isin(ERROR_QUANTITIES)].reset_index(drop=True)
    rows: list[dict[str, Any]] = []
    compared_with: set[tuple] = set()
    for error in model_errors(settings["task2"]):
        for place, own in select(frame, variant=error.variant).groupby(_OF_ERROR, sort=False):
            identity = dict(zip(_OF_ERROR, place, strict=True))
            usual = select(frame, variant="", **identity)
            if usual.empty:
                continue
            if place not in compared_with:
                compared_with.add(place)
                rows += _error_rows(usual, usual, ModelError("", "", NONE, 0.0, "%", ""))
            rows += _error_rows(own, usual, error)
    return pd.DataFrame(rows, columns=ERROR_COLUMNS)


def _error_rows(
    own: pd.DataFrame, usual: pd.DataFrame, error: ModelError
) -> Iterator[dict[str, Any]]:
    """One row for each quantity of a cell, in their order."""
    described = error._asdict()
    described["size_unit"] = described.pop("unit")
    heads, pairs = compared(own, usual, "variant")
    found = {
        tuple(head[key] for key in MEASURE): (head, each, values)
        for head, each, values in zip(
            heads.to_dict("records"), pairs, by_measure(own)[1], strict=True
        )
    }
    for head, each, values in map(found.get, ERROR_QUANTITIES):
        mean = interval_of(head["quantity"], values, head["targets"])
        yield {
            **head,
            **described,
            **{"mean": mean.mean, "low": mean.low, "high": mean.high, "usual": each.first},
            "difference": each.difference.mean,
            "difference_low": each.difference.low,
            "difference_high": each.difference.high,
            "seeds": each.difference.count,
        }


OBJECTIVES = ("J", "union_coverage", "target_days", "information_nat", "attitude_nat")
"""Columns of ``tables/objectives_{scenario}.csv``; more is better."""

_GROUP = ["scenario", "estimator", "variant", "targets", "interval_minutes", "observers"]


def _filled(texts: pd.Series) -> pd.Series:
    """A column of texts, empty where a table has no entry."""
    return texts.astype(object).fillna("")


def rank_rows(objectives: Sequence[pd.DataFrame], tracking: pd.DataFrame) -> pd.DataFrame:
    """Rows of ``tables/objective_ranks.csv``, from the tables of objectives and of tracking, or of
    tracking over days (`pooled_rows`).

    For every group of cells that differ only in their architecture and have the same number of
    observers: rank correlation of each objective with tracking performance. Groups of fewer
    architectures than `FEWEST_RANKED` are left out.
    """
    every = pd.concat(objectives)
    named = every[_filled(every["front"]) == ""]
    both = tracking.assign(**{key: _filled(tracking[key]) for key in ("variant", "part")})
    both = both.merge(named[["scenario", "architecture", *OBJECTIVES]], how="inner")
    rows = []
    for group, cells in both.groupby(_GROUP, sort=False):
        for quantity, part, unit, sign in MEASURES:
            labels = {"quantity": quantity, "part": part, "unit": unit}
            own = cells[(cells[list(labels)] == list(labels.values())).all(axis=1)]
            if own["architecture"].nunique() < FEWEST_RANKED:
                continue
            for objective in OBJECTIVES:
                found = rank_correlation(own[objective], sign * own["mean"])
                row = dict(zip(_GROUP, group, strict=True)) | {"objective": objective} | labels
                rows.append(
                    row
                    | {"correlation": found.mean, "low": found.low, "high": found.high}
                    | {"architectures": found.count}
                )
    columns = [*_GROUP, "objective", "quantity", "part", "unit"]
    return pd.DataFrame(rows, columns=[*columns, "correlation", "low", "high", "architectures"])
