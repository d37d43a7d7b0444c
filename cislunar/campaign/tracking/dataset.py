"""Data sets of sensor tasking and tracking: the moving targets, and one cell of the campaign."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.campaign.data.inputs import orbit_set_dataset
from cislunar.campaign.data.netcdf import Later, growing_dataset, variable
from cislunar.campaign.data.progress import Progress
from cislunar.campaign.data.provenance import provenance
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.cell import CellInputs, Problem, cell_loop, orbits_file
from cislunar.campaign.tracking.checkpoint import CHECKPOINT_S, Checkpoint, checkpoint_folder
from cislunar.campaign.tracking.records import (
    AMONG_BODIES,
    ESTIMATED,
    RECORD_COORDINATES,
    ROTATING,
    Described,
    look_values,
    observer_variables,
    recorded_variables,
    start_day,
)
from cislunar.dynamics.cr3bp import CR3BP
from cislunar.estimation.estimator import (
    CHOLESKY_FAILURES,
    FLOOR_HITS,
    OUT_OF_FIELD,
    UPDATES,
)
from cislunar.evaluation.metrics import PARTS, STATUS_NAMES
from cislunar.orbits.tracked import tracked_targets
from cislunar.tasking.closed_loop import ClosedLoop
from cislunar.tasking.fates import Names, counted, report_fates, report_unknowns
from cislunar.tasking.realization import FATE_NAMES, USED
from cislunar.tasking.recording import Piece, fill

COMPONENTS = tuple(
    f"{part}_{axis}"
    for part in ("attitude", "angular_velocity", "position", "velocity")
    for axis in "xyz"
)
COMPONENT_UNITS = ("1",) * 3 + ("rad s-1",) * 3 + ("1",) * 6
_KEYS = Names(
    limit="task2.sensor.limiting_magnitude",
    body="task2.material and task2.body",
    irradiance="task2.photometry.irradiance",
    sphere="task2.tasking.diffuse_reflection_coefficient",
    exclusion="task2.sensor.exclusion_deg",
    interval="task2.interval_minutes",
)


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
    """Run a cell and hold all of it; `write_cell` makes the same as a file, with less memory.

    Arguments are those of `cell_loop`.
    """
    loop, problem = cell_loop(cell, inputs, settings, propagator=propagator, seed=seed)
    pieces = list(loop.pieces(progress))
    used = {**settings, "propagator": propagator, **cell._asdict()}
    described, sizes = _histories(loop), _sizes(loop)
    whole = {
        name: np.empty([sizes[dim] for dim in each.dims], each.dtype)
        for name, each in described.items()
    }
    report_fates(_fill(whole, pieces, loop), loop.world, _KEYS)
    _report_unknowns(whole, loop)
    values = {name: (each.dims, whole[name], *each[2:]) for name, each in described.items()}
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

    Its histories are written a day or a realization at a time. A run that is killed goes on from
    its last `Checkpoint`.

    Parameters
    ----------
    cell, inputs, settings, propagator, seed
        As of `cell_loop`.
    path : str or Path
        The file to make; checkpoints lie in a folder beside it until it is whole.
    progress : callable, optional
        Called with (tasking epochs done, those of all seeds).
    checkpoint_s : float
        Least time between checkpoints, s.
    realization : int, optional
        Run that one alone, and leave it as a checkpoint for whoever makes the file.

    Raises
    ------
    ConfigurationError
        If the cell cannot be run, or there is a checkpoint of another one.
    InputFileError
        If the disk is full, or a checkpoint cannot be read; the last whole checkpoint is kept.
    """
    loop, problem = cell_loop(cell, inputs, settings, propagator=propagator, seed=seed)
    used = {**settings, "propagator": propagator, **cell._asdict()}
    attributes = _provenance(cell, used, seed)
    checkpoint = Checkpoint(checkpoint_folder(path), loop, attributes, least_s=checkpoint_s)
    checkpoint.run(progress, realization=realization)
    if realization is not None:
        return
    rest = _dataset(cell, inputs, loop, problem, {}, attributes)
    later = {
        name: Later(each.dims, each.dtype, _attributes(name, each.unit, each.meaning))
        for name, each in _histories(loop).items()
    }
    with growing_dataset(rest, path, later, {"look": loop.state.looks}) as whole:
        fates = _fill(whole, checkpoint.pieces(), loop)
        _report_unknowns(whole, loop)
    checkpoint.remove()
    report_fates(fates, loop.world, _KEYS)


