"""The paper's claims on tracking as the number of targets grows, beside ours.

Every verdict follows from the realizations by the rule stated in its row; it may be "not
reproduced".
"""

import numpy as np
import xarray as xr

from cislunar.campaign.claims.architecture import BEYOND, NOT_REPRODUCED, PARTLY, REPRODUCED, Claim
from cislunar.campaign.claims.estimators import estimator_claims
from cislunar.campaign.claims.intervals import interval_claims
from cislunar.campaign.claims.verdicts import (
    SATISFACTORY,
    TREND,
    Finding,
    Sweeps,
    graded,
    judged,
    range_finding,
    unsatisfactory,
    usual_interval,
)
from cislunar.campaign.tracking.statistics import t_interval
from cislunar.campaign.tracking.summary import cell_index, seed_values
from cislunar.constants import LENGTH_UNIT_KM

SCENARIOS = ("A", "B", "C")
EQUAL_COUNTS = {"A": 20, "B": 33, "C": 43}
"""Targets where the paper has as many as observers."""

SECTION = "section 5.2.1"
ROTATION_COVERAGE = 0.85
ROTATION_ERROR_DEG = 2.0


def tracking_claims(summary: xr.Dataset) -> list[Claim]:
    """Every claim on tracking.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    list of Claim
        Those that the tracked cells speak to.
    """
    claims = _smallest_cell(summary)
    for scenario in SCENARIOS:
        claims += _translation(summary, scenario)
        claims += _rotation(summary, scenario)
    claims += interval_claims(summary)
    for scenario in SCENARIOS:
        claims += _equal_counts(summary, scenario)
        claims += _attitude_behind(summary, scenario)
    return claims + _architectures(summary) + estimator_claims(summary) + _soundness(summary)


def _smallest_cell(summary: xr.Dataset) -> list[Claim]:
    """Scenario A with as many targets as observers."""

    def most(sweeps: Sweeps) -> Finding | None:
        index = sweeps.cell(20)
        if not index.size:
            return None
        share = t_interval(sweeps.values(index[0], "tracked_share"))
        above = share.low > 0.5 or (share.count < 2 and share.mean > 0.5)
        verdict = REPRODUCED if above else PARTLY if share.mean > 0.5 else NOT_REPRODUCED
        return Finding(f"{share.text('.2f')} of the targets tracked", verdict)

    def count(quantity: str, paper: int):
        def judge(sweeps: Sweeps) -> Finding | None:
            index = sweeps.cell(20)
            return range_finding(sweeps.values(index[0], quantity), paper) if index.size else None

        return judge

    ranged = "count per seed; reproduced if the paper's lies in the range, partly if 1 outside it"
    return [
        *judged(
            summary, "A", most, where=SECTION, paper="most targets",
            claim="satisfactory rotation and translation for most of 20 targets, scenario A",
            how="share of targets that are observed and not diverged (less than half of the final "
            "4 h within 3 sigma); reproduced if its 95 % interval over seeds lies above 0.5",
        ),
        *judged(
            summary, "A", count("never_observed", 1), where=SECTION, paper="1", how=ranged,
            claim="targets of 20 never observed, scenario A",
        ),
        *judged(
            summary, "A", count("diverged_rotation_only", 2), where=SECTION, paper="2",
            how=ranged,
            claim="targets of 20 whose rotation diverges while translation converges, scenario A",
        ),
    ]  # fmt: skip


