"""Every architecture under every objective: coverage, information and J side by side."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cislunar.campaign.architectures.goals import World
from cislunar.campaign.architectures.moving import Moving, orbit_set
from cislunar.campaign.architectures.variables import phases_of
from cislunar.campaign.architectures.visibility import architecture_coverage

MEASURED = ("value", "greedy", "bound", "gap")
"""What a certificate has of an architecture, by its own objective."""


class Flown(NamedTuple):
    """An architecture, which front it is from if any, and its certificate.

    `method` is that of a design, "" for others.
    """

    front: str
    name: str
    objective: str
    method: str
    unit: str
    orbit: np.ndarray
    satellites: np.ndarray
    phase: np.ndarray
    J: float
    measured: Mapping[str, float]


def single(name: str, architecture: xr.Dataset) -> Flown:
    """The architecture of ``architecture/{scenario}/{name}.nc``."""
    objective, method = architecture.attrs.get("objective", "J"), ""
    if "design" in architecture.attrs:
        method = json.loads(architecture.attrs["settings"])["design"]["method"]
    named = "value" in architecture
    measured = {key: float(architecture[key]) for key in MEASURED if named and key in architecture}
    unit = architecture["value"].attrs["units"] if named else "1"
    orbit, satellites = architecture["orbit"].values, architecture["satellites"].values
    J = float(architecture["J"])
    shown = measured or ({"value": J} if objective == "J" else {})
    return Flown(
        "", name, objective, method, unit, orbit, satellites, phases_of(architecture), J, shown
    )


def of_front(name: str, front: xr.Dataset) -> Iterator[Flown]:
    """The architectures of ``architecture/{scenario}/fronts/{name}.nc``."""
    for total in front["total"].values:
        own = front.sel(total=total)
        used = own["orbit"].values >= 0
        flown = (own[key].values[used] for key in ("orbit", "satellites", "phase"))
        measured = {key: float(own[key]) for key in MEASURED}
        unit, objective = own["value"].attrs["units"], front.attrs["objective"]
        yield Flown(name, f"{name}-{total}", objective, "", unit, *flown, np.nan, measured)


def objective_row(
    scenario: str, flown: Flown, world: World, settings: Mapping[str, Any], moving: Moving
) -> dict[str, Any]:
    """A row of ``tables/objectives.csv``; `settings` as of `goals.objective_of`.

    The architecture's own certificate, then what it reaches by the other objectives. `world.orbits`
    are those it refers to.
    """
    ways = flown.orbit, flown.satellites
    covered = architecture_coverage(
        *ways, world.orbits, world.targets, world.sun, settings, flown.phase
    )
    orbits = orbit_set(world.orbits)
    told = {
        f"{kind}_nat": moving.value(kind, orbits, *ways, flown.phase)
        for kind in ("information", "attitude")
    }
    return {
        "scenario": scenario,
        "front": flown.front,
        "architecture": flown.name,
        "objective": flown.objective,
        "method": flown.method,
        "satellites": int(flown.satellites.sum()),
        "unit": flown.unit,
        **{key: flown.measured.get(key, np.nan) for key in MEASURED},
        "J": flown.J,
        "union_coverage": covered.union_coverage,
        "target_days": covered.target_days,
        "never_seen": covered.never_seen,
        **told,
    }