def _report_unknowns(whole: Mapping[str, Any], loop: ClosedLoop) -> None:
    """Warn of unknowns that light curves cannot carry, if there are any."""
    if loop.unknowns:
        updates = loop.ends()[2][..., UPDATES]
        report_unknowns(whole["departure_sigma"], loop.unknowns, updates, "task2.batch.unknowns")


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
    histories: Mapping[str, tuple],
    attributes: Mapping[str, Any],
) -> xr.Dataset:
    """Coordinates, histories as far as they are given, and what the run came to."""
    settings, ids, slot = loop.world.settings, problem.target_ids, problem.observer_slot
    orbit_of = np.where(slot < 0, -1, inputs.architecture["orbit"].values[slot])
    since, days = "time since the epoch", start_day(attributes)
    since += f" and {days:g} days" if days else ""
    coords = {
        "seed": ("seed", np.arange(len(loop.seeds)), "1", "realization"),
        "time": ("time", settings.step_s * (settings.recorded + 1.0), "s", since),
        "step": ("step", settings.elapsed_s[1:], "s", since),
        "epoch": ("epoch", settings.step_s * settings.epochs, "s", since),
        "component": ("component", list(COMPONENTS), "1", "component of the state"),
        "component_unit": ("component", list(COMPONENT_UNITS), "1", "unit of the component"),
        "part": ("part", list(PARTS), "1", "part of the state"),
        "target_id": ("target", ids, "1", "row of the target in orbits/tracked.nc"),
        "family": ("target", list(inputs.tracked["family"].values[ids]), "1",
                   "orbit class of the target"),
        "observer_orbit": ("observer", orbit_of, "1",
                           f"row in {orbits_file(cell, inputs.orbits)}"),
        "observer_slot": ("observer", slot, "1", "slot of the architecture"),
    }  # fmt: skip
    names = list(loop.unknowns)
    if names:
        units = ["degree h-2" if name.startswith("angular") else "1" for name in names]
        coords["unknown"] = "unknown", names, "1", "what is estimated besides the motion"
        coords["unknown_unit"] = "unknown", units, "1", "unit of the unknown"
    described = {**histories, **_results(loop)}
    described |= observer_variables(settings.record, problem.scene, _frame(loop))
    coords |= {name: RECORD_COORDINATES[name] for name in _record_dims(loop)}
    if settings.slots is not None:
        begins = 60.0 * settings.schedule.slot_minutes * np.arange(settings.slots)
        coords["slot"] = "slot", begins, "s", "time since the tasking epoch"
    return xr.Dataset(
        {
            name: xr.Variable(dims, values, _attributes(name, unit, meaning))
            for name, (dims, values, unit, meaning) in described.items()
        },
        coords={name: variable(*each) for name, each in coords.items()},
        attrs=attributes,
    )


def _flags(names: tuple[str, ...]) -> dict[str, Any]:
    """Attributes that give the meaning of small integers."""
    return {
        "flag_values": np.arange(len(names), dtype=np.uint8),
        "flag_meanings": " ".join(names),
    }


_DIVERGED = "; diverged: observed, and inconsistent with its covariance in the final hours"

_FLAGS = {
    "fate": _flags(FATE_NAMES),
    "look_fate": _flags(FATE_NAMES),
    "status": _flags(STATUS_NAMES),
    "status_rotation": _flags(STATUS_NAMES),
    "status_translation": _flags(STATUS_NAMES),
}


def _attributes(name: str, unit: str, meaning: str) -> dict[str, Any]:
    return {"units": unit, "long_name": meaning, **_FLAGS.get(name, {})}


_COUNTED = {
    "updates": (UPDATES, "measurements used"),
    "out_of_field": (OUT_OF_FIELD, "measurements outside the field of view"),
    "dark_sigma_points": (FLOOR_HITS, "sigma points without reflected light"),
    "cholesky_failures": (CHOLESKY_FAILURES, "failed Cholesky factorizations"),
}

_SEVERAL, _OWN_UNIT = "see component_unit", "see unknown_unit"
_HISTORY = ("seed", "time", "target", "component")
_KEPT = {
    "assignment": Described(
        ("seed", "epoch", "observer"), "i2", "1",
        "index of the target along dimension target, -1 for an idle observer"),
    "information": Described(("seed", "epoch"), "f8", "nat", "mutual information of the tasking"),
    "evaluations": Described(("seed", "epoch"), "i4", "1", "taskings tried"),
    "valid": Described(("seed", "time", "target"), "i1", "1", "1 where a measurement was used"),
    "fate": Described(("seed", "step", "target"), "u1", "1", "what became of the measurement"),
    "error": Described(_HISTORY, "f4", _SEVERAL, "truth less estimate (attitude: GRP)"),
    "sigma": Described(_HISTORY, "f4", _SEVERAL, "standard deviation"),
    "bound": Described(
        _HISTORY, "f4", _SEVERAL, "standard deviation of the posterior Cramer-Rao bound"),
    "brightness_offset": Described(
        ("seed", "epoch", "target"), "f4", "mag",
        "magnitude of the target less the expected one, learned after the interval"),
    "brightness_offset_sigma": Described(
        ("seed", "epoch", "target"), "f4", "mag", "standard deviation of brightness_offset"),
    "planning_gap": Described(
        ("seed", "epoch"), "f8", "1",
        "by how much the schedule may fall short: largest relative gap of the set packings, "
        "or to the bound of all slots with task2.tasking.bound_steps"),
    "departure_error": Described(
        ("seed", "epoch", "target", "unknown"), "f4", _OWN_UNIT,
        "truth less estimate of what is not known of the target, after the interval"),
    "departure_sigma": Described(
        ("seed", "epoch", "target", "unknown"), "f4", _OWN_UNIT,
        "standard deviation of what is not known of the target"),
    "searches": Described(
        ("seed", "epoch", "target"), "i4", "1", "searches for the modes of the fits by then"),
}  # fmt: skip
"""Histories of a cell."""

