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
from cislunar.campaign.tracking.cell import CellInputs, run_cell
from cislunar.campaign.tracking.records import RECORD_COORDINATES, recorded_variables
from cislunar.estimation.estimator import (
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
    """Generate the moving targets: ``orbits/tracked.nc``."""
    return orbit_set_dataset(
        tracked_targets(progress=progress), "target", "Orbits of the moving targets", {}
    )


def cell_dataset(
    cell: Cell,
    inputs: CellInputs,
    settings: Mapping[str, Any],
    *,
    propagator: str,
    seed: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Run a cell: ``task2/{scenario}/{architecture}/{estimator}/nt{n}_dt{minutes}.nc``."""
    result, problem, loop = run_cell(
        cell, inputs, settings, propagator=propagator, seed=seed, progress=progress
    )
    title = (
        f"Tracking of {cell.targets} targets by the {cell.architecture} architecture of scenario "
        f"{cell.scenario}, tasking every {cell.interval_minutes} min"
    )
    used = {**settings, "propagator": propagator, **cell._asdict()}
    ids, slot = problem.target_ids, problem.observer_slot
    coords = {
        "seed": ("seed", np.arange(settings["seeds"]), "1", "realization"),
        "time": ("time", result.elapsed_s, "s", "time since the epoch"),
        "step": ("step", loop.elapsed_s[1:], "s", "time since the epoch"),
        "epoch": ("epoch", loop.step_s * loop.epochs, "s", "time since the epoch"),
        "component": ("component", list(COMPONENTS), "1", "component of the state"),
        "component_unit": ("component", list(COMPONENT_UNITS), "1", "unit of the component"),
        "part": ("part", list(PARTS), "1", "part of the state"),
        "target_id": ("target", ids, "1", "row of the target in orbits/tracked.nc"),
        "family": ("target", list(inputs.tracked["family"].values[ids]), "1",
                   "orbit class of the target"),
        "observer_orbit": ("observer", inputs.architecture["orbit"].values[slot], "1",
                           "row in orbits/families.nc"),
        "observer_slot": ("observer", slot, "1", "slot of the architecture"),
    }  # fmt: skip
    described = _described(result, loop) | recorded_variables(result.records, problem.scene)
    dims = {dim for along, *_ in described.values() for dim in along}
    coords |= {name: each for name, each in RECORD_COORDINATES.items() if name in dims}
    return xr.Dataset(
        {name: variable(*each, **_FLAGS.get(name, {})) for name, each in described.items()},
        coords={name: variable(*each) for name, each in coords.items()},
        attrs=provenance(title, settings=used, seed=seed),
    )


def _flags(names: tuple[str, ...]) -> dict[str, Any]:
    """Attributes that give the meaning of small integers."""
    return {
        "flag_values": np.arange(len(names), dtype=np.uint8),
        "flag_meanings": " ".join(names),
    }


_FLAGS = {
    "fate": _flags(FATE_NAMES),
    "look_fate": _flags(FATE_NAMES),
    "status": _flags(STATUS_NAMES),
    "status_rotation": _flags(STATUS_NAMES),
    "status_translation": _flags(STATUS_NAMES),
}

_COUNTED = {
    "updates": (UPDATES, "measurements used"),
    "out_of_field": (OUT_OF_FIELD, "measurements outside the field of view"),
    "dark_sigma_points": (FLOOR_HITS, "sigma points without reflected light"),
    "cholesky_failures": (CHOLESKY_FAILURES, "failed Cholesky factorizations"),
}


def _described(result: LoopResult, loop: LoopSettings) -> dict[str, tuple]:
    """Dimensions, values, unit and meaning of every variable of a cell."""
    found = result.metrics
    target, epoch = ("seed", "target"), ("seed", "epoch")
    history = ("seed", "time", "target", "component")
    axes = ("seed", "target", "component")
    valid = result.valid[:, loop.recorded].astype(np.int8)
    several = "see component_unit"
    described = {
        "assignment": (
            (*epoch, "observer"), result.assignment, "1",
            "index of the target along dimension target, -1 for an idle observer"),
        "information": (epoch, result.information, "nat", "mutual information of the tasking"),
        "evaluations": (epoch, result.evaluations.astype(np.int32), "1", "taskings tried"),
        "valid": (("seed", "time", "target"), valid, "1", "1 where a measurement was used"),
        "fate": (("seed", "step", "target"), result.fate, "1", "what became of the measurement"),
        "error": (history, result.error, several, "truth less estimate (attitude: GRP)"),
        "sigma": (history, result.sigma, several, "standard deviation"),
        "bound": (history, result.bound, several,
                  "standard deviation of the posterior Cramer-Rao bound"),
        "coverage": (axes, found.coverage, "1", "share of the time within 3 sigma"),
        "anees": (axes, found.anees, "1", "average normalized estimation error squared"),
        "rmse": (axes, found.rmse, several, "root mean square error"),
        "status": (target, found.status, "1", "status of the target"),
        "status_rotation": (
            target, found.status_rotation, "1", "status of attitude and angular velocity"),
        "status_translation": (
            target, found.status_translation, "1", "status of position and velocity"),
        "final_attitude_error": (target, found.final_attitude_error_deg, "degree",
                                 "root mean square attitude error over the final hours"),
        "bound_ratio": ((*target, "part"), found.bound_ratio, "1",
                        "root mean square error over Cramer-Rao bound in the final hours"),
        "bound_attitude": (
            target, found.bound_attitude_deg, "degree",
            "root mean square attitude of the Cramer-Rao bound over the final hours"),
    }  # fmt: skip
    for name, (index, meaning) in _COUNTED.items():
        described[name] = (target, result.counters[..., index].astype(np.int32), "1", meaning)
    described["failed"] = (target, result.failed, "1", "0, or why the estimate came to an end")
    return described
