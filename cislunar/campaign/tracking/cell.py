"""A cell of the tracking campaign: from configuration and data sets to the closed loop."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.architecture.coverage import architecture_tracks
from cislunar.campaign.data.inputs import sun_at
from cislunar.campaign.data.progress import Progress
from cislunar.campaign.settings.cells import Cell, check_cell, true_settings
from cislunar.constants import TIME_UNIT_S
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import EstimatorFactory
from cislunar.estimation.kalman.mukf import Spread
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.registry import estimator_named
from cislunar.observation.exclusion import ExclusionAngles
from cislunar.observation.measurement import Sensor
from cislunar.observation.scene import Scene, TargetSurfaces, make_scene, target_surfaces
from cislunar.photometry.materials import Material, PhotometryModel
from cislunar.photometry.mesh_files import load_shape
from cislunar.photometry.shapes import Facets, icosahedron, scale_to_sphere, stretch
from cislunar.tasking.closed_loop import LoopResult, LoopSettings, run_closed_loop
from cislunar.tasking.information import TaskingModel
from cislunar.tasking.simulation import TruthModel, epoch_states, monitored_targets


class Problem(NamedTuple):
    """What a cell needs of the world.

    Attributes
    ----------
    scene : Scene
        Observers, Sun and frames at all steps.
    surfaces : TargetSurfaces
        Shapes, materials and inertia of the monitored targets, as the estimator believes them.
    truth : TruthModel
        What they truly are, and the true noise.
    epoch_state : ndarray, shape (target, 6)
        Their mean states at the epoch, nondimensional, rotating frame.
    target_ids : ndarray of int, shape (target,)
        Their rows in ``orbits/tracked.nc``.
    observer_slot : ndarray of int, shape (observer,)
        Slot of the architecture each observer flies in.
    """

    scene: Scene
    surfaces: TargetSurfaces
    truth: TruthModel
    epoch_state: NDArray[np.float64]
    target_ids: NDArray[np.int64]
    observer_slot: NDArray[np.int64]


def realization_seeds(seed: int, count: int) -> list[int]:
    """Seeds of the realizations of truth and noise, the same in every cell.

    Parameters
    ----------
    seed : int
        Seed of the campaign.
    count : int
        Number of realizations.

    Returns
    -------
    list of int
        A longer list begins with the shorter ones.
    """
    return [int(np.random.SeedSequence([seed, k]).generate_state(1)[0]) for k in range(count)]


def body_facets(body: Mapping[str, Any]) -> Facets:
    """Shape of the targets.

    Parameters
    ----------
    body : mapping
        Configuration key `task2.body`.

    Returns
    -------
    Facets
    """
    shape, radius = body["shape"], body["radius_m"]
    if shape == "icosahedron":
        facets = icosahedron(radius)
    else:
        facets = load_shape(shape, metres_per_unit=body["metres_per_unit"], radius_m=radius)
    stretched = stretch(facets, body["stretch"])
    if stretched is facets or radius is None:
        return stretched
    return scale_to_sphere(stretched, radius)


def _sensor(sensor: Mapping[str, Any]) -> Sensor:
    """Configuration key `task2.sensor` as the library's."""
    given = dict(sensor)
    angles = {f"{body}_deg": angle for body, angle in given.pop("exclusion_deg").items()}
    return Sensor(**given, exclusion=ExclusionAngles(**angles))


def _surfaces(
    settings: Mapping[str, Any], photometry: Mapping[str, Any], n_targets: int
) -> TargetSurfaces:
    """The same body for all targets."""
    inertia = settings["body"]["inertia"]
    return target_surfaces(
        body_facets(settings["body"]),
        Material(**settings["material"]),
        n_targets,
        PhotometryModel(**photometry),
        inertia=1.0 if inertia is None else inertia,
    )


def truth_model(settings: Mapping[str, Any], n_targets: int) -> TruthModel:
    """What the targets truly are, and the true noise.

    Parameters
    ----------
    settings : mapping
        Settings of the cell.
    n_targets : int
        Number of monitored targets.

    Returns
    -------
    TruthModel
        What the estimators believe, unless the configuration key `task2.truth` says otherwise.
    """
    true = true_settings(settings)
    deg_h2 = np.array(true["angular_acceleration_deg_h2"], dtype=float)
    return TruthModel(
        _surfaces(true, settings["photometry"], n_targets),
        _sensor(true["sensor"]).noise,
        np.deg2rad(deg_h2) / 3600.0**2,
    )


