"""The paper's claims on tracking as the tasking interval grows, beside ours."""

import numpy as np
import xarray as xr

from cislunar.campaign.claims.architecture import NOT_REPRODUCED, PARTLY, REPRODUCED, Claim
from cislunar.campaign.claims.verdicts import (
    SATISFACTORY,
    TREND,
    Finding,
    Indices,
    Sweeps,
    graded,
    judged,
    unsatisfactory,
)
from cislunar.campaign.tracking.statistics import t_interval

SECTION = "section 5.2.2"
MODEST = 2.0
"""Largest ratio of the median position RMSE that is still a modest degradation."""

_ALONG = "interval_minutes"


def interval_claims(summary: xr.Dataset) -> list[Claim]:
    """Every claim on the tasking interval.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    list of Claim
        Those that the tracked cells speak to.
    """
    return [
        *_modest_translation(summary, "A", 20),
        *_no_rotation_trend(summary),
        *_better_at_three_hours(summary),
        *_rotation_change(summary),
        *_more_divergence(summary),
        *_modest_translation(summary, "B", 33),
        *_pronounced(summary),
        *_multiple_divergences(summary),
        *_translation_behaves(summary),
        *_more_sensitive(summary),
    ]


def _swept(sweeps: Sweeps, targets: int) -> Indices | None:
    """Cells of the sweep over the interval, if there are at least two."""
    index = sweeps.by_interval(targets)
    return index if index.size >= 2 else None


def _ends(sweeps: Sweeps, index: Indices) -> str:
    minutes = sweeps.summary[_ALONG].values[index]
    return f"{minutes[0]} -> {minutes[-1]} min"


def _modest_translation(summary: xr.Dataset, scenario: str, targets: int) -> list[Claim]:
    def judge(sweeps: Sweeps) -> Finding | None:
        index = _swept(sweeps, targets)
        if index is None:
            return None
        rmse = sweeps.values(index, "rmse_median", "position")
        growth = t_interval(np.log(rmse[:, -1] / rmse[:, 0]))
        ratio = growth._replace(mean=np.exp(growth.mean), low=np.exp(growth.low),
                                high=np.exp(growth.high))  # fmt: skip
        good = not unsatisfactory(sweeps, index)
        text = (
            f"position RMSE x {ratio.text('.2f')} from {_ends(sweeps, index)}, "
            f"{'' if good else 'not '}satisfactory throughout"
        )
        return Finding(text, graded([growth.above_zero, ratio.mean <= MODEST, good]))

    return judged(
        summary, scenario, judge, where=SECTION, paper="modest degradation, still satisfactory",
        claim=f"translation against the tasking interval, scenario {scenario}, {targets} targets",
        how=f"ratio of the median position RMSE, seed by seed: 95 % interval above 1, mean at most "
        f"{MODEST}; and {SATISFACTORY}; reproduced if all three, partly if any",
    )  # fmt: skip


def _no_rotation_trend(summary: xr.Dataset) -> list[Claim]:
    quantities = {"coverage": ".3f", "anees_median": ".2f", "rmse_median": ".4f"}

    def judge(sweeps: Sweeps) -> Finding | None:
        index = _swept(sweeps, 20)
        if index is None:
            return None
        found = {q: sweeps.trend(index, _ALONG, q, "attitude") for q in quantities}
        flat = [not (slope.above_zero or slope.below_zero) for slope in found.values()]
        text = ", ".join(f"{q} {slope.text(quantities[q])}" for q, slope in found.items())
        return Finding(text, graded(flat))

    return judged(
        summary, "A", judge, where=SECTION, paper="no clear trend",
        claim="rotation against the tasking interval, scenario A, 20 targets",
        how=f"{TREND} of T_ST, of attitude coverage, log10 median ANEES and median RMSE; "
        "reproduced if all three contain zero, partly if any does",
    )  # fmt: skip


def _better_at_three_hours(summary: xr.Dataset) -> list[Claim]:
    def judge(sweeps: Sweeps) -> Finding | None:
        cells = [sweeps.cell(20, minutes) for minutes in (120, 180, 240)]
        if not all(cell.size for cell in cells):
            return None
        two, three, four = (
            0.5 * sum(sweeps.values(cell[0], "anees_median", part)
                      for part in ("attitude", "angular_velocity"))
            for cell in cells
        )  # fmt: skip
        dip = t_interval(three - 0.5 * (two + four))
        verdict = REPRODUCED if dip.below_zero else PARTLY if dip.mean < 0.0 else NOT_REPRODUCED
        return Finding(f"{dip.text('.3f')}", verdict)

    return judged(
        summary, "A", judge, where=SECTION, paper="modest improvement at 3 h",
        claim="component-wise ANEES of rotation at T_ST = 3 h, scenario A, 20 targets",
        how="log10 median ANEES at 3 h less the mean of 2 h and 4 h, seed by seed; reproduced if "
        "its 95 % interval lies below zero, partly if its middle does",
    )  # fmt: skip


