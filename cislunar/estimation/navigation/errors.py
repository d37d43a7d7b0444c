"""Standard deviations of the errors of observers (position, pointing, clock), and the treatment of
the errors by estimators. No function here needs compiled kernels.

An error is the true minus the assumed value. It has six components, `OBSERVER_PARAMETERS`: position
along the axes of the propagation frame; zero-point offsets of measured right ascension and
declination, as the index errors of a mount (Meeks, Ball & Hull 1968); and the time of an exposure
minus its time stamp. Position and offsets are the sum of a constant and a random walk; the clock
error is constant.
"""

from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from cislunar.constants import LENGTH_UNIT_KM, SECONDS_PER_DAY
from cislunar.errors import ConfigurationError
from cislunar.runtime import Array
from cislunar.runtime.settings_fields import NotNegative, Section, partial, setting

OBSERVER_PARAMETERS = (
    "position_x",
    "position_y",
    "position_z",
    "right_ascension",
    "declination",
    "clock",
)
"""Components of an observer's error."""

PARAMETER_UNITS = ("m",) * 3 + ("arcsec",) * 2 + ("s",)
"""Unit of each component in settings, tables and data sets."""

ERROR_UNITS = np.array(
    [1e-3 / LENGTH_UNIT_KM] * 3 + [np.deg2rad(1.0 / 3600.0)] * 2 + [1.0], dtype=float
)
"""The same units in those of states and measurements: nondimensional, rad and s."""

N_PARAMETERS = len(OBSERVER_PARAMETERS)

TREATMENTS = ("none", "considered", "calibrated")
"""Treatments of the errors of the observers by estimators."""

# fmt: off


class ObserverErrorSigma(Section):
    """Standard deviations of the errors of every observer, independent and equal on all axes."""

    position_m: NotNegative = setting(
        "standard deviation of the constant error of each component of an observer's assumed "
        "position", "m", default=0)
    position_walk_m: NotNegative = setting(
        "standard deviation that a random walk of each component of the position error "
        "accumulates in a day", "m", default=0)
    pointing_arcsec: NotNegative = setting(
        "standard deviation of the constant zero-point offsets of measured right ascension and "
        "declination", "arcsec", default=0)
    pointing_walk_arcsec: NotNegative = setting(
        "standard deviation that a random walk of each zero-point offset accumulates in a day",
        "arcsec", default=0)
    clock_s: NotNegative = setting(
        "standard deviation of the constant error of an observer's clock", "s", default=0)

    # fmt: on

    def constant(self) -> Array:
        """Standard deviations of the constant errors, shape (6,), in the units of states and
        measurements: nondimensional, rad and s."""
        values = [self.position_m] * 3 + [self.pointing_arcsec] * 2 + [self.clock_s]
        return np.array(values, dtype=float) * ERROR_UNITS

    def walk(self, elapsed_s: float = SECONDS_PER_DAY) -> Array:
        """Standard deviations that the random walks accumulate in a time, shape (6,), in the same
        units."""
        values = [self.position_walk_m] * 3 + [self.pointing_walk_arcsec] * 2 + [0.0]
        return np.array(values, dtype=float) * ERROR_UNITS * np.sqrt(elapsed_s / SECONDS_PER_DAY)

    @property
    def present(self) -> bool:
        """Whether any of the standard deviations is not zero."""
        return bool(np.any(self.constant() > 0.0) or np.any(self.walk() > 0.0))


# fmt: off


class ObserverErrors(ObserverErrorSigma):
    """True errors of the observers, and their treatment by estimators."""

    omitted = ("table", "prior")

    table: Annotated[str, Field(min_length=1)] | None = setting(
        "table of constant errors of observers, which replace the random ones "
        "(docs/observers.md). Observers that are not in the table have no constant error",
        "path", default=None)
    treatment: Literal[TREATMENTS] = setting(
        "how estimators treat the errors: `none` ignores them, `considered` includes their "
        "covariance in the updates without estimating them (Schmidt-Kalman filter), `calibrated` "
        "estimates them from the measurements of all targets", default="none")
    prior: partial(ObserverErrorSigma) = setting(
        "prior standard deviations of the treatment, where they differ from the true ones: any of "
        "the keys in m, arcsec and s above", default=partial(ObserverErrorSigma)())

    # fmt: on

    @property
    def truth(self) -> ObserverErrorSigma:
        """Standard deviations of the true errors; 0 for constant errors with a table."""
        own = {key: getattr(self, key) for key in ObserverErrorSigma.model_fields}
        if self.table is not None:
            own |= {"position_m": 0.0, "pointing_arcsec": 0.0, "clock_s": 0.0}
        return ObserverErrorSigma(**own)

    @property
    def assumed(self) -> ObserverErrorSigma:
        """Prior standard deviations of the treatment."""
        own = {key: getattr(self, key) for key in ObserverErrorSigma.model_fields}
        return ObserverErrorSigma(**(own | self.prior.model_dump()))

    @model_validator(mode="after")
    def _possible(self) -> "ObserverErrors":
        if self.treatment != "none" and not self.assumed.present:
            raise ConfigurationError(
                f"treatment = {self.treatment!r} needs a prior: set prior.position_m, "
                "prior.pointing_arcsec or prior.clock_s, or set treatment to 'none'"
            )
        return self


class ObserverEstimate(NamedTuple):
    """Estimated errors of the observers.

    Attributes
    ----------
    mean : ndarray, shape (observer, 6)
        In the order of `OBSERVER_PARAMETERS`; m, arcsec and s. Zero for components that are not
        estimated.
    covariance : ndarray, shape (observer, 6, 6)
        For components that are not estimated, the prior covariance.
    """

    mean: Array
    covariance: Array
