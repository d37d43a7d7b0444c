"""What designs and fronts are chosen for: the objective over its tables, and the places."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.architecture.certified import Certificate, Choice
from cislunar.architecture.coordinate_search import random_start
from cislunar.architecture.coverage.certificate import certify_coverage
from cislunar.architecture.coverage.gap_objective import GapObjective, certify_gaps
from cislunar.architecture.coverage.objective import CoverageObjective
from cislunar.architecture.coverage.tables import coverage_tables
from cislunar.architecture.information.certificate import certify_information
from cislunar.architecture.information.objective import InformationObjective
from cislunar.architecture.objective import Objective
from cislunar.architecture.optimality.prescribed import certify_total
from cislunar.architecture.places import Places, places_at, steady_orbits
from cislunar.campaign.architectures.moving import Moving, orbit_set
from cislunar.campaign.architectures.visibility import cost_function, visibility_dataset
from cislunar.campaign.data.inputs import families_dataset, horizon, sun_at
from cislunar.campaign.data.progress import Progress
from cislunar.campaign.settings.library import visibility_settings
from cislunar.errors import ConfigurationError
from cislunar.orbits.station_keeping import station_keeping_m_s

UNITS = {"information": "nat", "attitude": "nat"}
"""Units of the objectives that have one."""

_GAPS = {"longest-gap": "longest", "mean-gap": "mean", "mean-wait": "wait"}


class World(NamedTuple):
    """Data sets architectures are chosen on.

    ``orbits/families.nc``, ``targets/static_{scenario}.nc``, ``orbits/tracked.nc`` and
    ``ephemeris/sun.nc``.
    """

    orbits: xr.Dataset
    targets: xr.Dataset
    tracked: xr.Dataset
    sun: xr.Dataset


class Where(NamedTuple):
    """Orbits and phases that satellites may take, up to `most` on each, in `slots` of them.

    Without slots every satellite has a place of its own.
    """

    places: Places
    most: int
    slots: int | None

    def at(self, place: NDArray) -> tuple[NDArray, NDArray]:
        """Orbits and phases of places."""
        return self.places.orbit[place], self.places.phase[place]

    def by_chance(self, satellites: int, rng: np.random.Generator) -> Choice:
        """So many satellites at places drawn by chance."""
        slots = self.slots or satellites
        return random_start(len(self.places.orbit), self.most, slots, rng, satellites)


def where(wanted: Mapping[str, Any], orbits: xr.Dataset, settings: Mapping[str, Any]) -> Where:
    """The places of a design or a front.

    `settings` has the keys `slots` and `max_satellites` of `architecture`. A `ConfigurationError`
    if no orbit is steady and cheap enough to stay on.
    """
    library = orbit_set(orbits)
    allowed = steady_orbits(library, wanted["max_stability_index"] or np.inf)
    most = wanted.get("max_station_keeping_m_s")
    if most is not None:
        ways = zip(library.state[allowed], library.period[allowed], strict=True)
        cost = np.array([station_keeping_m_s(*way) for way in ways])
        if not np.any(cost <= most):
            raise ConfigurationError(
                f"max_station_keeping_m_s = {most} leaves no orbit: the least is {cost.min():.3g}"
            )
        allowed = allowed[cost <= most]
    phases = wanted["phases"]
    phase = np.arange(phases or 1) / (phases or 1)
    at = places_at(library, np.repeat(allowed, phase.size), np.tile(phase, allowed.size))
    if phases is not None:
        return Where(at, 1, None)
    return Where(at, settings["max_satellites"], settings["slots"])


def check_places(config: Mapping[str, Any], goals: Mapping[str, int]) -> None:
    """Refuse designs and fronts, keys of `architecture`, that have not so many places.

    A `ConfigurationError` that names the key. The library of orbits is made for it.
    """
    search, orbits = config["architecture"], families_dataset({"orbits": config["orbits"]})
    for key, wanted in goals.items():
        kind, name = key.split(".")
        goal = search[kind][name]
        try:
            found = where(goal, orbits, search)
        except ConfigurationError as error:
            raise ConfigurationError(f"configuration key 'architecture.{key}': {error}") from None
        held = found.places.orbit.size
        if wanted > held:
            what = "satellites" if found.slots is None else "slots"
            raise ConfigurationError(
                f"configuration key 'architecture.{key}': {wanted} {what} on {held} places, those "
                f"on the {np.unique(found.places.orbit).size} orbits that max_stability_index and "
                "max_station_keeping_m_s leave; ask for fewer, raise a cap or phases"
            )


def objective_of(
    wanted: Mapping[str, Any],
    places: Where,
    world: World,
    settings: Mapping[str, Any],
    *,
    scenario: str,
    seed: int,
    progress: Progress | None = None,
) -> Objective:
    """The objective of a design or a front over the tables of its places.

    `settings` has the configuration keys `propagator` and `visibility`, the keys `slots`,
    `max_satellites` and `information` of `architecture`, and as `cell` the settings of a cell of
    the scenario; `progress` counts orbits.
    """
    kind = wanted["objective"]
    if kind in UNITS:
        moving = Moving(world.tracked, world.sun, settings, scenario=scenario, seed=seed)
        tables = moving.tables(kind, orbit_set(world.orbits), places.places, progress)
        return InformationObjective(tables)
    allowed = world.orbits.isel(orbit=np.unique(places.places.orbit))
    if kind == "J":
        seen = visibility_dataset(
            allowed, world.targets, world.sun, settings, places.most, progress
        )
        return cost_function(seen, allowed)
    times = horizon(settings)
    tables = coverage_tables(
        orbit_set(allowed), world.targets["position"].values, times, sun_at(world.sun, times),
        visibility_settings(settings), phases=wanted["phases"], max_satellites=places.most,
        fold=wanted["fold"], window="day" if kind == "target-days" else "sample",
        progress=progress,
    )  # fmt: skip
    return GapObjective(tables, _GAPS[kind]) if kind in _GAPS else CoverageObjective(tables)


def certificate(
    objective: Objective,
    satellites: int,
    slots: int | None,
    rng: np.random.Generator,
    halvings: int = 0,
) -> Certificate:
    """The best architecture of a number of satellites, and the bound.

    `halvings` as of `certify_information`, which it concerns alone.
    """
    if isinstance(objective, InformationObjective):
        return certify_information(objective, satellites, halvings=halvings)
    if isinstance(objective, GapObjective):
        return certify_gaps(objective, satellites, n_slots=slots)
    if isinstance(objective, CoverageObjective):
        return certify_coverage(objective, satellites, n_slots=slots)
    return certify_total(objective, satellites, n_slots=slots, rng=rng)
