"""Settings of the observers' telescopes."""

from typing import Annotated

from pydantic import Field

from cislunar.observation.sensor import Atmosphere, Sensor
from cislunar.runtime.settings_fields import Section, number, partial, setting, several, whole

# fmt: off

GroupName = Annotated[str, Field(pattern="^[a-z0-9][a-z0-9-]*$")]


class SensorGroup(Section):
    observers: Annotated[several(whole(ge=0)), Field(min_length=1)] = setting(
        "observers with a telescope of their own, counted from 0 like `observer` in a cell's file")
    sensor: partial(Sensor) = setting(
        "properties in which this telescope differs; keys of `sensor`")


class Station(Atmosphere):
    latitude_deg: number(ge=-90, le=90) = setting("geodetic latitude", "deg")
    longitude_deg: number(ge=-180, le=360) = setting("longitude, positive to the east", "deg")
    height_m: number(ge=-500, le=9000) = setting("height above the ellipsoid", "m", default=0)
    sensor: partial(Sensor) = setting(
        "properties in which the station's telescope differs; keys of `sensor`",
        default=partial(Sensor)())
