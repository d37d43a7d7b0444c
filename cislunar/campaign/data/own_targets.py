"""Data sets of targets and observers from a user's tables."""

from pathlib import Path

import numpy as np
import xarray as xr

from cislunar.campaign.data.inputs import AXES, COMPONENTS, orbit_set_dataset, variables
from cislunar.dynamics.cr3bp import jacobi_constant
from cislunar.exchange.inertial import epoch_at
from cislunar.orbits.observers import SENSOR_COLUMNS, load_observers, observer_orbits
from cislunar.runtime.progress import Progress
from cislunar.runtime.provenance import provenance
from cislunar.targets.tables import (
    TargetStates,
    check_closed_targets,
    load_target_positions,
    load_target_states,
)

_STATE = "state at the epoch, nondimensional, rotating frame"


def own_tracked_dataset(path: str | Path, epoch: tuple[float, str] | None = None) -> xr.Dataset:
    """``orbits/tracked_{scenario}.nc`` of a file (`cislunar.targets.tables`) of moving targets.

    `epoch` is the Julian date (UTC) and the kernel with which an OEM is read.
    """
    targets = load_target_states(path, epoch and epoch_at(*epoch))
    check_closed_targets(path, targets)
    used = {"tracked": str(path)} | ({"epoch_jd": epoch[0], "kernel": epoch[1]} if epoch else {})
    attributes = provenance("Moving targets of a table", settings=used)
    return objects_dataset("target", targets).assign_attrs(attributes)


def objects_dataset(dim: str, objects: TargetStates) -> xr.Dataset:
    """Names, classes, states, periods and Jacobi constants of targets, or other objects, along
    `dim`."""
    period = "period in units of time_unit_s; 0 for a target that starts at its state"
    return xr.Dataset(
        variables(
            name=(dim, objects.name, "1", "name of the target"),
            family=(dim, objects.family, "1", "class of the target"),
            state=((dim, "component"), objects.state, "1", _STATE),
            period=(dim, objects.period, "1", period),
            jacobi=(dim, jacobi_constant(objects.state), "1", "Jacobi constant"),
        ),
        coords=variables(component=("component", list(COMPONENTS), "1", "component")),
    )


def own_static_dataset(path: str | Path, scenario: str) -> xr.Dataset:
    """``targets/static_{scenario}.nc`` of a table (`cislunar.targets.tables`) of static targets."""
    name, position = load_target_positions(path)
    members = np.ones(len(name), dtype=np.int64)
    used = {"scenario": scenario, "static_targets": str(path)}
    return xr.Dataset(
        variables(
            name=("target", name, "1", "name of the target"),
            position=(("target", "axis"), position, "1", "nondimensional, rotating frame"),
            members=("target", members, "1", "points the target stands for"),
        ),
        coords=variables(axis=("axis", list(AXES), "1", "axis of the rotating frame")),
        attrs=provenance(f"Static targets of scenario {scenario}", settings=used),
    )


def own_observers_dataset(
    path: str | Path, days: float, progress: Progress | None = None
) -> xr.Dataset:
    """``orbits/observers_{architecture}.nc`` of a table (`cislunar.orbits.observers`).

    It has the variables of ``orbits/families.nc``; `days` is the duration of paths that are not
    closed.
    """
    observers = load_observers(path)
    used = {"observers": str(path), "days": days}
    found = observer_orbits(observers, days, progress)
    orbits = orbit_set_dataset(found, "orbit", "Observers of a table", used)
    orbits["state"].attrs["long_name"] = _STATE
    orbits["period"].attrs["long_name"] += "; 0 for a path that is not closed"
    orbits["stability_index"].attrs["long_name"] += "; NaN for a path that is not closed"
    own = "of the observer's own sensor; NaN where it has that of the configuration"
    ahead = "share of the period by which the state is ahead of the one in the table"
    sensors = {
        f"sensor_{column}": (
            "orbit", [each.sensor.get(column, np.nan) for each in observers], "1",
            f"{column} {own}")
        for column in SENSOR_COLUMNS
        if any(column in each.sensor for each in observers)
    }  # fmt: skip
    described = variables(
        name=("orbit", [each.name for each in observers], "1", "name of the observer"),
        phase=("orbit", [each.phase for each in observers], "1", ahead),
        **sensors,
    )
    return orbits.assign(described)
