"""Architectures by another objective than J: one of them, and fronts over their number."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cislunar.architecture.certified import Certificate
from cislunar.architecture.coordinate_search import random_start
from cislunar.architecture.coverage.certificate import certify_coverage
from cislunar.architecture.coverage.gap_objective import GapObjective, certify_gaps
from cislunar.architecture.coverage.objective import CoverageObjective
from cislunar.architecture.coverage.tables import coverage_tables
from cislunar.architecture.hyperopt_search import hyperopt_search
from cislunar.architecture.information.certificate import certify_information
from cislunar.architecture.information.objective import InformationObjective
from cislunar.architecture.places import free_places
from cislunar.campaign.architectures.moving import Moving, orbit_set
from cislunar.campaign.architectures.search_runs import sampling_method
from cislunar.campaign.architectures.variables import architecture_variables, dimensionless
from cislunar.campaign.architectures.visibility import cost_function, visibility_dataset
from cislunar.campaign.data.inputs import horizon, sun_at
from cislunar.campaign.data.netcdf import variable
from cislunar.campaign.data.progress import Progress, logger, progress_log
from cislunar.campaign.data.provenance import provenance
from cislunar.campaign.data.seeds import generator
from cislunar.campaign.settings.library import visibility_settings
from cislunar.dynamics.propagation import propagate_periodic
from cislunar.errors import ConfigurationError

UNITS = {"information": "nat", "attitude": "nat"}
"""Units of the objectives that have one."""

_GAPS = {"longest-gap": "longest", "mean-gap": "mean", "mean-wait": "wait"}
_VALUES = {
    "value": "value of the objective",
    "greedy": "value of the start of the search",
    "bound": "no architecture of as many satellites has a larger value",
}


class World(NamedTuple):
    """Data sets architectures are chosen on.

    ``orbits/families.nc``, ``targets/static_{scenario}.nc``, ``orbits/tracked.nc`` and
    ``ephemeris/sun.nc``.
    """

    orbits: xr.Dataset
    targets: xr.Dataset
    tracked: xr.Dataset
    sun: xr.Dataset


class Goal(NamedTuple):
    """An objective over its tables; `slots` of their places, or as many as satellites if None."""

    objective: CoverageObjective | InformationObjective
    slots: int | None

    def at(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Orbits and phases of places."""
        return self.objective.tables.orbit[place], self.objective.tables.phase[place]

    def certificate(self, satellites: int) -> Certificate:
        """The best architecture of a number of satellites, and the bound."""
        if isinstance(self.objective, InformationObjective):
            return certify_information(self.objective, satellites)
        certify = certify_gaps if isinstance(self.objective, GapObjective) else certify_coverage
        return certify(self.objective, satellites, n_slots=self.slots)


def goal_of(
    wanted: Mapping[str, Any],
    world: World,
    settings: Mapping[str, Any],
    *,
    scenario: str,
    seed: int,
    progress: Progress | None = None,
) -> Goal:
    """The objective of a design or a front, with its tables.

    `settings` has the configuration keys `propagator` and `visibility`, the keys `slots`,
    `max_satellites` and `information` of `architecture`, and as `cell` the settings of a cell of
    the scenario; `progress` counts orbits.
    """
    orbits, cap = orbit_set(world.orbits), wanted["max_stability_index"] or np.inf
    phases, kind = wanted["phases"], wanted["objective"]
    if kind in UNITS:
        places = free_places(orbits, phases, cap)
        moving = Moving(world.tracked, world.sun, settings, scenario=scenario, seed=seed)
        return Goal(InformationObjective(moving.tables(kind, orbits, places, progress)), None)
    times = horizon(settings)
    tables = coverage_tables(
        orbits, world.targets["position"].values, times, sun_at(world.sun, times),
        visibility_settings(settings), phases=phases, max_satellites=settings["max_satellites"],
        fold=wanted["fold"], window="day" if kind == "target-days" else "sample",
        max_stability_index=cap, progress=progress,
    )  # fmt: skip
    objective = GapObjective(tables, _GAPS[kind]) if kind in _GAPS else CoverageObjective(tables)
    return Goal(objective, settings["slots"] if phases is None else None)


def _certified(goal: Goal, numbers: Sequence[int], unit: str) -> list[Certificate]:
    found, progress = [], progress_log("numbers of satellites")
    told = "" if unit == "1" else f" {unit}"
    for done, number in enumerate(numbers, start=1):
        each = goal.certificate(number)
        logger.info(
            "%d satellites: %.6g%s, at most %.6g (%.2f %%), %.1f s",
            number, each.value, told, each.bound, 100.0 * each.gap, each.seconds,
        )  # fmt: skip
        found.append(each)
        progress(done, len(numbers))
    return found


