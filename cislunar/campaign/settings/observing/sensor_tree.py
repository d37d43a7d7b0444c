"""The settings of the observers' telescopes; each key is stated as in `tree`."""

from typing import Annotated

from pydantic import Field

from cislunar.campaign.settings.fields import (
    Angle,
    Flag,
    NotNegative,
    Number,
    Positive,
    Section,
    number,
    partial,
    setting,
    several,
    whole,
)
from cislunar.observation.sensor import Atmosphere, PhotonNoise

# fmt: off

GroupName = Annotated[str, Field(pattern="^[a-z0-9][a-z0-9-]*$")]


class Exclusion(Section):
    sun: Angle = setting("least angle between the line of sight and the Sun", "deg", "35")
    moon: Angle = setting("the same for the centre of the Moon", "deg", "5")
    earth: Angle = setting("the same for the centre of the Earth", "deg", "15")


class Photons(Section):
    aperture_m: Positive = setting("diameter of the telescope", "m")
    exposure_s: Positive = setting("of a measurement", "s", default=10)
    quantum_efficiency: number(gt=0, le=1) = setting(
        "electrons for each photon that reaches the aperture", "1",
        default=PhotonNoise.quantum_efficiency)
    image_fwhm_arcsec: Positive = setting(
        "full width of a star's image at half its height", "arcsec", default=3)
    sky_mag_arcsec2: Number = setting(
        "brightness of the sky, from space the zodiacal light", "mag arcsec^-2",
        default=PhotonNoise.sky_mag_arcsec2)
    read_noise_e: NotNegative = setting("of the image", "electrons", default=10)


class Sensor(Section):
    magnitude_noise: Positive = setting(
        "standard deviation of the measured magnitude", "mag", "0.1")
    angle_noise_arcsec: Positive = setting(
        "standard deviation of right ascension and of declination", "arcsec", "3")
    field_of_view_deg: number(gt=0, le=180) = setting(
        "full width; measurements beyond half of it from the expected direction are rejected",
        "deg", "3")
    limiting_magnitude: Number = setting(
        "faintest measured magnitude that counts, and the limit tasking assumes", "mag", "18")
    exclusion_deg: Exclusion = setting("")
    occultation: Flag = setting(
        "true: targets behind the disc of Earth or Moon are hidden",
        paper="not in the paper", default=True)
    photon_noise: Photons | None = setting(
        "noise of photons beside the constant one, greater for fainter targets (docs/tasking.md): "
        "`aperture_m` and, where not 10 s, 0.7, 3, 22.5 and 10, `exposure_s`, "
        "`quantum_efficiency`, `image_fwhm_arcsec`, `sky_mag_arcsec2` (of zodiacal light) and "
        "`read_noise_e`; null: none", paper="none", default=None)


class SensorGroup(Section):
    observers: Annotated[several(whole(ge=0)), Field(min_length=1)] = setting(
        "observers with a telescope of their own, counted from 0 as `observer` in a cell's file")
    sensor: partial(Sensor) = setting("what is otherwise about it; keys as of `sensor`")


class Station(Section):
    latitude_deg: number(ge=-90, le=90) = setting("geodetic latitude", "deg")
    longitude_deg: number(ge=-180, le=360) = setting("longitude, east", "deg")
    height_m: number(ge=-500, le=9000) = setting("above the ellipsoid", "m", default=0)
    min_elevation_deg: number(gt=0, lt=90) = setting(
        "least elevation of a line of sight", "deg", default=20)
    extinction_mag: NotNegative = setting(
        "by which the air dims at the zenith", "mag", default=Atmosphere.extinction_mag)
    sun_below_deg: number(ge=0, lt=90) = setting(
        "how far the Sun has to be below the horizon", "deg", default=12)
    sensor: partial(Sensor) = setting(
        "what is otherwise about its telescope; keys as of `sensor`", default=partial(Sensor)())
