"""The telescopes of a cell's observers as objects of the library.

Each observer has the telescope `sensor`, changed by its row in a table of observers, then by its
group.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cislunar.campaign.settings import CellSettings, merged, typed
from cislunar.errors import ConfigurationError
from cislunar.observation.sensor import Atmosphere, GroundSensor, Sensor, Sensors
from cislunar.orbits.observers import SENSOR_COLUMNS


def observer_sensors(
    cell: CellSettings, n_flying: int, own: Sequence[Mapping[str, Any]] = ()
) -> Sensors:
    """The telescope of all observers, or of each, those on the ground last.

    `own` has the changes by the table of the observers in orbit. A `ConfigurationError` if a group
    names an observer that does not exist, or that another group names.
    """
    if not cell.sensors and not cell.stations and not any(own):
        return cell.sensor
    usual = cell.sensor.model_dump()
    chosen = [merged(usual, one) for one in own] or [usual] * n_flying
    chosen += [merged(usual, site.sensor.model_dump()) for site in cell.stations.values()]
    taken: dict[int, str] = {}
    for name, group in cell.sensors.items():
        for observer in group.observers:
            key = f"configuration key 'task2.sensors.{name}.observers': {observer}"
            if observer >= len(chosen):
                raise ConfigurationError(f"{key} is none of the observers 0 .. {len(chosen) - 1}")
            if observer in taken:
                raise ConfigurationError(f"{key} is in {taken[observer]!r} already")
            taken[observer] = name
            chosen[observer] = merged(chosen[observer], group.sensor.model_dump())
    found = [typed(each, Sensor) for each in chosen]
    for number, site in enumerate(cell.stations.values(), start=n_flying):
        air = Atmosphere(**{key: getattr(site, key) for key in Atmosphere.model_fields})
        found[number] = GroundSensor(**dict(found[number]), atmosphere=air)
    return tuple(found)


def own_sensors(orbits: xr.Dataset, rows: Sequence[int]) -> list[dict[str, Any]]:
    """Changes of sensors that rows of ``orbits/observers_{architecture}.nc`` state."""
    columns = [column for column in SENSOR_COLUMNS if f"sensor_{column}" in orbits]
    rows_of = ({c: float(orbits[f"sensor_{c}"][row]) for c in columns} for row in rows)
    return [sensor_change({c: v for c, v in each.items() if np.isfinite(v)}) for each in rows_of]


def sensor_change(columns: Mapping[str, float]) -> dict[str, Any]:
    """Settings of a sensor from the columns of a row in a table of observers."""
    own: dict[str, Any] = {}
    for column, value in columns.items():
        body = column.replace("_exclusion_deg", "")
        change = {column: value} if body == column else {"exclusion_deg": {body: value}}
        own = merged(own, change)
    return own


def true_sensors(cell: CellSettings, assumed: Sensors) -> Sensors | None:
    """True telescopes if noise depends on observer or magnitude; None if it does not.

    The constant noise is that of ``truth.sensor`` where stated, for all telescopes.
    """
    if isinstance(assumed, Sensor) and assumed.plain:
        return None
    given = {} if cell.truth.sensor is None else cell.truth.sensor.model_dump()
    if isinstance(assumed, Sensor):
        return assumed.model_copy(update=given)
    return tuple(one.model_copy(update=given) for one in assumed)
