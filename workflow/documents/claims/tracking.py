"""The paper's claims on tracking, judged by the tracked cells, and further comparisons."""

import json
from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.campaign.settings.cells import PAPER_ARCHITECTURES, PAPER_FILTER
from cislunar.campaign.tracking.comparisons import paired
from cislunar.campaign.tracking.realizations import (
    CELL,
    cells_of,
    realizations,
    select,
    usual_interval,
    values_of,
)
from cislunar.evaluation.intervals import Interval, interval_of, t_interval

from .facts import STATISTICS, Sweep
from .judges import Claim, Facts, judge, table

BATCH = "batch"

_METHODS = {"tpe": "TPE", "random": "random tasking", "greedy": "greedy tasking"}
"""Variants that differ in the method of tasking, in words."""

OTHER_SETS = ("other-set", "set-2", "set-3", "set-4")
"""Variants that differ in the monitored targets alone."""

COUNTS = (20, 33, 43, 50, 100, 202)
"""Numbers of targets at which estimators are compared: the smallest of each scenario of the paper,
some larger ones, and all targets."""


def tracking_claims(summary: xr.Dataset) -> list[Claim]:
    """Every claim on tracking for which ``task2/summary.nc`` has the cells."""
    frame = realizations(summary)
    claims = []
    for group in table()["tracking"]:
        for scenario in group["scenarios"]:
            own = select(frame, scenario=scenario, estimator=PAPER_FILTER, variant="")
            for row in group["claims"]:
                claims += _put(row, scenario, own, usual_interval(frame))
    others = _architectures(frame), set_claims(frame), estimator_claims(frame)
    return [*claims, *chain(*others), _events(frame)]


def _put(row: Mapping[str, Any], scenario: str, frame: pd.DataFrame, usual: int) -> list[Claim]:
    """A row of the table judged by the architectures that were tracked; none without its cells."""
    found: dict[str, Facts] = {}
    for name in PAPER_ARCHITECTURES:
        facts = _facts(row, scenario, select(frame, architecture=name), usual)
        if facts is not None:
            found[name] = facts
    return [judge(row, *found.values(), names=list(found))] if found else []


def _facts(row: Mapping[str, Any], scenario: str, frame: pd.DataFrame, usual: int) -> Facts | None:
    """Statistics of a row; None where its cells are missing."""
    targets, along = row.get("targets"), row.get("along")
    targets = targets[scenario] if isinstance(targets, Mapping) else targets
    at = {} if targets is None else {"targets": targets}
    if along == "targets" or (along is None and at):
        at["interval_minutes"] = usual
    sweep = Sweep(select(frame, **at) if at else frame, along or "targets")
    if "beside" in row:
        sweep = sweep._replace(beside=select(frame, targets=row["beside"]))
    least = row.get("least", 1)
    tracked = [each for each in (sweep.frame, sweep.beside) if each is not None]
    if any(len(cells_of(each)) < least for each in tracked):
        return None
    wanted = {name: what.split() for name, what in row["statistics"].items()}
    found = {name: STATISTICS[what](sweep, *of) for name, (what, *of) in wanted.items()}
    if any(value is None for value in found.values()):
        return None
    ends = {"begin": sweep.places[0], "end": sweep.places[-1]}
    return {"scenario": scenario, "targets": targets} | ends | found


def _cells(frame: pd.DataFrame) -> Iterator[tuple[dict[str, Any], pd.DataFrame]]:
    """Every cell with its realizations, in the order of the frame."""
    keys = list(cells_of(frame).columns)
    for labels, own in frame.groupby(keys, sort=False):
        yield dict(zip(keys, labels, strict=True)), own


