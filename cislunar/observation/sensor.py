"""Telescopes of the observers: noise, limits, and how near to bright bodies they may point.

Noise. In the paper it is the same at every magnitude. With `PhotonNoise` a source of magnitude m
throws N = F A q t 10^(-0.4 m) electrons on the detector, F being `ZERO_MAGNITUDE_FLUX`, A the
area of the aperture, q the efficiency and t the exposure. Its signal-to-noise ratio is

    SNR = N / sqrt(N + B + r^2),    B = F A q t 10^(-0.4 mu) 4 pi s^2,

mu the magnitude of a square arcsecond of sky, 4 pi s^2 the noise-equivalent area of a Gaussian
image of standard deviation s (King 1983, PASP 95, 163), r the read noise in it. The magnitude has
then the variance (2.5 / ln 10 / SNR)^2 beside the constant one, either angle (s / SNR)^2.

Assumptions and limitations
---------------------------
- The telescope follows its target: nothing trails within an exposure.
- Estimators take the variance at the measured magnitude, the truth's is that at the true one.
- From the ground the air dims by `extinction_mag` times 1 / sin(elevation), which is known and
  taken off; refraction and seeing are left out. The vertical is that of a sphere, within 0.2 deg.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from cislunar.compiled import borrowing, put
from cislunar.errors import ConfigurationError

Array = NDArray[np.float64]

ARCSECOND = np.pi / 648_000.0

ZERO_MAGNITUDE_FLUX = 8.8e9
"""Photons of a source of magnitude 0 in V, s^-1 m^-2: 3640 Jy over a band of 0.16 in the logarithm
of the wavelength (Bessell 1979, PASP 91, 589)."""

_PER_SNR = 2.5 / np.log(10.0)


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


@dataclass(frozen=True)
class PhotonNoise:
    """Noise of the photons of source and sky; the module says how it acts.

    Attributes
    ----------
    aperture_m : float
        Diameter, m.
    exposure_s : float
        Of a measurement, s.
    quantum_efficiency : float
        Electrons for each photon that reaches the aperture.
    image_fwhm_arcsec : float
        Full width of a star's image at half its height, arcsec.
    sky_mag_arcsec2 : float
        Brightness of the sky, from space the zodiacal light: 22 to 23.3 mag arcsec^-2 in V.
    read_noise_e : float
        Within the image, electrons.

    Raises
    ------
    ConfigurationError
        If a value is impossible.
    """

    aperture_m: float
    exposure_s: float = 10.0
    quantum_efficiency: float = 0.7
    image_fwhm_arcsec: float = 3.0
    sky_mag_arcsec2: float = 22.5
    read_noise_e: float = 10.0

    def __post_init__(self) -> None:
        for key in ("aperture_m", "exposure_s", "quantum_efficiency", "image_fwhm_arcsec"):
            value = getattr(self, key)
            if not (value > 0.0 and np.isfinite(value)):
                raise ConfigurationError(f"{key} = {value} must be positive and finite")
        if self.quantum_efficiency > 1.0:
            raise ConfigurationError(
                f"quantum_efficiency = {self.quantum_efficiency} must not exceed 1"
            )
        if not (self.read_noise_e >= 0.0 and np.isfinite(self.read_noise_e)):
            raise ConfigurationError(f"read_noise_e = {self.read_noise_e} must not be negative")
        if not np.isfinite(self.sky_mag_arcsec2):
            raise ConfigurationError(f"sky_mag_arcsec2 = {self.sky_mag_arcsec2} is no number")

    def constants(self) -> Array:
        """Electrons of magnitude 0, variance without a source (electrons^2) and of the image."""
        area = 0.25 * np.pi * self.aperture_m**2
        electrons = ZERO_MAGNITUDE_FLUX * area * self.quantum_efficiency * self.exposure_s
        sigma = self.image_fwhm_arcsec / (2.0 * np.sqrt(2.0 * np.log(2.0)))
        sky = electrons * 10.0 ** (-0.4 * self.sky_mag_arcsec2) * 4.0 * np.pi * sigma**2
        return np.array([electrons, sky + self.read_noise_e**2, (sigma * ARCSECOND) ** 2])


@dataclass(frozen=True)
class Atmosphere:
    """What the ground does to a telescope.

    Attributes
    ----------
    min_elevation_deg : float
        Least elevation of a line of sight.
    extinction_mag : float
        By which the air dims at the zenith, mag.
    sun_below_deg : float
        How far the Sun has to be below the horizon: 12 at nautical twilight, 18 at night.

    Raises
    ------
    ConfigurationError
        If a value is impossible.
    """

    min_elevation_deg: float = 20.0
    extinction_mag: float = 0.2
    sun_below_deg: float = 12.0

    def __post_init__(self) -> None:
        if not 0.0 < self.min_elevation_deg < 90.0:
            raise ConfigurationError(
                f"min_elevation_deg = {self.min_elevation_deg} must lie between 0 and 90"
            )
        if not 0.0 <= self.sun_below_deg < 90.0:
            raise ConfigurationError(f"sun_below_deg = {self.sun_below_deg} must lie in [0, 90)")
        if not (self.extinction_mag >= 0.0 and np.isfinite(self.extinction_mag)):
            raise ConfigurationError(f"extinction_mag = {self.extinction_mag} must not be negative")

    def constants(self) -> Array:
        """Sines of the least elevation and of the Sun's greatest, and the extinction, mag."""
        least, sun = np.sin(np.deg2rad([self.min_elevation_deg, -self.sun_below_deg]))
        return np.array([least, sun, self.extinction_mag])


