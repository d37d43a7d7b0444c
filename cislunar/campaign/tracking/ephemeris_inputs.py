"""Inputs of a cell in ephemeris dynamics: its scene, initial states and force models.

All states of such a cell are nondimensional, in the barycentric frame with J2000 axes, its
propagation frame (see `cislunar.observation.scene`).
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from cislunar.campaign.architectures.variables import phases_of
from cislunar.campaign.data import forces_of, forces_on_observers, horizon_days, observer_states
from cislunar.campaign.data.inputs import COMPONENTS, variables
from cislunar.campaign.settings.cell_tree import CellSettings, Dynamics
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics.frames import earth_moon_axes
from cislunar.dynamics.instantaneous_frame_cr3bp import instantaneous_frame_cr3bp
from cislunar.ephemeris import BODY_COLUMNS, BodyTable, read_table
from cislunar.errors import ConvergenceError
from cislunar.observation import Scene, make_scene, station_positions, station_tracks
from cislunar.orbits.ephemeris_refined.refinement import RefinedPath, refined_path
from cislunar.runtime import Array, Progress
from cislunar.runtime.provenance import provenance
from cislunar.tasking.settings import LoopSettings


class CellEphemeris(NamedTuple):
    """Ephemeris table, and TDB seconds past J2000 of the campaign's epoch and of a run's start."""

    table: BodyTable
    epoch: float
    start: float


def assumed_forces(
    ephemeris: CellEphemeris, settings: CellSettings, loop: LoopSettings, low_lunar: ArrayLike
) -> tuple:
    """Force model that the estimator assumes; `low_lunar` tells which targets are in low lunar
    orbits."""
    dynamics = settings.dynamics
    if dynamics.filter == "ephemeris":
        factor = dynamics.srp.assumed_factor
        return forces_of(ephemeris.table, ephemeris.start, dynamics, factor)
    return instantaneous_frame_cr3bp(
        ephemeris.table, ephemeris.start, loop.step_s, loop.n_steps, low_lunar
    )


def observer_tracks(
    ephemeris: CellEphemeris,
    dynamics: Dynamics,
    state: ArrayLike,
    period: ArrayLike,
    ahead: list[Array],
    elapsed_s: Array,
    paths: Sequence[RefinedPath | str] | None = None,
) -> Array:
    """Positions (satellite, time, 3) of observers, barycentric frame with J2000 axes.

    Satellites are ordered by orbit; `ahead` has the phases of the satellites of each orbit, as
    fractions of the period. `paths` are the refined orbits of the satellites, if they are known.
    See `observer_states`.
    """
    forces = forces_of(ephemeris.table, ephemeris.epoch, dynamics)
    times = ephemeris.start - ephemeris.epoch + elapsed_s
    flown = enumerate(zip(np.asarray(state), np.asarray(period), ahead, strict=True), start=1)
    known = iter(paths or [None] * sum(map(len, ahead)))
    return np.array(
        [
            observer_states(
                forces, dynamics, s, p, phase, times, f"the orbit of slot {slot}", next(known)
            )
            for slot, (s, p, phases) in flown
            for phase in phases
        ]
    )[..., :3]


def flown_dataset(
    architecture: xr.Dataset,
    orbits: xr.Dataset,
    bodies: xr.Dataset,
    settings: Mapping[str, Any],
    progress: Progress | None = None,
) -> xr.Dataset:
    """``orbits/flown_{scenario}_{architecture}.nc``: the refined orbit of each satellite over the
    horizon, which all cells of the architecture share.

    The inputs are the architecture, the orbits to which it refers and ``ephemeris/bodies.nc``.
    `settings` has `task2.dynamics` as `dynamics`, and further keys for provenance.
    """
    forces, found = forces_on_observers(bodies, settings["dynamics"]), []
    orbit, ahead = architecture["orbit"].values, satellites_ahead(architecture)
    total, days = sum(map(len, ahead)), horizon_days(forces)
    for row, phases in zip(orbit, ahead, strict=True):
        state, period = orbits["state"].values[row], float(orbits["period"].values[row])
        for phase in phases:
            try:
                found.append(refined_path(forces, state, period, days, ahead=phase))
            except ConvergenceError as error:
                found.append(str(error))
            if progress is not None:
                progress(len(found), total)
    paths = [path for path in found if not isinstance(path, str)]
    nodes = [0 if isinstance(path, str) else len(path.time) for path in found]
    failure = [path if isinstance(path, str) else "" for path in found]
    miss = np.full((total, 2), np.nan)
    miss[np.array(nodes) > 0] = np.reshape([path[2:] for path in paths], (-1, 2))
    times = np.concatenate([np.empty(0), *(path.time for path in paths)])
    states = np.concatenate([np.empty((0, 6)), *(path.state for path in paths)])
    return xr.Dataset(
        variables(
            nodes=("satellite", nodes, "1", "number of nodes; 0: not refined"),
            failure=("satellite", failure, "1", "why it is not refined"),
            miss=(("satellite", "kind"), miss, "km, km/s", "largest mismatch of an arc"),
            node_time=("node", times, "s", "time since the epoch"),
            node_state=(("node", "component"), states, "1",
                        "nondimensional, barycentric frame with J2000 axes"),
        ),
        coords=variables(component=("component", list(COMPONENTS), "1", "component")),
        attrs=provenance("Ephemeris-refined orbits of satellites", settings=dict(settings)),
    )  # fmt: skip


def flown_paths(flown: xr.Dataset) -> list[RefinedPath | str]:
    """The path of each satellite of ``orbits/flown_{scenario}_{architecture}.nc``, or why there is
    none."""
    ends = np.cumsum(flown["nodes"].values)[:-1]
    times, states = (np.split(flown[f"node_{key}"].values, ends) for key in ("time", "state"))
    rows = zip(times, states, flown["miss"].values, flown["failure"].values, strict=True)
    return [
        RefinedPath(time, state, *miss.tolist()) if len(time) else str(failure)
        for time, state, miss, failure in rows
    ]


def satellites_ahead(architecture: xr.Dataset) -> list[np.ndarray]:
    """Phases of the satellites of each orbit of an architecture, as fractions of the period."""
    satellites = zip(phases_of(architecture), architecture["satellites"].values, strict=True)
    return [phase + np.arange(count) / count for phase, count in satellites]


def ground_station_tracks(
    ephemeris: CellEphemeris, settings: CellSettings, loop: LoopSettings, *, inertial: bool
) -> Array:
    """Positions (station, time, 3) of the stations, in the rotating frame or with `inertial` in
    J2000 axes."""
    sites = settings.stations.values()
    if not sites:
        return np.empty((0, loop.n_steps + 1, 3))
    coordinates = zip(*((s.latitude_deg, s.longitude_deg, s.height_m) for s in sites), strict=True)
    times = ephemeris.start + loop.elapsed_s
    return station_tracks(
        station_positions(*coordinates), ephemeris.table, times, inertial=inertial
    )


def ephemeris_scene(ephemeris: CellEphemeris, tracks: Array, loop: LoopSettings) -> Scene:
    """The scene for positions of observers (observer, time, 3), barycentric frame with J2000
    axes."""
    position, velocity, _ = read_table(ephemeris.table, ephemeris.start + loop.elapsed_s)
    start = earth_moon_axes(position[0], velocity[0])
    bodies = [position[:, BODY_COLUMNS[name]] for name in ("earth", "moon")]
    primaries = np.stack(bodies, axis=1) / LENGTH_UNIT_KM
    sun = position[:, BODY_COLUMNS["sun"]] / LENGTH_UNIT_KM
    return make_scene(tracks, sun, loop.step_s, axes=start, primaries=primaries)
