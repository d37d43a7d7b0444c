"""A cell of the tracking campaign: from configuration and data sets to the closed loop."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import count
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.campaign.architectures.variables import phases_of
from cislunar.campaign.data import forces_of
from cislunar.campaign.data.inputs import body_table, sun_at
from cislunar.campaign.settings import Cell, CellSettings, check_cell, orbits_of, typed
from cislunar.campaign.settings.cell_settings import observer_sensors, own_sensors, true_sensors
from cislunar.campaign.settings.library import (
    estimator_factory,
    loop_settings,
    nominal_surfaces,
    target_names,
    truth_model,
)
from cislunar.campaign.tracking.ephemeris_inputs import (
    CellEphemeris,
    assumed_forces,
    ephemeris_scene,
    flown_paths,
    ground_station_tracks,
    observer_tracks,
    satellites_ahead,
)
from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import (
    EARTH_MOON,
    advance_orbits,
    inertial_states,
    of_targets,
    propagate_bundle,
)
from cislunar.ephemeris.time_scales import tdb_after
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import InitialEstimate
from cislunar.estimation.navigation.table import errors_of_observers, load_observer_errors
from cislunar.observation import Scene, Sensors, TargetSurfaces, make_scene
from cislunar.runtime.netcdf import read_dataset
from cislunar.targets.maneuvers import Maneuvers, load_maneuvers
from cislunar.tasking import TruthModel, epoch_states, monitored_targets
from cislunar.tasking.closed_loop import ClosedLoop, LoopSettings
from cislunar.visibility.tracks import architecture_tracks


class CellInputs(NamedTuple):
    """Input data sets of a cell, by the names of their files in the workflow.

    ``architecture/{scenario}/{architecture}.nc``, ``orbits/families.nc`` or the architecture's own
    observers, ``orbits/tracked.nc`` and ``ephemeris/sun.nc``, the last two of the scenario, and its
    ``ephemeris/bodies.nc`` for ephemeris dynamics and ground stations; and, to save time,
    ``orbits/flown_{scenario}_{architecture}.nc`` for ephemeris-refined observers.
    """

    architecture: xr.Dataset
    orbits: xr.Dataset
    tracked: xr.Dataset
    sun: xr.Dataset
    bodies: xr.Dataset | None = None
    flown: xr.Dataset | None = None


def read_inputs(files: Any) -> CellInputs:
    """Read the data sets of a cell from an object with the path of each as attribute."""
    given = {name: getattr(files, name, None) for name in CellInputs._fields}
    return CellInputs(**{name: read_dataset(path) for name, path in given.items() if path})


class Problem(NamedTuple):
    """Inputs of the closed loop of a cell.

    `surfaces` are the assumed bodies, `truth` the true ones with the true noise. `epoch_state`,
    shape (target, 6), has the targets' mean states at the start of the run, nondimensional,
    propagation frame (see `cislunar.observation.scene`). `target_ids` are the rows of the targets
    in ``orbits/tracked.nc``; `observer_slot` is the slot of the architecture of each observer, -1
    for observers on the ground, which come last; `forces` are the assumed forces; `sensor` has the
    telescopes of all observers. `observer_names` are those of a user's table and of stations, and
    empty without both.
    """

    scene: Scene
    surfaces: TargetSurfaces
    truth: TruthModel
    epoch_state: NDArray[np.float64]
    target_ids: NDArray[np.int64]
    observer_slot: NDArray[np.int64]
    forces: tuple
    sensor: Sensors
    observer_names: Sequence[str] = ()


class Placement(NamedTuple):
    """Observers in orbit and targets of a cell, in the propagation frame.

    `tracks`, shape (observer, time, 3), are positions of the observers at all times of the scene,
    `epoch_state`, shape (target, 6), the targets' mean states at the start of the run, all
    nondimensional. `low_lunar`, shape (target,), tells which targets are in low lunar orbits. For
    `target_ids` see `Problem`. `initial` has initial estimates other than the paper's.
    """

    tracks: NDArray[np.float64]
    epoch_state: NDArray[np.float64]
    low_lunar: NDArray[np.bool_]
    target_ids: NDArray[np.int64]
    initial: InitialEstimate | None = None


def orbits_file(cell: Cell, orbits: xr.Dataset) -> str:
    """File of the orbits of a cell's observers; those of a user's table have names."""
    return orbits_of(cell.architecture, own="name" in orbits)


def target_labels(tracked: xr.Dataset, rows: NDArray[np.int64]) -> list[str]:
    """Names of targets of ``orbits/tracked.nc`` in data sets, exports and figures.

    A target has the id of the user's table; a target of the library has its orbit class and row,
    such as ``Halo_L2_S 12``.
    """
    if "name" in tracked:
        return tracked["name"].values[rows].astype(str).tolist()
    return [
        f"{family} {row}" for family, row in zip(tracked["family"].values[rows], rows, strict=True)
    ]


def realization_seeds(seed: int, count: int, first: int = 0) -> list[int]:
    """Seeds of the realizations from number `first` on; a longer list begins with shorter ones."""
    numbers = range(first, first + count)
    return [int(np.random.SeedSequence([seed, k]).generate_state(1)[0]) for k in numbers]


def cell_problem(
    cell: Cell,
    inputs: CellInputs,
    settings: CellSettings,
    propagator: str,
    loop: LoopSettings,
    placement: Placement | None = None,
) -> Problem:
    """Observers, targets and Sun of a cell; a `ConfigurationError` if its data sets do not fit.

    Without a `placement`, which has all targets, the observers are those of the architecture, and
    the targets are selected and placed on their orbits at random."""
    architecture, orbits, tracked, sun, bodies, _ = inputs
    orbit, satellites = architecture["orbit"].values, architecture["satellites"].values
    moving = settings.dynamics.truth == "ephemeris"
    ephemeris = cell_ephemeris(bodies, settings) if moving or settings.stations else None
    if placement is None:
        _check_architecture(cell, orbit, satellites, orbits)
        placement = _drawn_placement(cell, inputs, settings, propagator, loop, ephemeris)
    tracks, placed, low_lunar, ids, _ = placement
    names = target_names(tracked, ids.tolist())
    truth = truth_model(settings, names)
    forces: tuple = EARTH_MOON
    slots = np.repeat(np.arange(orbit.size), satellites)
    sensors = observer_sensors(settings, slots.size, own_sensors(orbits, orbit[slots]))
    truth = truth._replace(
        sensor=true_sensors(settings, sensors),
        observer_errors=_observer_errors(settings, orbits, orbit[slots]),
    )
    if ephemeris is not None:
        stations = ground_station_tracks(ephemeris, settings, loop, inertial=moving)
        tracks = np.concatenate([tracks, stations])
    if moving:
        scene = ephemeris_scene(ephemeris, tracks, loop)
        true_forces = forces_of(ephemeris.table, ephemeris.start, settings.dynamics)
        truth = truth._replace(forces=true_forces)
        forces = assumed_forces(ephemeris, settings, loop, low_lunar)
    else:
        scene = make_scene(tracks, sun_at(sun, scene_times(settings, loop)), loop.step_s)
    if settings.truth.maneuvers.table is not None:
        given = _table_maneuvers(settings, inputs, names, scene, placed, truth.forces)
        truth = truth._replace(maneuvers=given)
    return Problem(
        scene,
        nominal_surfaces(settings, names),
        truth,
        placed,
        ids,
        np.append(slots, np.full(len(settings.stations), -1)),
        forces,
        sensors,
        _observer_names(orbits, orbit[slots], settings),
    )


def scene_times(settings: CellSettings, loop: LoopSettings) -> NDArray[np.float64]:
    """Nondimensional times of the scene since the epoch."""
    start = settings.start_day * SECONDS_PER_DAY / TIME_UNIT_S
    return start + loop.elapsed_s / TIME_UNIT_S


def _check_architecture(
    cell: Cell, orbit: NDArray, satellites: NDArray, orbits: xr.Dataset
) -> None:
    """Refuse an architecture without observers, or of another library of orbits."""
    where = f"architecture/{cell.scenario}/{cell.architecture}.nc"
    if satellites.sum() < 1:
        raise ConfigurationError(
            f"{where} has no observers: every slot has 0 satellites; choose another architecture"
        )
    if orbit.min() < 0 or orbit.max() >= orbits.sizes["orbit"]:
        raise ConfigurationError(
            f"{where} refers to orbit {orbit.max()} of a library of {orbits.sizes['orbit']}: it "
            f"was made with another {orbits_file(cell, orbits)}; delete it and run snakemake again"
        )


def _drawn_placement(
    cell: Cell,
    inputs: CellInputs,
    settings: CellSettings,
    propagator: str,
    loop: LoopSettings,
    ephemeris: CellEphemeris | None,
) -> Placement:
    """Observers of the architecture, and targets selected and placed on their orbits at random."""
    architecture, orbits, tracked, *_ = inputs
    orbit, satellites = architecture["orbit"].values, architecture["satellites"].values
    times = scene_times(settings, loop)
    flown = orbits["state"].values[orbit], orbits["period"].values[orbit]
    phase = phases_of(architecture)
    ids = monitored_targets(tracked.sizes["target"], cell.targets, settings.monitored_seed)
    # All targets get a state, so that a target starts at the same point in every monitored set.
    periods = tracked["period"].values
    states = epoch_states(tracked["state"].values, periods, settings.monitored_seed)
    placed = advance_orbits(states[ids], periods[ids], times[0])
    if settings.dynamics.truth == "ephemeris":
        tracks = observer_tracks(
            ephemeris,
            settings.dynamics,
            *flown,
            satellites_ahead(architecture),
            loop.elapsed_s,
            None if inputs.flown is None else flown_paths(inputs.flown),
        )
        states = inertial_states(placed, ephemeris.table, ephemeris.start)
        return Placement(tracks, *states, ids)
    tracks = architecture_tracks(*flown, satellites, times, phase=phase, propagator=propagator)
    return Placement(tracks, placed, np.zeros(ids.size, dtype=bool), ids)


def _table_maneuvers(
    settings: CellSettings,
    inputs: CellInputs,
    names: Sequence[Sequence[str]],
    scene: Scene,
    state: NDArray[np.float64],
    forces: tuple,
) -> Maneuvers:
    """True maneuvers of the monitored targets by the table of the settings; an `InputFileError` if
    one cannot be. `state` (target, 6) are the targets' mean states at the start of the run."""
    start = tdb_after(inputs.sun["et"].values[0], SECONDS_PER_DAY * settings.start_day)
    table = load_maneuvers(settings.truth.maneuvers.table, settings.duration_hours, float(start))
    every = range(inputs.tracked.sizes["target"])
    known = {each for own in target_names(inputs.tracked, every) for each in own}
    table.require_known(known, "the scenario")
    found = table.of_targets(names)
    flown = np.unique(found.maneuvers.target)
    n_steps = scene.sun_position.shape[0] - 1
    path = propagate_bundle(state[flown], scene.step, n_steps, forces=of_targets(forces, flown))
    where = path[np.searchsorted(flown, found.maneuvers.target), :, :3]
    found.require_bound(scene.step_s, where, scene.primaries)
    return found.maneuvers


