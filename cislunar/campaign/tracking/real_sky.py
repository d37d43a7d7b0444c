"""A cell among Earth, Moon and Sun as they are: its scene, its first states, its force models.

All states of such a cell are nondimensional, about the Earth-Moon barycenter in the axes of J2000.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.campaign.data.refined_orbits import observer_states
from cislunar.campaign.settings.cell_tree import CellSettings, Dynamics
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics.ephemeris_forces import Ephemeris, ephemeris_forces
from cislunar.dynamics.framed_cr3bp import framed_cr3bp, inertial_states
from cislunar.ephemeris.bodies import COLUMNS, BodyTable, read_table
from cislunar.ephemeris.sampling import rotating_frame
from cislunar.observation.ground import station_positions, station_tracks
from cislunar.observation.scene import Scene, make_scene
from cislunar.tasking.settings import LoopSettings

Array = NDArray[np.float64]


class Sky(NamedTuple):
    """The bodies, and TDB seconds past J2000 of the campaign's epoch and of a run's start."""

    table: BodyTable
    epoch: float
    start: float


def true_forces(sky: Sky, dynamics: Dynamics) -> Ephemeris:
    """What truly moves the targets."""
    return _ephemeris(sky, dynamics, 1.0)


def believed_forces(
    sky: Sky, settings: CellSettings, loop: LoopSettings, low_lunar: ArrayLike
) -> tuple:
    """What the estimator believes; `low_lunar` says of which targets, see `is_low_lunar`."""
    dynamics = settings.dynamics
    if dynamics.filter == "ephemeris":
        return _ephemeris(sky, dynamics, dynamics.srp.believed_factor)
    return framed_cr3bp(sky.table, sky.start, loop.step_s, loop.n_steps, low_lunar)


def _ephemeris(sky: Sky, dynamics: Dynamics, factor: float) -> Ephemeris:
    area = dynamics.srp.area_to_mass * factor
    return ephemeris_forces(
        sky.table,
        sky.start,
        area_to_mass=area or None,
        reflectivity=dynamics.srp.reflectivity,
        figure=dynamics.lunar_harmonics,
    )


def placed_targets(sky: Sky, state: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
    """Mean states (target, 6) of the CR3BP among the bodies, and which are low lunar orbits."""
    return inertial_states(state, sky.table, sky.start)


def observer_tracks(
    sky: Sky,
    dynamics: Dynamics,
    state: ArrayLike,
    period: ArrayLike,
    ahead: list[Array],
    elapsed_s: Array,
) -> Array:
    """Satellites on orbits of the CR3BP among the bodies, (satellite, time, 3), inertial axes.

    Row by row of the orbits; `ahead` has the phases of the satellites of each, as fractions of the
    period. See `observer_states`.
    """
    forces = true_forces(sky._replace(start=sky.epoch), dynamics)
    times = sky.start - sky.epoch + elapsed_s
    flown = enumerate(zip(np.asarray(state), np.asarray(period), ahead, strict=True), start=1)
    return np.array(
        [
            observer_states(forces, dynamics, s, p, phase, times, f"the orbit of slot {slot}")
            for slot, (s, p, phases) in flown
            for phase in phases
        ]
    )[..., :3]


def grounded(sky: Sky, settings: CellSettings, loop: LoopSettings, *, inertial: bool) -> Array:
    """Tracks (station, time, 3) of the stations, in the rotating frame or inertial axes."""
    sites = settings.stations.values()
    if not sites:
        return np.empty((0, loop.n_steps + 1, 3))
    places = zip(*((s.latitude_deg, s.longitude_deg, s.height_m) for s in sites), strict=True)
    times = sky.start + loop.elapsed_s
    return station_tracks(station_positions(*places), sky.table, times, inertial=inertial)


def real_scene(sky: Sky, tracks: Array, loop: LoopSettings) -> Scene:
    """The scene of observers (observer, time, 3) in inertial axes."""
    position, velocity, _ = read_table(sky.table, sky.start + loop.elapsed_s)
    earth, moon = COLUMNS["earth"], COLUMNS["moon"]
    start = rotating_frame(
        position[0, moon] - position[0, earth], velocity[0, moon] - velocity[0, earth]
    )
    primaries = np.stack([position[:, earth], position[:, moon]], axis=1) / LENGTH_UNIT_KM
    sun = position[:, COLUMNS["sun"]] / LENGTH_UNIT_KM
    return make_scene(tracks, sun, loop.step_s, axes=start, primaries=primaries)
