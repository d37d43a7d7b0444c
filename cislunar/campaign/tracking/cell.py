"""A cell of the tracking campaign: from configuration and data sets to the closed loop."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.architecture.coverage import architecture_tracks
from cislunar.campaign.data.inputs import sun_at
from cislunar.campaign.data.progress import Progress
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.cells import Cell, check_cell
from cislunar.campaign.settings.library import (
    believed_surfaces,
    estimator_factory,
    loop_settings,
    truth_model,
)
from cislunar.campaign.settings.reading import typed
from cislunar.constants import TIME_UNIT_S
from cislunar.errors import ConfigurationError
from cislunar.observation.scene import Scene, TargetSurfaces, make_scene
from cislunar.tasking.closed_loop import LoopResult, LoopSettings, run_closed_loop
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
    """Seeds of the realizations in every cell; a longer list begins with shorter ones."""
    return [int(np.random.SeedSequence([seed, k]).generate_state(1)[0]) for k in range(count)]


def tracking_problem(
    cell: Cell,
    architecture: xr.Dataset,
    orbits: xr.Dataset,
    tracked: xr.Dataset,
    sun: xr.Dataset,
    settings: CellSettings,
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
    settings : CellSettings
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
    ids = monitored_targets(tracked.sizes["target"], cell.targets, settings.monitored_seed)
    # All targets are placed, so that a target starts at the same point in every monitored set.
    states = epoch_states(
        tracked["state"].values, tracked["period"].values, settings.monitored_seed
    )
    return Problem(
        make_scene(tracks, sun_at(sun, times), loop.step_s),
        believed_surfaces(settings, cell.targets),
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
    cell, architecture, orbits, tracked, sun, propagator
        As for `tracking_problem`.
    settings : mapping
        Of `cislunar.campaign.settings.cells.cell_settings`.
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
    chosen = typed(settings, CellSettings)
    loop = loop_settings(chosen, cell.interval_minutes, keep_information=keep_information)
    problem = tracking_problem(
        cell, architecture, orbits, tracked, sun, chosen, propagator=propagator, loop=loop
    )
    result = run_closed_loop(
        problem.scene,
        problem.surfaces,
        problem.epoch_state,
        problem.target_ids,
        realization_seeds(seed, chosen.seeds),
        loop,
        estimator=estimator_factory(cell.estimator, chosen),
        truth=problem.truth,
        progress=progress,
    )
    return result, problem, loop