_OPTIONAL = {"errors": ("error", "sigma"), "bound": ("bound",)}
"""Those that `task2.histories` may leave out."""


def _histories(loop: ClosedLoop) -> dict[str, Described]:
    """What is kept of every realization."""
    settings = loop.world.settings
    left_out = {
        name
        for history, names in _OPTIONAL.items()
        for name in names
        if history not in settings.histories
    }
    if settings.tasking.detection is None:
        left_out |= {"brightness_offset", "brightness_offset_sigma"}
    if not settings.schedule.bounded:
        left_out.add("planning_gap")
    if not loop.unknowns:
        left_out |= {"departure_error", "departure_sigma", "searches"}
    usual = {name: each for name, each in _KEPT.items() if name not in left_out}
    if settings.slots is not None:
        usual["assignment"] = usual["assignment"]._replace(
            dims=("seed", "epoch", "slot", "observer")
        )
    return usual | recorded_variables(settings.record, _frame(loop))


def _frame(loop: ClosedLoop) -> str:
    """What positions and velocities of a cell refer to."""
    return ROTATING if isinstance(loop.world.truth.forces, CR3BP) else AMONG_BODIES


def _record_dims(loop: ClosedLoop) -> list[str]:
    """Coordinates that what is recorded needs."""
    record, scene = loop.world.settings.record, loop.world.scene
    found = [each.dims for each in recorded_variables(record).values()]
    found += [dims for dims, *_ in observer_variables(record, scene).values()]
    return [name for name in RECORD_COORDINATES if any(name in dims for dims in found)]


def _sizes(loop: ClosedLoop) -> dict[str, int]:
    """Lengths of the dimensions of the histories."""
    world = loop.world
    own = {name: len(RECORD_COORDINATES[name][1]) for name in _record_dims(loop)}
    return {
        **loop.lengths,
        **own,
        "seed": len(loop.seeds),
        "target": world.ids.size,
        "observer": world.scene.observer_position.shape[0],
        "slot": world.settings.slots or 1,
        "component": len(COMPONENTS),
        "unknown": len(loop.unknowns),
        "look": loop.state.looks,
    }


def _fill(whole: Mapping[str, Any], pieces: Iterable[Piece], loop: ClosedLoop) -> NDArray[np.int64]:
    """Put pieces into arrays, or variables of an open file, of the names above.

    Gives the number of looks of each fate.
    """
    done, fates = 0, np.zeros(len(FATE_NAMES), dtype=np.int64)
    for piece in pieces:
        named = {
            f"estimated_{name}" if name in ESTIMATED else name: each
            for name, each in piece.kept.items()
        }
        steps = piece.places["step"]
        recorded = loop.world.settings.recorded[piece.places["time"]] - steps.start
        named["valid"] = "time", (named["fate"][1][recorded] == USED).astype(np.int8)
        fates += counted(named["fate"][1])
        fill(whole, piece._replace(kept=named))
        if piece.looks is not None:
            rows = slice(done, done + piece.looks.step.size)
            for name, values in look_values(piece.looks).items():
                whole[name][rows] = values
            done = rows.stop
    return fates


def _results(loop: ClosedLoop) -> dict[str, tuple]:
    """Dimensions, values, unit and meaning of what a run came to, per target."""
    found, failed, counters = loop.ends()
    target, axes = ("seed", "target"), ("seed", "target", "component")
    described = {
        "coverage": (axes, found.coverage, "1", "share of the time within 3 sigma"),
        "final_coverage": (
            axes, found.final_coverage, "1", "share of the final hours within 3 sigma"),
        "custody": (
            target, found.custody.astype(np.int8), "1",
            "1 where the last position and attitude are within task2.custody"),
        "anees": (axes, found.anees, "1", "average normalized estimation error squared"),
        "rmse": (axes, found.rmse, _SEVERAL, "root mean square error"),
        "status": (target, found.status, "1", f"status of the target{_DIVERGED}"),
        "status_rotation": (
            target, found.status_rotation, "1",
            f"status of attitude and angular velocity{_DIVERGED}"),
        "status_translation": (
            target, found.status_translation, "1",
            f"status of position and velocity{_DIVERGED}"),
        "final_attitude_error": (target, found.final_attitude_error_deg, "degree",
                                 "root mean square attitude error over the final hours"),
        "bound_ratio": ((*target, "part"), found.bound_ratio, "1",
                        "root mean square error over Cramer-Rao bound in the final hours"),
        "bound_attitude": (
            target, found.bound_attitude_deg, "degree",
            "root mean square attitude of the Cramer-Rao bound over the final hours"),
    }  # fmt: skip
    for name, (index, meaning) in _COUNTED.items():
        described[name] = (target, counters[..., index].astype(np.int32), "1", meaning)
    described["failed"] = (target, failed, "1", "0, or why the estimate came to an end")
    return described
