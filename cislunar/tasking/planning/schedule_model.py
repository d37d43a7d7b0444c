"""How the observers may be scheduled between two tasking epochs."""

from dataclasses import dataclass

import numpy as np

from cislunar.errors import ConfigurationError


@dataclass(frozen=True)
class ScheduleModel:
    """Slots of a tasking interval, observers at a target, and turning from one to another.

    Attributes
    ----------
    slot_minutes : float or None
        Time an observer stays at a target before it may turn to another, the last slot of an
        interval being maybe shorter; None: the interval, as in the paper.
    observers_per_target : int
        Observers that may look at a target at the same time; 1 in the paper.
    slew_deg_s : float or None
        Rate of turning to another target, deg/s; None: at once.
    settle_s : float
        Time after turning until the first look, s.
    horizon_epochs : int
        Tasking intervals that are planned together at an epoch; the first is carried out.
    bound_steps : int
        Steps of the prices by which the best joint choice of all slots is bounded; 0: it is not.

    Raises
    ------
    ConfigurationError
        If a value is impossible.
    """

    slot_minutes: float | None = None
    observers_per_target: int = 1
    slew_deg_s: float | None = None
    settle_s: float = 0.0
    horizon_epochs: int = 1
    bound_steps: int = 0

    def __post_init__(self) -> None:
        for key in ("slot_minutes", "slew_deg_s"):
            value = getattr(self, key)
            if value is not None and not (value > 0.0 and np.isfinite(value)):
                raise ConfigurationError(f"{key} = {value} must be positive, or left out")
        for key, least in (("observers_per_target", 1), ("horizon_epochs", 1), ("bound_steps", 0)):
            if getattr(self, key) < least:
                raise ConfigurationError(f"{key} = {getattr(self, key)} must be at least {least}")
        if not (self.settle_s >= 0.0 and np.isfinite(self.settle_s)):
            raise ConfigurationError(f"settle_s = {self.settle_s} must not be negative")

    @property
    def turning(self) -> bool:
        """Whether turning to another target takes time."""
        return self.slew_deg_s is not None or self.settle_s > 0.0

    @property
    def bounded(self) -> bool:
        """Whether it is said how far a schedule may be from the best."""
        return self.observers_per_target > 1 or self.bound_steps > 0

    @property
    def plain(self) -> bool:
        """Whether each observer has one target from epoch to epoch, and each target one of them.

        And nothing is thought of beyond.
        """
        alone = self.observers_per_target == self.horizon_epochs == 1
        return self.slot_minutes is None and alone and not self.turning
