"""Data sets of sensor tasking and tracking: the moving targets, and one cell of the campaign."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.association.tracks import TRACK_STATUS_NAMES
from cislunar.campaign.data.inputs import orbit_set_dataset
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.cell import (
    CellInputs,
    Placement,
    Problem,
    cell_loop,
    orbits_file,
    target_labels,
)
from cislunar.campaign.tracking.checkpoint import CHECKPOINT_S, Checkpoint, checkpoint_folder
from cislunar.campaign.tracking.records import (
    EPHEMERIS_FRAME,
    RECORD_COORDINATES,
    ROTATING,
    observer_variables,
    start_day,
)
from cislunar.dynamics.cr3bp import CR3BP
from cislunar.estimation.estimator import CHOLESKY_FAILURES, FLOOR_HITS, OUT_OF_FIELD, UPDATES
from cislunar.estimation.light_curves.model_selection.characterization import (
    ATTITUDE_STATUS_NAMES,
)
from cislunar.evaluation import CHARACTERIZED_FIELDS, PARTS, TARGET_STATUS_NAMES
from cislunar.orbits.tracked import tracked_targets
from cislunar.runtime import Later, Progress, growing_dataset, variable
from cislunar.runtime.provenance import provenance
from cislunar.tasking import OBSERVATION_COLUMNS, ClosedLoop, kept_histories, log_variables
from cislunar.tasking.detection_outcomes import (
    SettingNames,
    count_outcomes,
    report_estimated_parameters,
    report_outcomes,
)
from cislunar.tasking.realization import OUTCOME_NAMES, USED
from cislunar.tasking.recording import Piece, fill

COMPONENTS = tuple(
    f"{part}_{axis}"
    for part in ("attitude", "angular_velocity", "position", "velocity")
    for axis in "xyz"
)
_COMPONENT_UNITS = ("1",) * 3 + ("rad s-1",) * 3 + ("1",) * 6
SETTING_KEYS = SettingNames(
    limit="task2.sensor.limiting_magnitude",
    body="task2.material and task2.body",
    irradiance="task2.photometry.irradiance",
    sphere="task2.tasking.diffuse_reflection_coefficient",
    exclusion="task2.sensor.exclusion_deg",
    interval="task2.interval_minutes",
)
"""Names of settings in warnings."""


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
    placement: Placement | None = None,
    names: SettingNames = SETTING_KEYS,
) -> xr.Dataset:
    """Run a cell in memory; `write_cell` writes the same data set to a file, with less memory.

    See `cell_loop` for the arguments. Warnings name settings by `names`.
    """
    given = {"propagator": propagator, "seed": seed, "placement": placement}
    loop, problem = cell_loop(cell, inputs, settings, **given)
    pieces = list(loop.pieces(progress))
    used = {**settings, "propagator": propagator, **cell._asdict()}
    described, sizes = _histories(loop), _sizes(loop)
    whole = {
        name: np.empty([sizes[dim] for dim in each.dims], each.dtype)
        for name, each in described.items()
    }
    report_outcomes(_fill(whole, pieces, loop), loop.inputs, names)
    _report_estimated_parameters(whole, loop)
    values = {
        name: xr.Variable(each.dims, whole[name], each.attributes)
        for name, each in described.items()
    }
    return _dataset(cell, inputs, loop, problem, values, _provenance(cell, used, seed))


def write_cell(
    cell: Cell,
    inputs: CellInputs,
    settings: Mapping[str, Any],
    path: str | Path,
    *,
    propagator: str,
    seed: int,
    progress: Progress | None = None,
    checkpoint_s: float = CHECKPOINT_S,
    realization: int | None = None,
) -> None:
    """Run a cell: ``task2/{scenario}/{architecture}/{estimator}/nt{n}_dt{minutes}.nc``.

    Its histories are written a day or a realization at a time. An interrupted run continues from
    its last `Checkpoint`.

    Parameters
    ----------
    cell, inputs, settings, propagator, seed
        See `cell_loop`.
    path : str or Path
        The file to write; checkpoints are in a folder beside it until it is complete.
    progress : callable, optional
        Called with (tasking epochs done, those of all realizations).
    checkpoint_s : float
        Least time between checkpoints, s.
    realization : int, optional
        Run this realization alone, and store it as a checkpoint for the process that writes the
        file.

    Raises
    ------
    ConfigurationError
        If the cell cannot be run, or there is a checkpoint of another one.
    InputFileError
        If the disk is full, or a checkpoint cannot be read; the last complete checkpoint is kept.
    """
    loop, problem = cell_loop(cell, inputs, settings, propagator=propagator, seed=seed)
    used = {**settings, "propagator": propagator, **cell._asdict()}
    attributes = _provenance(cell, used, seed)
    checkpoint = Checkpoint(checkpoint_folder(path), loop, attributes, least_s=checkpoint_s)
    checkpoint.run(progress, realization=realization)
    if realization is not None:
        return
    rest = _dataset(cell, inputs, loop, problem, {}, attributes)
    later = _histories(loop)
    with growing_dataset(rest, path, later, {"observation": loop.state.observations}) as whole:
        outcomes = _fill(whole, checkpoint.pieces(), loop)
        _report_estimated_parameters(whole, loop)
    checkpoint.remove()
    report_outcomes(outcomes, loop.inputs, SETTING_KEYS)


def _report_estimated_parameters(whole: Mapping[str, Any], loop: ClosedLoop) -> None:
    """Warn of estimated parameters that light curves cannot determine, if there are any."""
    if loop.estimated_parameters:
        updates = loop.ends()[2][..., UPDATES]
        report_estimated_parameters(
            whole["parameter_sigma"],
            loop.estimated_parameters,
            updates,
            "task2.batch.estimated_parameters",
        )


def _provenance(cell: Cell, used: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Attributes of a cell's file."""
    title = (
        f"Tracking of {cell.targets} targets by the {cell.architecture} architecture of scenario "
        f"{cell.scenario}, tasking every {cell.interval_minutes} min"
    )
    return provenance(title, settings=used, seed=seed)