def _architectures(frame: pd.DataFrame) -> Iterator[Claim]:
    """Tracking by every architecture that tracked the same targets."""
    names = list(dict.fromkeys(frame["architecture"]))
    for scenario in ("A", "B", "C"):
        own = select(frame, scenario=scenario, estimator=PAPER_FILTER, variant="")
        others = own[~own["architecture"].isin(PAPER_ARCHITECTURES)]
        for targets in sorted(set(others["targets"])):
            same = select(own, targets=targets, interval_minutes=usual_interval(frame))
            parts = [
                _described(labels, cell)
                for name in names
                for labels, cell in _cells(select(same, architecture=name))
            ]
            facts = {"targets": targets, "scenario": scenario, "all": "; ".join(parts)}
            facts["first"] = parts[0].split(", final")[0] if parts else "-"
            yield judge(table()["comparisons"]["architectures"], facts)


def set_claims(frame: pd.DataFrame) -> Iterator[Claim]:
    """The effect of the choice of the monitored targets: cells of the usual set and of others.

    Realizations are nested in sets, so that each set counts once, by its mean over realizations.
    """
    for labels, usual in _cells(select(frame, variant="")):
        place = {key: labels[key] for key in CELL if key != "variant"}
        same = select(frame, **place)
        sets = [usual, *(own for at, own in _cells(same) if at["variant"] in OTHER_SETS)]
        if len(sets) < 2:
            continue

        def over_sets(*measure: str, sets=sets, labels=labels) -> Interval:
            values = np.array([values_of(own, *measure)[:, 0] for own in sets])
            number = np.repeat(np.arange(len(sets)), values.shape[1])
            return interval_of(measure[0], values.ravel(), labels["targets"], number)

        facts = {
            "sets": len(sets),
            "coverage": over_sets("coverage", "attitude"),
            "inconsistent": over_sets("inconsistent_rotation"),
            "unseen": over_sets("never_observed"),
            "outside": over_sets("translation_outside_share"),
        }
        yield judge(table()["comparisons"]["sets"], labels | facts)


def _described(labels: Mapping[str, Any], cell: pd.DataFrame) -> str:
    def mean(*measure: str) -> str:
        return f"{interval_of(measure[0], values_of(cell, *measure)[:, 0], labels['targets']):.3g}"

    return (
        f"{labels['architecture']} ({labels['observers']} observers): position RMSE "
        f"{mean('rmse_median', 'position', 'km')} km, final attitude error "
        f"{mean('final_attitude_error_median')} deg, targets never observed "
        f"{mean('never_observed')}, targets with inconsistent rotation "
        f"{mean('inconsistent_rotation')}"
    )


def estimator_claims(frame: pd.DataFrame) -> Iterator[Claim]:
    """The batch estimator beside the paper's filter.

    For each cell with `COUNTS` targets of the first architecture that both estimators ran.
    """
    first = frame["architecture"].iloc[0]
    usual = select(frame, architecture=first, variant="", interval_minutes=usual_interval(frame))
    for labels, batch in _cells(select(usual, estimator=BATCH)):
        place = {key: labels[key] for key in ("scenario", "targets")}
        filtered = select(usual, estimator=PAPER_FILTER, **place)
        if labels["targets"] not in COUNTS or filtered.empty:
            continue

        def means(form: str, *measure: str, pair=(batch, filtered), n=labels["targets"]) -> str:
            return " and ".join(
                f"{interval_of(measure[0], values_of(each, *measure)[:, 0], n):{form}}"
                for each in pair
            )

        most = (np.nanmax(values_of(each, "inconsistent_rotation")) for each in (batch, filtered))
        facts = {
            "coverage": means(".3f", "coverage", "attitude"),
            "inconsistent": means(".1f", "inconsistent_rotation"),
            "most": " and ".join(f"{each:.0f}" for each in most),
            "final": means(".3g", "final_attitude_error_median"),
            "final_90": means(".3g", "final_attitude_error_90"),
            "ratio": means(".2f", "bound_ratio_median", "attitude"),
        }
        yield judge(table()["comparisons"]["estimators"], labels | facts)


