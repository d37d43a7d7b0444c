"""Standard deviations of the parts of a state, as uncertainty at the epoch or as process noise."""

import numpy as np

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.runtime import Array
from cislunar.runtime.settings_fields import NotNegative, Positive, Section, setting


class _StateSigma(Section):
    """Standard deviations of the four parts of a state, the same on each axis."""

    attitude_deg: float
    angular_velocity_deg_h: float
    position_km: float
    velocity_m_s: float

    def components(self) -> Array:
        """Shape (12,): attitude error (GRP), angular velocity (rad/s), position and velocity."""
        values = (
            np.deg2rad(self.attitude_deg),
            np.deg2rad(self.angular_velocity_deg_h) / 3600.0,
            self.position_km / LENGTH_UNIT_KM,
            1e-3 * self.velocity_m_s * TIME_UNIT_S / LENGTH_UNIT_KM,
        )
        return np.repeat(values, 3)


# fmt: off


class InitialSigma(_StateSigma):
    """Uncertainty of the targets at the epoch."""

    attitude_deg: Positive = setting(
        "initial standard deviation of each attitude error angle", "deg", "5 (variance 5^2)")
    angular_velocity_deg_h: Positive = setting(
        "initial standard deviation of each component of the angular velocity", "deg/h",
        "2.4 (variance (0.1 x 24)^2)")
    position_km: Positive = setting(
        "initial standard deviation of each component of the position", "km",
        "31.6 (variance 0.1 x 100000^2 m^2)")
    velocity_m_s: Positive = setting(
        "initial standard deviation of each component of the velocity", "m/s",
        "0.0316 (variance 0.1 x 0.1^2)")


PAPER_INITIAL_SIGMA = InitialSigma(
    attitude_deg=5.0,
    angular_velocity_deg_h=2.4,
    position_km=100.0 * np.sqrt(0.1),
    velocity_m_s=0.1 * np.sqrt(0.1),
)
"""Uncertainty of the targets at the epoch (Paul & Fan, table 3)."""

PROCESS_NOISE_PERIOD_S = 60.0
"""Time over which the standard deviations of the process noise accumulate, s."""


class ProcessNoise(_StateSigma):
    """Process noise: what accumulates in `PROCESS_NOISE_PERIOD_S`, and white accelerations. Over a
    step of length h a spectral density q of the acceleration adds the covariance q [h^3/3, h^2/2;
    h^2/2, h] to position and velocity."""

    omitted = ("acceleration_m2_s3",)

    attitude_deg: NotNegative = setting(
        "standard deviation of the attitude noise that accumulates in 60 s, for "
        "instance 0.03", "deg", "not given", default=0)
    angular_velocity_deg_h: NotNegative = setting(
        "standard deviation of the angular-velocity noise that accumulates in 60 s", "deg/h",
        "not given", default=0)
    position_km: NotNegative = setting(
        "standard deviation of the position noise that accumulates in 60 s", "km", "not given",
        default=0)
    velocity_m_s: NotNegative = setting(
        "standard deviation of the velocity noise that accumulates in 60 s", "m/s", "not given",
        default=0)
    acceleration_m2_s3: NotNegative = setting(
        "spectral density of a white acceleration on each axis", "m^2/s^3", "not given", default=0)

    # fmt: on

    def covariance(self, step_s: float) -> tuple[Array, float]:
        """Variances gained in a step (12,), and the covariance of position and velocity on each
        axis, in the units of `components`."""
        variance = self.components() ** 2 * (step_s / PROCESS_NOISE_PERIOD_S)
        step = step_s / TIME_UNIT_S
        density = self.acceleration_m2_s3 * 1e-6 * TIME_UNIT_S**3 / LENGTH_UNIT_KM**2
        variance[6:9] += density * step**3 / 3.0
        variance[9:] += density * step
        return variance, density * step**2 / 2.0


def noise_of_step(noise: ProcessNoise | None, step_s: float) -> Array:
    """Covariance (6, 6) of the process noise of position and velocity in a step."""
    variance, both = (ProcessNoise() if noise is None else noise).covariance(step_s)
    process = np.diag(variance[6:])
    process[np.arange(3), np.arange(3, 6)] = process[np.arange(3, 6), np.arange(3)] = both
    return process