def _dataset(
    cell: Cell,
    inputs: CellInputs,
    loop: ClosedLoop,
    problem: Problem,
    histories: Mapping[str, xr.Variable],
    attributes: Mapping[str, Any],
) -> xr.Dataset:
    """Coordinates, histories if given, and results of a run."""
    settings, ids, slot = loop.inputs.settings, problem.target_ids, problem.observer_slot
    orbit_of = np.where(slot < 0, -1, inputs.architecture["orbit"].values[slot])
    since, days = "time since the epoch", start_day(attributes)
    since += f" and {days:g} days" if days else ""
    coords = {
        "seed": ("seed", np.arange(len(loop.seeds)), "1", "realization"),
        "time": ("time", settings.step_s * (settings.recorded + 1.0), "s", since),
        "step": ("step", settings.elapsed_s[1:], "s", since),
        "epoch": ("epoch", settings.step_s * settings.epochs, "s", since),
        "component": ("component", list(COMPONENTS), "1", "component of the state"),
        "component_unit": ("component", list(_COMPONENT_UNITS), "1", "unit of the component"),
        "part": ("part", list(PARTS), "1", "part of the state"),
        "target_id": ("target", ids, "1", "row of the target in orbits/tracked.nc"),
        "target_name": ("target", target_labels(inputs.tracked, ids), "1",
                        "name of the target: id in the user's table, or orbit class and row"),
        "family": ("target", list(inputs.tracked["family"].values[ids]), "1",
                   "orbit class of the target"),
        "observer_orbit": ("observer", orbit_of, "1",
                           f"row in {orbits_file(cell, inputs.orbits)}"),
        "observer_slot": ("observer", slot, "1", "slot of the architecture"),
    }  # fmt: skip
    if problem.observer_names:
        coords["observer_name"] = "observer", list(problem.observer_names), "1", "name"
    names = list(loop.estimated_parameters)
    if names:
        units = ["degree h-2" if name.startswith("angular") else "1" for name in names]
        coords["parameter"] = "parameter", names, "1", "estimated body parameter"
        coords["parameter_unit"] = "parameter", units, "1", "unit of the parameter"
    described = _results(loop)
    if loop.inputs.records_maneuvers:
        described |= log_variables(loop.maneuvers())
    if loop.inputs.abilities.maneuvers_per_day:
        described |= log_variables(loop.recovered())
    if (found := loop.characterized()) is not None:
        described |= {
            name: (("seed", "target", *each.dims), getattr(found, name), each.unit, each.meaning)
            for name, each in CHARACTERIZED_FIELDS.items()
        }
    described |= observer_variables(settings.record, problem.scene, _frame(loop))
    kept = [*_histories(loop).values(), *described.values()]
    coords |= {name: RECORD_COORDINATES[name] for name in _record_dims(kept)}
    if settings.slots is not None:
        begins = 60.0 * settings.schedule.slot_minutes * np.arange(settings.slots)
        coords["slot"] = "slot", begins, "s", "time since the tasking epoch"
    return xr.Dataset(
        histories
        | {
            name: xr.Variable(dims, values, _attributes(name, unit, meaning))
            for name, (dims, values, unit, meaning) in described.items()
        },
        coords={name: variable(*each) for name, each in coords.items()},
        attrs=attributes,
    )