class SensorLimits(NamedTuple):
    """`Sensor` in the layout of the compiled kernels; see there.

    With `sensor_limits` all attributes have a leading axis over observers.

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
    photons : ndarray, shape (3,)
        As of `PhotonNoise.constants`; zero for noise that is constant.
    ground : bool
        Whether the observer stands on the Earth.
    atmosphere : ndarray, shape (3,)
        As of `Atmosphere.constants`; zero in space.
    """

    noise_variance: Array
    limiting_magnitude: float
    half_field: float
    cosines: Array
    occultation: bool
    photons: Array
    ground: bool
    atmosphere: Array


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
    photon_noise : PhotonNoise or None
        Noise beside the constant one, greater for fainter targets; None: there is none.
    atmosphere : Atmosphere or None
        Of a telescope on the ground; None: in space.

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
    photon_noise: PhotonNoise | None = None
    atmosphere: Atmosphere | None = None

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

    @property
    def plain(self) -> bool:
        """Whether noise is the same at every magnitude and there is no air."""
        return self.photon_noise is None and self.atmosphere is None

    def limits(self) -> SensorLimits:
        """The same for the compiled kernels."""
        photons, air = self.photon_noise, self.atmosphere
        return SensorLimits(
            self.noise**2,
            float(self.limiting_magnitude),
            float(np.deg2rad(0.5 * self.field_of_view_deg)),
            self.exclusion.cosines,
            bool(self.occultation),
            np.zeros(3) if photons is None else photons.constants(),
            air is not None,
            np.zeros(3) if air is None else air.constants(),
        )


Sensors = Sensor | Sequence[Sensor]
"""One sensor for all observers, or one for each."""


def sensors_of(sensor: Sensors, n_observers: int) -> tuple[Sensor, ...]:
    """The sensor of each observer.

    Parameters
    ----------
    sensor : Sensor or sequence of Sensor
        One for all, or one for each.
    n_observers : int

    Returns
    -------
    tuple of Sensor

    Raises
    ------
    ConfigurationError
        If an observer has none.
    """
    found = (sensor,) * n_observers if isinstance(sensor, Sensor) else tuple(sensor)
    if len(found) != n_observers:
        raise ConfigurationError(
            f"sensor: {len(found)} given for {n_observers} observers; give one for all, or one "
            "for each"
        )
    return found


def sensor_limits(sensor: Sensors, n_observers: int) -> SensorLimits:
    """Sensors of all observers for the compiled kernels.

    Parameters
    ----------
    sensor, n_observers
        As of `sensors_of`.

    Returns
    -------
    SensorLimits
        Of arrays with a leading axis over observers.

    Raises
    ------
    ConfigurationError
        If an observer has no sensor.
    """
    each = [one.limits() for one in sensors_of(sensor, n_observers)]
    return SensorLimits(*(np.array(column) for column in zip(*each, strict=True)))


@njit(cache=True, error_model="numpy", inline="always")
def limits_of(limits, o):
    """`SensorLimits` of one observer, out of those of all."""
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


@borrowing
def noise_variance_at(limits, magnitude, out):
    """Variances (3,) of a measurement of a source as faint as it arrives, into `out`."""
    put(out, limits.noise_variance)
    electrons, background, image = limits.photons
    if electrons > 0.0:
        signal = electrons * 10.0 ** (-0.4 * magnitude)
        per_square = (signal + background) / (signal * signal)
        out[0] += _PER_SNR * _PER_SNR * per_square
        out[1] += image * per_square
        out[2] += image * per_square


def noise_at(sensor: Sensor, magnitude: ArrayLike) -> Array:
    """Standard deviations of a measurement, by the magnitude that arrives.

    Parameters
    ----------
    sensor : Sensor
    magnitude : array_like

    Returns
    -------
    ndarray, shape (..., 3)
        Of magnitude (mag), right ascension and declination (rad).
    """
    wanted = np.asarray(magnitude, dtype=float)
    out, limits = np.empty((wanted.size, 3)), sensor.limits()
    for each, row in zip(wanted.ravel(), out, strict=True):
        noise_variance_at(limits, each, row)
    return np.sqrt(out).reshape(*wanted.shape, 3)


@njit(cache=True, error_model="numpy", inline="always")
def sine_of_elevation(ox, oy, oz, dx, dy, dz, earth):
    """Sine of the elevation of a direction d at a place o on the ground."""
    ux, uy, uz = ox - earth[0], oy - earth[1], oz - earth[2]
    squares = (ux * ux + uy * uy + uz * uz) * (dx * dx + dy * dy + dz * dz)
    return (ux * dx + uy * dy + uz * dz) / np.sqrt(squares)


@njit(cache=True, error_model="numpy", inline="always")
def extinction(ox, oy, oz, dx, dy, dz, earth, limits):
    """By how much the air dims along a line of sight, mag; endless from the horizon down."""
    if not limits.ground:
        return 0.0
    sine = sine_of_elevation(ox, oy, oz, dx, dy, dz, earth)
    return limits.atmosphere[2] / sine if sine > 0.0 else np.inf
