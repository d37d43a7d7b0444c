"""What tasking believes of the targets' brightness before the first look."""

from dataclasses import dataclass

import numpy as np

from cislunar.errors import ConfigurationError

BRIGHTNESSES = ("facets", "sphere")


@dataclass(frozen=True)
class DetectionModel:
    """Brightness of targets; see `cislunar.tasking.planning.detection`.

    Attributes
    ----------
    brightness : {"facets", "sphere"}
        What a target's magnitude is expected to be but for its offset: that of its facets in the
        attitude the estimator expects, or that of a sphere.
    prior_mag : float
        Standard deviation of a target's offset from that, mag.
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

    brightness: str = "facets"
    prior_mag: float = 0.3
    flicker_mag: float = 0.3
    never_detected_bonus: float = 5.0

    def __post_init__(self) -> None:
        if self.brightness not in BRIGHTNESSES:
            raise ConfigurationError(
                f"brightness = {self.brightness!r} is unknown: use one of {list(BRIGHTNESSES)}"
            )
        for key in ("prior_mag", "flicker_mag"):
            if not (getattr(self, key) > 0.0 and np.isfinite(getattr(self, key))):
                raise ConfigurationError(f"{key} = {getattr(self, key)} must be positive")
        if not (self.never_detected_bonus >= 0.0 and np.isfinite(self.never_detected_bonus)):
            raise ConfigurationError(
                f"never_detected_bonus = {self.never_detected_bonus} must not be negative"
            )
