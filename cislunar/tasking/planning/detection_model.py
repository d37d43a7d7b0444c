"""What tasking believes of the targets' brightness before the first look."""

from dataclasses import dataclass

import numpy as np

from cislunar.errors import ConfigurationError


@dataclass(frozen=True)
class DetectionModel:
    """Brightness of targets against the sphere; see `cislunar.tasking.planning.detection`.

    Attributes
    ----------
    prior_mag : float
        Standard deviation of a target's offset from the sphere, mag.
    flicker_mag : float
        Standard deviation of a magnitude about that, mag.
    never_detected_bonus : float
        What a sure detection of a target that was never detected is worth beyond its information,
        nats.

    Raises
    ------
    ConfigurationError
        If a value is impossible.
    """

    prior_mag: float = 1.0
    flicker_mag: float = 0.5
    never_detected_bonus: float = 5.0

    def __post_init__(self) -> None:
        for key in ("prior_mag", "flicker_mag"):
            if not (getattr(self, key) > 0.0 and np.isfinite(getattr(self, key))):
                raise ConfigurationError(f"{key} = {getattr(self, key)} must be positive")
        if not (self.never_detected_bonus >= 0.0 and np.isfinite(self.never_detected_bonus)):
            raise ConfigurationError(
                f"never_detected_bonus = {self.never_detected_bonus} must not be negative"
            )
