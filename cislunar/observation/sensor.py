"""Telescopes of the observers: noise, limits, and how near to bright bodies they may point."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.errors import ConfigurationError

Array = NDArray[np.float64]

ARCSECOND = np.pi / 648_000.0


@dataclass(frozen=True)
class ExclusionAngles:
    """Smallest angles between the line of sight and each bright body (Paul & Fan, section 3).

    Attributes
    ----------
    sun_deg, moon_deg, earth_deg : float
        Degrees in [0, 180); measured at the observer, from the centre of the body.

    Raises
    ------
    ConfigurationError
        If an angle lies outside [0, 180).
    """

    sun_deg: float = 35.0
    moon_deg: float = 5.0
    earth_deg: float = 15.0

    def __post_init__(self) -> None:
        for body in ("sun_deg", "moon_deg", "earth_deg"):
            angle = getattr(self, body)
            if not 0.0 <= angle < 180.0:
                raise ConfigurationError(f"exclusion angle {body} = {angle} must lie in [0, 180)")

    @property
    def cosines(self) -> Array:
        """Cosines of the Sun, Moon and Earth angles, shape (3,)."""
        return np.cos(np.deg2rad([self.sun_deg, self.moon_deg, self.earth_deg]))


class SensorLimits(NamedTuple):
    """`Sensor` in the layout of the compiled kernels; see there.

    Attributes
    ----------
    noise_variance : ndarray, shape (3,)
        Of magnitude, right ascension and declination; mag^2, rad^2.
    limiting_magnitude : float
    half_field : float
        rad.
    cosines : ndarray, shape (3,)
        Of the Sun, Moon and Earth exclusion angles.
    occultation : bool
    """

    noise_variance: Array
    limiting_magnitude: float
    half_field: float
    cosines: Array
    occultation: bool


@dataclass(frozen=True)
class Sensor:
    """Telescope of an observer (Paul & Fan, table 3).

    Attributes
    ----------
    magnitude_noise : float
        Standard deviation, mag.
    angle_noise_arcsec : float
        Standard deviation of right ascension and of declination, arcsec.
    limiting_magnitude : float
        Faintest measured magnitude that counts as an observation.
    field_of_view_deg : float
        Full width; a measurement further than half of it from the expected direction is rejected.
    exclusion : ExclusionAngles
        Smallest angles between the line of sight and the Sun, Moon and Earth.
    occultation : bool
        Whether a target behind the disc of the Earth or Moon is hidden. The exclusion angles are
        measured from the centres, so an observer near the Moon needs this.

    Raises
    ------
    ConfigurationError
        If a noise or the field of view is not positive.
    """

    magnitude_noise: float = 0.1
    angle_noise_arcsec: float = 3.0
    limiting_magnitude: float = 18.0
    field_of_view_deg: float = 3.0
    exclusion: ExclusionAngles = field(default_factory=ExclusionAngles)
    occultation: bool = True

    def __post_init__(self) -> None:
        for key in ("magnitude_noise", "angle_noise_arcsec", "field_of_view_deg"):
            value = getattr(self, key)
            if not (value > 0.0 and np.isfinite(value)):
                raise ConfigurationError(f"{key} = {value} must be positive and finite")
        if not np.isfinite(self.limiting_magnitude):
            raise ConfigurationError(f"limiting_magnitude = {self.limiting_magnitude} is no number")

    @property
    def noise(self) -> Array:
        """Standard deviations of magnitude (mag), right ascension and declination (rad)."""
        angle = self.angle_noise_arcsec * ARCSECOND
        return np.array([self.magnitude_noise, angle, angle])

    def limits(self) -> SensorLimits:
        """The same for the compiled kernels."""
        return SensorLimits(
            self.noise**2,
            float(self.limiting_magnitude),
            float(np.deg2rad(0.5 * self.field_of_view_deg)),
            self.exclusion.cosines,
            bool(self.occultation),
        )
