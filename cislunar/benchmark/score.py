"""Score of a submission at the scoring epochs.

An object is *findable* at an epoch if it has had detections in at least three passes by then
(`survey.quality.findable_tracklets`). A pass consists of the detections of the object by one
observer of which consecutive ones are at most half an hour apart. Catalog objects are assigned to
objects of the truth by the GOSPA metric of positions (`cislunar.evaluation.gospa`, p = 2,
alpha = 2) with a cutoff of 100 km; each object is assigned to one catalog object at most, so that
further ones are false. All other numbers are of the assigned pairs.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from cislunar.benchmark.files import (
    BenchmarkScenario,
    PublicData,
    dates,
    read_public_data,
    read_scenario,
    read_truth,
)
from cislunar.benchmark.submission import ScoredStates, Submission, read_submission
from cislunar.detection import FALSE_ALARM
from cislunar.errors import InputFileError
from cislunar.evaluation import Custody, catalog_quality
from cislunar.evaluation.gospa import Gospa, gospa
from cislunar.runtime import Array, Indices, counted

CUTOFF_KM = 100.0
"""Distance from which on a catalog object is none of an object's."""

PASS_GAP_S = 1800.0
"""Longest time between consecutive detections of a pass."""

_SAME_S = 1e-3
"""Tolerance of times."""

SCORE_COLUMNS = (
    "epoch_utc", "objects", "findable", "catalog", "assigned", "with_covariance", "completeness",
    "completeness_outside", "completeness_maneuvering", "custody", "gospa_km",
    "gospa_localization_km2", "gospa_missed_km2", "gospa_false_km2", "missed", "false",
    "position_median_km", "position_95_km", "velocity_median_m_s", "velocity_95_m_s", "anees",
    "anees_ballistic", "purity", "wrong_assignments", "false_objects", "fragments",
    "latency_median_h",
)  # fmt: skip
"""Columns of a score; see docs/benchmark.md. The last five are of the whole time and are in the
last row only."""


