"""How measurements get from the observers to the common estimate."""

from collections.abc import Callable

from cislunar.errors import ConfigurationError
from cislunar.runtime.settings_fields import (
    Angle,
    Flag,
    NotNegative,
    Positive,
    Section,
    require_multiple,
    setting,
)

# fmt: off


class Contact(Section):
    """When an observer is in contact with the Earth."""

    moon: Flag = setting(
        "true: an observer behind the Moon's disc is out of contact with the Earth", default=False)
    sun_deg: Angle = setting(
        "angle at the Earth between Sun and observer below which there is no contact; 0: contact "
        "at every angle", "deg", default=0)


class CommunicationModel(Section):
    """Delay and contact windows of the observers' links to the Earth.

    An observer sends its measurements at the next step at which it is in contact, and the common
    estimate has them `delay_minutes` later. Observations without a detection take the same way.
    Commands reach the observers at once.
    """

    delay_minutes: NotNegative = setting(
        "time from the contact of an observer until the common estimate has its measurements, "
        "rounded up to whole steps; shorter than the run", "min", "0", default=0)
    contact: Contact = Contact()
    update_minutes: Positive | None = setting(
        "time between the instants at which the common estimate processes late measurements; "
        "null: the tasking interval. A measurement that arrives at its own step is processed at "
        "once", "min", default=None)
    use_pending_measurements: Flag = setting(
        "true: tasking uses the expected updates by pending measurements (taken, not yet "
        "received)", default=True)

    # fmt: on

    @property
    def late(self) -> bool:
        """Whether any measurement can be late."""
        return self.delay_minutes > 0.0 or self.contact.moon or self.contact.sun_deg > 0.0

    def require_possible(
        self, step_s: float, hours: float, states: str, named: Callable[[str], str] = str
    ) -> None:
        """Refuse measurements that never arrive, and settings that late measurements exclude. The
        step is in s, the length of the run in h; `states` is that of
        `cislunar.tasking.planning.information.TaskingModel`, and `named` gives the name of a key in
        messages."""
        if self.delay_minutes >= 60.0 * hours:
            raise ConfigurationError(
                f"{named('delay_minutes')} = {self.delay_minutes} is as long as the run of "
                f"duration_hours = {hours}: nothing would ever be received; shorten it"
            )
        if self.update_minutes is not None:
            require_multiple(named("update_minutes"), self.update_minutes, 60.0, step_s)
        if self.late and self.use_pending_measurements and states != "translation":
            raise ConfigurationError(
                f"{named('use_pending_measurements')} needs states = 'translation', but states = "
                f"{states!r}; set use_pending_measurements to false or change states"
            )
