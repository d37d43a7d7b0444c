"""Data sets of architectures by an objective other than J: designs, and fronts over their number of
satellites."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cislunar.architecture import Choice, Objective, ObjectiveCertificate
from cislunar.architecture.hyperopt_search import hyperopt_search
from cislunar.campaign.architectures.objectives import (
    OBJECTIVE_UNITS,
    ArchitectureInputs,
    candidate_slots,
    certificate,
    objective_of,
)
from cislunar.campaign.architectures.search_runs import sampling_method
from cislunar.campaign.architectures.variables import architecture_variables, dimensionless
from cislunar.campaign.architectures.visibility import cost_function, visibility_dataset
from cislunar.dynamics.propagation import propagate_periodic
from cislunar.errors import ConfigurationError
from cislunar.runtime import Progress, counted, generator, logger, progress_log, variable
from cislunar.runtime.provenance import provenance

_VALUES = {
    "value": "value of the objective",
    "greedy": "value of the start of the search",
    "bound": "no architecture of as many satellites has a larger value",
}


def _certificates(
    objective: Objective,
    numbers: Sequence[int],
    slots: int | None,
    rng: np.random.Generator,
    unit: str,
    halvings: int = 0,
) -> list[ObjectiveCertificate]:
    found, suffix = [], "" if unit == "1" else f" {unit}"
    for number in counted(numbers, progress_log("numbers of satellites")):
        each = certificate(objective, number, slots, rng, halvings)
        logger.info(
            "%d satellites: %.6g%s, at most %.6g (%.2f %%), %.1f s",
            number, each.value, suffix, each.bound, 100.0 * each.gap, each.seconds,
        )  # fmt: skip
        found.append(each)
    return found


def _certificate_variables(
    found: Sequence[ObjectiveCertificate], unit: str, dims: tuple[str, ...]
) -> dict[str, xr.Variable]:
    """Value, start, bound and gap of certificates, along `dims` or of a single one."""

    def shaped(name: str) -> Any:
        values = [getattr(each, name) for each in found]
        return values if dims else values[0]

    measured = {
        name: variable(dims, shaped(name), unit, meaning) for name, meaning in _VALUES.items()
    }
    return measured | dimensionless(gap=(dims, shaped("gap"), "bound / value - 1"))


def design_dataset(
    design: Mapping[str, Any],
    inputs: ArchitectureInputs,
    settings: Mapping[str, Any],
    *,
    scenario: str,
    name: str,
    seed: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """``architecture/{scenario}/{design}.nc``: the best architecture by an objective.

    `design` is the configuration key ``architecture.designs.{name}``; for `settings` see
    `cislunar.campaign.architectures.objectives.objective_of`. J counts each satellite with a phase
    of its own as one on an orbit of its own. Methods other than `certified` give no bound, and
    random choice gives no value; `tpe` and `random` use the keys `labels`, `early_stop`,
    `max_evaluations` and `sampler` of `settings`.
    """
    candidates, rng = (
        candidate_slots(design, inputs.orbits, settings),
        generator(seed, scenario, "design", name),
    )
    number, method = design["satellites"], design["method"]
    kind = design["objective"] or method
    unit = OBJECTIVE_UNITS.get(kind, "1")
    title = f"Scenario {scenario}, {number} satellites by {kind}"
    attributes = provenance(
        title, settings={**settings, "design": _recorded_settings(design)}, seed=seed
    )
    attributes |= {"design": name, "objective": kind}
    if method == "chance":
        measured, (chosen_slots, satellites) = {}, candidates.random_choice(number, rng)
    else:
        objective = objective_of(
            design, candidates, inputs, settings, scenario=scenario, seed=seed, progress=progress
        )
        if method == "certified":
            # coverage has no settings for the observation of moving targets
            halvings = settings.get("information", {}).get("halvings", 0)
            (best,) = _certificates(objective, [number], candidates.slots, rng, unit, halvings)
            attributes["certificate_seconds"] = best.seconds
            measured, chosen_slots, satellites = (
                _certificate_variables([best], unit, ()),
                best.orbit,
                best.satellites,
            )
        else:
            chosen_slots, satellites = _searched(objective, design, settings, rng)
            value = objective.value(chosen_slots, satellites)
            measured = {"value": variable((), value, unit, _VALUES["value"])}
    orbit, phase = candidates.at(chosen_slots)
    chosen = _from_phases(inputs.orbits.isel(orbit=orbit), phase)
    most = int(satellites.max())
    visibility = visibility_dataset(chosen, inputs.targets, inputs.sun, settings, most)
    cost, slots = cost_function(visibility, chosen), np.arange(orbit.size)
    seen = visibility["observations"].values[slots, satellites - 1]
    found = architecture_variables(slots, satellites, cost)
    found |= dimensionless(
        orbit=("slot", orbit, "index into orbits/families.nc"),
        phase=("slot", phase, "share of the period by which the satellites are ahead"),
        observations=(("slot", "target"), seen, "times the static target is observable"),
    )
    return xr.Dataset(found | measured, attrs=attributes)


def _recorded_settings(design: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of a design for provenance: all keys except unused ones."""
    # its observation of targets is among the settings
    unusual = {"information": None, "sampler": design.get("sampler")}
    return {key: value for key, value in design.items() if unusual.get(key, key) is not None}


