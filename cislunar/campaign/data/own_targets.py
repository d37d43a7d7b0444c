"""Data sets of targets and observers from one's own tables."""

from pathlib import Path

import numpy as np
import xarray as xr

from cislunar.campaign.data.inputs import AXES, COMPONENTS, orbit_set_dataset
from cislunar.campaign.data.netcdf import variable
from cislunar.campaign.data.progress import Progress
from cislunar.campaign.data.provenance import provenance
from cislunar.dynamics.cr3bp import jacobi_constant
from cislunar.exchange.inertial import epoch_at
from cislunar.orbits.observers import SENSOR_COLUMNS, load_observers, observer_orbits
from cislunar.targets.tables import (
    check_closed_targets,
    load_target_positions,
    load_target_states,
)


def own_tracked_dataset(path: str | Path, epoch: tuple[float, str] | None = None) -> xr.Dataset:
    """``orbits/tracked_{scenario}.nc`` of a file (`cislunar.targets.tables`) of moving targets.

    `epoch` is the Julian date and the kernel that an OEM is read with.
    """
    targets = load_target_states(path, epoch and epoch_at(*epoch))
    check_closed_targets(path, targets)
    used = {"tracked": str(path)} | ({"epoch_jd": epoch[0], "kernel": epoch[1]} if epoch else {})
    return xr.Dataset(
        {
            "name": variable("target", targets.name, "1", "name of the target"),
            "family": variable("target", targets.family, "1", "class of the target"),
            "state": variable(
                ("target", "component"),
                targets.state,
                "1",
                "state at the epoch, nondimensional, rotating frame",
            ),
            "period": variable(
                "target",
                targets.period,
                "1",
                "period in units of time_unit_s; 0 for a target that starts at its state",
            ),
            "jacobi": variable("target", jacobi_constant(targets.state), "1", "Jacobi constant"),
        },
        coords={"component": variable("component", list(COMPONENTS), "1", "component")},
        attrs=provenance("Moving targets of a table", settings=used),
    )


def own_static_dataset(path: str | Path, scenario: str) -> xr.Dataset:
    """``targets/static_{scenario}.nc`` of a table (`cislunar.targets.tables`) of static targets."""
    targets = load_target_positions(path)
    members = np.ones(len(targets), dtype=np.int64)
    return xr.Dataset(
        {
            "name": variable("target", targets.name, "1", "name of the target"),
            "position": variable(
                ("target", "axis"), targets.position, "1", "nondimensional, rotating frame"
            ),
            "members": variable("target", members, "1", "points the target stands for"),
        },
        coords={"axis": variable("axis", list(AXES), "1", "axis of the rotating frame")},
        attrs=provenance(
            f"Static targets of scenario {scenario}",
            settings={"scenario": scenario, "static_targets": str(path)},
        ),
    )


def own_observers_dataset(
    path: str | Path, days: float, progress: Progress | None = None
) -> xr.Dataset:
    """``orbits/observers_{architecture}.nc`` of a table (`cislunar.orbits.observers`).

    Like ``orbits/families.nc``; `days` is how long observers on no closed orbit fly.
    """
    observers = load_observers(path)
    orbits = orbit_set_dataset(
        observer_orbits(observers, days, progress),
        "orbit",
        "Observers of a table",
        {"observers": str(path), "days": days},
    )
    names = variable("orbit", [each.name for each in observers], "1", "name of the observer")
    phases = variable(
        "orbit",
        [each.phase for each in observers],
        "1",
        "share of the period by which the state is ahead of the one in the table",
    )
    orbits["state"].attrs["long_name"] = "state at the epoch, nondimensional, rotating frame"
    orbits["period"].attrs["long_name"] += "; 0 for a path that is not closed"
    orbits["stability_index"].attrs["long_name"] += "; NaN for a path that is not closed"
    sensors = {
        f"sensor_{column}": variable(
            "orbit",
            [each.sensor.get(column, np.nan) for each in observers],
            "1",
            f"{column} of the observer's own sensor; NaN where it has that of the configuration",
        )
        for column in SENSOR_COLUMNS
        if any(column in each.sensor for each in observers)
    }
    return orbits.assign(name=names, phase=phases, **sensors)
