"""Replay of a realization of a cell, of a study, or of a survey."""

import json
from collections.abc import Mapping

import numpy as np
import xarray as xr

from cislunar.campaign.settings import CellSettings, typed
from cislunar.campaign.settings.cell_settings import observer_sensors, own_sensors
from cislunar.campaign.tracking.records import (
    FrameOfCell,
    frame_of,
    observer_names,
    recorded_names,
    require_records,
)
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.evaluation.custody import attitude_angle_deg
from cislunar.exchange.observations import observation_dates
from cislunar.figures.replay.page import (
    Replay,
    ReplayDetections,
    ReplayFact,
    ReplayManeuver,
    replay_page,
)
from cislunar.observation import sensors_of, unit_vectors
from cislunar.runtime import Array

RECORD = ("estimates", "covariance", "measurements")
"""What a cell must record (`task2.record`) for a replay. With ``truth`` the page can show it, and
with ``pointing`` observers that slew point nowhere."""

_FIELD_KM = 100_000.0
"""Distance to which the fields of a survey, which have no target, are drawn."""

_DEG_H = float(np.rad2deg(3600.0))
_STATUSES = {"track_status": "track", "attitude_status": "attitude"}


def cell_page(
    cell: xr.Dataset, sun: xr.Dataset, *, seed: int = 0, orbits: xr.Dataset | None = None
) -> str:
    """HTML of the replay of a realization; for the arguments see `cell_replay`."""
    return replay_page(cell_replay(cell, sun, seed=seed, orbits=orbits))


