"""Data sets of sensor tasking and tracking: the moving targets, and one cell of the campaign."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from cislunar.campaign.data.inputs import orbit_set_dataset
from cislunar.campaign.data.netcdf import variable
from cislunar.campaign.data.progress import Progress
from cislunar.campaign.data.provenance import provenance
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.cell import run_cell
from cislunar.estimation.kalman.mukf_kernels import (
    CHOLESKY_FAILURES,
    FLOOR_HITS,
    OUT_OF_FIELD,
    UPDATES,
)
from cislunar.evaluation.metrics import PARTS, STATUS_NAMES
from cislunar.orbits.tracked import tracked_targets
from cislunar.tasking.closed_loop import FATE_NAMES, LoopResult, LoopSettings

COMPONENTS = tuple(
    f"{part}_{axis}"
    for part in ("attitude", "angular_velocity", "position", "velocity")
    for axis in "xyz"
)
COMPONENT_UNITS = ("1",) * 3 + ("rad s-1",) * 3 + ("1",) * 6


def tracked_dataset(progress: Progress | None = None) -> xr.Dataset:
    """Generate the moving targets.

    Parameters
    ----------
    progress : callable, optional
        Called with (orbits done, orbits in all).

    Returns
    -------
    xarray.Dataset
        ``orbits/tracked.nc``.
    """
    return orbit_set_dataset(
        tracked_targets(progress=progress), "target", "Orbits of the moving targets", {}
    )


def cell_dataset(
    cell: Cell,
    architecture: xr.Dataset,
    orbits: xr.Dataset,
    tracked: xr.Dataset,
    sun: xr.Dataset,
    settings: Mapping[str, Any],
    *,
    propagator: str,
    seed: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Run a cell with all its seeds.

    Parameters
    ----------
    cell, architecture, orbits, tracked, sun, settings, propagator, seed, progress
        As for `run_cell`.

    Returns
    -------
    xarray.Dataset
        ``task2/{scenario}/{architecture}/{estimator}/nt{n}_dt{minutes}.nc``.
    """
    result, problem, loop = run_cell(
        cell,
        architecture,
        orbits,
        tracked,
        sun,
        settings,
        propagator=propagator,
        seed=seed,
        progress=progress,
    )
    title = (
        f"Tracking of {cell.targets} targets by the {cell.architecture} architecture of scenario "
        f"{cell.scenario}, tasking every {cell.interval_minutes} min"
    )
    used = {**settings, "propagator": propagator, **cell._asdict()}
    slot = problem.observer_slot
    return xr.Dataset(
        _tasking(result) | _time_histories(result, loop) | _metrics(result) | _counters(result),
        coords={
            "seed": variable("seed", np.arange(settings["seeds"]), "1", "realization"),
            "time": variable("time", result.elapsed_s, "s", "time since the epoch"),
            "step": variable("step", loop.elapsed_s[1:], "s", "time since the epoch"),
            "epoch": variable("epoch", loop.step_s * loop.epochs, "s", "time since the epoch"),
            "component": variable("component", list(COMPONENTS), "1", "component of the state"),
            "component_unit": variable(
                "component", list(COMPONENT_UNITS), "1", "unit of the component"
            ),
            "part": variable("part", list(PARTS), "1", "part of the state"),
            "target_id": variable(
                "target", problem.target_ids, "1", "row of the target in orbits/tracked.nc"
            ),
            "family": variable(
                "target",
                list(tracked["family"].values[problem.target_ids]),
                "1",
                "orbit class of the target",
            ),
            "observer_orbit": variable(
                "observer", architecture["orbit"].values[slot], "1", "row in orbits/families.nc"
            ),
            "observer_slot": variable("observer", slot, "1", "slot of the architecture"),
        },
        attrs=provenance(title, settings=used, seed=seed),
    )


def _flags(names: tuple[str, ...]) -> dict[str, Any]:
    """Attributes that give the meaning of small integers."""
    return {
        "flag_values": np.arange(len(names), dtype=np.uint8),
        "flag_meanings": " ".join(names),
    }


def _tasking(result: LoopResult) -> dict[str, xr.Variable]:
    return {
        "assignment": variable(
            ("seed", "epoch", "observer"),
            result.assignment,
            "1",
            "index of the target along dimension target, -1 for an idle observer",
        ),
        "information": variable(
            ("seed", "epoch"), result.information, "nat", "mutual information of the tasking"
        ),
        "evaluations": variable(
            ("seed", "epoch"), result.evaluations.astype(np.int32), "1", "taskings tried"
        ),
    }


def _time_histories(result: LoopResult, loop: LoopSettings) -> dict[str, xr.Variable]:
    dims = ("seed", "time", "target", "component")
    step = ("seed", "step", "target")
    valid = result.valid[:, loop.recorded].astype(np.int8)
    return {
        "valid": variable(("seed", "time", "target"), valid, "1", "1 where a measurement was used"),
        "fate": variable(
            step, result.fate, "1", "what became of the measurement", **_flags(FATE_NAMES)
        ),
        "error": variable(
            dims, result.error, "see component_unit", "truth less estimate (attitude: GRP)"
        ),
        "sigma": variable(dims, result.sigma, "see component_unit", "standard deviation"),
        "bound": variable(
            dims,
            result.bound,
            "see component_unit",
            "standard deviation of the posterior Cramer-Rao bound",
        ),
    }


def _metrics(result: LoopResult) -> dict[str, xr.Variable]:
    found = result.metrics
    dims, status = ("seed", "target", "component"), ("seed", "target")
    flags = _flags(STATUS_NAMES)
    return {
        "coverage": variable(dims, found.coverage, "1", "share of the time within 3 sigma"),
        "anees": variable(dims, found.anees, "1", "average normalized estimation error squared"),
        "rmse": variable(dims, found.rmse, "see component_unit", "root mean square error"),
        "status": variable(status, found.status, "1", "status of the target", **flags),
        "status_rotation": variable(
            status, found.status_rotation, "1", "status of attitude and angular velocity", **flags
        ),
        "status_translation": variable(
            status, found.status_translation, "1", "status of position and velocity", **flags
        ),
        "final_attitude_error": variable(
            status,
            found.final_attitude_error_deg,
            "degree",
            "root mean square attitude error over the final hours",
        ),
        "bound_ratio": variable(
            ("seed", "target", "part"),
            found.bound_ratio,
            "1",
            "root mean square error over Cramer-Rao bound in the final hours",
        ),
        "bound_attitude": variable(
            status,
            found.bound_attitude_deg,
            "degree",
            "root mean square attitude of the Cramer-Rao bound over the final hours",
        ),
    }


def _counters(result: LoopResult) -> dict[str, xr.Variable]:
    names = {
        "updates": (UPDATES, "measurements used"),
        "out_of_field": (OUT_OF_FIELD, "measurements outside the field of view"),
        "dark_sigma_points": (FLOOR_HITS, "sigma points without reflected light"),
        "cholesky_failures": (CHOLESKY_FAILURES, "failed Cholesky factorizations"),
    }
    counted = {
        name: variable(("seed", "target"), result.counters[..., index].astype(np.int32), "1", what)
        for name, (index, what) in names.items()
    }
    counted["failed"] = variable(
        ("seed", "target"), result.failed, "1", "0, or why the estimate came to an end"
    )
    return counted
