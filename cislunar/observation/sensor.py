"""Telescopes of the observers: noise, limits and exclusion angles.

In the paper the noise is the same at every magnitude. With `PhotonNoise` (docs/tasking.md) the
variance (2.5 / ln 10 / SNR)^2 adds to the constant variance of the magnitude, and (s / SNR)^2 to
that of each angle, where s is the standard deviation of the image. The noise-equivalent area 4 pi
s^2 is that of King 1983, PASP 95, 163.

Assumptions and limitations
---------------------------
- The telescope follows its target: nothing trails within an exposure.
- Estimators take the variance at the measured magnitude; the true variance is that at the true
  magnitude.
- For a telescope on the ground the atmosphere dims by `extinction_mag` times 1 / sin(elevation).
  The dimming is known and removed. Refraction and seeing are neglected. The vertical is that of a
  sphere, which is within 0.2 deg.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cislunar.compiled import copy_into, njit, njit_inline, njit_noalloc
from cislunar.errors import ConfigurationError
from cislunar.runtime import Array
from cislunar.runtime.settings_fields import (
    Angle,
    Flag,
    NotNegative,
    Number,
    Positive,
    Section,
    number,
    setting,
)

ARCSECOND = np.pi / 648_000.0

_ZERO_MAGNITUDE_FLUX = 8.8e9
"""Photons of a source of magnitude 0 in V, s^-1 m^-2: 3640 Jy over a band of 0.16 in the logarithm
of the wavelength (Bessell 1979, PASP 91, 589)."""

_PER_SNR = 2.5 / np.log(10.0)


class ExclusionAngles(Section):
    """Smallest angles between the line of sight and each bright body, degrees (Paul & Fan,
    section 3)."""

    # fmt: off

    sun: Angle = setting("minimum angle between the line of sight and the Sun", "deg", 35)
    moon: Angle = setting(
        "minimum angle between the line of sight and the center of the Moon", "deg", 5)
    earth: Angle = setting(
        "minimum angle between the line of sight and the center of the Earth", "deg", 15)

    # fmt: on

    @property
    def cosines(self) -> Array:
        """Cosines of the Sun, Moon and Earth angles, shape (3,)."""
        return np.cos(np.deg2rad([self.sun, self.moon, self.earth]))


class PhotonNoise(Section):
    """Noise of the photons of source and sky, see docs/tasking.md."""

    # fmt: off

    aperture_m: Positive = setting("diameter of the telescope's aperture", "m")
    exposure_s: Positive = setting("exposure time of a measurement", "s", default=10)
    quantum_efficiency: number(gt=0, le=1) = setting(
        "number of electrons per photon that reaches the aperture", "1", default=0.7)
    image_fwhm_arcsec: Positive = setting(
        "full width at half maximum of the image of a star", "arcsec", default=3)
    sky_mag_arcsec2: Number = setting(
        "brightness of the sky, in space that of the zodiacal light, 22 to 23.3 in V",
        "mag arcsec^-2", default=22.5)
    read_noise_e: NotNegative = setting("read noise within the image", "electrons", default=10)

    # fmt: on

    def constants(self) -> Array:
        """Electrons at magnitude 0, variance without a source (electrons^2), image variance
        (rad^2)."""
        area = 0.25 * np.pi * self.aperture_m**2
        electrons = _ZERO_MAGNITUDE_FLUX * area * self.quantum_efficiency * self.exposure_s
        sigma = self.image_fwhm_arcsec / (2.0 * np.sqrt(2.0 * np.log(2.0)))
        sky = electrons * 10.0 ** (-0.4 * self.sky_mag_arcsec2) * 4.0 * np.pi * sigma**2
        return np.array([electrons, sky + self.read_noise_e**2, (sigma * ARCSECOND) ** 2])


class Atmosphere(Section):
    """Limits of a telescope on the ground."""

    # fmt: off

    min_elevation_deg: number(gt=0, lt=90) = setting(
        "minimum elevation of a line of sight", "deg", default=20)
    extinction_mag: NotNegative = setting(
        "atmospheric extinction at the zenith", "mag", default=0.2)
    sun_below_deg: number(ge=0, lt=90) = setting(
        "minimum angle of the Sun below the horizon: 12 deg at the end of nautical twilight, 18 "
        "deg at the end of astronomical twilight", "deg", default=12)

    # fmt: on

    def constants(self) -> Array:
        """Sines of the least elevation and of the Sun's greatest elevation; extinction, mag."""
        least, sun = np.sin(np.deg2rad([self.min_elevation_deg, -self.sun_below_deg]))
        return np.array([least, sun, self.extinction_mag])


class SensorLimits(NamedTuple):
    """`Sensor` in the layout of the compiled kernels.
    `sensor_limits` returns them with a leading axis over observers. `noise_variance` (3,):
    magnitude, right ascension, declination; mag^2, rad^2. `half_field`: half the field of view,
    rad. `cosines` (3,): of the Sun, Moon and Earth exclusion angles. `photons` (3,): see
    `PhotonNoise.constants`, zero for constant noise. `ground`: whether the observer stands on the
    Earth. `atmosphere` (3,): see `Atmosphere.constants`, zero in space."""

    noise_variance: Array
    limiting_magnitude: float
    half_field: float
    cosines: Array
    occultation: bool
    photons: Array
    ground: bool
    atmosphere: Array