def score_submission(
    submission: str | Path,
    folder: str | Path,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> pd.DataFrame:
    """Score a submission against the sealed truth.

    Parameters
    ----------
    submission : str or Path
        File or folder, see `cislunar.benchmark.read_submission`.
    folder : str or Path
        Folder of the benchmark, with the truth.
    progress : callable, optional
        Called with (epochs done, all epochs).

    Returns
    -------
    DataFrame
        A row for each scoring epoch with `SCORE_COLUMNS`; NaN where there is nothing to evaluate.

    Raises
    ------
    ConfigurationError, InputFileError
        If a file of the benchmark was changed, or the submission cannot be used.
    """
    scenario = read_scenario(folder)
    given = read_submission(submission, scenario)
    public, truth = read_public_data(folder, scenario), read_truth(folder)
    rows, pairs = [], None
    epochs = [*zip(scenario.scoring_tdb.tolist(), given.states, strict=True)]
    for epoch, states in counted(epochs, progress):
        row, pairs = _at_epoch(epoch, states, public, truth, scenario)
        rows.append(row)
    rows[-1] |= _of_assignments(submission, given, truth)
    rows[-1] |= _latency(given, pairs, public, truth)
    return pd.DataFrame(rows, columns=list(SCORE_COLUMNS))


def count_passes(
    origin: ArrayLike, observer: ArrayLike, time_s: ArrayLike, n_objects: int
) -> Indices:
    """Number of passes in which objects were detected.

    Parameters
    ----------
    origin : array_like of int, shape (row,)
        Object of each detection, negative for false alarms.
    observer : array_like of int, shape (row,)
    time_s : array_like, shape (row,)
    n_objects : int

    Returns
    -------
    ndarray of int, shape (object,)
    """
    of, by, time = np.asarray(origin), np.asarray(observer), np.asarray(time_s, dtype=float)
    order = np.lexsort((time, by, of))
    order = order[of[order] >= 0]
    begins = np.ones(order.size, dtype=bool)
    begins[1:] = (
        (np.diff(of[order]) != 0)
        | (np.diff(by[order]) != 0)
        | (np.diff(time[order]) > PASS_GAP_S + _SAME_S)
    )
    return np.bincount(of[order][begins], minlength=n_objects)


def _at_epoch(
    epoch: float,
    states: ScoredStates,
    public: PublicData,
    truth: xr.Dataset,
    scenario: BenchmarkScenario,
) -> tuple[dict[str, Any], dict[str, int]]:
    """Score at one epoch, and the objects to which catalog objects are assigned by their names."""
    at = int(np.argmin(np.abs(truth["time"].values - epoch)))
    true, origin = truth["state"].values[:, at], truth["origin"].values
    early = public.tdb <= epoch + _SAME_S
    passes = count_passes(
        origin[early], public.angles.observer[early], public.tdb[early], len(true)
    )
    findable = passes >= scenario.survey.quality.findable_tracklets
    found = gospa(true[:, :3], states.state[:, :3], CUTOFF_KM)
    held = np.zeros(len(true), dtype=bool)
    held[found.target] = True
    error = true[found.target] - states.state[found.track]
    away = np.linalg.norm(error[:, :3], axis=1)
    kept = np.zeros(len(true), dtype=bool)
    kept[found.target[away <= Custody().position_km]] = True
    outside, moved = truth["outside"].values == 1, truth["maneuvers"].values > 0
    covariance, ballistic = states.covariance[found.track], ~moved[found.target]
    row = {
        "epoch_utc": dates([epoch])[0],
        "objects": len(true),
        "findable": int(findable.sum()),
        "catalog": len(states.names),
        "assigned": found.target.size,
        "with_covariance": int(_is_known(covariance).sum()),
        "completeness": _share(held, findable),
        "completeness_outside": _share(held, findable & outside),
        "completeness_maneuvering": _share(held, findable & moved),
        "custody": _share(kept, findable),
        **_parts(found),
        **_quantiles("position", "km", away),
        **_quantiles("velocity", "m_s", 1e3 * np.linalg.norm(error[:, 3:], axis=1)),
        "anees": _anees(error, covariance),
        "anees_ballistic": _anees(error[ballistic], covariance[ballistic]),
    }
    names = [states.names[k] for k in found.track.tolist()]
    return row, dict(zip(names, found.target.tolist(), strict=True))


def _share(part: NDArray[np.bool_], whole: NDArray[np.bool_]) -> float:
    return float(np.mean(part[whole])) if whole.any() else float("nan")


def _parts(found: Gospa) -> dict[str, float]:
    return {
        "gospa_km": found.distance,
        "gospa_localization_km2": found.localization,
        "gospa_missed_km2": found.missed,
        "gospa_false_km2": found.false,
        "missed": found.n_missed,
        "false": found.n_false,
    }


def _quantiles(name: str, unit: str, values: Array) -> dict[str, float]:
    """Median and 95th percentile."""
    found = np.quantile(values, [0.5, 0.95]) if values.size else np.full(2, np.nan)
    return {f"{name}_median_{unit}": found[0], f"{name}_95_{unit}": found[1]}


def _is_known(covariance: Array) -> NDArray[np.bool_]:
    """Whether each state has a covariance."""
    known: NDArray[np.bool_] = np.isfinite(covariance).all(axis=(1, 2))
    return known


def _anees(error: Array, covariance: Array) -> float:
    """Arithmetic mean of the normalized squared errors of the pairs with a covariance, divided by
    the six components."""
    known = _is_known(covariance)
    if not known.any():
        return float("nan")
    error, matrix = error[known], covariance[known]
    # scaled, since km and km/s differ by many orders of magnitude
    scale = np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))
    scaled = matrix / (scale[:, :, None] * scale[:, None])
    unit = (error / scale)[..., None]
    return float(np.mean(np.sum(unit * np.linalg.solve(scaled, unit), axis=(1, 2))) / 6.0)


def _of_assignments(
    submission: str | Path, given: Submission, truth: xr.Dataset
) -> dict[str, float]:
    """Purity of the assignments of detections, if there are any."""
    if given.assigned is None:
        return {}
    row_of = {name: row for row, name in enumerate(truth["observation"].values.tolist())}
    for name in given.assigned:
        if name not in row_of:
            raise InputFileError(
                f"{submission}: obsID {name!r} is none of detections.csv; correct assignments.csv"
            )
    rows = [row_of[name] for name in given.assigned]
    track = np.unique([*given.assigned.values()], return_inverse=True)[1]
    found = catalog_quality(track.tolist(), truth["origin"].values[rows].tolist())
    return {
        "purity": found.purity,
        "wrong_assignments": found.wrong_associations,
        "false_objects": found.false_tracks,
        "fragments": found.fragments,
    }


def _latency(
    given: Submission, pairs: dict[str, int], public: PublicData, truth: xr.Dataset
) -> dict[str, float]:
    """Median time from the first detection of an object to its entry into the catalog, over the
    objects that are assigned at the last epoch, if dates are given; zero before the detection."""
    if given.cataloged is None:
        return {}
    first = np.full(truth.sizes["object"], np.inf)
    origin = truth["origin"].values
    real = origin != FALSE_ALARM
    np.minimum.at(first, origin[real], public.tdb[real])
    since = [
        max(given.cataloged[name] - first[target], 0.0)
        for name, target in pairs.items()
        if np.isfinite(first[target])
    ]
    return {"latency_median_h": float(np.median(since)) / 3600.0} if since else {}
