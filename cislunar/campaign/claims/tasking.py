"""What the searches reach of the best tasking, and what that does to tracking."""

import numpy as np
import xarray as xr

from cislunar.campaign.claims.architecture import BEYOND, NOT_REPRODUCED, PARTLY, REPRODUCED, Claim
from cislunar.campaign.tracking.statistics import t_interval
from cislunar.campaign.tracking.summary import cell_index, seed_values
from cislunar.constants import LENGTH_UNIT_KM

NEAR = 0.95
"""Share of the best information that counts as near-optimal."""


def tasking_claims(comparison: xr.Dataset | None, summary: xr.Dataset) -> list[Claim]:
    """Claims on the tasking search.

    Parameters
    ----------
    comparison : xarray.Dataset or None
        ``task2/tasking_comparison.nc``, if tasking methods have been compared.
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    list of Claim
    """
    claims = []
    for index in range(comparison.sizes["cell"]) if comparison is not None else ():
        claims += _searched(comparison.isel(cell=index))
    return claims + _carried_through(summary)


def _searched(cell: xr.Dataset) -> list[Claim]:
    """TPE against the exact assignment, random taskings and greedy picking on one cell."""
    best = cell["direct_information"].sel(direct="exact").values
    usable = best > 0.0
    if not usable.any():
        return []
    what = f"{int(cell['targets'])} targets, {int(cell['observers'])} observers"
    reached = cell["information"].values[:, usable] / best[usable][None, :, None, None]
    tpe, random = reached
    tried = np.isfinite(tpe).any(axis=(0, 1))
    largest = int(np.flatnonzero(tried)[-1])
    budget = int(cell["budget"].values[largest])
    share = t_interval(tpe[..., largest].ravel())
    gain = t_interval((tpe - random)[..., largest].ravel())
    seconds = cell["elapsed"].sel(search="tpe").values[..., largest]
    exact = cell["direct_elapsed"].sel(direct="exact").values
    greedy = cell["direct_information"].sel(direct="greedy").values[usable] / best[usable]
    long_random = random[..., -1]
    verdict = REPRODUCED if share.mean >= NEAR else PARTLY if share.mean >= 0.9 else NOT_REPRODUCED
    return [
        Claim("section 5.2", f"TPE finds near-optimal sensor-target associations, {what}",
              "near-optimal", f"{share.text('.3f')} of the best information after {budget} "
              "evaluations", f"information over that of the exact assignment, over epochs and "
              f"runs; reproduced if {NEAR} on average, partly if 0.9", verdict),
        Claim("section 4", f"TPE against other methods of tasking, {what}", "-",
              f"TPE less random taskings, same number: {gain.text('+.3f')} of the best; random, "
              f"{int(cell['budget'].values[-1])} taskings: {np.nanmean(long_random):.3f}; greedy: "
              f"{greedy.mean():.4f}; time of TPE {np.nanmean(seconds):.1f} s, of the exact "
              f"assignment {1e3 * exact.mean():.3f} ms",
              "shares of the information of the exact assignment", BEYOND),
    ]  # fmt: skip


def _carried_through(summary: xr.Dataset) -> list[Claim]:
    """Tracking with other methods of tasking, against exact tasking."""
    claims = []
    for variant in ("tpe", "random", "greedy"):
        for index in cell_index(summary, variant=variant):
            keys = ("scenario", "architecture", "estimator", "targets", "interval_minutes")
            same = {key: summary[key].values[index] for key in keys}
            usual = cell_index(summary, variant="", **same)
            if usual.size:
                claims.append(_difference(summary, variant, int(index), int(usual[0])))
    return claims


def _difference(summary: xr.Dataset, variant: str, index: int, usual: int) -> Claim:
    def change(quantity: str, part: str | None = None, factor: float = 1.0) -> str:
        after = seed_values(summary, index, quantity, part)
        before = seed_values(summary, usual, quantity, part)
        return t_interval(factor * (after - before)).text("+.3g")

    text = (
        f"position RMSE {change('rmse_median', 'position', LENGTH_UNIT_KM)} km, attitude coverage "
        f"{change('coverage', 'attitude')}, final attitude error "
        f"{change('final_attitude_error_median')} deg, never observed {change('never_observed')}"
    )
    targets, scenario = int(summary["targets"].values[index]), summary["scenario"].values[index]
    return Claim(
        "-", f"tracking with {variant} less tracking with exact tasking, scenario {scenario}, "
        f"{targets} targets", "-", text,
        "differences seed by seed with 95 % intervals over the common seeds", BEYOND,
    )  # fmt: skip
