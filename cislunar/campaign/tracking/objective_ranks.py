"""Whether what an architecture is chosen for goes with how well it tracks: rank correlations."""

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.stats import norm, spearmanr

from cislunar.campaign.settings.cells import FEWEST_RANKED
from cislunar.campaign.tracking.statistics import CONFIDENCE, Interval

OBJECTIVES = ("J", "union_coverage", "target_days", "information_nat", "attitude_nat")
"""Columns of ``tables/objectives_{scenario}.csv``; more is better."""

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
"""Quantity, part and unit in ``tables/tracking.csv``, and the sign that makes more better."""

_DIGITS = 9  # values that agree in these are ties: ranks must not hang on rounding
_GROUP = ["scenario", "estimator", "variant", "targets", "interval_minutes", "observers"]


def rank_correlation(one: ArrayLike, other: ArrayLike) -> Interval:
    """Spearman's rank correlation with its 95 % confidence interval; NaN for too few.

    The interval is symmetric in Fisher's z with the variance (1 + rho^2 / 2) / (n - 3) of
    D. G. Bonett and T. A. Wright, Psychometrika 65 (2000). Values equal in nine digits are ties.
    """
    pairs = np.array([one, other], dtype=float)
    pairs = pairs[:, np.isfinite(pairs).all(axis=0)]
    count = pairs.shape[1]
    rounded = [[float(f"{value:.{_DIGITS}g}") for value in row] for row in pairs]
    if count < FEWEST_RANKED or any(len(set(row)) == 1 for row in rounded):
        return Interval(np.nan, np.nan, np.nan, count)
    rho = float(spearmanr(*rounded).statistic)
    # z is infinite where all ranks agree
    z = np.arctanh(np.clip(rho, -1.0 + 1e-12, 1.0 - 1e-12))
    half = norm.ppf(0.5 + 0.5 * CONFIDENCE) * np.sqrt((1.0 + 0.5 * rho**2) / (count - 3))
    return Interval(rho, *np.tanh([z - half, z + half]).tolist(), count)


def _filled(texts: pd.Series) -> pd.Series:
    """A column of texts, empty where a table has nothing."""
    return texts.astype(object).fillna("")


def rank_rows(objectives: pd.DataFrame, tracking: pd.DataFrame) -> pd.DataFrame:
    """Rows of ``tables/objective_ranks.csv``, from the tables of objectives and of tracking.

    For every group of cells that differ in their architecture alone, and have as many observers:
    how far larger values of each objective go with better tracking. Groups of fewer architectures
    than `FEWEST_RANKED` are left out.
    """
    named = objectives[_filled(objectives["front"]) == ""]
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
                told = dict(zip(_GROUP, group, strict=True)) | {"objective": objective} | labels
                rows.append(
                    told
                    | {"correlation": found.mean, "low": found.low, "high": found.high}
                    | {"architectures": found.count}
                )
    columns = [*_GROUP, "objective", "quantity", "part", "unit"]
    return pd.DataFrame(rows, columns=[*columns, "correlation", "low", "high", "architectures"])
