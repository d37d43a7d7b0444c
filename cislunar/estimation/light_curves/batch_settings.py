"""Settings of the batch estimator, and named choices of them."""

from typing import NamedTuple

from pydantic import model_validator

from cislunar.errors import ConfigurationError
from cislunar.estimation.light_curves.model_selection.settings import ModelSelectionSettings
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.runtime.settings_fields import (
    Count,
    Flag,
    NotNegative,
    Positive,
    Section,
    setting,
    whole,
)


class SearchSettings(NamedTuple):
    """How the modes are searched for, in the layout of the compiled kernels.
    `modes`: most modes kept. `starts`, `first_starts`: points of the pool that are refined, the
    latter while the light curve is short and in searches afresh. `pool`: points drawn.
    `warm_iterations`, `iterations`: steps from a live mode, and from a point of the pool. `spread`:
    factor on the standard deviations of a mode around which points are drawn. `merge_distance`:
    squared Mahalanobis distance below which two modes are one. `drop`: difference in log weight
    below which a mode is given up. `searches`: most searches of a fit, which are repeated while it
    is in doubt."""

    modes: int
    starts: int
    first_starts: int
    pool: int
    warm_iterations: int
    iterations: int
    spread: float
    merge_distance: float
    drop: float
    searches: int


_KNOWN_NOISE = (
    ("window_hours", None, "condensed data have a noise of their own"),
    ("use_non_detections", False, "a limit has the known noise"),
)
_ALL_ROWS = (
    ("window_hours", None, "a correlated model error needs all rows"),
    ("use_non_detections", False, "a correlated model error is one of magnitudes"),
)
"""Keys that exclude `noise_freedom` or `model_selection`, their usual values, and the reason."""

# fmt: off


class BatchSettings(Section):
    """How the attitude is fitted."""

    omitted = ("noise_freedom", "most_searches", "estimated_parameters", "model_selection")

    modes: Count = setting(
        "maximum number of modes of the attitude's posterior that the estimator `batch` keeps (16 "
        "in the preset `accurate`)", default=8)
    starts: whole(ge=0) = setting(
        "number of starts of a fit of at least 20 measurements in addition to the modes found "
        "before (8 in `accurate`)", default=4)
    first_starts: whole(ge=0) = setting(
        "number of starts of a fit of fewer than 20 measurements, and of a repeated search (16 "
        "in `accurate`)", default=8)
    pool: whole(ge=0) = setting(
        "number of random points from which the starts are chosen by cost, at least the number of "
        "starts (128 in `accurate`)", default=64)
    refit_growth: NotNegative = setting(
        "share by which a light curve has to grow to be fitted again between tasking epochs; 0: "
        "fits at tasking epochs only (0.1 in `accurate`)", "1", default=0.25)
    window_hours: Positive | None = setting(
        "age beyond which measurements are condensed into a Gaussian per mode; null: all are kept",
        "h", default=None)
    memory_hours: Positive | None = setting(
        "time in which the information of condensed measurements decays by a factor e; null: no "
        "decay; needs `window_hours`", "h", default=None)
    use_non_detections: Flag = setting(
        "true: a tasked target that is not detected although nothing hides it counts as fainter "
        "than the limiting magnitude", default=False)
    magnitude_noise_factor: Positive = setting(
        "factor on the magnitude noise in the fit of the attitude, for inexact models",
        "1", default=1)
    noise_freedom: Positive | None = setting(
        "degrees of freedom of the prior of the magnitude noise's variance, over which the fit is "
        "marginalized; null: the variance is known", "1", default=None)
    most_searches: Count = setting(
        "maximum number of searches of a fit whose residuals are too large, whose modes disagree "
        "or whose best mode is new; above 1 the attitude has a status", default=1)
    estimated_parameters: BodyParameterPrior = BodyParameterPrior()
    model_selection: ModelSelectionSettings = ModelSelectionSettings()

    # fmt: on

    @model_validator(mode="after")
    def _possible(self) -> "BatchSettings":
        if self.pool < max(self.starts, self.first_starts):
            raise ConfigurationError(
                f"pool = {self.pool} must be at least as large as starts = {self.starts} and "
                f"first_starts = {self.first_starts}"
            )
        if self.memory_hours is not None and self.window_hours is None:
            raise ConfigurationError(
                f"memory_hours = {self.memory_hours} needs window_hours: only condensed data fade"
            )
        effort = self.model_selection.effort
        for name, value, others in (
            ("noise_freedom", self.noise_freedom, _KNOWN_NOISE),
            ("model_selection.effort", effort or None, _ALL_ROWS),
        ):
            for other, usual, why in others if value is not None else ():
                if getattr(self, other) != usual:
                    raise ConfigurationError(
                        f"{name} = {value} and {other} = {getattr(self, other)} exclude each "
                        f"other: {why}"
                    )
        return self

    def search_settings(self) -> SearchSettings:
        """The same for the compiled kernels, with the constants of the method."""
        return SearchSettings(
            self.modes,
            self.starts,
            self.first_starts,
            self.pool,
            warm_iterations=3,
            iterations=8,
            spread=3.0,
            merge_distance=2.0,
            drop=12.0,
            searches=self.most_searches,
        )


PRESETS = {
    "default": BatchSettings(),
    "accurate": BatchSettings(modes=16, starts=8, first_starts=16, pool=128, refit_growth=0.1),
    "single-start": BatchSettings(modes=1, starts=0, first_starts=0, pool=0),
}
"""Settings by name; "single-start" is for comparison, not for use."""
