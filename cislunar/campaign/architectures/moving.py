"""What architectures tell of moving targets, by the settings of a campaign."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from cislunar.architecture.information.brightness import squared_reaches
from cislunar.architecture.information.objective import InformationObjective
from cislunar.architecture.information.tables import (
    InformationTables,
    attitude_information,
    moving_targets,
    orbit_information,
    windows_of,
)
from cislunar.architecture.places import Places, satellite_places
from cislunar.attitude.quaternion import normalize
from cislunar.campaign.data.inputs import sun_at
from cislunar.campaign.data.progress import Progress
from cislunar.campaign.data.seeds import generator
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.library import believed_surfaces, information_looks, target_names
from cislunar.campaign.settings.reading import typed
from cislunar.orbits.families import OrbitSet
from cislunar.tasking.simulation import INITIAL_RATE_DEG_H, epoch_states, monitored_targets

ATTITUDE_STEP_HOURS = 0.25
"""Longest step of attitude information: the targets turn by 46 deg an hour."""

ATTITUDES = 100
"""Attitudes over which the share in which a body is bright enough is taken."""


def orbit_set(orbits: xr.Dataset) -> OrbitSet:
    """Orbits of a data set as the library takes them."""
    columns = (orbits[name].values for name in OrbitSet._fields[1:])
    return OrbitSet(orbits["family"].values.astype(str), *columns)


class Moving:
    """Moving targets in windows of the horizon, and how they are looked at.

    `settings` as of `cislunar.campaign.architectures.goals.objective_of`; `seed` is that of the
    campaign.
    """

    def __init__(
        self,
        tracked: xr.Dataset,
        sun: xr.Dataset,
        settings: Mapping[str, Any],
        *,
        scenario: str,
        seed: int,
    ) -> None:
        self._wanted, self._propagator = settings["information"], settings["propagator"]
        self._days = settings["visibility"]["duration_days"]
        self._cell = typed(settings["cell"], CellSettings)
        self._sun, self._stream = sun, (seed, scenario, "attitudes", self._wanted["target_seed"])
        period, own = tracked["period"].values, self._wanted["target_seed"]
        ids = monitored_targets(period.size, self._wanted["targets"], own)
        states = epoch_states(tracked["state"].values, period, own)
        self._targets = states[ids], period[ids]
        self._names = target_names(tracked, ids.tolist())

    def _scene(self, step_hours: float) -> tuple:
        """Targets, windows and Sun for looks at some spacing."""
        hours = self._wanted["window_hours"]
        windows = windows_of(
            self._days, self._wanted["windows"], hours=hours, step_hours=step_hours
        )
        sun = sun_at(self._sun, windows.times.ravel()).reshape(*windows.times.shape, 3)
        return moving_targets(*self._targets, windows), windows, sun

    @cached_property
    def _coarse(self) -> tuple:
        return self._scene(self._wanted["step_hours"])

    @cached_property
    def _fine(self) -> tuple:
        step = self._wanted["step_hours"]
        return self._scene(step / np.ceil(step / ATTITUDE_STEP_HOURS - 1e-9))

    @cached_property
    def _reaches(self) -> np.ndarray | None:
        if self._wanted.get("brightness", "sphere") == "sphere":
            return None
        attitudes = normalize(
            generator(*self._stream, "brightness").standard_normal((ATTITUDES, 4))
        )
        surfaces = believed_surfaces(self._cell, self._names)
        return squared_reaches(surfaces, self._cell.sensor.limiting_magnitude, attitudes)

    def tables(
        self, kind: str, orbits: OrbitSet, places: Places, progress: Progress | None = None
    ) -> InformationTables:
        """Tables of places for `information` or `attitude`; `progress` counts orbits."""
        looks = information_looks(self._cell)
        shared = {"propagator": self._propagator, "progress": progress}
        if kind == "information":
            return orbit_information(
                orbits, places, *self._coarse, looks, reaches=self._reaches, **shared
            )
        surfaces = believed_surfaces(self._cell, self._names)
        rate = np.deg2rad(INITIAL_RATE_DEG_H) / 3600.0
        given = looks, surfaces, rate, generator(*self._stream)
        count = self._wanted["attitudes"]
        return attitude_information(orbits, places, *self._fine, *given, attitudes=count, **shared)

    def value(
        self, kind: str, orbits: OrbitSet, orbit: np.ndarray, satellites: np.ndarray, phase
    ) -> float:
        """Mean information of an architecture (slot,), nats."""
        places = satellite_places(orbits, orbit, satellites, phase)
        objective = InformationObjective(self.tables(kind, orbits, places))
        every = np.arange(places.orbit.size)
        return objective.value(every, np.ones_like(every))
