"""Information of architectures on moving targets, from the settings of a campaign."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from cislunar.architecture.information import InformationObjective, squared_detection_ranges
from cislunar.architecture.information.tables import (
    InformationTables,
    attitude_information,
    moving_targets,
    orbit_information,
    windows_of,
)
from cislunar.architecture.orbit_slots import OrbitSlots, satellite_orbit_slots
from cislunar.attitude.quaternion import normalize
from cislunar.campaign.data.inputs import sun_at
from cislunar.campaign.settings import CellSettings, typed
from cislunar.campaign.settings.library import nominal_surfaces, observation_settings, target_names
from cislunar.orbits.families import OrbitSet
from cislunar.runtime import Progress, generator
from cislunar.tasking.initial_conditions import INITIAL_RATE_DEG_H, epoch_states, monitored_targets

_ATTITUDE_STEP_HOURS = 0.25
"""Longest step of attitude information, h: the targets rotate by 46 deg per hour."""

_ATTITUDES = 100
"""Number of attitudes over which the share is computed in which a body is bright enough."""


def orbit_set(orbits: xr.Dataset) -> OrbitSet:
    """Orbits of a data set as an `OrbitSet`."""
    columns = (orbits[name].values for name in OrbitSet._fields[1:])
    return OrbitSet(orbits["family"].values.astype(str), *columns)


class MovingTargets:
    """Moving targets in windows of the horizon, and their observation.

    For `settings` see `cislunar.campaign.architectures.objectives.objective_of`; `seed` is that of
    the campaign.
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
        self._information, self._propagator = settings["information"], settings["propagator"]
        self._days = settings["visibility"]["duration_days"]
        self._cell = typed(settings["cell"], CellSettings)
        self._sun, self._stream = (
            sun,
            (seed, scenario, "attitudes", self._information["target_seed"]),
        )
        period, own = tracked["period"].values, self._information["target_seed"]
        ids = monitored_targets(period.size, self._information["targets"], own)
        states = epoch_states(tracked["state"].values, period, own)
        self._targets = states[ids], period[ids]
        self._names = target_names(tracked, ids.tolist())

    def _scene(self, step_hours: float) -> tuple:
        """Targets, windows and Sun for observations at a given spacing."""
        hours = self._information["window_hours"]
        windows = windows_of(
            self._days, self._information["windows"], hours=hours, step_hours=step_hours
        )
        sun = sun_at(self._sun, windows.times.ravel()).reshape(*windows.times.shape, 3)
        return moving_targets(*self._targets, windows), windows, sun

    @cached_property
    def _coarse(self) -> tuple:
        return self._scene(self._information["step_hours"])

    @cached_property
    def _fine(self) -> tuple:
        step = self._information["step_hours"]
        return self._scene(step / np.ceil(step / _ATTITUDE_STEP_HOURS - 1e-9))

    @cached_property
    def _squared_ranges(self) -> np.ndarray | None:
        if self._information.get("brightness", "sphere") == "sphere":
            return None
        attitudes = normalize(
            generator(*self._stream, "brightness").standard_normal((_ATTITUDES, 4))
        )
        surfaces = nominal_surfaces(self._cell, self._names)
        return squared_detection_ranges(surfaces, self._cell.sensor.limiting_magnitude, attitudes)

    def tables(
        self, kind: str, orbits: OrbitSet, orbit_slots: OrbitSlots, progress: Progress | None = None
    ) -> InformationTables:
        """Tables of orbit slots for `information` or `attitude`; `progress` counts orbits."""
        observations = observation_settings(self._cell)
        shared = {"propagator": self._propagator, "progress": progress}
        if kind == "information":
            given = orbits, orbit_slots, *self._coarse, observations
            return orbit_information(*given, squared_ranges=self._squared_ranges, **shared)
        surfaces = nominal_surfaces(self._cell, self._names)
        rate = np.deg2rad(INITIAL_RATE_DEG_H) / 3600.0
        given = observations, surfaces, rate, generator(*self._stream)
        count = self._information["attitudes"]
        return attitude_information(
            orbits, orbit_slots, *self._fine, *given, attitudes=count, **shared
        )

    def value(
        self, kind: str, orbits: OrbitSet, orbit: np.ndarray, satellites: np.ndarray, phase
    ) -> float:
        """Mean information of an architecture (slot,), nats."""
        orbit_slots = satellite_orbit_slots(orbits, orbit, satellites, phase)
        objective = InformationObjective(self.tables(kind, orbits, orbit_slots))
        every = np.arange(orbit_slots.orbit.size)
        return objective.value(every, np.ones_like(every))