def _events(frame: pd.DataFrame) -> Claim:
    """Numerical events that would cast doubt on the other rows."""
    usual = frame[frame["variant"] == ""]
    counts = {
        what: int(np.nansum(values_of(usual, name)))
        for name, what in (
            ("cholesky_failures", "failed Cholesky factorizations"),
            ("failed", "terminated estimates"),
            ("undetectable_sigma_points", "undetectable sigma points"),
            ("out_of_field", "measurements outside the field of view"),
        )
    }
    text = ", ".join(f"{count} {what}" for what, count in counts.items())
    facts = {"events": text, "total": sum(counts.values()), "cells": len(cells_of(usual))}
    return judge(table()["comparisons"]["events"], facts)


def tasking_claims(comparison: xr.Dataset | None, summary: xr.Dataset) -> list[Claim]:
    """Claims on the tasking search: its share of the best information, and its effect on tracking.

    `comparison` is ``task2/tasking_comparison.nc`` if tasking methods have been compared.
    """
    claims = []
    for index in range(comparison.sizes["cell"]) if comparison is not None else ():
        facts = _searched(comparison.isel(cell=index))
        claims += [judge(row, facts) for row in table()["tasking"]] if facts else []
    frame, task2 = realizations(summary), json.loads(summary.attrs["settings"])["task2"]
    for variant in _METHODS:
        for labels, cell in _cells(select(frame, variant=variant)):
            place = {k: v for k, v in labels.items() if k not in ("variant", "observers")}
            usual = select(frame, variant="", **place)
            if not usual.empty:
                claims.append(_changed(labels | {"budget": _budget(task2, variant)}, usual, cell))
    return claims


def _budget(task2: Mapping[str, Any], variant: str) -> str:
    """The budget of a variant's tasking at an epoch."""
    change = task2["variants"]["cells"][variant]["change"]
    used = {**task2["tasking"], **change.get("tasking", {})}
    if used["method"] == "greedy":
        return "-"
    budget = f"at most {used['max_evaluations']} evaluations"
    if used["method"] == "random":
        return budget
    return f"{budget}, stop after {used['early_stop']} without improvement"


def _searched(cell: xr.Dataset) -> Facts:
    """TPE against the exact assignment, random taskings and greedy picking on one cell."""
    best = cell["direct_information"].sel(direct="exact").values
    usable = best > 0.0
    if not usable.any():
        return {}
    tpe, random = cell["information"].values[:, usable] / best[usable][None, :, None, None]
    largest = int(np.flatnonzero(np.isfinite(tpe).any(axis=(0, 1)))[-1])
    greedy = cell["direct_information"].sel(direct="greedy").values[usable] / best[usable]
    share = t_interval(np.nanmean(tpe[..., largest], axis=1))
    return {
        "targets": int(cell["targets"]),
        "observers": int(cell["observers"]),
        "budget": int(cell["budget"].values[largest]),
        "most": int(cell["budget"].values[-1]),
        "early_stop": json.loads(cell.attrs["settings"])["comparison"]["early_stop"],
        # runs at one epoch share its problem: a mean of each, and the interval over epochs
        "share": share._replace(high=min(share.high, max(1.0, share.mean))),
        "gain": t_interval(np.nanmean((tpe - random)[..., largest], axis=1)),
        "random": np.nanmean(random[..., -1]),
        "greedy": greedy.mean(),
        "seconds": np.nanmean(cell["elapsed"].sel(search="tpe").values[..., largest]),
        "exact_ms": 1e3 * cell["direct_elapsed"].sel(direct="exact").values.mean(),
    }


def _changed(labels: Facts, usual: pd.DataFrame, cell: pd.DataFrame) -> Claim:
    """Tracking with another method of tasking, less that with exact tasking."""
    measures = {
        "position": ("rmse_median", "position", "km"),
        "coverage": ("coverage", "attitude"),
        "final": ("final_attitude_error_median",),
        "unseen": ("never_observed",),
    }
    changes = {
        name: paired(values_of(usual, *own)[:, 0], values_of(cell, *own)[:, 0]).difference
        for name, own in measures.items()
    }
    named = {"method": _METHODS[labels["variant"]]}
    return judge(table()["comparisons"]["tasking"], labels | named | changes)
