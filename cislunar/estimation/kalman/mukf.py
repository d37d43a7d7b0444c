"""The error-state multiplicative UKF of Paul & Fan (section 2.4), over many targets.

Assumptions and limitations
---------------------------
- Targets are torque-free rigid bodies. For spherical inertia, as in the paper, the angular velocity
  is constant and the attitude follows in closed form; any other (`TargetSurfaces.inertia`) is
  integrated for every sigma point.
- The covariance's root is its lower Cholesky factor in the paper's order of the states; the paper
  does not say which root it takes, and another gives other, equally valid sigma points.
- The mean attitude error is injected after the prediction, not only after the update (a difference
  of third order in the spread).
- An estimate ends when its mean position lies inside the Earth or the Moon.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import Estimates, EstimatorFactory, InitialEstimate, Prediction
from cislunar.estimation.kalman.attitude_spread import rigid_bodies
from cislunar.estimation.kalman.mukf_kernels import (
    CHOLESKY_FAILURES,
    HEALTHY,
    LOST_DEFINITENESS,
    N_COUNTERS,
    SIZE,
    WEIGHTS,
    FilterConstants,
    make_workspace,
    predict,
    update,
)
from cislunar.observation.measurement import Sensor
from cislunar.observation.scene import Scene, TargetSurfaces

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Spread:
    """Standard deviations of the four parts of a state, the same on each axis.

    Attributes
    ----------
    attitude_deg, angular_velocity_deg_h, position_km, velocity_m_s : float
        Not negative.

    Raises
    ------
    ConfigurationError
        If one is negative or not finite.
    """

    attitude_deg: float = 0.0
    angular_velocity_deg_h: float = 0.0
    position_km: float = 0.0
    velocity_m_s: float = 0.0

    def __post_init__(self) -> None:
        for key, value in vars(self).items():
            if not (value >= 0.0 and np.isfinite(value)):
                raise ConfigurationError(f"{key} = {value} must be finite and not negative")

    def components(self) -> Array:
        """Shape (12,): attitude error (GRP), angular velocity (rad/s), position and velocity."""
        values = (
            np.deg2rad(self.attitude_deg),
            np.deg2rad(self.angular_velocity_deg_h) / 3600.0,
            self.position_km / LENGTH_UNIT_KM,
            1e-3 * self.velocity_m_s * TIME_UNIT_S / LENGTH_UNIT_KM,
        )
        return np.repeat(values, 3)


INITIAL_SPREAD = Spread(
    attitude_deg=5.0,
    angular_velocity_deg_h=2.4,
    position_km=100.0 * np.sqrt(0.1),
    velocity_m_s=0.1 * np.sqrt(0.1),
)
"""Uncertainty of the targets at the epoch (Paul & Fan, table 3)."""

PROCESS_NOISE_PERIOD_S = 60.0
"""A `Spread` given as process noise is what accumulates over this time, s."""


@njit(cache=True, error_model="numpy")
def _advance(
    first,
    scene,
    surfaces,
    bodies,
    constants,
    observer_of,
    measurements,
    quaternion,
    omega,
    translation,
    root,
    failed,
    counters,
    out_quaternion,
    out_omega,
    out_translation,
    out_sigma,
    used,
):
    """Filter all targets over an interval, target by target (compiled)."""
    work = make_workspace(3 if constants.use_magnitude else 2)
    for j in range(measurements.shape[0]):
        for i in range(measurements.shape[1]):
            k = first + i
            if failed[j] == HEALTHY:
                failed[j] = predict(
                    quaternion[j],
                    omega[j],
                    translation[j],
                    root[j],
                    bodies,
                    j,
                    (k - 1) * scene.step,
                    scene.step_s,
                    scene.step,
                    constants,
                    work,
                )
                if failed[j] == LOST_DEFINITENESS:
                    counters[j, CHOLESKY_FAILURES] += 1
            if failed[j] != HEALTHY:
                out_quaternion[j, i, :] = np.nan
                out_omega[j, i, :] = np.nan
                out_translation[j, i, :] = np.nan
                out_sigma[j, i, :] = np.nan
                used[j, i] = False
                continue
            used[j, i] = observer_of[j] >= 0 and update(
                quaternion[j],
                omega[j],
                translation[j],
                root[j],
                measurements[j, i],
                observer_of[j],
                k,
                j,
                scene,
                surfaces,
                constants,
                work,
                counters[j],
            )
            out_quaternion[j, i, :] = quaternion[j]
            out_omega[j, i, :] = omega[j]
            out_translation[j, i, :] = translation[j]
            for c in range(SIZE):
                total = 0.0
                for d in range(c + 1):
                    total += root[j, c, d] * root[j, c, d]
                out_sigma[j, i, c] = np.sqrt(total)


@njit(cache=True, error_model="numpy")
def _predict_all(t, scene, bodies, constants, quaternion, omega, translation, root, failed):
    """One step of all healthy targets from time t (compiled)."""
    work = make_workspace(3)
    for j in range(failed.shape[0]):
        if failed[j] == HEALTHY:
            failed[j] = predict(
                quaternion[j],
                omega[j],
                translation[j],
                root[j],
                bodies,
                j,
                t,
                scene.step_s,
                scene.step,
                constants,
                work,
            )
        if failed[j] != HEALTHY:
            translation[j, :] = np.nan


class MultiplicativeUKF:
    """Error-state multiplicative unscented Kalman filter of many targets (Paul & Fan, eq. 21).

    An `Estimator`. A target whose estimate becomes not finite, loses definiteness or runs into a
    primary is marked in `failed` and returns NaN from then on; nothing is raised.

    Parameters
    ----------
    scene : Scene
        Observers, Sun and frames; index 0 is the epoch of the initial estimate.
    surfaces : TargetSurfaces
        Shapes, materials and inertia.
    sensor : Sensor
        Noise and field of view.
    initial : InitialEstimate
        Estimates at the epoch.
    process_noise : Spread
        Standard deviations that accumulate in `PROCESS_NOISE_PERIOD_S`; none by default.
    use_magnitude : bool
        False filters on the angles alone.
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.

    Raises
    ------
    ConfigurationError
        If an initial standard deviation is not positive, or an inertia impossible.
    """

    def __init__(
        self,
        scene: Scene,
        surfaces: TargetSurfaces,
        sensor: Sensor,
        initial: InitialEstimate,
        *,
        process_noise: Spread | None = None,
        use_magnitude: bool = True,
        forces: tuple = EARTH_MOON,
    ) -> None:
        if not np.all(initial.sigma > 0.0):
            raise ConfigurationError(f"initial sigma {initial.sigma} must be positive throughout")
        process = (Spread() if process_noise is None else process_noise).components()
        self._scene = scene
        self._surfaces = surfaces
        self._bodies = rigid_bodies(surfaces.inertia)
        self._quaternion = np.array(initial.quaternion, dtype=float)
        self._omega = np.array(initial.angular_velocity, dtype=float)
        self._translation = np.array(initial.translation, dtype=float)
        n_targets = self._translation.shape[0]
        self._root = np.tile(np.diag(initial.sigma), (n_targets, 1, 1))
        self._failed = np.zeros(n_targets, dtype=np.uint8)
        self._counters = np.zeros((n_targets, N_COUNTERS), dtype=np.int64)
        self._index = 0
        limits = sensor.limits()
        self._constants = FilterConstants(
            forces,
            process**2 * (scene.step_s / PROCESS_NOISE_PERIOD_S),
            limits.noise_variance,
            limits.half_field,
            bool(use_magnitude),
            WEIGHTS,
        )

    @property
    def failed(self) -> NDArray[np.uint8]:
        """Per target, 0 or why its estimate came to an end."""
        return self._failed

    @property
    def counters(self) -> NDArray[np.int64]:
        """Counts per target: updates, out of field, dark sigma points, Cholesky failures."""
        return self._counters

    @property
    def constants(self) -> FilterConstants:
        """Settings in the layout of the compiled kernels."""
        return self._constants

    def predict(self) -> Prediction:
        """Estimates at the next measurement time; the filter itself does not move on."""
        quaternion, omega = self._quaternion.copy(), self._omega.copy()
        translation, root = self._translation.copy(), self._root.copy()
        failed = self._failed.copy()
        world = (self._index * self._scene.step, self._scene, self._bodies, self._constants)
        _predict_all(*world, quaternion, omega, translation, root, failed)
        covariance = root[:, 6:] @ np.swapaxes(root[:, 6:], 1, 2)
        return Prediction(self._index + 1, translation, covariance, quaternion, root)

    def advance(self, measurements: Array, observer_of: NDArray[np.int64]) -> Estimates:
        """Work through the next steps; see `Estimator.advance`."""
        n_targets, n_steps = measurements.shape[:2]
        out = Estimates(
            np.empty((n_targets, n_steps, 4)),
            np.empty((n_targets, n_steps, 3)),
            np.empty((n_targets, n_steps, 6)),
            np.empty((n_targets, n_steps, SIZE)),
            np.empty((n_targets, n_steps), dtype=np.bool_),
        )
        _advance(
            self._index + 1,
            self._scene,
            self._surfaces,
            self._bodies,
            self._constants,
            np.asarray(observer_of, dtype=np.int64),
            np.ascontiguousarray(measurements),
            self._quaternion,
            self._omega,
            self._translation,
            self._root,
            self._failed,
            self._counters,
            *out,
        )
        self._index += n_steps
        return out


def mukf(*, process_noise: Spread | None = None, use_magnitude: bool = True) -> EstimatorFactory:
    """Factory of the paper's filter for the tasking loop.

    Parameters
    ----------
    process_noise, use_magnitude
        As in `MultiplicativeUKF`.

    Returns
    -------
    EstimatorFactory
    """

    def make(scene, surfaces, sensor, initial, rng, forces):
        del rng  # the filter draws nothing
        return MultiplicativeUKF(
            scene,
            surfaces,
            sensor,
            initial,
            process_noise=process_noise,
            use_magnitude=use_magnitude,
            forces=forces,
        )

    return make
