"""How measurements get from the observers to the common estimate."""

from dataclasses import dataclass

import numpy as np

from cislunar.errors import ConfigurationError


@dataclass(frozen=True)
class CommunicationModel:
    """Delay and contact windows of the observers' links to the Earth.

    An observer sends what it has measured at the next step at which it is in contact, and the
    common estimate has it `delay_minutes` later. What became of a look that found nothing takes
    the same way. Commands reach the observers at once.

    Attributes
    ----------
    delay_minutes : float
        Time from contact to the common estimate, rounded up to whole steps.
    moon : bool
        Whether the Moon's disc breaks contact with the Earth's centre.
    sun_deg : float
        Angle at the Earth between Sun and observer below which there is no contact, deg; 0: none.
    update_minutes : float or None
        Time between the instants at which the common estimate takes in what has come late; None:
        the tasking interval. What comes at the step it is measured is always used at once.
    credit_under_way : bool
        Whether tasking counts on looks taken and not yet received.

    Raises
    ------
    ConfigurationError
        If a value is impossible.
    """

    delay_minutes: float = 0.0
    moon: bool = False
    sun_deg: float = 0.0
    update_minutes: float | None = None
    credit_under_way: bool = True

    def __post_init__(self) -> None:
        if not (self.delay_minutes >= 0.0 and np.isfinite(self.delay_minutes)):
            raise ConfigurationError(
                f"delay_minutes = {self.delay_minutes} must be finite and not negative"
            )
        if not 0.0 <= self.sun_deg < 180.0:
            raise ConfigurationError(f"sun_deg = {self.sun_deg} must lie in [0, 180)")
        if self.update_minutes is not None and not (
            self.update_minutes > 0.0 and np.isfinite(self.update_minutes)
        ):
            raise ConfigurationError(
                f"update_minutes = {self.update_minutes} must be positive, or left out"
            )

    @property
    def late(self) -> bool:
        """Whether any measurement can be late."""
        return self.delay_minutes > 0.0 or self.moon or self.sun_deg > 0.0