def _rotation_change(summary: xr.Dataset) -> list[Claim]:
    def judge(sweeps: Sweeps) -> Finding | None:
        index = _swept(sweeps, 33)
        if index is None:
            return None
        covered = sweeps.change(index, "coverage", "attitude")
        anees = sweeps.change(index, "anees_median", "attitude")
        rmse = sweeps.change(index, "rmse_median", "attitude")
        text = (
            f"{_ends(sweeps, index)}: coverage {covered.text('.3f')}, log10 ANEES "
            f"{anees.text('.2f')}, RMSE {rmse.text('.4f')}"
        )
        return Finding(text, graded([covered.below_zero, anees.above_zero, rmse.above_zero]))

    return judged(
        summary, "B", judge, where=SECTION,
        paper="noticeable degradation: less coverage, larger ANEES and RMSE",
        claim="rotation from the shortest to the longest tasking interval, scenario B, 33 targets",
        how="change of attitude coverage, log10 median ANEES and median RMSE, seed by seed: 95 % "
        "interval beyond zero; reproduced if all three, partly if any",
    )  # fmt: skip


def _more_divergence(summary: xr.Dataset) -> list[Claim]:
    def judge(sweeps: Sweeps) -> Finding | None:
        index = _swept(sweeps, 33)
        if index is None:
            return None
        more = sweeps.change(index, "diverged_rotation")
        verdict = REPRODUCED if more.above_zero else PARTLY if more.mean > 0.0 else NOT_REPRODUCED
        return Finding(f"{_ends(sweeps, index)}: {more.text('+.2f')} targets", verdict)

    return judged(
        summary, "B", judge, where=SECTION, paper="increased occurrence",
        claim="attitude divergence from the shortest to the longest tasking interval, scenario B, "
        "33 targets",
        how="change of the number of targets with diverged rotation, seed by seed; reproduced if "
        "its 95 % interval lies above zero, partly if its middle does",
    )  # fmt: skip


def _pronounced(summary: xr.Dataset) -> list[Claim]:
    quantities = {"anees_median": ".2f", "rmse_median": ".4f", "rmse_90": ".4f"}

    def judge(sweeps: Sweeps) -> Finding | None:
        index = _swept(sweeps, 50)
        if index is None:
            return None
        found = {q: sweeps.trend(index, _ALONG, q, "attitude") for q in quantities}
        text = ", ".join(f"{q} {slope.text(quantities[q])}" for q, slope in found.items())
        return Finding(text, graded([slope.above_zero for slope in found.values()]))

    return judged(
        summary, "A", judge, where=SECTION, paper="increasingly pronounced degradation",
        claim="rotation against the tasking interval, scenario A, 50 targets",
        how=f"{TREND} of T_ST, of attitude's log10 median ANEES, median and 90th percentile of "
        "RMSE; reproduced if all lie above zero, partly if any does",
    )  # fmt: skip


def _multiple_divergences(summary: xr.Dataset) -> list[Claim]:
    def judge(sweeps: Sweeps) -> Finding | None:
        index = _swept(sweeps, 50)
        if index is None:
            return None
        counts = sweeps.values(index, "diverged_rotation")
        several = np.nanmean(counts >= 2)
        slope = sweeps.trend(index, _ALONG, "diverged_rotation")
        text = (
            f"two or more in {several:.0%} of runs, {np.nanmean(counts):.1f} on average, "
            f"{slope.text('+.2f')} per doubling of T_ST"
        )
        verdict = REPRODUCED if several >= 0.95 else PARTLY if several >= 0.5 else NOT_REPRODUCED
        return Finding(text, verdict)

    return judged(
        summary, "A", judge, where=SECTION, paper="multiple divergence events",
        claim="rotational divergences over the tasking intervals, scenario A, 50 targets",
        how="runs (seed and interval) with at least two diverged targets; reproduced if 95 % of "
        "them, partly if half",
    )  # fmt: skip


def _translation_behaves(summary: xr.Dataset) -> list[Claim]:
    def judge(sweeps: Sweeps) -> Finding | None:
        index = _swept(sweeps, 50)
        if index is None:
            return None
        failing = unsatisfactory(sweeps, index)
        count = np.nanmean(sweeps.values(index, "diverged_translation"))
        text = (
            f"satisfactory in {index.size - len(failing)} of {index.size} cells, {count:.2f} "
            "diverged targets on average"
        )
        return Finding(text, graded([not failing, len(failing) < index.size]))

    return judged(
        summary, "A", judge, where=SECTION, paper="comparatively well behaved",
        claim="translation over the tasking intervals, scenario A, 50 targets",
        how=f"{SATISFACTORY}; reproduced if in every cell, partly if in any",
    )  # fmt: skip


def _more_sensitive(summary: xr.Dataset) -> list[Claim]:
    def judge(sweeps: Sweeps) -> Finding | None:
        few, many = _swept(sweeps, 20), _swept(sweeps, 50)
        if few is None or many is None:
            return None
        differences = {
            name: sweeps.change_of_changes(few, many, quantity, part)
            for name, quantity, part in (
                ("attitude RMSE", "rmse_median", "attitude"),
                ("diverged targets, share", "diverged_rotation_share", None),
            )
        }
        text = ", ".join(f"{name} {found.text('.3g')}" for name, found in differences.items())
        return Finding(text, graded([found.above_zero for found in differences.values()]))

    return judged(
        summary, "A", judge, where="section 6", paper="more sensitive at more targets per observer",
        claim="rotation suffers more from long tasking intervals with 50 targets than with 20, "
        "scenario A",
        how="change from the shortest to the longest interval with 50 targets less that with 20, "
        "seed by seed: 95 % interval above zero; reproduced if both, partly if either",
    )  # fmt: skip
