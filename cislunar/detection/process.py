"""False alarms and lost detections. Nothing here needs compiled kernels."""

import numpy as np

from cislunar.runtime import Array
from cislunar.runtime.settings_fields import NotNegative, Section, number, setting


class DetectionProcess(Section):
    """What an exposure returns besides the detections of its targets."""

    # fmt: off

    false_alarms_deg2: NotNegative = setting(
        "mean number of false alarms per exposure and square degree", "deg^-2", default=0)
    false_alarm_slope: number(gt=0, le=2) = setting(
        "growth of the number of false alarms with magnitude m, as 10^(slope m)", "mag^-1",
        default=0.3)
    detection_loss: number(ge=0, lt=1) = setting(
        "share of detectable targets that an exposure loses, as next to a star", "1", default=0.02)

    # fmt: on

    def log_intensity(self, magnitude: Array, limit: Array, more_deg2: float) -> Array:
        """Logarithm of the density of detections that are of no track, per square radian and
        magnitude: false alarms and `more_deg2` others, with the same magnitudes. It is per square
        radian alone where the magnitude is NaN, hence unknown."""
        per_square = (self.false_alarms_deg2 + more_deg2) * np.rad2deg(1.0) ** 2
        rate = np.log(10.0) * self.false_alarm_slope
        known = np.log(per_square * rate) + rate * (magnitude - limit)
        return np.where(np.isnan(magnitude), np.log(per_square), known)