def _flags(names: tuple[str, ...]) -> dict[str, Any]:
    """Attributes that give the meaning of small integers."""
    return {"flag_values": np.arange(len(names), dtype=np.uint8), "flag_meanings": " ".join(names)}


_INCONSISTENT = "; inconsistent: observed, but inconsistent with its covariance in the final hours"

_FLAGS = {
    "outcome": _flags(OUTCOME_NAMES),
    "observation_outcome": _flags(OUTCOME_NAMES),
    "status": _flags(TARGET_STATUS_NAMES),
    "status_rotation": _flags(TARGET_STATUS_NAMES),
    "status_translation": _flags(TARGET_STATUS_NAMES),
    "attitude_status": _flags(ATTITUDE_STATUS_NAMES),
    "track_status": _flags(TRACK_STATUS_NAMES),
}


def _attributes(name: str, unit: str, meaning: str) -> dict[str, Any]:
    return {"units": unit, "long_name": meaning, **_FLAGS.get(name, {})}


_COUNTED = {
    "updates": (UPDATES, "measurements used"),
    "out_of_field": (OUT_OF_FIELD, "measurements outside the field of view"),
    "undetectable_sigma_points": (FLOOR_HITS, "undetectable sigma points"),
    "cholesky_failures": (CHOLESKY_FAILURES, "failed Cholesky factorizations"),
}

_SEVERAL = "see component_unit"


def _histories(loop: ClosedLoop) -> dict[str, Later]:
    """The histories and observations of a cell as variables."""
    settings, frame = loop.inputs.settings, _frame(loop)
    found = {
        name: Later(
            ("seed", each.along, *each.dims),
            "i1" if each.dtype == "bool" else each.dtype,
            _attributes(name, each.unit, each.long_name.format(frame=frame)),
        )
        for name, each in kept_histories(settings, loop.inputs.outputs).items()
    }
    attributes = _attributes("valid", "1", "1 where a measurement was used")
    found["valid"] = Later(("seed", "time", "target"), "i1", attributes)
    if "measurements" in settings.record:
        found |= {
            name: Later(("observation",), each.dtype, _attributes(name, *each[1:3]))
            for name, each in OBSERVATION_COLUMNS.items()
        }
    return found


def _frame(loop: ClosedLoop) -> str:
    """Unit and frame of positions and velocities of a cell."""
    return ROTATING if isinstance(loop.inputs.truth.forces, CR3BP) else EPHEMERIS_FRAME


def _record_dims(several: Iterable[tuple]) -> list[str]:
    """Coordinates of recorded variables, which begin with their dimensions."""
    found = [dims for dims, *_ in several]
    return [name for name in RECORD_COORDINATES if any(name in dims for dims in found)]