class Sensor(Section):
    """Telescope of an observer in space (Paul & Fan, table 3)."""

    # fmt: off

    omitted = ("photon_noise",)

    magnitude_noise: Positive = setting(
        "standard deviation of the measured magnitude", "mag", 0.1)
    angle_noise_arcsec: Positive = setting(
        "standard deviation of right ascension and of declination", "arcsec", 3)
    field_of_view_deg: number(gt=0, le=180) = setting(
        "full width of the field of view; measurements beyond half of it from the expected "
        "direction are rejected", "deg", 3)
    limiting_magnitude: Number = setting(
        "faintest measured magnitude that counts as a detection, and limit that tasking assumes",
        "mag", 18)
    exclusion_deg: ExclusionAngles = setting("")
    # The exclusion angles are measured from the centers: an observer near the Moon needs this.
    occultation: Flag = setting(
        "true: targets behind the disc of Earth or Moon are hidden",
        paper="not in the paper", default=True)
    photon_noise: PhotonNoise | None = setting(
        "photon noise in addition to the constant noise, larger for fainter targets "
        "(docs/tasking.md): `aperture_m` and, unless 10 s, 0.7, 3, 22.5 and 10, `exposure_s`, "
        "`quantum_efficiency`, `image_fwhm_arcsec`, `sky_mag_arcsec2` (of zodiacal light) and "
        "`read_noise_e`; null: none", paper="none", default=None)

    # fmt: on

    @property
    def noise(self) -> Array:
        """Standard deviations of magnitude (mag), right ascension and declination (rad)."""
        angle = self.angle_noise_arcsec * ARCSECOND
        return np.array([self.magnitude_noise, angle, angle])

    @property
    def plain(self) -> bool:
        """Whether noise is the same at every magnitude and there is no atmosphere."""
        return self.photon_noise is None

    def limits(self) -> SensorLimits:
        """The sensor in the layout of the compiled kernels."""
        photons = self.photon_noise
        return SensorLimits(
            self.noise**2,
            float(self.limiting_magnitude),
            float(np.deg2rad(0.5 * self.field_of_view_deg)),
            self.exclusion_deg.cosines,
            bool(self.occultation),
            np.zeros(3) if photons is None else photons.constants(),
            False,
            np.zeros(3),
        )


class GroundSensor(Sensor):
    """Telescope of a ground station, with the atmosphere above it."""

    atmosphere: Atmosphere

    @property
    def plain(self) -> bool:
        """False, since an atmosphere dims targets by their elevation."""
        return False

    def limits(self) -> SensorLimits:
        """The sensor in the layout of the compiled kernels."""
        return super().limits()._replace(ground=True, atmosphere=self.atmosphere.constants())


Sensors = Sensor | Sequence[Sensor]
"""One sensor for all observers, or one for each."""


def sensors_of(sensor: Sensors, n_observers: int) -> tuple[Sensor, ...]:
    """The sensor of each observer.

    Parameters
    ----------
    sensor : Sensor or sequence of Sensor
        One for all observers, or one for each.
    n_observers : int

    Raises
    ------
    ConfigurationError
        If their number is not that of the observers.
    """
    found = (sensor,) * n_observers if isinstance(sensor, Sensor) else tuple(sensor)
    if len(found) != n_observers:
        raise ConfigurationError(
            f"sensor: {len(found)} given for {n_observers} observers; give one for all, or one "
            "for each"
        )
    return found


def sensor_limits(sensor: Sensors, n_observers: int) -> SensorLimits:
    """Limits of all observers for the compiled kernels, with a leading axis; see `sensors_of`."""
    each = [one.limits() for one in sensors_of(sensor, n_observers)]
    return SensorLimits(*(np.array(column) for column in zip(*each, strict=True)))


@njit(cache=True, error_model="numpy", inline="always")
def limits_of(limits, o):
    """`SensorLimits` of observer o, from the limits of all observers."""
    return SensorLimits(
        limits.noise_variance[o],
        limits.limiting_magnitude[o],
        limits.half_field[o],
        limits.cosines[o],
        limits.occultation[o],
        limits.photons[o],
        limits.ground[o],
        limits.atmosphere[o],
    )


@njit_noalloc
def noise_variance_at(limits, magnitude, out):
    """Variances (3,) of a measurement of a source of this apparent magnitude, into `out`."""
    copy_into(out, limits.noise_variance)
    electrons, background, image = limits.photons
    if electrons > 0.0:
        signal = electrons * 10.0 ** (-0.4 * magnitude)
        per_square = (signal + background) / (signal * signal)
        out[0] += _PER_SNR * _PER_SNR * per_square
        out[1] += image * per_square
        out[2] += image * per_square


def noise_at(sensor: Sensor, magnitude: ArrayLike) -> Array:
    """Standard deviations (..., 3) of a measurement, mag and rad, given the apparent magnitude at
    the telescope, dimmed by the atmosphere if there is one."""
    magnitudes = np.asarray(magnitude, dtype=float)
    out, limits = np.empty((magnitudes.size, 3)), sensor.limits()
    for each, row in zip(magnitudes.ravel(), out, strict=True):
        noise_variance_at(limits, each, row)
    return np.sqrt(out).reshape(*magnitudes.shape, 3)


@njit_inline
def sine_of_elevation(ox, oy, oz, dx, dy, dz, earth):
    """Sine of the elevation of a direction d at a position o on the ground."""
    ux, uy, uz = ox - earth[0], oy - earth[1], oz - earth[2]
    squares = (ux * ux + uy * uy + uz * uz) * (dx * dx + dy * dy + dz * dz)
    return (ux * dx + uy * dy + uz * dz) / np.sqrt(squares)


@njit_inline
def extinction(ox, oy, oz, dx, dy, dz, earth, limits):
    """Atmospheric extinction along a line of sight, mag; infinite at and below the horizon."""
    if not limits.ground:
        return 0.0
    sine = sine_of_elevation(ox, oy, oz, dx, dy, dz, earth)
    return limits.atmosphere[2] / sine if sine > 0.0 else np.inf
