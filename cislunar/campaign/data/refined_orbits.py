"""Data sets and table of ephemeris-refined orbits."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.campaign.data.inputs import AXES, COMPONENTS, body_table, horizon, variables
from cislunar.campaign.settings import Dynamics, typed
from cislunar.constants import LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import UNITS, from_inertial, is_low_lunar, pulsating_frame
from cislunar.dynamics.ephemeris_forces import EphemerisForces, ephemeris_forces
from cislunar.ephemeris.bodies import BODY_COLUMNS, BodyTable, read_table
from cislunar.errors import ConfigurationError, ConvergenceError
from cislunar.orbits.ephemeris_refined.reference_tracking import reference_states, tracking_cost
from cislunar.orbits.ephemeris_refined.refinement import RefinedPath, path_states, refined_path
from cislunar.runtime.progress import Progress, counted, logger
from cislunar.runtime.provenance import provenance
from cislunar.visibility.phasing import distinct_phases

_HOUR_S = 3600.0

MEASURES = {
    "position_miss": ("m", "largest gap between the end of an arc and the next node"),
    "velocity_miss": ("mm/s", "largest gap in velocity there"),
    "reference_distance": ("km", "largest distance, hour by hour, from reference tracking of the "
                                 "CR3BP orbit in the instantaneous frame"),
    "tracking_cost": ("m/s", "change of velocity that reference tracking of the CR3BP orbit would "
                             "need"),
    "least_moon": ("km", "least distance to the Moon's center, hour by hour"),
}  # fmt: skip
"""Measures of a refined orbit, with their units."""


def forces_on_observers(bodies: xr.Dataset, dynamics: Mapping[str, Any]) -> EphemerisForces:
    """Forces on observers in ephemeris dynamics, from the epoch on, with
    ``ephemeris/bodies.nc``."""
    return forces_of(body_table(bodies), float(bodies["epoch_et"]), typed(dynamics, Dynamics))


def forces_of(
    table: BodyTable, epoch: float, dynamics: Dynamics, factor: float = 1.0
) -> EphemerisForces:
    """Forces of ephemeris dynamics from an epoch on, TDB seconds past J2000, with a multiple of the
    true solar radiation pressure."""
    return ephemeris_forces(
        table,
        epoch,
        area_to_mass=dynamics.srp.area_to_mass * factor or None,
        reflectivity=dynamics.srp.reflectivity,
        figure=dynamics.lunar_harmonics,
    )


def horizon_days(forces: EphemerisForces) -> float:
    """Days that the ephemeris table covers, in whole hours."""
    return float(np.floor(forces.span[1] * TIME_UNIT_S / _HOUR_S)) / 24.0


def observer_states(
    forces: EphemerisForces,
    dynamics: Dynamics,
    state: np.ndarray,
    period: float,
    ahead: float,
    time: np.ndarray,
    name: str,
    known: RefinedPath | str | None = None,
) -> np.ndarray:
    """States (time, 6) of a satellite, barycentric frame with J2000 axes, at s since the forces'
    epoch.

    The satellite is kept on its CR3BP orbit (reference tracking) or flies the ephemeris-refined
    orbit over the horizon, according to `dynamics.observers`. If the refinement fails,
    `dynamics.unrefined` selects reference tracking, with a warning, or a `ConfigurationError`.
    `known` is the result of the refinement where it is known: a path, or why there is none.
    """
    if dynamics.observers == "refined":
        try:
            path = known or refined_path(forces, state, period, horizon_days(forces), ahead=ahead)
            if isinstance(path, str):
                raise ConvergenceError(path)
            return path_states(forces, path, time)
        except ConvergenceError as error:
            message = f"{name}, {ahead:.3g} of a period ahead, is not refined: {error}"
            if dynamics.unrefined == "refused":
                raise ConfigurationError(
                    f"{message}; set task2.dynamics.unrefined to 'reference', or take another orbit"
                ) from None
            logger.warning("warning: %s; it is kept on its CR3BP orbit", message)
    return reference_states(forces.table, forces.epoch, state, period, time, ahead=ahead)


def refined_dataset(
    orbits: xr.Dataset,
    bodies: xr.Dataset,
    settings: Mapping[str, Any],
    progress: Progress | None = None,
) -> xr.Dataset:
    """``orbits/refined_{orbits}.nc``: every orbit of a data set refined over the horizon.

    `orbits` is ``orbits/families.nc`` or ``orbits/tracked.nc``. `settings` has `task2.dynamics` as
    `dynamics`, and further keys for provenance. An orbit that cannot be refined is named in the
    log. Low lunar orbits are left out, since any trajectory near one is such an orbit.
    """
    forces = forces_on_observers(bodies, settings["dynamics"])
    days = horizon_days(forces)
    states, periods = orbits["state"].values, orbits["period"].values
    families, low = orbits["family"].values.astype(str), is_low_lunar(states)
    values = np.full((len(states), len(MEASURES)), np.nan)
    paths: list[RefinedPath | None] = []
    orbit_rows = [*enumerate(zip(states, periods, strict=True))]
    for row, (state, period) in counted(orbit_rows, progress):
        path = None
        try:
            if not low[row]:
                path = refined_path(forces, state, period, days)
                values[row] = _measured(forces, path, state, period, days)
        except ConvergenceError as error:
            logger.warning("warning: %s, row %d, is not refined: %s", families[row], row, error)
        paths.append(path)
    (dim,) = orbits["period"].dims
    found = {
        name: (dim, values[:, column], unit, meaning)
        for column, (name, (unit, meaning)) in enumerate(MEASURES.items())
    }
    kept = [(row, path) for row, path in enumerate(paths) if path is not None]
    node_orbit = np.repeat([r for r, _ in kept], [len(p.time) for _, p in kept])
    node_state = np.concatenate([p.state for _, p in kept])
    refined = np.array([p is not None for p in paths], dtype=np.int8)
    return xr.Dataset(
        variables(
            family=(dim, list(families), "1", "orbit family"),
            low_lunar=(dim, low.astype(np.int8), "1", "1: low about the Moon, left out"),
            refined=(dim, refined, "1", "1: refined"),
            **found,
            node_orbit=("node", node_orbit, "1", f"row along {dim} of a node"),
            node_time=("node", np.concatenate([p.time for _, p in kept]), "s",
                       "time since the epoch"),
            node_state=(("node", "component"), node_state, "1",
                        "nondimensional, barycentric frame with J2000 axes"),
        ),
        coords=variables(component=("component", list(COMPONENTS), "1", "component")),
        attrs=provenance("Ephemeris-refined orbits", settings=dict(settings)),
    )  # fmt: skip


def paths_dataset(
    orbits: xr.Dataset,
    bodies: xr.Dataset,
    settings: Mapping[str, Any],
    max_satellites: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """``orbits/paths.nc``: Sun and satellites of every orbit and phase in ephemeris dynamics.

    Positions are at the times of the horizon, in the instantaneous frame, whose unit of length is a
    variable. The inputs are ``orbits/families.nc`` or a table's orbits and ``ephemeris/bodies.nc``.
    `settings` has `visibility`, and `task2.dynamics` as `dynamics` (see `observer_states`).
    `progress` counts orbits.
    """
    dynamics = typed(settings["dynamics"], Dynamics)
    forces = forces_on_observers(bodies, settings["dynamics"])
    elapsed = horizon(settings) * TIME_UNIT_S
    frame = pulsating_frame(forces.table, forces.epoch + elapsed)
    sun = np.zeros((elapsed.size, 6))
    sun[:, :3] = read_table(forces.table, forces.epoch + elapsed)[0][:, BODY_COLUMNS["sun"]]
    phase, _ = distinct_phases(max_satellites)
    states, periods = orbits["state"].values, orbits["period"].values
    track = np.empty((len(states), phase.size, elapsed.size, 3))
    orbit_rows = [*enumerate(zip(states, periods, strict=True))]
    for row, (state, period) in counted(orbit_rows, progress):
        name = f"{orbits['family'].values[row]}, row {row}"
        for k, ahead in enumerate(phase):
            flown = observer_states(forces, dynamics, state, period, ahead, elapsed, name)
            track[row, k] = from_inertial(flown * UNITS, frame)[:, :3]
    frame_of = "nondimensional, rotating frame with the distance of Earth and Moon as unit"
    seen, length = from_inertial(sun, frame)[:, :3], frame.length / LENGTH_UNIT_KM
    return xr.Dataset(
        variables(
            track=(("orbit", "phase", "time", "axis"), track, "1", frame_of),
            sun_position=(("time", "axis"), seen, "1", f"Sun, {frame_of}"),
            length=("time", length, "1", "distance of Earth and Moon over l*"),
        ),
        coords=variables(
            phase=("phase", phase, "1", "share of the period ahead"),
            time=("time", elapsed, "s", "time since the epoch"),
            axis=("axis", list(AXES), "1", "axis of the rotating frame"),
        ),
        attrs=provenance("Observers in ephemeris dynamics", settings=dict(settings)),
    )


def _measured(
    forces: EphemerisForces, path: RefinedPath, state: np.ndarray, period: float, days: float
) -> tuple[float, ...]:
    """The values of `MEASURES` for a path."""
    time = np.arange(0.0, days * SECONDS_PER_DAY + 1.0, _HOUR_S)
    flown = path_states(forces, path, time)[:, :3] * LENGTH_UNIT_KM
    reference = reference_states(forces.table, forces.epoch, state, period, time)[:, :3]
    moon = read_table(forces.table, forces.epoch + time)[0][:, BODY_COLUMNS["moon"]]
    return (
        1e3 * path.position_miss_km,
        1e6 * path.velocity_miss_km_s,
        float(np.max(np.linalg.norm(flown - reference * LENGTH_UNIT_KM, axis=1))),
        tracking_cost(forces, state, period, days),
        float(np.min(np.linalg.norm(flown - moon, axis=1))),
    )


def refined_rows(**refined: xr.Dataset) -> pd.DataFrame:
    """Rows of ``tables/refined_orbits.csv``: measures of the refined orbits of each family.

    The arguments are data sets of `refined_dataset`, named by the use of their orbits.
    """
    rows = []
    for use, data in refined.items():
        family = data["family"].values.astype(str)
        for name in [*dict.fromkeys(family), "all"]:
            own = slice(None) if name == "all" else family == name
            done = data["refined"].values[own] == 1
            row: dict[str, Any] = {
                "use": use,
                "family": name,
                "orbits": int(done.size),
                "low_lunar": int(data["low_lunar"].values[own].sum()),
                "refined": int(done.sum()),
            }
            for key in ("position_miss", "velocity_miss", "reference_distance", "tracking_cost"):
                kept = data[key].values[own][done]
                unit = data[key].attrs["units"].replace("/", "_")
                row |= {f"{key}_median_{unit}": _or_nan(np.median, kept)}
                row |= {f"{key}_largest_{unit}": _or_nan(np.max, kept)}
            rows.append(row)
    return pd.DataFrame(rows)


def _or_nan(function: Any, values: Sequence[float]) -> float:
    return float(function(values)) if len(values) else np.nan