def _sizes(loop: ClosedLoop) -> dict[str, int]:
    """Lengths of the dimensions of the histories."""
    inputs = loop.inputs
    recorded = _record_dims(_histories(loop).values())
    own = {name: len(RECORD_COORDINATES[name][1]) for name in recorded}
    return {
        **loop.lengths,
        **own,
        "seed": len(loop.seeds),
        "target": inputs.ids.size,
        "observer": inputs.scene.observer_position.shape[0],
        "slot": inputs.settings.slots or 1,
        "component": len(COMPONENTS),
        "parameter": len(loop.estimated_parameters),
        "observation": loop.state.observations,
    }


def _fill(whole: Mapping[str, Any], pieces: Iterable[Piece], loop: ClosedLoop) -> NDArray[np.int64]:
    """Put pieces into arrays, or variables of an open file; returns the number of each outcome."""
    done, outcomes = 0, np.zeros(len(OUTCOME_NAMES), dtype=np.int64)
    for piece in pieces:
        fill(whole, piece)
        outcome, recorded = piece.kept["outcome"], piece.extent["time"]
        steps = loop.inputs.settings.recorded[recorded] - piece.extent["step"].start
        whole["valid"][piece.seed, recorded] = (outcome[steps] == USED).astype(np.int8)
        outcomes += count_outcomes(outcome)
        if piece.observations is not None:
            rows = slice(done, done + piece.observations.step.size)
            for name, column in OBSERVATION_COLUMNS.items():
                whole[name][rows] = column.values(piece.observations)
            done = rows.stop
    return outcomes


def _results(loop: ClosedLoop) -> dict[str, tuple]:
    """Dimensions, values, unit and description of the results of a run, per target."""
    found, failed, counters = loop.ends()
    target, axes = ("seed", "target"), ("seed", "target", "component")
    described = {
        "coverage": (axes, found.coverage, "1", "share of the time within 3 sigma"),
        "final_coverage": (
            axes, found.final_coverage, "1", "share of the final hours within 3 sigma"),
        "custody": (
            target, found.custody.astype(np.int8), "1",
            "1 where the last position and attitude are within task2.custody"),
        "custody_position": (
            target, found.custody_position.astype(np.int8), "1",
            "1 where the last position is within task2.custody"),
        "custody_attitude": (
            target, found.custody_attitude.astype(np.int8), "1",
            "1 where the last attitude is within task2.custody, and reported as known"),
        "accurate_attitude": (
            target, found.accurate_attitude.astype(np.int8), "1",
            "1 where the last attitude error is within task2.custody, reported as known or not"),
        "anees": (axes, found.anees, "1", "average normalized estimation error squared"),
        "rmse": (axes, found.rmse, _SEVERAL, "root mean square error"),
        "status": (target, found.status, "1", f"status of the target{_INCONSISTENT}"),
        "status_rotation": (
            target, found.status_rotation, "1",
            f"status of attitude and angular velocity{_INCONSISTENT}"),
        "status_translation": (
            target, found.status_translation, "1",
            f"status of position and velocity{_INCONSISTENT}"),
        "final_attitude_error": (target, found.final_attitude_error_deg, "degree",
                                 "root mean square attitude error over the final hours"),
        "bound_ratio": ((*target, "part"), found.bound_ratio, "1",
                        "root mean square error over Cramer-Rao bound in the final hours"),
        "bound_attitude": (
            target, found.bound_attitude_deg, "degree",
            "root mean square attitude of the Cramer-Rao bound over the final hours"),
    }  # fmt: skip
    if loop.inputs.abilities.reports_status:
        described["unique_share"] = (
            target,
            found.unique_share,
            "1",
            "share of the time with the status unique, by the last attitude_status before",
        )
        described["anees_unique"] = (
            target,
            found.anees_unique,
            "1",
            "average normalized estimation error squared of the attitude over axes and that time",
        )
    for name, (index, meaning) in _COUNTED.items():
        described[name] = (target, counters[..., index].astype(np.int32), "1", meaning)
    described["failed"] = (target, failed, "1", "0, or the reason for which the estimate ended")
    return described
