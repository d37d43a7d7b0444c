"""The role of an estimator in the tasking loop.

The loop knows the truth, the estimator does not. Between two tasking epochs it is handed the
measurements that exist and returns its estimates at every step; at an epoch it says what it will
know at the next measurement time, which is what the tasking step weighs.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cislunar.errors import ConfigurationError
from cislunar.observation.body_spread import BodySpread
from cislunar.observation.records import Measurements
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.observation.sensor import Sensors

Array = NDArray[np.float64]

# Condition of an estimate.
HEALTHY, NOT_FINITE, INSIDE_PRIMARY, LOST_DEFINITENESS = range(4)

# Counters kept per target.
UPDATES, OUT_OF_FIELD, FLOOR_HITS, CHOLESKY_FAILURES = range(4)
N_COUNTERS = 4


class InitialEstimate(NamedTuple):
    """What is known of the targets at the epoch.

    Attributes
    ----------
    quaternion : ndarray, shape (target, 4)
        Attitude, inertial to body.
    angular_velocity : ndarray, shape (target, 3)
        rad/s, body frame.
    translation : ndarray, shape (target, 6)
        Position and velocity, nondimensional, rotating frame.
    sigma : ndarray, shape (12,)
        Standard deviations, common to all targets and independent: attitude error (GRP), angular
        velocity (rad/s), position and velocity (nondimensional).
    """

    quaternion: Array
    angular_velocity: Array
    translation: Array
    sigma: Array

    def require_positive(self) -> None:
        """Raise ConfigurationError if a standard deviation is not positive."""
        if not np.all(self.sigma > 0.0):
            raise ConfigurationError(f"initial sigma {self.sigma} must be positive throughout")


class Rotation(NamedTuple):
    """Attitudes as they are known at a time.

    Attributes
    ----------
    quaternion : ndarray, shape (target, 4)
        Inertial to body.
    angular_velocity : ndarray, shape (target, 3)
        rad/s, body frame.
    root : ndarray, shape (target, 6, 6)
        Lower Cholesky factor of the covariance of attitude error (GRP) and angular velocity.
    """

    quaternion: Array
    angular_velocity: Array
    root: Array


class Prediction(NamedTuple):
    """Estimates carried to the next measurement time.

    Attributes
    ----------
    index : int
        Index of that time in the scene.
    translation : ndarray, shape (target, 6)
        Position and velocity, nondimensional, rotating frame; NaN for a failed target.
    covariance : ndarray, shape (target, 6, 6)
        Of the translation.
    quaternion : ndarray, shape (target, 4), or None
        Attitude, inertial to body, if the estimator has a Gaussian joint estimate.
    root : ndarray, shape (target, 12, 12), or None
        Lower Cholesky factor of the joint covariance of attitude error, angular velocity (rad/s),
        position and velocity.
    rotation : Rotation or None
        Attitude and angular velocity by themselves, if the estimator has one estimate of them.
    """

    index: int
    translation: Array
    covariance: Array
    quaternion: Array | None = None
    root: Array | None = None
    rotation: Rotation | None = None


class Estimates(NamedTuple):
    """Estimates at the steps of an interval, after the updates.

    Attributes
    ----------
    quaternion : ndarray, shape (target, step, 4)
        Attitude, inertial to body.
    angular_velocity : ndarray, shape (target, step, 3)
        rad/s, body frame.
    translation : ndarray, shape (target, step, 6)
        Nondimensional, rotating frame.
    sigma : ndarray, shape (target, step, 12)
        Standard deviations of attitude error (GRP, rad for small angles), angular velocity
        (rad/s), position and velocity (nondimensional).
    covariance : ndarray, shape (target, step, 6, 6)
        Of the translation; without steps where it was not asked for.
    used : ndarray of bool, shape (row,)
        Whether each of the measurements was used.
    """

    quaternion: Array
    angular_velocity: Array
    translation: Array
    sigma: Array
    covariance: Array
    used: NDArray[np.bool_]


def empty_estimates(measurements: Measurements, covariance: bool) -> Estimates:
    """Room for the estimates of an interval with these measurements."""
    n_targets, n_offsets = measurements.offset.shape
    steps = (n_targets, n_offsets - 1)
    return Estimates(
        np.empty((*steps, 4)),
        np.empty((*steps, 3)),
        np.empty((*steps, 6)),
        np.empty((*steps, 12)),
        np.empty((n_targets, steps[1] if covariance else 0, 6, 6)),
        np.empty(measurements.observer.size, dtype=np.bool_),
    )


class Estimator(Protocol):
    """Anything that turns measurements into estimates of all targets."""

    @property
    def failed(self) -> NDArray[np.uint8]:
        """Per target, 0 or why its estimate came to an end: NOT_FINITE, INSIDE_PRIMARY ..."""
        ...

    @property
    def counters(self) -> NDArray[np.int64]:
        """Counts per target: updates, out of field, dark sigma points, Cholesky failures."""
        ...

    @property
    def unknowns(self) -> BodySpread:
        """What it estimates of the targets besides their motion."""
        ...

    def predict(self) -> Prediction:
        """Estimates at the next measurement time; the estimator itself does not move on."""
        ...

    def advance(self, measurements: Measurements, *, covariance: bool = False) -> Estimates:
        """Work through the next steps, those of the measurements' offsets.

        Looks that found nothing (NaN) are among the measurements. `covariance` asks for that of
        the translation at every step.
        """
        ...


class EstimatorFactory(Protocol):
    """Makes an estimator for one run of the loop.

    One whose estimators have `unknowns` says so by an attribute of that name, and they have
    `learned` and `searches` as `cislunar.estimation.light_curves.batch.BatchEstimator`.
    """

    def __call__(
        self,
        scene: Scene,
        surfaces: TargetSurfaces,
        sensor: Sensors,
        initial: InitialEstimate,
        rng: np.random.Generator,
        forces: tuple,
    ) -> Estimator:
        """The generator is the estimator's own; one that draws nothing ignores it."""
        ...