def loop_settings(
    settings: Mapping[str, Any], interval_minutes: int, *, keep_information: bool = False
) -> LoopSettings:
    """Settings of the closed loop.

    Parameters
    ----------
    settings : mapping
        Of `cislunar.campaign.settings.cells.cell_settings`.
    interval_minutes : int
        Time between tasking epochs.
    keep_information : bool
        Keep the information of all pairs.

    Returns
    -------
    LoopSettings
    """
    tasking = settings["tasking"]
    return LoopSettings(
        step_s=settings["step_s"],
        interval_minutes=interval_minutes,
        duration_hours=settings["duration_hours"],
        method=tasking["method"],
        max_evaluations=tasking["max_evaluations"],
        early_stop=tasking["early_stop"],
        sensor=_sensor(settings["sensor"]),
        tasking=TaskingModel(
            diffuse_reflection_coefficient=tasking["diffuse_reflection_coefficient"],
            # the sphere that stands in for the body has its surface area
            radius_m=body_facets(settings["body"]).equivalent_radius,
            states=tasking["states"],
            track_gate=tasking["track_gate"],
            measurements=tasking["credited_measurements"],
        ),
        initial=Spread(**settings["initial_sigma"]),
        record_every=round(60.0 * settings["record_minutes"] / settings["step_s"]),
        keep_information=keep_information,
    )


def estimator_factory(name: str, settings: Mapping[str, Any]) -> EstimatorFactory:
    """The estimator of a cell.

    Parameters
    ----------
    name : str
        As in the configuration key `task2.estimators`.
    settings : mapping
        Settings of the cell.

    Returns
    -------
    EstimatorFactory

    Raises
    ------
    ConfigurationError
        If there is no such estimator.
    """
    return estimator_named(
        name,
        process_noise=Spread(**settings["process_noise"]),
        batch_settings=BatchSettings(**settings["batch"]),
    )


def tracking_problem(
    cell: Cell,
    architecture: xr.Dataset,
    orbits: xr.Dataset,
    tracked: xr.Dataset,
    sun: xr.Dataset,
    settings: Mapping[str, Any],
    *,
    propagator: str,
    loop: LoopSettings,
) -> Problem:
    """Observers, targets and Sun of a cell.

    Parameters
    ----------
    cell : Cell
        Which cell.
    architecture, orbits, tracked, sun : xarray.Dataset
        ``architecture/{scenario}/{architecture}.nc``, ``orbits/families.nc``,
        ``orbits/tracked.nc``, ``ephemeris/sun.nc``.
    settings : mapping
        Settings of the cell.
    propagator : str
        Of the observers.
    loop : LoopSettings
        For its times.

    Returns
    -------
    Problem

    Raises
    ------
    ConfigurationError
        If the architecture has no observers or does not fit the orbit library, or there are not
        so many targets.
    """
    where = f"architecture/{cell.scenario}/{cell.architecture}.nc"
    orbit, satellites = architecture["orbit"].values, architecture["satellites"].values
    if satellites.sum() < 1:
        raise ConfigurationError(
            f"{where} has no observers: every slot has 0 satellites; choose another architecture"
        )
    if orbit.min() < 0 or orbit.max() >= orbits.sizes["orbit"]:
        raise ConfigurationError(
            f"{where} refers to orbit {orbit.max()} of a library of {orbits.sizes['orbit']}: it "
            "was made with another orbits/families.nc; delete it and run snakemake again"
        )
    times = loop.elapsed_s / TIME_UNIT_S
    tracks = architecture_tracks(
        orbits["state"].values[orbit],
        orbits["period"].values[orbit],
        satellites,
        times,
        propagator=propagator,
    )
    ids = monitored_targets(tracked.sizes["target"], cell.targets, settings["monitored_seed"])
    # All targets are placed, so that a target starts at the same point in every monitored set.
    states = epoch_states(
        tracked["state"].values, tracked["period"].values, settings["monitored_seed"]
    )
    return Problem(
        make_scene(tracks, sun_at(sun, times), loop.step_s),
        _surfaces(settings, settings["photometry"], cell.targets),
        truth_model(settings, cell.targets),
        states[ids],
        ids,
        np.repeat(np.arange(orbit.size), satellites),
    )


def run_cell(
    cell: Cell,
    architecture: xr.Dataset,
    orbits: xr.Dataset,
    tracked: xr.Dataset,
    sun: xr.Dataset,
    settings: Mapping[str, Any],
    *,
    propagator: str,
    seed: int,
    keep_information: bool = False,
    progress: Progress | None = None,
) -> tuple[LoopResult, Problem, LoopSettings]:
    """Run the closed loop of a cell.

    Parameters
    ----------
    cell, architecture, orbits, tracked, sun, settings, propagator
        As for `tracking_problem`.
    seed : int
        Seed of the campaign.
    keep_information : bool
        Keep the information of all pairs.
    progress : callable, optional
        Called with (epochs done, epochs of all seeds).

    Returns
    -------
    LoopResult, Problem, LoopSettings

    Raises
    ------
    ConfigurationError
        If the cell cannot be run.
    """
    check_cell(cell.targets, cell.interval_minutes, settings, tracked.sizes["target"])
    loop = loop_settings(settings, cell.interval_minutes, keep_information=keep_information)
    problem = tracking_problem(
        cell, architecture, orbits, tracked, sun, settings, propagator=propagator, loop=loop
    )
    result = run_closed_loop(
        problem.scene,
        problem.surfaces,
        problem.epoch_state,
        problem.target_ids,
        realization_seeds(seed, settings["seeds"]),
        loop,
        estimator=estimator_factory(cell.estimator, settings),
        truth=problem.truth,
        progress=progress,
    )
    return result, problem, loop