def _observer_names(
    orbits: xr.Dataset, rows: NDArray[np.int64], settings: CellSettings
) -> list[str]:
    """Names of all observers, if the user gave any. Those that share an orbit have a number after
    its name, and those on orbits of the library have the codes of exports."""
    if "name" not in orbits and not settings.stations:
        return []
    own = orbits["name"].values[rows].astype(str).tolist() if "name" in orbits else None
    names = own or [f"O{number:03d}" for number in range(1, rows.size + 1)]
    names += settings.stations
    found = [name if names.count(name) == 1 else "" for name in names]
    for k, name in enumerate(names):
        if not found[k]:
            numbered = (f"{name} {number}" for number in count(1))
            found[k] = next(each for each in numbered if each not in (*names, *found))
    return found


def _observer_errors(
    settings: CellSettings, orbits: xr.Dataset, rows: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """Constant errors of the observers by the table of the settings, (observer, 6), if there is
    one; `rows` are the orbits of the flying observers."""
    path = settings.observer_errors.table
    if path is None:
        return None
    names = [[str(number)] for number in range(rows.size + len(settings.stations))]
    for number, station in enumerate(settings.stations, start=rows.size):
        names[number].append(station)
    if "name" in orbits:
        own = orbits["name"].values[rows].astype(str)
        for number, name in enumerate(own):
            if np.sum(own == name) == 1:  # satellites that share an orbit have numbers alone
                names[number].append(str(name))
    return errors_of_observers(path, load_observer_errors(path), names)


def cell_ephemeris(bodies: xr.Dataset | None, settings: CellSettings) -> CellEphemeris:
    """Ephemeris and times of a cell.

    Raises
    ------
    ConfigurationError
        If `bodies` is None.
    """
    if bodies is None:
        raise ConfigurationError(
            "'task2.dynamics.truth' = 'ephemeris' and 'task2.stations' need ephemeris/bodies.nc: "
            "give it as `bodies`"
        )
    epoch = float(bodies["epoch_et"])
    return CellEphemeris(body_table(bodies), epoch, epoch + settings.start_day * SECONDS_PER_DAY)


def cell_loop(
    cell: Cell,
    inputs: CellInputs,
    settings: Mapping[str, Any],
    *,
    propagator: str,
    seed: int,
    keep_information: bool = False,
    placement: Placement | None = None,
) -> tuple[ClosedLoop, Problem]:
    """The closed loop of a cell with all its realizations, from the `seed` of the campaign.

    `settings` are those of `cell_settings`, `propagator` is that of the observers; for `placement`
    see `cell_problem`. Raises `ConfigurationError` if the cell cannot be run.
    """
    chosen = typed(settings, CellSettings)
    check_cell(cell, chosen, inputs.tracked.sizes["target"])
    loop = loop_settings(chosen, cell.interval_minutes, keep_information=keep_information)
    problem = cell_problem(cell, inputs, chosen, propagator, loop, placement)
    run = ClosedLoop(
        problem.scene,
        problem.surfaces,
        problem.epoch_state,
        problem.target_ids,
        realization_seeds(seed, chosen.seeds, chosen.first_realization),
        replace(loop, sensor=problem.sensor),
        estimator=estimator_factory(cell.estimator, chosen),
        initial=None if placement is None else placement.initial,
        truth=problem.truth,
        forces=problem.forces,
    )
    return run, problem