def _translation(summary: xr.Dataset, scenario: str) -> list[Claim]:
    def judge(sweeps: Sweeps) -> Finding | None:
        index = sweeps.by_targets()
        if not index.size:
            return None
        failing = unsatisfactory(sweeps, index)
        share = 1.0 - len(failing) / index.size
        text = f"satisfactory in {index.size - len(failing)} of {index.size} cells"
        if failing:
            periodic = index.size - len(unsatisfactory(sweeps, index, "anees_mean_periodic"))
            lunar = np.nansum(sweeps.values(index, "diverged_translation_lunar"))
            lost = np.nansum(sweeps.values(index, "diverged_translation"))
            text += (
                f" (not: {' | '.join(failing[:3])}); with the ANEES of targets on periodic orbits "
                f"alone in {periodic}; {lunar:.0f} of {lost:.0f} diverged targets are on low lunar "
                "trajectories"
            )
        return Finding(text, REPRODUCED if not failing else PARTLY if share >= 0.5 else
                       NOT_REPRODUCED)  # fmt: skip

    return judged(
        summary, scenario, judge, where=SECTION, paper="satisfactory for every number of targets",
        claim=f"translation stays satisfactory as targets are added, scenario {scenario}",
        how=f"{SATISFACTORY}; reproduced if in every cell, partly if in at least half",
    )  # fmt: skip


def _rotation(summary: xr.Dataset, scenario: str) -> list[Claim]:
    """Rotation against the number of targets: in error, coverage and divergence."""

    def rising(quantity: str, part: str | None, form: str, factor: float, falls: bool = False):
        def judge(sweeps: Sweeps) -> Finding | None:
            index = sweeps.by_targets()
            if index.size < 2:
                return None
            slope = sweeps.trend(index, "targets", quantity, part)
            means = np.nanmean(sweeps.values(index, quantity, part), axis=0)
            targets = summary["targets"].values[index]
            holds = slope.below_zero if falls else slope.above_zero
            leaning = slope.mean < 0.0 if falls else slope.mean > 0.0
            text = (
                f"{factor * means[0]:{form}} at {targets[0]}, {factor * means[-1]:{form}} at "
                f"{targets[-1]}, {slope.scaled(factor).text(form)} per doubling"
            )
            return Finding(text, REPRODUCED if holds else PARTLY if leaning else NOT_REPRODUCED)

        return judge

    rule = f"{TREND} of n_T; reproduced if it lies wholly {{}} zero, partly if only its middle does"
    claims = []
    for claim, quantity, part, form, factor, falls in (
        ("median attitude RMSE rises with the number of targets, deg", "rmse_median", "attitude",
         ".3g", np.rad2deg(1.0), False),
        ("median final attitude error rises with the number of targets, deg",
         "final_attitude_error_median", None, ".3g", 1.0, False),
        ("attitude coverage falls with the number of targets", "coverage", "attitude", ".3f", 1.0,
         True),
        ("rotational divergences become more frequent with the number of targets (count)",
         "diverged_rotation", None, ".3g", 1.0, False),
        ("rotational divergences become more frequent with the number of targets (share of "
         "observed)", "diverged_rotation_share", None, ".3f", 1.0, False),
    ):  # fmt: skip
        claims += judged(
            summary, scenario, rising(quantity, part, form, factor, falls), where=SECTION,
            paper="rotation becomes progressively more difficult", how=rule.format(
                "below" if falls else "above"), claim=f"{claim}, scenario {scenario}",
        )  # fmt: skip
    return claims


def _equal_counts(summary: xr.Dataset, scenario: str) -> list[Claim]:
    targets = EQUAL_COUNTS[scenario]

    def judge(sweeps: Sweeps) -> Finding | None:
        index = sweeps.cell(targets)
        if not index.size:
            return None
        covered = t_interval(sweeps.values(index[0], "coverage", "attitude"))
        final = t_interval(sweeps.values(index[0], "final_attitude_error_median"))
        good = not unsatisfactory(sweeps, index)
        text = (
            f"attitude coverage {covered.text('.3f')}, final attitude error {final.text('.2f')} "
            f"deg, translation {'' if good else 'not '}satisfactory"
        )
        holds = [covered.mean >= ROTATION_COVERAGE, final.mean < ROTATION_ERROR_DEG, good]
        return Finding(text, graded(holds))

    return judged(
        summary, scenario, judge, where="section 6", paper="satisfactory",
        claim=f"rotation and translation of {targets} targets by as many observers, scenario "
        f"{scenario}",
        how=f"mean attitude coverage at least {ROTATION_COVERAGE}, median final attitude error "
        f"below {ROTATION_ERROR_DEG:.0f} deg, translation satisfactory; reproduced if all, partly "
        "if any",
    )  # fmt: skip


