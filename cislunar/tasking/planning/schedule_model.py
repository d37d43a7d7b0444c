"""How the observers may be scheduled between two tasking epochs."""

from collections.abc import Callable

from cislunar.errors import ConfigurationError
from cislunar.runtime.settings_fields import (
    NotNegative,
    Positive,
    Section,
    require_multiple,
    setting,
    whole,
)


class ScheduleModel(Section):
    """Slots of a tasking interval, observers per target, and slewing between targets."""

    # fmt: off

    slot_minutes: Positive | None = setting(
        "time that an observer stays at a target before it may slew to another, a multiple of "
        "`step_s`; the last slot of an interval may be shorter; null: the tasking interval", "min",
        "the interval", default=None)
    observers_per_target: whole(ge=1, le=4) = setting(
        "maximum number of observers that observe a target at the same time", "1", "1", default=1)
    slew_deg_s: Positive | None = setting(
        "rate at which an observer slews to another target; null: at once", "deg/s", "at once",
        default=None)
    settle_s: NotNegative = setting(
        "time between the end of a slew and the first observation", "s", "0", default=0)
    horizon_epochs: whole(ge=1, le=24) = setting(
        "number of tasking intervals that are planned together at an epoch; the first is carried "
        "out", "1", "1", default=1)
    bound_steps: whole(ge=0) = setting(
        "number of steps of a Lagrangian relaxation that bounds the best joint choice of all slots "
        "(`planning_gap` in the results; 30 steps take some tenths of a second per epoch); 0: no "
        "bound", "1",
        "not in the paper", default=0)

    # fmt: on

    def require_possible(
        self, step_s: float, method: str, states: str, named: Callable[[str], str] = str
    ) -> None:
        """Refuse slots that are no multiple of the step (s), and schedules that need another method
        of assignment or other states, see `cislunar.tasking.settings.LoopSettings`; `named` gives
        the name of a key in messages."""
        if self.slot_minutes is not None:
            require_multiple(named("slot_minutes"), self.slot_minutes, 60.0, step_s)
        usual = ScheduleModel()
        changed = [key for key in ScheduleModel.model_fields
                   if getattr(self, key) != getattr(usual, key)]  # fmt: skip
        for key, value, needed in (("method", method, "exact"), ("states", states, "translation")):
            if changed and value != needed:
                raise ConfigurationError(
                    f"{named(key)} = {value!r}: {', '.join(changed)} can be had with {needed!r} "
                    "alone"
                )

    @property
    def slewing(self) -> bool:
        """Whether slewing to another target takes time."""
        return self.slew_deg_s is not None or self.settle_s > 0.0

    @property
    def bounded(self) -> bool:
        """Whether the best joint choice of all slots is bounded."""
        return self.observers_per_target > 1 or self.bound_steps > 0

    @property
    def plain(self) -> bool:
        """Whether an observer keeps a target for one interval, which is planned by itself. Each
        target then has at most one observer, and slewing takes no time."""
        alone = self.observers_per_target == self.horizon_epochs == 1
        return self.slot_minutes is None and alone and not self.slewing
