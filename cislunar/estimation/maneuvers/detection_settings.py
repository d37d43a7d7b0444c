"""Settings of the detection of maneuvers. No function here needs compiled kernels."""

from pydantic import model_validator

from cislunar.errors import ConfigurationError
from cislunar.runtime.settings_fields import Positive, Section, number, setting

# fmt: off


class ManeuverDetection(Section):
    """The test of all targets for maneuvers; see
    `cislunar.estimation.maneuvers.likelihood_ratio`."""

    false_alarms_per_target_day: number(gt=0, lt=1) | None = setting(
        "rate of false alarms of the test of each target for maneuvers, a generalized likelihood "
        "ratio test beside the estimator (docs/maneuvers.md); null: no test", "1/d", default=None)
    window_hours: Positive = setting(
        "time before the present within which maneuvers are hypothesized", "h", default=12)
    spacing_minutes: Positive = setting(
        "time between the hypothesized maneuvers", "min", default=60)
    independent_tests_per_day: Positive = setting(
        "number of independent tests with as many false alarms as the correlated ones of a target "
        "in a day, which with the rate gives the threshold. 60 to 160 fit 120 to 220 observations "
        "a day; the default gives fewer false alarms than the rate (docs/maneuvers.md)", "1/d",
        default=300)

    recover: bool = setting(
        "true: after an alarm, time and vector of the maneuver are estimated, and the orbit anew "
        "from all observations since before it; false: estimates do not change", default=False)
    maneuvers_per_target_day: Positive = setting(
        "expected number of maneuvers of a target in a day, from which the probability of a "
        "maneuver is computed; for `recover`", "1/d", default=0.14)
    search_share: number(ge=0, le=0.2) = setting(
        "largest share of all observations that search for targets which may have left the field "
        "of view, instead of the observations of these targets; for `recover`; 0: no search", "1",
        default=0)

    # fmt: on

    @model_validator(mode="after")
    def _possible(self) -> "ManeuverDetection":
        if self.spacing_minutes > 60.0 * self.window_hours:
            raise ConfigurationError(
                f"spacing_minutes = {self.spacing_minutes} is longer than window_hours = "
                f"{self.window_hours}"
            )
        if self.recover and self.false_alarms_per_target_day is None:
            raise ConfigurationError(
                "recover = true: orbits are estimated anew after an alarm, but there is no test; "
                "set false_alarms_per_target_day"
            )
        if self.search_share > 0.0 and not self.recover:
            raise ConfigurationError(
                f"search_share = {self.search_share}: a target that is found is estimated anew; "
                "set recover to true"
            )
        return self
