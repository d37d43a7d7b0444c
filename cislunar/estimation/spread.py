"""Standard deviations of the parts of a state, as uncertainty at the epoch or as process noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.errors import ConfigurationError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Spread:
    """Standard deviations of the four parts of a state, the same on each axis.

    Attributes
    ----------
    attitude_deg, angular_velocity_deg_h, position_km, velocity_m_s : float
        Not negative.

    Raises
    ------
    ConfigurationError
        If one is negative or not finite.
    """

    attitude_deg: float = 0.0
    angular_velocity_deg_h: float = 0.0
    position_km: float = 0.0
    velocity_m_s: float = 0.0

    def __post_init__(self) -> None:
        for key, value in vars(self).items():
            if not (value >= 0.0 and np.isfinite(value)):
                raise ConfigurationError(f"{key} = {value} must be finite and not negative")

    def components(self) -> Array:
        """Shape (12,): attitude error (GRP), angular velocity (rad/s), position and velocity."""
        values = (
            np.deg2rad(self.attitude_deg),
            np.deg2rad(self.angular_velocity_deg_h) / 3600.0,
            self.position_km / LENGTH_UNIT_KM,
            1e-3 * self.velocity_m_s * TIME_UNIT_S / LENGTH_UNIT_KM,
        )
        return np.repeat(values, 3)


INITIAL_SPREAD = Spread(
    attitude_deg=5.0,
    angular_velocity_deg_h=2.4,
    position_km=100.0 * np.sqrt(0.1),
    velocity_m_s=0.1 * np.sqrt(0.1),
)
"""Uncertainty of the targets at the epoch (Paul & Fan, table 3)."""

PROCESS_NOISE_PERIOD_S = 60.0
"""The spread of process noise is what accumulates over this time, s."""


@dataclass(frozen=True)
class ProcessNoise(Spread):
    """Process noise: what accumulates in `PROCESS_NOISE_PERIOD_S`, and white accelerations.

    Attributes
    ----------
    attitude_deg, angular_velocity_deg_h, position_km, velocity_m_s : float
        As of `Spread`.
    acceleration_m2_s3 : float
        Spectral density q of the acceleration on each axis, m^2/s^3. Over a step of length h
        position and velocity gain the covariance q [h^3/3, h^2/2; h^2/2, h].

    Raises
    ------
    ConfigurationError
        If one is negative or not finite.
    """

    acceleration_m2_s3: float = 0.0

    def covariance(self, step_s: float) -> tuple[Array, float]:
        """Variances gained in a step (12,), and the covariance of position and velocity, an axis.

        In the units of the states, see `Spread.components`.
        """
        variance = self.components() ** 2 * (step_s / PROCESS_NOISE_PERIOD_S)
        step = step_s / TIME_UNIT_S
        density = self.acceleration_m2_s3 * 1e-6 * TIME_UNIT_S**3 / LENGTH_UNIT_KM**2
        variance[6:9] += density * step**3 / 3.0
        variance[9:] += density * step
        return variance, density * step**2 / 2.0
