"""The second attitude estimator against the paper's filter, on the paper's own sweeps."""

import numpy as np
import xarray as xr

from cislunar.campaign.claims.architecture import BEYOND, Claim
from cislunar.campaign.claims.verdicts import usual_interval
from cislunar.campaign.tracking.statistics import log_interval, t_interval
from cislunar.campaign.tracking.summary import cell_index, seed_values

FILTER, BATCH = "mukf", "batch"

COUNTS = (20, 33, 43, 50, 100, 202)
"""Numbers of targets compared: the fewest of each scenario of the paper, a few more, and all."""


def estimator_claims(summary: xr.Dataset) -> list[Claim]:
    """What the batch estimator gets where the paper reports divergences.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    list of Claim
        One for each cell with `COUNTS` targets of the first architecture that both estimators ran.
    """
    usual = usual_interval(summary)
    claims = []
    first = str(summary["architecture"].values[0])
    for index in cell_index(
        summary, estimator=BATCH, variant="", interval_minutes=usual, architecture=first
    ):
        if int(summary["targets"].values[index]) not in COUNTS:
            continue
        labels = {
            key: summary[key].values[index] for key in ("scenario", "architecture", "targets")
        }
        other = cell_index(summary, estimator=FILTER, variant="", interval_minutes=usual, **labels)
        if other.size:
            where = (
                f"scenario {labels['scenario']}, {labels['architecture']}, "
                f"{int(labels['targets'])} targets"
            )
            claims.append(
                Claim("-", f"attitude by the batch estimator and by the filter, {where}", "-",
                      _both(summary, int(index), int(other[0])),
                      "batch, then filter; means over the same realizations with 95 % intervals, "
                      "largest number of divergences in brackets", BEYOND)
            )  # fmt: skip
    return claims


def _both(summary: xr.Dataset, batch: int, filtered: int) -> str:
    pair = (batch, filtered)

    def means(quantity: str, part: str | None = None, form: str = ".3g") -> str:
        interval = log_interval if quantity.startswith("bound_ratio") else t_interval
        return " and ".join(
            interval(seed_values(summary, index, quantity, part)).text(form) for index in pair
        )

    most = " and ".join(
        f"{np.nanmax(seed_values(summary, index, 'diverged_rotation')):.0f}" for index in pair
    )
    return (
        f"coverage {means('coverage', 'attitude', '.3f')}; diverged "
        f"{means('diverged_rotation', None, '.1f')} ({most}); final error, median "
        f"{means('final_attitude_error_median')} deg, 90th percentile "
        f"{means('final_attitude_error_90')} deg; error over bound, median "
        f"{means('bound_ratio_median', 'attitude', '.2f')}"
    )
