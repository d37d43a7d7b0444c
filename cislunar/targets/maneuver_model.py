"""Settings of the maneuvers of true targets. No function here needs compiled kernels."""

from pydantic import model_validator

from cislunar.errors import ConfigurationError
from cislunar.runtime.settings_fields import NotNegative, Positive, Section, Text, number, setting

# fmt: off


class DrawnManeuvers(Section):
    """One kind of maneuvers drawn at random for each target and realization: station keeping,
    which is small and periodic, or transfers, which are rare and large."""

    share: number(ge=0, le=1) = setting(
        "probability that a target makes maneuvers of this kind", "1", default=1)
    smallest_m_s: Positive = setting(
        "smallest change of velocity; its logarithm is uniform between smallest and largest, and "
        "its direction isotropic", "m/s")
    largest_m_s: number(gt=0, le=1000) = setting(
        "largest change of velocity; up to the escape speed from Earth and Moon 800,000 km away",
        "m/s")
    interval_hours: Positive | None = setting(
        "time between the maneuvers of a target, the first of which is uniform within the first "
        "interval; null: one maneuver, at a time that is uniform within the window", "h",
        default=None)
    first_hour: NotNegative = setting(
        "begin of the window in which maneuvers start, since the start of the run", "h", default=0)
    last_hour: NotNegative | None = setting(
        "end of the window in which maneuvers start; null: the last time at which one ends within "
        "the run", "h", default=None)
    duration_minutes: NotNegative = setting(
        "duration of a maneuver, with constant thrust along the axes of the propagation frame; 0: "
        "an impulse", "min", default=0)

    # fmt: on

    @model_validator(mode="after")
    def _possible(self) -> "DrawnManeuvers":
        if self.largest_m_s < self.smallest_m_s:
            raise ConfigurationError(
                f"largest_m_s = {self.largest_m_s} is less than smallest_m_s = {self.smallest_m_s}"
            )
        if self.last_hour is not None and self.last_hour < self.first_hour:
            raise ConfigurationError(
                f"last_hour = {self.last_hour} is before first_hour = {self.first_hour}"
            )
        every = self.interval_hours
        if every is not None and self.duration_minutes > 60.0 * every:
            raise ConfigurationError(
                f"duration_minutes = {self.duration_minutes} is longer than interval_hours = "
                f"{every}: the maneuvers of a target would overlap"
            )
        return self

    def window(self, duration_hours: float) -> tuple[float, float]:
        """First and last hour at which a maneuver can start in a run of this duration, h.

        Raises
        ------
        ConfigurationError
            If a maneuver that starts in the window does not end within the run.
        """
        length = self.duration_minutes / 60.0
        last = duration_hours - length if self.last_hour is None else self.last_hour
        if last + length > duration_hours or self.first_hour > last:
            raise ConfigurationError(
                f"maneuvers of {length:g} h that start between hours {self.first_hour:g} and "
                f"{last:g} are not within the run of {duration_hours:g} h; change first_hour, "
                "last_hour or duration_minutes"
            )
        return self.first_hour, last


# fmt: off


class ManeuverModel(Section):
    """Maneuvers of true targets; see `cislunar.targets.maneuvers`."""

    table: Text | None = setting(
        "table of maneuvers (docs/maneuvers.md)", "path", default=None)
    drawn: list[DrawnManeuvers] = setting(
        "kinds of maneuvers drawn at random, with the keys of `DrawnManeuvers`", default=[])

    # fmt: on
