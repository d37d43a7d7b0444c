"""What an observer measures of a target, and when it can (Paul & Fan, sections 2.4 and 5.2).

A measurement is (magnitude, right ascension, declination): the facet model's apparent magnitude
and the direction of the target in the body frame of the observer.

Assumptions and limitations
---------------------------
- Observers know their own position and attitude exactly; light time and aberration are neglected.
- Right ascension and declination have the same constant noise everywhere, as in the paper, also
  near the pole of the observer's frame, where right ascension is then too informative.
- A target in the shadow of the Earth or Moon is taken as lit.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.errors import ConfigurationError
from cislunar.observation.exclusion import ExclusionAngles
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.photometry.facets import facet_magnitude

Array = NDArray[np.float64]

ARCSECOND = np.pi / 648_000.0
EARTH_RADIUS = EARTH_RADIUS_KM / LENGTH_UNIT_KM
MOON_RADIUS = MOON_RADIUS_KM / LENGTH_UNIT_KM
_METRES = 1000.0 * LENGTH_UNIT_KM

# What became of an attempted measurement.
NOT_TASKED, FAINT, EXCLUDED, OCCULTED, DETECTED = range(5)


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


@njit(cache=True, inline="always")
def wrap_angle(angle):
    """An angle in [-pi, pi) (compiled)."""
    return angle - 2.0 * np.pi * np.floor(0.5 * angle / np.pi + 0.5)


@njit(cache=True, inline="always")
def rotate(axes, x, y, z):
    """Product of a 3 x 3 matrix and a vector, as scalars (compiled)."""
    return (
        axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z,
        axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z,
        axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z,
    )


@njit(cache=True, error_model="numpy")
def direction_angles(dx, dy, dz, axes):
    """Right ascension and declination of a line of sight (compiled).

    Parameters
    ----------
    dx, dy, dz : float
        Observer to target, any unit, rotating frame.
    axes : ndarray, shape (3, 3)
        Rotation from the rotating frame to the observer's body.

    Returns
    -------
    right_ascension, declination : float
        rad.
    """
    bx, by, bz = rotate(axes, dx, dy, dz)
    return np.arctan2(by, bx), np.arctan2(bz, np.sqrt(bx * bx + by * by))


@njit(cache=True, error_model="numpy")
def target_magnitude(dx, dy, dz, sx, sy, sz, to_inertial, quaternion, surfaces, j):
    """Apparent magnitude of target j (compiled).

    Parameters
    ----------
    dx, dy, dz : float
        Observer to target, nondimensional, rotating frame.
    sx, sy, sz : float
        Target to Sun, any unit, rotating frame.
    to_inertial : ndarray, shape (3, 3)
        Rotation from the rotating to the inertial frame.
    quaternion : tuple of 4 floats
        Attitude of the target, inertial to body.
    surfaces : TargetSurfaces
        Of all targets.
    j : int
        Index of the target.

    Returns
    -------
    float
        mag; `cislunar.photometry.facets.FLOOR_MAGNITUDE` if it is dark.
    """
    distance = np.sqrt(dx * dx + dy * dy + dz * dz)
    to_sun = np.sqrt(sx * sx + sy * sy + sz * sz)
    vx, vy, vz = rotate(to_inertial, -dx / distance, -dy / distance, -dz / distance)
    lx, ly, lz = rotate(to_inertial, sx / to_sun, sy / to_sun, sz / to_sun)
    first = surfaces.first[j]
    last = surfaces.first[j + 1]
    return facet_magnitude(
        quaternion,
        (lx, ly, lz),
        (vx, vy, vz),
        distance * _METRES,
        surfaces.areas[first:last],
        surfaces.normals[first:last],
        surfaces.material[j],
        surfaces.irradiance_4pi,
        surfaces.fresnel_sqrt,
    )


@njit(cache=True, error_model="numpy")
def outside_exclusion(ox, oy, oz, dx, dy, dz, sun, cosines, mu):
    """Whether a line of sight keeps clear of the Sun, Moon and Earth (compiled).

    Parameters
    ----------
    ox, oy, oz : float
        Observer, nondimensional, rotating frame.
    dx, dy, dz : float
        Observer to target.
    sun : ndarray, shape (3,)
        Sun, nondimensional, rotating frame.
    cosines : ndarray, shape (3,)
        Of the exclusion angles: Sun, Moon, Earth.
    mu : float
        Mass ratio.

    Returns
    -------
    bool
    """
    squared = dx * dx + dy * dy + dz * dz
    for body in range(3):
        if body == 0:
            bx, by, bz = sun[0] - ox, sun[1] - oy, sun[2] - oz
        else:
            bx, by, bz = (1.0 - mu if body == 1 else -mu) - ox, -oy, -oz
        along = bx * dx + by * dy + bz * dz
        if along >= cosines[body] * np.sqrt(squared * (bx * bx + by * by + bz * bz)):
            return False
    return True


@njit(cache=True, error_model="numpy")
def _disc_hides(bx, by, bz, dx, dy, dz, radius):
    """Whether a sphere at b from the observer cuts the segment to d (compiled)."""
    fraction = (bx * dx + by * dy + bz * dz) / (dx * dx + dy * dy + dz * dz)
    fraction = min(1.0, max(0.0, fraction))
    gx, gy, gz = bx - fraction * dx, by - fraction * dy, bz - fraction * dz
    return gx * gx + gy * gy + gz * gz < radius * radius


@njit(cache=True, error_model="numpy")
def occulted(ox, oy, oz, dx, dy, dz, mu):
    """Whether the Earth or the Moon stands between observer and target (compiled).

    Parameters
    ----------
    ox, oy, oz : float
        Observer, nondimensional, rotating frame.
    dx, dy, dz : float
        Observer to target.
    mu : float
        Mass ratio.

    Returns
    -------
    bool
    """
    return _disc_hides(-mu - ox, -oy, -oz, dx, dy, dz, EARTH_RADIUS) or _disc_hides(
        1.0 - mu - ox, -oy, -oz, dx, dy, dz, MOON_RADIUS
    )


@njit(cache=True, error_model="numpy")
def _measure(first, scene, surfaces, limits, observer_of, states, attitudes, noise, mu, out, fate):
    """Measurements of the steps first .. first + n - 1 (compiled); see `measure`."""
    for j in range(out.shape[0]):
        observer = observer_of[j]
        for i in range(out.shape[1]):
            out[j, i, :] = np.nan
            fate[j, i] = NOT_TASKED
            if observer < 0:
                continue
            k = first + i
            ox = scene.observer_position[observer, k, 0]
            oy = scene.observer_position[observer, k, 1]
            oz = scene.observer_position[observer, k, 2]
            x, y, z = states[j, k, 0], states[j, k, 1], states[j, k, 2]
            dx, dy, dz = x - ox, y - oy, z - oz
            sun = scene.sun_position[k]
            if not outside_exclusion(ox, oy, oz, dx, dy, dz, sun, limits.cosines, mu):
                fate[j, i] = EXCLUDED
                continue
            if limits.occultation and occulted(ox, oy, oz, dx, dy, dz, mu):
                fate[j, i] = OCCULTED
                continue
            magnitude = target_magnitude(
                dx,
                dy,
                dz,
                sun[0] - x,
                sun[1] - y,
                sun[2] - z,
                scene.frame_axes[k],
                (attitudes[j, k, 0], attitudes[j, k, 1], attitudes[j, k, 2], attitudes[j, k, 3]),
                surfaces,
                j,
            )
            magnitude += noise[j, k, 0]
            if not magnitude <= limits.limiting_magnitude:
                fate[j, i] = FAINT
                continue
            fate[j, i] = DETECTED
            ra, dec = direction_angles(dx, dy, dz, scene.observer_axes[k])
            out[j, i, 0] = magnitude
            out[j, i, 1] = wrap_angle(ra + noise[j, k, 1])
            out[j, i, 2] = dec + noise[j, k, 2]


def measure(
    first: int,
    n_steps: int,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensor,
    observer_of: NDArray[np.int64],
    states: Array,
    attitudes: Array,
    noise: Array,
    mu: float = MU,
) -> tuple[Array, NDArray[np.uint8]]:
    """Simulate the measurements of an interval from the true states (Paul & Fan, eqs. 23, 43).

    An observation exists when the noisy magnitude reaches the sensor's limit and the true line of
    sight keeps clear of the bright bodies (Paul & Fan, section 5.2). The field of view is the
    estimator's to check, since it compares with the expected direction.

    Parameters
    ----------
    first, n_steps : int
        Index of the first measurement time, and their number.
    scene : Scene
        Observers and Sun.
    surfaces : TargetSurfaces
        Shapes and materials.
    sensor : Sensor
        Noise and limits.
    observer_of : ndarray of int, shape (target,)
        Observer that looks at each target, or -1.
    states : ndarray, shape (target, time, 6)
        True states, nondimensional, rotating frame.
    attitudes : ndarray, shape (target, time, 4)
        True attitudes, inertial to body.
    noise : ndarray, shape (target, time, 3)
        Measurement errors: mag, rad, rad.
    mu : float
        Mass ratio.

    Returns
    -------
    measurements : ndarray, shape (target, n_steps, 3)
        mag, rad, rad; NaN where there is none.
    fate : ndarray of uint8, shape (target, n_steps)
        NOT_TASKED, FAINT, EXCLUDED, OCCULTED or DETECTED.
    """
    n_targets = states.shape[0]
    out = np.empty((n_targets, n_steps, 3))
    fate = np.empty((n_targets, n_steps), dtype=np.uint8)
    arguments = (np.asarray(observer_of, dtype=np.int64), states, attitudes, noise, float(mu))
    _measure(first, scene, surfaces, sensor.limits(), *arguments, out, fate)
    return out, fate
