"""Objectives of designs and fronts over their tables, and the candidate orbit slots."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.architecture import Choice, Objective, ObjectiveCertificate, random_start
from cislunar.architecture.coverage import CoverageObjective, certify_coverage, coverage_tables
from cislunar.architecture.coverage.gap_objective import GapObjective, certify_gaps
from cislunar.architecture.information import InformationObjective, certify_information
from cislunar.architecture.optimality.prescribed import certify_total
from cislunar.architecture.orbit_slots import OrbitSlots, orbit_slots_at, steady_orbits
from cislunar.campaign.architectures.moving import MovingTargets, orbit_set
from cislunar.campaign.architectures.visibility import cost_function, visibility_dataset
from cislunar.campaign.data.inputs import families_dataset, horizon, sun_at
from cislunar.campaign.settings import Visibility, typed
from cislunar.errors import ConfigurationError, placed
from cislunar.orbits.station_keeping import station_keeping_m_s
from cislunar.runtime import Progress, generator
from cislunar.survey import DensityPrior, PriorSources, sample_prior, search_tables

OBJECTIVE_UNITS = {"information": "nat", "attitude": "nat"}
"""Units of the objectives that have one."""

_UNDETECTED = DensityPrior(particles=500)
"""Prior of the undetected objects for `search`. One of its particles on a day is an element of the
coverage, of which there are as many as with 500 static targets."""

_GAPS = {"longest-gap": "longest", "mean-gap": "mean", "mean-wait": "wait"}


class ArchitectureInputs(NamedTuple):
    """Data sets from which architectures are chosen.

    ``orbits/families.nc``, ``targets/static_{scenario}.nc``, ``orbits/tracked.nc`` and
    ``ephemeris/sun.nc``.
    """

    orbits: xr.Dataset
    targets: xr.Dataset
    tracked: xr.Dataset
    sun: xr.Dataset


class _CandidateSlots(NamedTuple):
    """Candidate orbit slots, with up to `most` satellites on each, and the number of `slots` used.

    If `slots` is None every satellite has an orbit slot of its own.
    """

    orbit_slots: OrbitSlots
    most: int
    slots: int | None

    def at(self, candidate: NDArray) -> tuple[NDArray, NDArray]:
        """Orbits and phases of candidates."""
        return self.orbit_slots.orbit[candidate], self.orbit_slots.phase[candidate]

    def random_choice(self, satellites: int, rng: np.random.Generator) -> Choice:
        """This number of satellites on random candidates."""
        slots = self.slots or satellites
        return random_start(len(self.orbit_slots.orbit), self.most, slots, rng, satellites)


def candidate_slots(
    design: Mapping[str, Any], orbits: xr.Dataset, settings: Mapping[str, Any]
) -> _CandidateSlots:
    """The candidate orbit slots of a design or a front.

    `settings` has the keys `slots` and `max_satellites` of `architecture`. Raises
    `ConfigurationError` if no orbit satisfies the limits of stability index and station keeping.
    """
    library = orbit_set(orbits)
    allowed = steady_orbits(library, design["max_stability_index"] or np.inf)
    most = design.get("max_station_keeping_m_s")
    if most is not None:
        orbits_allowed = zip(library.state[allowed], library.period[allowed], strict=True)
        cost = np.array([station_keeping_m_s(*each) for each in orbits_allowed])
        if not np.any(cost <= most):
            raise ConfigurationError(
                f"max_station_keeping_m_s = {most} leaves no orbit: the least is {cost.min():.3g}"
            )
        allowed = allowed[cost <= most]
    phases = design["phases"]
    phase = np.arange(phases or 1) / (phases or 1)
    at = orbit_slots_at(library, np.repeat(allowed, phase.size), np.tile(phase, allowed.size))
    if phases is not None:
        return _CandidateSlots(at, 1, None)
    return _CandidateSlots(at, settings["max_satellites"], settings["slots"])


def check_orbit_slots(config: Mapping[str, Any], objectives: Mapping[str, int]) -> None:
    """Refuse designs and fronts, keys of `architecture`, with too few candidate orbit slots.

    Raises `ConfigurationError` with the key. The library of orbits is computed for this check.
    """
    search, orbits = config["architecture"], families_dataset({"orbits": config["orbits"]})
    for key, number in objectives.items():
        kind, name = key.split(".")
        objective = search[kind][name]
        with placed(f"configuration key 'architecture.{key}'", ConfigurationError):
            found = candidate_slots(objective, orbits, search)
        available = found.orbit_slots.orbit.size
        if number > available:
            what = "satellites" if found.slots is None else "slots"
            raise ConfigurationError(
                f"configuration key 'architecture.{key}': {number} {what} on {available} orbit "
                f"slots, those on the {np.unique(found.orbit_slots.orbit).size} orbits that "
                "max_stability_index and max_station_keeping_m_s leave; choose fewer, raise a "
                "limit or phases"
            )


def objective_of(
    design: Mapping[str, Any],
    candidates: _CandidateSlots,
    inputs: ArchitectureInputs,
    settings: Mapping[str, Any],
    *,
    scenario: str,
    seed: int,
    progress: Progress | None = None,
) -> Objective:
    """The objective of a design or a front over the tables of its candidate slots.

    `settings` has the configuration keys `propagator` and `visibility`, the keys `slots`,
    `max_satellites` and `information` of `architecture`, and as `cell` the settings of a cell of
    the scenario; `progress` counts orbits.
    """
    kind = design["objective"]
    if kind in OBJECTIVE_UNITS:
        moving = MovingTargets(inputs.tracked, inputs.sun, settings, scenario=scenario, seed=seed)
        tables = moving.tables(kind, orbit_set(inputs.orbits), candidates.orbit_slots, progress)
        return InformationObjective(tables)
    allowed = inputs.orbits.isel(orbit=np.unique(candidates.orbit_slots.orbit))
    if kind == "J":
        seen = visibility_dataset(
            allowed, inputs.targets, inputs.sun, settings, candidates.most, progress
        )
        return cost_function(seen, allowed)
    times, points = horizon(settings), inputs.targets["position"].values
    seen = times, sun_at(inputs.sun, times), typed(settings["visibility"], Visibility)
    given = {
        "phases": design["phases"], "max_satellites": candidates.most, "fold": design["fold"],
        "propagator": settings["propagator"], "progress": progress,
    }  # fmt: skip
    if kind == "search":
        library = inputs.orbits["state"].values, inputs.orbits["period"].values
        rng = generator(seed, scenario, kind)
        state, _ = sample_prior(_UNDETECTED, PriorSources(*library, points), rng)
        return CoverageObjective(search_tables(orbit_set(allowed), state, *seen, **given))
    window = "day" if kind == "target-days" else "sample"
    tables = coverage_tables(orbit_set(allowed), points, *seen, window=window, **given)
    return GapObjective(tables, _GAPS[kind]) if kind in _GAPS else CoverageObjective(tables)


def certificate(
    objective: Objective,
    satellites: int,
    slots: int | None,
    rng: np.random.Generator,
    halvings: int = 0,
) -> ObjectiveCertificate:
    """The best architecture of a number of satellites, and its bound.

    `halvings` is used by `certify_information` only.
    """
    if isinstance(objective, InformationObjective):
        return certify_information(objective, satellites, halvings=halvings)
    if isinstance(objective, GapObjective):
        return certify_gaps(objective, satellites, n_slots=slots)
    if isinstance(objective, CoverageObjective):
        return certify_coverage(objective, satellites, n_slots=slots)
    return certify_total(objective, satellites, n_slots=slots, rng=rng)
