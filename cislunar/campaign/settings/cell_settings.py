"""Settings of a cell: of the configuration, of a variant, of the mode of tasking, and true ones;
and the telescopes of its observers.

Each observer has the telescope `sensor`, changed by its row in a table of observers, then by its
group.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cislunar.campaign.settings.cell_tree import CellSettings, Tasking
from cislunar.campaign.settings.reading import merged, typed
from cislunar.errors import ConfigurationError
from cislunar.observation.body_spec import ICOSAHEDRON, load_body_table
from cislunar.observation.sensor import Atmosphere, GroundSensor, Sensor, Sensors
from cislunar.orbits.observers import SENSOR_COLUMNS
from cislunar.photometry import MODELS, REFLECTION_LAWS

REPLAY_MINUTES = 5.0
"""Time between the recorded states of a replay, at least a step."""

RECOMMENDED = {"detection": "learned", "slot_minutes": 20, "expected_measurements": 20}
"""Settings of the recommended mode of `task2.tasking`."""


def cell_settings(task2: Mapping[str, Any], variant: str = "") -> dict[str, Any]:
    """The settings of a cell of checked `task2`, as jobs get them and results keep them, with those
    of a variant; keys that are omitted while they have their defaults are left out.

    Raises
    ------
    ConfigurationError
        If there is no such variant.
    """
    found = {key: task2[key] for key in CellSettings.model_fields}
    if variant:
        variants = task2["variants"]["cells"]
        if variant not in variants:
            raise ConfigurationError(
                f"variant {variant!r} is none of the configuration key 'task2.variants.families', "
                f"which make {', '.join(variants) or 'none'}"
            )
        found = merged(found, variants[variant]["change"])
    return CellSettings.kept({**found, "tasking": in_mode(found["tasking"])})


def in_mode(tasking: Mapping[str, Any]) -> dict[str, Any]:
    """The section `tasking` with the settings of its mode, and without the mode."""
    stated = {key: value for key, value in tasking.items() if key != "mode"}
    if tasking.get("mode") != "recommended":
        return stated
    usual = {key: Tasking.model_fields[key].default for key in RECOMMENDED}
    return stated | {
        key: value
        for key, value in RECOMMENDED.items()
        if stated.get(key, usual[key]) == usual[key]
    }


def replay_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a cell with the first realization alone and the records of a replay, which
    change no result."""
    step_s = settings["step_s"]
    steps = max(1, round(60.0 * REPLAY_MINUTES / step_s))
    return {
        **settings,
        "seeds": 1,
        "record": ["truth", "estimates", "covariance", "measurements", "pointing"],
        "histories": ["errors"],
        "record_minutes": min(settings["record_minutes"], steps * step_s / 60.0),
    }


def true_settings(settings: CellSettings) -> CellSettings:
    """The settings with material, body and sensor as `truth` states them."""
    changed = settings.truth.model_dump(include={"material", "body", "sensor"})
    return typed(merged(settings.model_dump(), changed), CellSettings)


def cell_files(settings: Mapping[str, Any]) -> list[str]:
    """Meshes and tables that a cell depends on, each once: of bodies and of a reflection law,
    assumed and true, of the errors of observers, and of maneuvers."""
    assumed = typed(settings, CellSettings)
    tables = assumed.observer_errors.table, assumed.truth.maneuvers.table
    found: list[str] = [each for each in tables if each is not None]
    for body in (assumed.body, true_settings(assumed).body):
        shapes = [body.shape]
        if body.table is not None:
            found.append(body.table)
            shapes += [each.shape for each in load_body_table(body.table).values()]
        found += [shape for shape in shapes if shape != ICOSAHEDRON and shape not in MODELS]
    if assumed.truth.reflection not in REFLECTION_LAWS:
        found.append(assumed.truth.reflection)
    return list(dict.fromkeys(found))


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