def cell_replay(
    cell: xr.Dataset,
    sun: xr.Dataset,
    *,
    seed: int = 0,
    orbits: xr.Dataset | None = None,
    most_states: int = 300_000,
) -> Replay:
    """The arrays of a replay of a realization.

    Parameters
    ----------
    cell, sun : xarray.Dataset
        A cell made with `RECORD`, or the record of a survey
        (`cislunar.campaign.survey.SurveyRecorder`), and its ``ephemeris/sun.nc``.
    seed : int
        Index of the realization.
    orbits : xarray.Dataset, optional
        Orbits of the observers, for those whose sensor the table of observers states.
    most_states : int
        Number of states of objects above which times are left out; 202 objects have fewer in a day
        of minutes.

    Returns
    -------
    Replay
        At the recorded times, or at every second, third and so on of them. An observer points at
        the estimated position of its target, or in the direction of its field in a survey. The
        axes of ephemeris dynamics are those of the instantaneous rotating frame.

    Raises
    ------
    ConfigurationError
        If the cell lacks a record.
    """
    require_records(cell, RECORD)
    own = cell.isel(seed=seed)
    n_objects = cell.sizes["target"]
    # the last time is always kept
    every = -(-cell.sizes["time"] * n_objects // most_states)
    own = own.isel(time=slice((cell.sizes["time"] - 1) % every, None, every))
    times, frame = own["time"].values, frame_of(cell, sun)
    turn, earth, moon = frame.instantaneous(times)

    def placed(positions: Array) -> Array:
        """Positions (time, ..., 3) in the rotating frame, km."""
        return LENGTH_UNIT_KM * np.einsum("tij,t...j->t...i", turn, positions)

    estimate = placed(own["estimated_translation"].values[..., :3])
    covariance = own["covariance"].values[..., :3, :3]
    covariance = turn[:, None] @ covariance @ turn[:, None].swapaxes(-1, -2) * LENGTH_UNIT_KM**2
    steps = np.searchsorted(cell["step"].values, times - 1e-6)
    observed = placed(cell["observer_position"].values[:, steps].swapaxes(0, 1))
    error = untracked = None
    if "true_translation" in own:
        truth = placed(own["true_translation"].values[..., :3])
        error, unknown = truth - estimate, np.isnan(estimate)
        if np.any(unknown & np.isfinite(truth)):
            untracked = np.where(unknown, truth, np.nan)
    if "assignment" in own:
        aims = _aims(own, estimate, observed.shape[1])
    elif "pointing" in own:
        aims = observed + _field_directions(own, turn, cell["observer_axes"].values[steps])
    else:
        aims = np.full(observed.shape, np.nan)
    return Replay(
        title=str(cell.attrs["title"]),
        utc=observation_dates(frame.tdb_s(times)),
        time_s=times,
        earth_km=earth,
        moon_km=moon,
        axes=frame.to_icrf(times) @ turn.swapaxes(-1, -2),
        observers=dict(zip(observer_names(cell), _fields_deg(cell, orbits), strict=True)),
        observer_km=observed,
        aim_km=aims,
        objects=recorded_names(cell),
        estimate_km=estimate,
        covariance_km2=covariance,
        error_km=error,
        untracked_km=untracked,
        detections=_detections(cell, seed, frame),
        maneuvers=_maneuvers(cell, seed),
        facts=_facts(own),
    )


def _fields_deg(cell: xr.Dataset, orbits: xr.Dataset | None) -> list[float]:
    """Widths of the fields of view of the observers."""
    given, count = json.loads(cell.attrs["settings"]), cell.sizes["observer"]
    own = {key: value for key, value in given.items() if key in CellSettings.model_fields}
    settings = typed(own, CellSettings)
    flying = count - len(settings.stations)
    rows = [] if orbits is None else cell["observer_orbit"].values[:flying]
    sensors = observer_sensors(
        settings, flying, [] if orbits is None else own_sensors(orbits, rows)
    )
    return [each.field_of_view_deg for each in sensors_of(sensors, count)]


def _aims(own: xr.Dataset, estimate: Array, n_observers: int) -> Array:
    """Positions (time, observer, 3) at which observers point, NaN if they are idle or slew."""
    assigned, begins = own["assignment"], own["epoch"].values
    if "slot" in assigned.dims:
        begins = (begins[:, None] + own["slot"].values).ravel()
    # a measurement at the end of an interval, or of a slot, belongs to it
    interval = np.searchsorted(begins, own["time"].values - 1e-6) - 1
    targets = assigned.transpose("epoch", ..., "observer").values.reshape(-1, n_observers)[interval]
    rows = np.arange(interval.size)[:, None]
    aims = np.where(targets[..., None] >= 0, estimate[rows, np.maximum(targets, 0)], np.nan)
    if "pointing" in own:
        aims[np.isnan(own["pointing"].values).any(axis=-1)] = np.nan
    return aims


def _field_directions(own: xr.Dataset, turn: Array, axes: Array) -> Array:
    """Vectors (time, observer, 3) along the fields of observers without a target, NaN if they are
    idle."""
    body = unit_vectors(*np.moveaxis(own["pointing"].values, -1, 0))
    return _FIELD_KM * np.einsum("tij,tkj,tok->toi", turn, axes, body)


def _detections(cell: xr.Dataset, seed: int, frame: FrameOfCell) -> ReplayDetections:
    """Detections of a realization in order of time, in the rotating frame of their time."""
    of = {
        name: cell[f"observation_{name}"].values
        for name in ("observer", "target", "magnitude", "right_ascension", "declination")
    }
    if real := "observation_elapsed" in cell:  # of a study of real observations, in the ICRF
        times, rows = cell["observation_elapsed"].values, np.arange(of["target"].size)
    else:
        step = cell["observation_step"].values
        times = cell["step"].values[step]
        known = np.isfinite(of["magnitude"]) & (cell["observation_seed"].values == seed)
        rows = np.flatnonzero(known)
    rows = rows[np.argsort(times[rows], kind="stable")]
    times, (observer, target, magnitude, ra, dec) = times[rows], (of[name][rows] for name in of)
    turn = frame.instantaneous(times)[0]
    if real:
        turn = turn @ frame.to_icrf(times).swapaxes(1, 2)
    else:
        turn = turn @ cell["observer_axes"].values[step[rows]].swapaxes(1, 2)
    body = unit_vectors(ra, dec)
    direction = np.einsum("nij,nj->ni", turn, body)
    return ReplayDetections(times, observer, target, direction, magnitude)


def _maneuvers(cell: xr.Dataset, seed: int) -> list[ReplayManeuver]:
    """True maneuvers, and estimated ones: recovered ones, or alarms of the test."""
    found = []
    for prefix, time, truth in (("maneuver", "start", True), ("recovered", "time", False)):
        if f"{prefix}_seed" in cell:
            rows = np.flatnonzero(cell[f"{prefix}_seed"].values == seed)
            change = np.linalg.norm(cell[f"{prefix}_velocity"].values[rows], axis=1)
            columns = cell[f"{prefix}_{time}"].values[rows], cell[f"{prefix}_target"].values[rows]
            found += [ReplayManeuver(*each, truth) for each in zip(*columns, change, strict=True)]
    if "maneuver_alarm" in cell and "recovered_seed" not in cell:
        for k, j in np.argwhere(cell["maneuver_alarm"].values[seed] > 0).tolist():
            time = float(cell["maneuver_estimated_time"].values[seed, k, j])
            change = float(np.linalg.norm(cell["maneuver_estimate"].values[seed, k, j]))
            found.append(ReplayManeuver(time, j, change, False))
    return sorted(found, key=lambda each: (each.time_s, each.object))


def _facts(own: xr.Dataset) -> Mapping[str, ReplayFact]:
    """Status, existence and attitude over time, as far as a cell has them."""
    facts = {}

    def after_intervals(name: str) -> Array:
        ends = np.append(own["epoch"].values[1:], own["step"].values[-1])
        last = np.searchsorted(ends, own["time"].values + 1e-6) - 1
        values = own[name].values[np.maximum(last, 0)].astype(float)
        values[last < 0] = np.nan
        return values

    for name, label in _STATUSES.items():
        if name in own:
            words = own[name].attrs["flag_meanings"].split()
            facts[label] = ReplayFact(after_intervals(name), names=words)
    if "existence" in own:
        facts["probability of existence"] = ReplayFact(after_intervals("existence"))
    if "estimated_quaternion" not in own:
        return facts
    facts["attitude quaternion"] = ReplayFact(own["estimated_quaternion"].values, resolution=1e-3)
    if "sigma" in own:
        sigma = np.rad2deg(np.linalg.norm(own["sigma"].values[..., :3].astype(float), axis=-1))
        facts["attitude, standard deviation"] = ReplayFact(sigma, "deg")
    if "error" in own:
        error = attitude_angle_deg(own["error"].values.astype(float))
        facts["attitude error"] = ReplayFact(error, "deg", truth=True)
    rate = _DEG_H * np.linalg.norm(own["estimated_angular_velocity"].values, axis=-1)
    facts["angular velocity"] = ReplayFact(rate, "deg/h")
    return facts
