"""Data sets and table of orbits of the CR3BP flown among the bodies as they are."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.campaign.data.inputs import AXES, COMPONENTS, body_table, horizon
from cislunar.campaign.data.netcdf import variable
from cislunar.campaign.data.progress import Progress, logger
from cislunar.campaign.data.provenance import provenance
from cislunar.campaign.settings.cell_tree import Dynamics
from cislunar.campaign.settings.reading import typed
from cislunar.constants import LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics.ephemeris import UNITS
from cislunar.dynamics.ephemeris_forces import Ephemeris, ephemeris_forces
from cislunar.dynamics.framed_cr3bp import is_low_lunar
from cislunar.dynamics.frames import from_inertial, pulsating_frame
from cislunar.ephemeris.bodies import COLUMNS, read_table
from cislunar.errors import ConfigurationError, ConvergenceError
from cislunar.orbits.among_bodies.held import holding_cost, reference_states
from cislunar.orbits.among_bodies.refinement import RefinedPath, path_states, refined_path
from cislunar.visibility.phasing import distinct_phases

_HOUR_S = 3600.0

MEASURES = {
    "position_miss": ("m", "largest gap between the end of an arc and the next node"),
    "velocity_miss": ("mm/s", "largest gap in velocity there"),
    "departure": ("km", "largest distance, hour by hour, from the orbit of the CR3BP held by the "
                        "instantaneous frame"),
    "holding": ("m/s", "change of velocity that holding the orbit of the CR3BP would take"),
    "least_moon": ("km", "least distance to the Moon's center, hour by hour"),
}  # fmt: skip
"""What is measured of a path, with its unit."""


def forces_on_observers(bodies: xr.Dataset, dynamics: Mapping[str, Any]) -> Ephemeris:
    """What moves observers among the bodies of ``ephemeris/bodies.nc``, from the epoch on."""
    chosen = typed(dynamics, Dynamics)
    return ephemeris_forces(
        body_table(bodies),
        float(bodies["epoch_et"]),
        area_to_mass=chosen.srp.area_to_mass or None,
        reflectivity=chosen.srp.reflectivity,
        figure=chosen.lunar_harmonics,
    )


def horizon_days(forces: Ephemeris) -> float:
    """Days that the table of the bodies covers, in whole hours."""
    return float(np.floor(forces.span[1] * TIME_UNIT_S / _HOUR_S)) / 24.0


def observer_states(
    forces: Ephemeris,
    dynamics: Dynamics,
    state: np.ndarray,
    period: float,
    ahead: float,
    time: np.ndarray,
    name: str,
) -> np.ndarray:
    """States (time, 6) of a satellite among the bodies, s since the epoch of the forces.

    It is held on its orbit of the CR3BP, or flies the path that this is refined into over the
    horizon, as `dynamics.observers` says. Where that fails, `dynamics.unrefined` says whether it is
    held all the same, and named in the log, or refused with a `ConfigurationError`.
    """
    if dynamics.observers == "refined":
        try:
            path = refined_path(forces, state, period, horizon_days(forces), ahead=ahead)
            return path_states(forces, path, time)
        except ConvergenceError as error:
            told = f"{name}, {ahead:.3g} of a period ahead, is not refined: {error}"
            if dynamics.unrefined == "refused":
                raise ConfigurationError(
                    f"{told}; set task2.dynamics.unrefined to 'held', or take another orbit"
                ) from None
            logger.warning("warning: %s; it is held on its orbit of the CR3BP", told)
    return reference_states(forces.table, forces.epoch, state, period, time, ahead=ahead)


def refined_dataset(
    orbits: xr.Dataset,
    bodies: xr.Dataset,
    settings: Mapping[str, Any],
    progress: Progress | None = None,
) -> xr.Dataset:
    """``orbits/refined_{orbits}.nc``: every orbit of a data set refined over the horizon.

    `orbits` is ``orbits/families.nc`` or ``orbits/tracked.nc``. `settings` has `task2.dynamics` as
    `dynamics`, and what else decides. An orbit that cannot be refined is named in the log. Low
    orbits of the Moon are left out: any path is one of them.
    """
    forces = forces_on_observers(bodies, settings["dynamics"])
    days = horizon_days(forces)
    states, periods = orbits["state"].values, orbits["period"].values
    families, low = orbits["family"].values.astype(str), is_low_lunar(states)
    values = np.full((len(states), len(MEASURES)), np.nan)
    paths: list[RefinedPath | None] = []
    for row, (state, period) in enumerate(zip(states, periods, strict=True)):
        path = None
        try:
            if not low[row]:
                path = refined_path(forces, state, period, days)
                values[row] = _measured(forces, path, state, period, days)
        except ConvergenceError as error:
            logger.warning("warning: %s, row %d, is not refined: %s", families[row], row, error)
        paths.append(path)
        if progress is not None:
            progress(row + 1, len(states))
    (dim,) = orbits["period"].dims
    found = {
        name: variable(dim, values[:, column], unit, meaning)
        for column, (name, (unit, meaning)) in enumerate(MEASURES.items())
    }
    kept = [(row, path) for row, path in enumerate(paths) if path is not None]
    return xr.Dataset(
        {
            "family": variable(dim, list(families), "1", "orbit family"),
            "low_lunar": variable(dim, low.astype(np.int8), "1", "1: low about the Moon, left out"),
            "refined": variable(
                dim, np.array([p is not None for p in paths], dtype=np.int8), "1", "1: refined"
            ),
            **found,
            "node_orbit": variable(
                "node", np.repeat([r for r, _ in kept], [len(p.time) for _, p in kept]), "1",
                f"row along {dim} of a node",
            ),
            "node_time": variable(
                "node", np.concatenate([p.time for _, p in kept]), "s", "time since the epoch"
            ),
            "node_state": variable(
                ("node", "component"), np.concatenate([p.state for _, p in kept]), "1",
                "nondimensional, about the Earth-Moon barycenter, axes of J2000",
            ),
        },
        coords={"component": variable("component", list(COMPONENTS), "1", "component")},
        attrs=provenance("Orbits refined among Earth, Moon and Sun", settings=dict(settings)),
    )  # fmt: skip


def paths_dataset(
    orbits: xr.Dataset,
    bodies: xr.Dataset,
    settings: Mapping[str, Any],
    max_satellites: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """``orbits/paths.nc``: Sun and satellites of every orbit and phase among the bodies.

    At the times of the horizon, in the frame of the instant, whose unit of length is there too.
    From ``orbits/families.nc`` or a table's orbits and ``ephemeris/bodies.nc``; `settings` has
    `visibility`, and `task2.dynamics` as `dynamics`, which says how satellites fly (see
    `observer_states`). `progress` counts orbits.
    """
    dynamics = typed(settings["dynamics"], Dynamics)
    forces = forces_on_observers(bodies, settings["dynamics"])
    elapsed = horizon(settings) * TIME_UNIT_S
    frame = pulsating_frame(forces.table, forces.epoch + elapsed)
    sun = np.zeros((elapsed.size, 6))
    sun[:, :3] = read_table(forces.table, forces.epoch + elapsed)[0][:, COLUMNS["sun"]]
    phase, _ = distinct_phases(max_satellites)
    states, periods = orbits["state"].values, orbits["period"].values
    track = np.empty((len(states), phase.size, elapsed.size, 3))
    for row, (state, period) in enumerate(zip(states, periods, strict=True)):
        name = f"{orbits['family'].values[row]}, row {row}"
        for k, ahead in enumerate(phase):
            flown = observer_states(forces, dynamics, state, period, ahead, elapsed, name)
            track[row, k] = from_inertial(flown * UNITS, frame)[:, :3]
        if progress is not None:
            progress(row + 1, len(states))
    frame_of = "nondimensional, rotating frame with the distance of Earth and Moon as unit"
    return xr.Dataset(
        {
            "track": variable(("orbit", "phase", "time", "axis"), track, "1", frame_of),
            "sun_position": variable(
                ("time", "axis"), from_inertial(sun, frame)[:, :3], "1", f"Sun, {frame_of}"
            ),
            "length": variable(
                "time", frame.length / LENGTH_UNIT_KM, "1", "distance of Earth and Moon over l*"
            ),
        },
        coords={
            "phase": variable("phase", phase, "1", "share of the period ahead"),
            "time": variable("time", elapsed, "s", "time since the epoch"),
            "axis": variable("axis", list(AXES), "1", "axis of the rotating frame"),
        },
        attrs=provenance("Observers among Earth, Moon and Sun", settings=dict(settings)),
    )


def _measured(
    forces: Ephemeris, path: RefinedPath, state: np.ndarray, period: float, days: float
) -> tuple[float, ...]:
    """The values of `MEASURES` for a path."""
    time = np.arange(0.0, days * SECONDS_PER_DAY + 1.0, _HOUR_S)
    flown = path_states(forces, path, time)[:, :3] * LENGTH_UNIT_KM
    held = reference_states(forces.table, forces.epoch, state, period, time)[:, :3] * LENGTH_UNIT_KM
    moon = read_table(forces.table, forces.epoch + time)[0][:, COLUMNS["moon"]]
    return (
        1e3 * path.position_miss_km,
        1e6 * path.velocity_miss_km_s,
        float(np.max(np.linalg.norm(flown - held, axis=1))),
        holding_cost(forces, state, period, days),
        float(np.min(np.linalg.norm(flown - moon, axis=1))),
    )


def refined_rows(refined: Mapping[str, xr.Dataset]) -> pd.DataFrame:
    """Rows of ``tables/refined_orbits.csv``: what the paths of each family measure.

    `refined` has data sets of `refined_dataset` by what their orbits are for.
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
            for key in ("position_miss", "velocity_miss", "departure", "holding"):
                kept = data[key].values[own][done]
                unit = data[key].attrs["units"].replace("/", "_")
                row |= {f"{key}_median_{unit}": _or_nan(np.median, kept)}
                row |= {f"{key}_largest_{unit}": _or_nan(np.max, kept)}
            rows.append(row)
    return pd.DataFrame(rows)


def _or_nan(function: Any, values: Sequence[float]) -> float:
    return float(function(values)) if len(values) else np.nan
