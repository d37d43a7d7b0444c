"""Table of every architecture under every objective: coverage, information and J."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cislunar.campaign.architectures.moving import MovingTargets, orbit_set
from cislunar.campaign.architectures.objectives import ArchitectureInputs
from cislunar.campaign.architectures.variables import phases_of
from cislunar.campaign.architectures.visibility import architecture_coverage

MEASURED = ("value", "greedy", "bound", "gap")
"""Values of a certificate, by the architecture's own objective."""


class _EvaluatedArchitecture(NamedTuple):
    """An architecture, its front if any, and its certificate; `method` is that of a design, else
    ""."""

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


def single_architecture(name: str, architecture: xr.Dataset) -> _EvaluatedArchitecture:
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
    return _EvaluatedArchitecture(
        "", name, objective, method, unit, orbit, satellites, phases_of(architecture), J, shown
    )


def front_architectures(name: str, front: xr.Dataset) -> Iterator[_EvaluatedArchitecture]:
    """The architectures of ``architecture/{scenario}/fronts/{name}.nc``."""
    for total in front["total"].values:
        own = front.sel(total=total)
        used = own["orbit"].values >= 0
        flown = (own[key].values[used] for key in ("orbit", "satellites", "phase"))
        measured = {key: float(own[key]) for key in MEASURED}
        unit, objective = own["value"].attrs["units"], front.attrs["objective"]
        yield _EvaluatedArchitecture(
            name, f"{name}-{total}", objective, "", unit, *flown, np.nan, measured
        )


def objective_row(
    scenario: str,
    flown: _EvaluatedArchitecture,
    inputs: ArchitectureInputs,
    settings: Mapping[str, Any],
    moving: MovingTargets,
) -> dict[str, Any]:
    """A row of ``tables/objectives.csv``; for `settings` see
    `cislunar.campaign.architectures.objectives.objective_of`.

    It has the architecture's own certificate, then its values by the other objectives.
    `inputs.orbits` are the orbits to which the architecture refers.
    """
    flown_on = flown.orbit, flown.satellites
    covered = architecture_coverage(
        *flown_on, inputs.orbits, inputs.targets, inputs.sun, settings, flown.phase
    )
    orbits = orbit_set(inputs.orbits)
    information = {
        f"{kind}_nat": moving.value(kind, orbits, *flown_on, flown.phase)
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
        **information,
    }
