"""Settings of the batch estimator, and named choices of them."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cislunar.errors import ConfigurationError
from cislunar.observation.body_spread import BodySpread


class SearchSettings(NamedTuple):
    """How the modes are searched for, in the layout of the compiled kernels.

    Attributes
    ----------
    modes : int
        Most modes kept.
    starts, first_starts : int
        Points of the pool that are refined, later and at the first time.
    pool : int
        Points drawn.
    warm_iterations, iterations : int
        Steps from a live mode, and from a point of the pool.
    spread : float
        Factor on the standard deviations of a mode around which points are drawn.
    merge_distance : float
        Squared Mahalanobis distance below which two modes are one.
    drop : float
        Difference in log weight below which a mode is given up.
    searches : int
        Most searches of a fit, the further ones while it is in doubt.
    """

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


@dataclass(frozen=True)
class BatchSettings:
    """How the attitude is fitted.

    Attributes
    ----------
    modes : int
        Most modes of the posterior kept.
    starts, first_starts : int
        Starts of a fit besides the live modes, and of the first fit.
    pool : int
        Random points out of which the starts are chosen by cost; at least as many as starts.
    refit_growth : float
        Share by which a light curve has to grow before it is fitted between tasking epochs; 0
        fits at tasking epochs only.
    window_hours : float or None
        Age beyond which data are condensed into a Gaussian per mode; None keeps all.
    memory_hours : float or None
        Time in which what is known from condensed data fades by e; None forgets nothing.
    use_non_detections : bool
        Whether a tasked target that was in clear view and not seen counts as fainter than the
        limit.
    magnitude_noise_factor : float
        Factor on the sensor's magnitude noise, for models known to be inexact.
    noise_freedom : float or None
        Degrees of freedom of what is known of the noise variance beforehand: it is integrated out,
        as if known from so many measurements. None if it is known.
    most_searches : int
        Searches of a fit that is in doubt, see `cislunar.estimation.light_curves.effort`.
    unknowns : BodySpread
        What is estimated of a target besides its rotation, by its prior standard deviations.

    Raises
    ------
    ConfigurationError
        If a setting is impossible; the message names it.
    """

    modes: int = 8
    starts: int = 4
    first_starts: int = 8
    pool: int = 64
    refit_growth: float = 0.25
    window_hours: float | None = None
    memory_hours: float | None = None
    use_non_detections: bool = False
    magnitude_noise_factor: float = 1.0
    noise_freedom: float | None = None
    most_searches: int = 1
    unknowns: BodySpread = field(default_factory=BodySpread)

    def __post_init__(self) -> None:
        for key in ("modes", "most_searches"):
            if getattr(self, key) < 1:
                raise ConfigurationError(f"{key} = {getattr(self, key)} must be at least 1")
        if min(self.starts, self.first_starts) < 0:
            raise ConfigurationError(
                f"starts = {self.starts} and first_starts = {self.first_starts} must not be "
                "negative"
            )
        if self.pool < max(self.starts, self.first_starts):
            raise ConfigurationError(
                f"pool = {self.pool} must be at least as large as starts = {self.starts} and "
                f"first_starts = {self.first_starts}"
            )
        if not (self.refit_growth >= 0.0 and np.isfinite(self.refit_growth)):
            raise ConfigurationError(
                f"refit_growth = {self.refit_growth} must be finite and not negative"
            )
        positive = {"magnitude_noise_factor": self.magnitude_noise_factor}
        for key in ("window_hours", "memory_hours", "noise_freedom"):
            if getattr(self, key) is not None:
                positive[key] = getattr(self, key)
        if self.noise_freedom is not None:
            self._require_free_noise_alone()
        if self.memory_hours is not None and self.window_hours is None:
            raise ConfigurationError(
                f"memory_hours = {self.memory_hours} needs window_hours: only condensed data fade"
            )
        for key, value in positive.items():
            if not (value > 0.0 and np.isfinite(value)):
                raise ConfigurationError(f"{key} = {value} must be positive and finite")

    def _require_free_noise_alone(self) -> None:
        """Refuse what goes with a known noise alone."""
        others = {
            "window_hours": (self.window_hours, None, "condensed data have a noise of their own"),
            "use_non_detections": (self.use_non_detections, False, "a limit has the known noise"),
        }
        for key, (value, usual, why) in others.items():
            if value != usual:
                raise ConfigurationError(
                    f"noise_freedom = {self.noise_freedom} and {key} = {value} exclude each "
                    f"other: {why}"
                )

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
