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

    def process_variance(self, step_s: float) -> Array:
        """Variances gained in a step by process noise of this spread, shape (12,)."""
        return self.components() ** 2 * (step_s / PROCESS_NOISE_PERIOD_S)


INITIAL_SPREAD = Spread(
    attitude_deg=5.0,
    angular_velocity_deg_h=2.4,
    position_km=100.0 * np.sqrt(0.1),
    velocity_m_s=0.1 * np.sqrt(0.1),
)
"""Uncertainty of the targets at the epoch (Paul & Fan, table 3)."""

PROCESS_NOISE_PERIOD_S = 60.0
"""A `Spread` given as process noise is what accumulates over this time, s."""
