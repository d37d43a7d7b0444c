"""Table of a study of maneuvers: ``tables/maneuvers.csv``."""

import json
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import log_expit
from scipy.stats import binomtest

from cislunar.association.model import AssociationModel
from cislunar.campaign.settings.cells import Cell
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.runtime.arguments import Array
from cislunar.tasking.realization import USED

PLACE = ("response", "targets", "observers", "mode", "estimator", "dynamics", "clutter",
         "delay_minutes", "days")  # fmt: skip
MANEUVER_COLUMNS = (*PLACE, "smallest_m_s", "largest_m_s", "quantity", "value", "low", "high",
                    "number", "seeds")  # fmt: skip
"""Columns of the table. `response`: of the estimates to an alarm, "none", "recovery" or "search"
(with recovery). A quantity of maneuvers has the smallest and largest change of velocity of their
class; both are NaN for a quantity of all targets. Custody after a maneuver does not regard later
ones. `low` and `high` bound an exact interval of 95 % of a share, NaN for other quantities;
`number` counts maneuvers, targets or target-days."""

CLASSES = (0.01, 0.03, 0.1, 0.2, 0.5, 1.0, 10.0, 100.0, 500.0)
"""Limits of the classes of changes of velocity, m/s."""

WITHIN_HOURS = 24.0
"""Time within which a maneuver is detected or not, h."""

OBSERVED_HOURS = 6.0
"""Time after a maneuver within which a target counts as observed, h."""

AFTER_HOURS = (1.0, 3.0, 6.0, 12.0, 24.0)
"""Times after a maneuver at which custody is judged, h."""

_PROBABILITY = 0.9
_LARGEST_M_S = 10.0
_NORMALIZED = slice(6, 12)


def maneuver_rows(cells: Sequence[tuple[Cell, xr.Dataset]], custody_km: float) -> pd.DataFrame:
    """Rows of the table, from cells with `errors` among the histories and the truth in the record;
    `custody_km` is the largest position error in custody."""
    rows: list[dict[str, Any]] = []
    for cell, data in cells:
        place = _place(cell, data)
        found = _cell_values(data, custody_km)
        for (low, high), quantity, value, interval, number in found:
            rows.append({**place, "smallest_m_s": low, "largest_m_s": high, "quantity": quantity,
                         "value": value, "low": interval[0], "high": interval[1],
                         "number": number, "seeds": data.sizes["seed"]})  # fmt: skip
    return pd.DataFrame(rows, columns=list(MANEUVER_COLUMNS))


def _place(cell: Cell, data: xr.Dataset) -> dict[str, Any]:
    """What distinguishes a cell from others."""
    settings = json.loads(data.attrs["settings"])
    given = AssociationModel(**settings.get("association", {}))
    field_deg = float(settings["sensor"]["field_of_view_deg"])
    detection = settings.get("maneuver_detection", {})
    slots = settings["tasking"].get("slot_minutes") is not None
    return {
        "response": _response(detection),
        "targets": cell.targets,
        "observers": data.sizes["observer"],
        "mode": "recommended" if slots else "paper",
        "estimator": cell.estimator,
        "dynamics": settings.get("dynamics", {}).get("truth", "cr3bp"),
        "clutter": round(given.false_alarms_deg2 * field_deg**2, 1) if given.in_field else 0.0,
        "delay_minutes": settings.get("communication", {}).get("delay_minutes", 0.0),
        "days": round(float(data["step"].values[-1]) / 86400.0, 2),
    }


def _response(detection: dict[str, Any]) -> str:
    if detection.get("search_share"):
        return "search"
    return "recovery" if detection.get("recover") else "none"


_Value = tuple[tuple[float, float], str, float, tuple[float, float], int]
_ALL = _NONE = (np.nan, np.nan)


def _cell_values(data: xr.Dataset, custody_km: float) -> list[_Value]:
    """Classes, quantities, values, intervals and numbers of a cell."""
    seed, target = data["maneuver_seed"].values, data["maneuver_target"].values
    start = data["maneuver_start"].values
    # rounded, since the norm of a change of exactly 0.1 m/s is on either side of the class limit
    size = np.round(np.linalg.norm(data["maneuver_velocity"].values, axis=1), 9)
    tested, alarm = data["maneuver_tested_time"].values, data["maneuver_alarm"].values > 0
    time = data["time"].values
    place = LENGTH_UNIT_KM * np.linalg.norm(data["error"].values[..., 6:9], axis=3)
    normalized = (data["error"].values / data["sigma"].values)[..., _NORMALIZED] ** 2
    normalized = normalized.mean(axis=3)
    used = data["outcome"].values == USED
    step = data["step"].values
    latency, seen = np.full(size.size, np.inf), np.zeros(size.size, dtype=bool)
    for k, (s, j) in enumerate(zip(seed, target, strict=True)):
        own = tested[s, :, j]
        after = own[alarm[s, :, j] & (own > start[k])]
        latency[k] = (after.min() - start[k]) / 3600.0 if after.size else np.inf
        soon = (step > start[k]) & (step <= start[k] + 3600.0 * OBSERVED_HOURS)
        seen[k] = used[s, soon, j].any()
    estimates = _estimates(data, seed, target, start)
    found: list[_Value] = []
    for low, high in pairwise(CLASSES):
        within = (size >= low) & (size < high)
        if not within.any():
            continue
        own = low, high
        detected = latency[within] <= WITHIN_HOURS
        found.append(_share(own, "detected", detected))
        found.append(_median(own, "latency_h", latency[within][detected]))
        for hours in AFTER_HOURS:
            at = np.searchsorted(time, start + 3600.0 * hours - 1e-6)
            there = within & (at < time.size)
            if not there.any():
                continue
            rows = seed[there], at[there], target[there]
            kept = place[rows] <= custody_km
            found.append(_share(own, f"custody_{hours:g}_h", kept))
            observed = seen[there]
            if observed.any():
                found.append(_share(own, f"custody_{hours:g}_h_observed", kept[observed]))
            found.append(_median(own, f"error_{hours:g}_h_km", place[rows]))
            found.append(_median(own, f"anees_{hours:g}_h", normalized[rows]))
        for name, values in estimates.items():
            of = values[within][np.isfinite(values[within]).reshape(within.sum(), -1).all(axis=1)]
            if name != "velocity_coverage":
                found.append(_median(own, name, of))
            elif of.size:
                found.append(_share(own, name, (np.abs(of) <= 3.0).ravel()))
    found.append(_limit(size, latency <= WITHIN_HOURS))
    found += _of_coasting(data, seed, target, place, normalized, alarm, custody_km)
    return found