def _searched(
    objective: Objective,
    design: Mapping[str, Any],
    settings: Mapping[str, Any],
    rng: np.random.Generator,
) -> Choice:
    """Orbit slots and satellites by a sampling search; `ConfigurationError` if they are not
    distinct."""
    budget = design["evaluations"] or settings["max_evaluations"]
    found = hyperopt_search(
        objective,
        method=sampling_method(design["method"], design.get("sampler") or settings["sampler"]),
        rng=rng,
        n_slots=design["satellites"],
        labels=settings["labels"],
        max_evaluations=budget,
        early_stop=None if design["method"] == "random" else settings["early_stop"],
        progress=progress_log("evaluations"),
    )
    if np.unique(found.orbit).size < found.orbit.size:
        raise ConfigurationError(
            f"design: {budget} evaluations found no architecture of distinct orbit slots; raise "
            "evaluations"
        )
    return found.orbit, found.satellites


def _from_phases(orbits: xr.Dataset, phase: np.ndarray) -> xr.Dataset:
    """The same orbits, each from the state at a phase."""
    period = orbits["period"].values
    later = [
        propagate_periodic(state, t, [p * t], method="dop853")[0]
        for state, t, p in zip(orbits["state"].values, period, phase, strict=True)
    ]
    return orbits.assign(state=orbits["state"].copy(data=np.array(later)))


def objective_front_dataset(
    front: Mapping[str, Any],
    inputs: ArchitectureInputs,
    settings: Mapping[str, Any],
    *,
    scenario: str,
    name: str,
    seed: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """``architecture/{scenario}/fronts/{front}.nc``: the best by number of satellites, and bounds.

    `front` is the configuration key ``architecture.objective_fronts.{name}``; for `settings` see
    `cislunar.campaign.architectures.objectives.objective_of`. Slots of fewer satellites are filled
    up with orbit -1.
    """
    candidates = candidate_slots(front, inputs.orbits, settings)
    objective = objective_of(
        front, candidates, inputs, settings, scenario=scenario, seed=seed, progress=progress
    )
    unit, numbers = OBJECTIVE_UNITS.get(front["objective"], "1"), sorted(front["satellites"])
    rng = generator(seed, scenario, "front", name)
    found = _certificates(objective, numbers, candidates.slots, rng, unit)
    shape = len(found), max(each.orbit.size for each in found)
    orbit, phase = np.full(shape, -1), np.full(shape, np.nan)
    satellites = np.zeros(shape, dtype=np.int64)
    for row, each in enumerate(found):
        own = row, slice(each.orbit.size)
        orbit[own], phase[own] = candidates.at(each.orbit)
        satellites[own] = each.satellites
    both = ("total", "slot")
    title = f"Scenario {scenario}, best by number of satellites: {front['objective']}"
    attributes = provenance(title, settings={**settings, "front": dict(front)}, seed=seed)
    attributes |= {"front": name, "objective": front["objective"]}
    attributes["certificate_seconds"] = [each.seconds for each in found]
    return xr.Dataset(
        _certificate_variables(found, unit, ("total",))
        | dimensionless(
            orbit=(both, orbit, "index into orbits/families.nc, -1 for none"),
            satellites=(both, satellites, "satellites on the orbit"),
            phase=(both, phase, "share of the period by which the satellites are ahead"),
        ),
        coords=dimensionless(total=("total", numbers, "satellites in all")),
        attrs=attributes,
    )
