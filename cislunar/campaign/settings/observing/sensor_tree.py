"""Settings of the observers' telescopes."""

from typing import Annotated

from pydantic import Field

from cislunar.observation.sensor import Atmosphere, PhotonNoise
from cislunar.runtime.settings_fields import (
    Angle,
    Flag,
    Number,
    Positive,
    Section,
    number,
    partial,
    setting,
    several,
    whole,
)

# fmt: off

GroupName = Annotated[str, Field(pattern="^[a-z0-9][a-z0-9-]*$")]


class Exclusion(Section):
    sun: Angle = setting("minimum angle between the line of sight and the Sun", "deg", "35")
    moon: Angle = setting(
        "minimum angle between the line of sight and the center of the Moon", "deg", "5")
    earth: Angle = setting(
        "minimum angle between the line of sight and the center of the Earth", "deg", "15")


class Sensor(Section):
    omitted = ("photon_noise",)

    magnitude_noise: Positive = setting(
        "standard deviation of the measured magnitude", "mag", "0.1")
    angle_noise_arcsec: Positive = setting(
        "standard deviation of right ascension and of declination", "arcsec", "3")
    field_of_view_deg: number(gt=0, le=180) = setting(
        "full width of the field of view; measurements beyond half of it from the expected "
        "direction are rejected", "deg", "3")
    limiting_magnitude: Number = setting(
        "faintest measured magnitude that counts as a detection, and limit that tasking assumes",
        "mag", "18")
    exclusion_deg: Exclusion = setting("")
    occultation: Flag = setting(
        "true: targets behind the disc of Earth or Moon are hidden",
        paper="not in the paper", default=True)
    photon_noise: PhotonNoise | None = setting(
        "photon noise in addition to the constant noise, larger for fainter targets "
        "(docs/tasking.md): `aperture_m` and, unless 10 s, 0.7, 3, 22.5 and 10, `exposure_s`, "
        "`quantum_efficiency`, `image_fwhm_arcsec`, `sky_mag_arcsec2` (of zodiacal light) and "
        "`read_noise_e`; null: none", paper="none", default=None)


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