def _measured(
    found: Sequence[Certificate], unit: str, dims: tuple[str, ...]
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
    world: World,
    settings: Mapping[str, Any],
    *,
    scenario: str,
    name: str,
    seed: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """``architecture/{scenario}/{design}.nc``: the best architecture by an objective.

    `design` is the configuration key ``architecture.designs.{name}``, `settings` as of `goal_of`.
    J takes each satellite with a phase of its own for one on an orbit of its own. By other methods
    than `certified` there is no bound; those of `tpe` and `random` take the keys `labels`,
    `early_stop`, `max_evaluations` and `sampler` of `settings`.
    """
    goal = goal_of(design, world, settings, scenario=scenario, seed=seed, progress=progress)
    unit, number = UNITS.get(design["objective"], "1"), design["satellites"]
    title = f"Scenario {scenario}, {number} satellites by {design['objective']}"
    attributes = provenance(title, settings={**settings, "design": dict(design)}, seed=seed)
    attributes |= {"design": name, "objective": design["objective"]}
    if design["method"] == "certified":
        (best,) = _certified(goal, [number], unit)
        attributes["certificate_seconds"] = best.seconds
        measured, place, satellites = _measured([best], unit, ()), best.orbit, best.satellites
    else:
        rng = generator(seed, scenario, "design", name)
        place, satellites = _sampled(goal, design, settings, rng)
        value = goal.objective.value(place, satellites)
        measured = {"value": variable((), value, unit, _VALUES["value"])}
    orbit, phase = goal.at(place)
    chosen = _from_phases(world.orbits.isel(orbit=orbit), phase)
    most = int(satellites.max())
    visibility = visibility_dataset(chosen, world.targets, world.sun, settings, most)
    cost, slots = cost_function(visibility, chosen), np.arange(orbit.size)
    seen = visibility["observations"].values[slots, satellites - 1]
    found = architecture_variables(slots, satellites, cost)
    found |= dimensionless(
        orbit=("slot", orbit, "index into orbits/families.nc"),
        phase=("slot", phase, "share of the period by which the satellites are ahead"),
        observations=(("slot", "target"), seen, "times the static target is observable"),
    )
    return xr.Dataset(found | measured, attrs=attributes)


def _sampled(
    goal: Goal, design: Mapping[str, Any], settings: Mapping[str, Any], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Places and satellites by a sampling search, or by chance.

    A `ConfigurationError` if a search found no distinct places.
    """
    number, method = design["satellites"], design["method"]
    if method == "chance":
        return random_start(goal.objective, goal.slots or number, rng, number)
    budget = design["evaluations"] or settings["max_evaluations"]
    found = hyperopt_search(
        goal.objective,
        method=sampling_method(method, settings["sampler"]),
        rng=rng,
        n_slots=number,
        labels=settings["labels"],
        max_evaluations=budget,
        early_stop=None if method == "random" else settings["early_stop"],
        progress=progress_log("evaluations"),
    )
    if np.unique(found.orbit).size < found.orbit.size:
        raise ConfigurationError(
            f"design: {budget} evaluations found no architecture of distinct places; raise "
            "evaluations"
        )
    return found.orbit, found.satellites


def _from_phases(orbits: xr.Dataset, phase: np.ndarray) -> xr.Dataset:
    """The same orbits, each from a later point."""
    period = orbits["period"].values
    later = [
        propagate_periodic(state, t, [p * t], method="dop853")[0]
        for state, t, p in zip(orbits["state"].values, period, phase, strict=True)
    ]
    return orbits.assign(state=orbits["state"].copy(data=np.array(later)))


def objective_front_dataset(
    front: Mapping[str, Any],
    world: World,
    settings: Mapping[str, Any],
    *,
    scenario: str,
    name: str,
    seed: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """``architecture/{scenario}/fronts/{front}.nc``: the best by number of satellites, and bounds.

    `front` is the configuration key ``architecture.objective_fronts.{name}``, `settings` as of
    `goal_of`. Places of fewer satellites are filled up with orbit -1.
    """
    goal = goal_of(front, world, settings, scenario=scenario, seed=seed, progress=progress)
    unit, numbers = UNITS.get(front["objective"], "1"), sorted(front["satellites"])
    found = _certified(goal, numbers, unit)
    shape = len(found), max(each.orbit.size for each in found)
    orbit, phase = np.full(shape, -1), np.full(shape, np.nan)
    satellites = np.zeros(shape, dtype=np.int64)
    for row, each in enumerate(found):
        own = row, slice(each.orbit.size)
        orbit[own], phase[own] = goal.at(each.orbit)
        satellites[own] = each.satellites
    both = ("total", "slot")
    title = f"Scenario {scenario}, best by number of satellites: {front['objective']}"
    attributes = provenance(title, settings={**settings, "front": dict(front)}, seed=seed)
    attributes |= {"front": name, "objective": front["objective"]}
    attributes["certificate_seconds"] = [each.seconds for each in found]
    return xr.Dataset(
        _measured(found, unit, ("total",))
        | dimensionless(
            orbit=(both, orbit, "index into orbits/families.nc, -1 for none"),
            satellites=(both, satellites, "satellites on the orbit"),
            phase=(both, phase, "share of the period by which the satellites are ahead"),
        ),
        coords=dimensionless(total=("total", numbers, "satellites in all")),
        attrs=attributes,
    )