def _estimates(
    data: xr.Dataset, seed: NDArray[np.int64], target: NDArray[np.int64], start: Array
) -> dict[str, Array]:
    """Errors of the estimated maneuvers, by true maneuver: of the first one with an alarm after it;
    of `velocity_coverage` by component, in standard deviations. NaN without any."""
    if "recovered_seed" not in data:
        return {}
    found = {name: np.full(start.size, np.nan) for name in (
        "time_error_h", "velocity_error_m_s", "velocity_anees")}  # fmt: skip
    found["velocity_coverage"] = np.full((start.size, 3), np.nan)
    alarm = data["recovered_alarm"].values
    for k in range(start.size):
        own = (data["recovered_seed"].values == seed[k]) & (alarm > start[k])
        own = np.flatnonzero(own & (data["recovered_target"].values == target[k]))
        if own.size == 0:
            continue
        i = own[np.argmin(alarm[own])]
        off = data["recovered_velocity"].values[i] - data["maneuver_velocity"].values[k]
        covariance = data["recovered_covariance"].values[i]
        found["time_error_h"][k] = abs(data["recovered_time"].values[i] - start[k]) / 3600.0
        found["velocity_error_m_s"][k] = np.linalg.norm(off)
        found["velocity_anees"][k] = off @ np.linalg.solve(covariance, off) / 3.0
        found["velocity_coverage"][k] = off / np.sqrt(np.diag(covariance))
    return found


def _share(own: tuple[float, float], name: str, true: NDArray[np.bool_]) -> _Value:
    interval = binomtest(int(true.sum()), true.size).proportion_ci()
    return own, name, float(true.mean()), (interval.low, interval.high), true.size


def _median(own: tuple[float, float], name: str, values: Array) -> _Value:
    return own, name, float(np.median(values)) if values.size else np.nan, _NONE, values.size


def _limit(size: Array, detected: NDArray[np.bool_]) -> _Value:
    """Change of velocity that is detected with a probability of 90 %, by logistic regression of its
    logarithm (Cox 1958); NaN beyond the changes that occurred. Larger changes than 10 m/s are left
    out, after which a target may leave the field of view."""
    name, own = "detectable_m_s", size <= _LARGEST_M_S
    size, detected = size[own], detected[own]
    if size.size == 0 or detected.all() or not detected.any() or size.max() < 2.0 * size.min():
        return _ALL, name, np.nan, _NONE, size.size
    x = np.log(size)

    def cost(p: Array) -> float:
        z = np.exp(p[1]) * (x - p[0])
        # a weak prior on the slope, for classes that are separated
        return -np.sum(np.where(detected, log_expit(z), log_expit(-z))) + 0.05 * p[1] ** 2

    fit = minimize(cost, [np.median(x), 1.0], method="Nelder-Mead").x
    value = np.exp(fit[0] + np.log(_PROBABILITY / (1.0 - _PROBABILITY)) / np.exp(fit[1]))
    inside = size.min() <= value <= size.max()
    return _ALL, name, float(value) if inside else np.nan, _NONE, size.size


def _of_coasting(
    data: xr.Dataset,
    seed: NDArray[np.int64],
    target: NDArray[np.int64],
    place: Array,
    normalized: Array,
    alarm: NDArray[np.bool_],
    custody_km: float,
) -> list[_Value]:
    """False alarms and errors of targets that do not maneuver, and the share of all targets in
    custody at the end."""
    shape = data.sizes["seed"], data.sizes["target"]
    coasting = np.ones(shape, dtype=bool)
    coasting[seed, target] = False
    last = place[:, -1]
    found = [
        _share(_ALL, "custody_end", (last <= custody_km).ravel()),
        _median(_ALL, "anees_end", normalized[:, -1].ravel()),
    ]
    if not coasting.any():
        return found
    days = float(data["step"].values[-1]) / 86400.0
    # an estimate that has never been updated, or has failed, counts as well
    alarms = int(alarm.any(axis=1)[coasting].sum())
    count = max(1, round(coasting.sum() * days))
    interval = binomtest(min(alarms, count), count).proportion_ci()
    rate = alarms / (coasting.sum() * days)
    found.append((_ALL, "false_alarms_per_day", rate, (interval.low, interval.high), count))
    error = last[coasting]
    found.append(_median(_ALL, "coasting_error_km", error[np.isfinite(error)]))
    return found
