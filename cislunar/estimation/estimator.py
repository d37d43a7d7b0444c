"""The interface of an estimator in the tasking loop.

The loop knows the truth, the estimator does not. Between two tasking epochs the estimator receives
the measurements and returns its estimates at every step. At an epoch it predicts its estimates at
the next measurement time, on which tasking is based. States are in the propagation frame, see
`cislunar.observation.scene`.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.errors import ConfigurationError
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.records import Measurements
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors
from cislunar.observation.target_surfaces import TargetSurfaces
from cislunar.runtime import Array
from cislunar.runtime.arguments import array_of, require_unit

# Health of an estimate.
HEALTHY, NOT_FINITE, INSIDE_PRIMARY, LOST_DEFINITENESS = range(4)

# Counters kept per target.
UPDATES, OUT_OF_FIELD, FLOOR_HITS, CHOLESKY_FAILURES = range(4)
N_COUNTERS = 4


class InitialEstimate(NamedTuple):
    """Estimates of the targets at the time from which they are tracked.

    Attributes
    ----------
    quaternion : ndarray, shape (target, 4)
        Attitude, inertial frame to body frame.
    angular_velocity : ndarray, shape (target, 3)
        rad/s, body frame.
    translation : ndarray, shape (target, 6)
        Position and velocity, nondimensional, propagation frame.
    sigma : ndarray, shape (12,)
        Standard deviations, common to all targets and independent: attitude error (GRP), angular
        velocity (rad/s), position and velocity (nondimensional).
    covariance : ndarray, shape (target, 12, 12), optional
        Covariance of each target, in the order of `sigma`. Estimators use it instead of `sigma`.
    """

    quaternion: Array
    angular_velocity: Array
    translation: Array
    sigma: Array
    covariance: Array | None = None

    def checked(self) -> "InitialEstimate":
        """The same estimates with unit quaternions.

        Raises
        ------
        ConfigurationError
            If an array has another shape, an estimate is not finite, or the norm of a quaternion
            differs from 1 by more than 1e-6; the message names the first such target.
        """
        n_targets = np.shape(self.translation)[0] if np.ndim(self.translation) else 0
        shapes = ("target", 4), ("target", 3), ("target", 6), (12,)
        for name, given, axes in zip(self._fields, self, shapes, strict=False):
            shape = (n_targets, *axes[1:]) if len(axes) > 1 else axes
            found = array_of(f"initial {name}", given, finite=False)
            if found.shape != shape:
                raise ConfigurationError(f"initial {name} has shape {found.shape}; give {shape}")
            array_of(f"initial {name}", found, axes if found.size else None)
        require_unit("initial quaternion", self.quaternion, "target")
        # unit quaternions are left as they are, to the last bit
        norm = np.linalg.norm(self.quaternion, axis=1)
        norm = np.where(np.abs(norm - 1.0) > 1e-15, norm, 1.0)
        return self._replace(quaternion=np.asarray(self.quaternion, dtype=float) / norm[:, None])

    def of_targets(self, targets: NDArray[np.int64]) -> "InitialEstimate":
        """Estimates of some of the targets, given by indices, shape (n,)."""
        motion = (each[targets] for each in self[:3])
        some = None if self.covariance is None else self.covariance[targets]
        return InitialEstimate(*motion, self.sigma, some)

    def deviations(self) -> Array:
        """Standard deviations of each target, shape (target, 12), in the order of `sigma`."""
        if self.covariance is None:
            return np.tile(self.sigma, (self.translation.shape[0], 1))
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    def roots(self, first: int = 0) -> Array:
        """Lower Cholesky factors of the covariances of the states from `first` on, shape (target,
        12 - first, 12 - first).

        Raises
        ------
        ConfigurationError
            If a standard deviation is not positive, or the covariance of a target not positive
            definite.
        """
        n_targets = self.translation.shape[0]
        if self.covariance is None:
            if not np.all(self.sigma > 0.0):
                raise ConfigurationError(
                    f"initial sigma {np.asarray(self.sigma).tolist()} must be positive throughout"
                )
            return np.tile(np.diag(self.sigma[first:]), (n_targets, 1, 1))
        given = np.asarray(self.covariance, dtype=float)
        if given.shape != (n_targets, 12, 12):
            raise ConfigurationError(
                f"initial covariance of shape {given.shape}: it must be {(n_targets, 12, 12)}"
            )
        out = np.empty((n_targets, 12 - first, 12 - first))
        for j, each in enumerate(given):
            scale = np.sqrt(np.abs(np.diag(each)))
            even = np.abs(each - each.T) <= 1e-9 * scale * scale[:, None]  # false for NaN
            try:
                np.linalg.cholesky(each)
                out[j] = np.linalg.cholesky(each[first:, first:])
            except np.linalg.LinAlgError:
                even[:] = False
            if not np.all(even):
                raise ConfigurationError(
                    f"initial covariance of target {j} is not symmetric and positive definite"
                )
        return out


def require_estimates(initial: InitialEstimate, surfaces: TargetSurfaces) -> None:
    """Raise a `ConfigurationError` if initial estimates are impossible or not one of each body."""
    targets, bodies = len(initial.checked().translation), len(surfaces.inertia)
    if targets != bodies:
        raise ConfigurationError(f"initial: estimates of {targets} targets, surfaces of {bodies}")


class Rotation(NamedTuple):
    """Estimated attitudes and angular velocities at a time.

    Attributes
    ----------
    quaternion : ndarray, shape (target, 4)
        Inertial frame to body frame.
    angular_velocity : ndarray, shape (target, 3)
        rad/s, body frame.
    root : ndarray, shape (target, 6, 6)
        Lower Cholesky factor of the covariance of attitude error (GRP) and angular velocity.
    """

    quaternion: Array
    angular_velocity: Array
    root: Array


class Prediction(NamedTuple):
    """Estimates propagated to the next measurement time.

    Attributes
    ----------
    index : int
        Index of that time in the scene.
    translation, covariance : ndarray, shapes (target, 6) and (target, 6, 6)
        Position and velocity, nondimensional, propagation frame; NaN for a failed estimate.
    quaternion : ndarray, shape (target, 4), or None
        Attitude, inertial frame to body frame, if the estimator has a joint Gaussian estimate.
    root : ndarray, shape (target, 12, 12), or None
        Lower Cholesky factor of the joint covariance of attitude error, angular velocity (rad/s),
        position and velocity.
    rotation : Rotation or None
        Attitude and angular velocity alone, if the estimator has a single estimate of them.
    """

    index: int
    translation: Array
    covariance: Array
    quaternion: Array | None = None
    root: Array | None = None
    rotation: Rotation | None = None


class OrbitEstimates(NamedTuple):
    """Orbits of all tracks at the time of the last processed step.

    Attributes
    ----------
    index : int
        Index of that time in the scene.
    translation, covariance : ndarray, shapes (target, 6) and (target, 6, 6)
        Position and velocity, nondimensional, propagation frame; NaN for a failed estimate.
    """

    index: int
    translation: Array
    covariance: Array


class Estimates(NamedTuple):
    """Estimates at the steps of an interval, after the updates.

    Attributes
    ----------
    quaternion : ndarray, shape (target, step, 4)
        Attitude, inertial frame to body frame.
    angular_velocity : ndarray, shape (target, step, 3)
        rad/s, body frame.
    translation : ndarray, shape (target, step, 6)
        Nondimensional, propagation frame.
    sigma : ndarray, shape (target, step, 12)
        Standard deviations of attitude error (GRP, rad for small angles), angular velocity (rad/s),
        position and velocity (nondimensional).
    covariance : ndarray, shape (target, step, 6, 6)
        Covariance of the translation; without steps if it was not requested.
    used : ndarray of bool, shape (row,)
        Whether each of the measurements was used.
    """

    quaternion: Array
    angular_velocity: Array
    translation: Array
    sigma: Array
    covariance: Array
    used: NDArray[np.bool_]


def empty_estimates(
    measurements: Measurements, covariance: bool, histories: bool = True
) -> Estimates:
    """Empty arrays for the estimates of an interval with these measurements."""
    n_targets, n_offsets = measurements.offset.shape
    steps = (n_targets, n_offsets - 1 if histories else 0)
    return Estimates(
        np.empty((*steps, 4)),
        np.empty((*steps, 3)),
        np.empty((*steps, 6)),
        np.empty((*steps, 12)),
        np.empty((n_targets, steps[1] if covariance else 0, 6, 6)),
        np.empty(measurements.observer.size, dtype=np.bool_),
    )


class Estimator(Protocol):
    """Converts measurements into estimates of all targets."""

    @property
    def failed(self) -> NDArray[np.uint8]:
        """Per target, 0 or the reason for which its estimate ended, such as NOT_FINITE."""
        ...

    @property
    def counters(self) -> NDArray[np.int64]:
        """Counts per target: updates, measurements outside the field of view, undetectable sigma
        points, Cholesky failures."""
        ...

    def predict(self) -> Prediction:
        """Estimates at the next measurement time; the estimator itself does not advance."""
        ...

    def orbits(self) -> OrbitEstimates:
        """Orbits at the time of the last processed step."""
        ...

    def advance(
        self,
        measurements: Measurements,
        *,
        covariance: bool = False,
        final: bool = True,
        histories: bool = True,
    ) -> Estimates:
        """Process the next steps, which are those of the measurements' offsets.

        The measurements include observations that detected nothing (NaN). `covariance` requests the
        covariance of the translation at every step. `final` states whether an interval ends with
        these steps. Without `histories` only `Estimates.used` is needed: the other arrays may have
        no steps, and the estimator may skip what does not affect the estimate at the end.
        """
        ...

    def correct(self, shift: Array, covariance: Array) -> NDArray[np.bool_]:
        """Change orbits at the time of the last processed step.

        Parameters
        ----------
        shift : ndarray, shape (target, 6)
            Added to position and velocity.
        covariance : ndarray, shape (target, 6, 6)
            Added to their covariance.

        Returns
        -------
        ndarray of bool, shape (target,)
            Which orbits have changed: not those of failed estimates, nor Gaussian mixtures, nor, if
            Gaussians are split, any without an update at that time.
        """
        ...

    def replace_orbits(self, targets: ArrayLike, translation: Array, covariance: Array) -> None:
        """Replace orbits at the time of the last processed step by those of another method.

        Parameters
        ----------
        targets : array_like of int, shape (n,)
            Targets whose estimates have not failed.
        translation, covariance : ndarray, shapes (n, 6) and (n, 6, 6)
            Nondimensional, propagation frame. Correlations with the rotation become zero.
        """
        ...

    def add(
        self,
        initial: InitialEstimate,
        surfaces: TargetSurfaces,
        rng: np.random.Generator | None = None,
        *,
        index: int | None = None,
        forces: tuple | None = None,
    ) -> None:
        """Add tracks at the end of the axis of targets.

        The new tracks are propagated from the time of their initial estimate to the time of the
        last processed step without measurements. The other tracks do not change.

        Parameters
        ----------
        initial : InitialEstimate
            Estimates of the new tracks.
        surfaces : TargetSurfaces
            Assumed shapes, materials and inertia of the new tracks.
        rng : numpy.random.Generator, optional
            Random numbers of the new tracks; if omitted, those of the estimator.
        index : int, optional
            Time of `initial`, an index of the scene; that of the last processed step if omitted.
        forces : NamedTuple, optional
            Force model of all tracks from now on, with the new tracks at the end. It is needed if
            the model has values for each target.

        Raises
        ------
        ConfigurationError
            If the estimate is not valid, its time is later than the last processed step, or the
            surfaces or the force model do not fit.
        """
        ...

    def remove(self, targets: ArrayLike) -> None:
        """Remove tracks; the others keep their order and state.

        Parameters
        ----------
        targets : array_like of int, shape (n,)
            Indices of the tracks that are removed.

        Raises
        ------
        ConfigurationError
            If there is no track of an index.
        """
        ...


class Abilities(NamedTuple):
    """What the estimators of a factory do besides `Estimator`.
    `estimated_parameters`: prior of body parameters, for which they have `learned` and `searches`.
    `chooses_models`: between models of the bodies (`characterizations`). `reports_status`: whether
    attitudes are unique (`attitude_status`). `tests_maneuvers`: of orbits (`tested_maneuvers`).
    `maneuvers_per_day`: expected of a target; if above zero, maneuvers are estimated after an alarm
    (`recovered_maneuvers`). `searches_field`: for targets outside of it (`command_search`)."""

    estimated_parameters: BodyParameterPrior = BodyParameterPrior()
    chooses_models: bool = False
    reports_status: bool = False
    tests_maneuvers: bool = False
    maneuvers_per_day: float = 0.0
    searches_field: bool = False


class EstimatorFactory(Protocol):
    """Makes an estimator for one realization.

    A factory whose estimators do more than `Estimator` has an attribute `abilities`.
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
        """Make an estimator with a random generator of its own, which deterministic estimators
        ignore."""
        ...


def abilities_of(factory: EstimatorFactory) -> Abilities:
    """The abilities of the estimators of a factory, which has none unless it states them."""
    return getattr(factory, "abilities", Abilities())