def _attitude_behind(summary: xr.Dataset, scenario: str) -> list[Claim]:
    def judge(sweeps: Sweeps) -> Finding | None:
        index = sweeps.all_cells()
        if not index.size:
            return None
        behind = sweeps.values(index, "coverage", "attitude") - sweeps.values(
            index, "coverage", "position"
        )
        below = [t_interval(column).below_zero for column in behind.T]
        text = f"in {sum(below)} of {len(below)} cells, by {-np.nanmean(behind):.3f} on average"
        share = np.mean(below)
        verdict = REPRODUCED if share == 1.0 else PARTLY if share > 0.5 else NOT_REPRODUCED
        return Finding(text, verdict)

    return judged(
        summary, scenario, judge, where="section 6", paper="comparatively degraded",
        claim=f"attitude is estimated less consistently than translation, scenario {scenario}",
        how="coverage of attitude less that of position, seed by seed; reproduced if the 95 % "
        "interval lies below zero in every cell, partly if in most",
    )  # fmt: skip


def _architectures(summary: xr.Dataset) -> list[Claim]:
    """Tracking by every architecture that tracked the same targets."""
    claims = []
    names = list(dict.fromkeys(summary["architecture"].values.astype(str)))
    for scenario in SCENARIOS:
        plain = {
            name: cell_index(
                summary, scenario=scenario, architecture=name, estimator="mukf", variant=""
            )
            for name in names
        }
        others = [name for name in names if name not in ("published", "tpe") and plain[name].size]
        for targets in sorted(
            {int(n) for o in others for n in summary["targets"].values[plain[o]]}
        ):
            parts = []
            for name in names:
                index = cell_index(
                    summary, scenario=scenario, architecture=name, estimator="mukf", variant="",
                    targets=targets, interval_minutes=usual_interval(summary),
                )  # fmt: skip
                if index.size:
                    parts.append(_described(summary, name, int(index[0])))
            claims.append(
                Claim("-", f"tracking of {targets} targets by each architecture, scenario "
                      f"{scenario}", "-", "; ".join(parts),
                      "means over seeds with 95 % intervals, same targets and noise", BEYOND)
            )  # fmt: skip
    return claims


def _described(summary: xr.Dataset, name: str, index: int) -> str:
    def mean(quantity: str, part: str | None = None, factor: float = 1.0, form: str = ".3g") -> str:
        return t_interval(factor * seed_values(summary, index, quantity, part)).text(form)

    observers = int(summary["observers"].values[index])
    return (
        f"{name} ({observers} observers): position RMSE "
        f"{mean('rmse_median', 'position', LENGTH_UNIT_KM)} km, final attitude error "
        f"{mean('final_attitude_error_median')} deg, never observed {mean('never_observed')}, "
        f"rotation diverged {mean('diverged_rotation')}"
    )


def _soundness(summary: xr.Dataset) -> list[Claim]:
    """Events that would cast doubt on the rest."""
    usual = cell_index(summary, variant="")
    counts = {
        what: int(np.nansum(summary[name].values[usual]))
        for name, what in (
            ("cholesky_failures", "failed Cholesky factorizations"),
            ("failed", "estimates that came to an end"),
            ("dark_sigma_points", "dark sigma points"),
            ("out_of_field", "measurements outside the field of view"),
        )
    }
    text = ", ".join(f"{count} {what}" for what, count in counts.items())
    return [
        Claim("-", "numerical events in all sweeps", "-", text,
              f"counted over {usual.size} cells and all seeds", BEYOND)
    ]  # fmt: skip
