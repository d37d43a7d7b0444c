"""The error-state multiplicative UKF of Paul & Fan (section 2.4), over many targets.

Assumptions and limitations
---------------------------
- Targets are torque-free rigid bodies. For spherical inertia, as in the paper, the angular velocity
  is constant and the attitude follows in closed form; otherwise (`TargetSurfaces.inertia`) the
  attitude of every sigma point is integrated.
- The covariance's root is its lower Cholesky factor in the paper's order of the states. The paper
  does not specify the root; another root gives other, equally valid sigma points.
- The mean attitude error is injected after the prediction as well as after the update (a difference
  of third order in the standard deviations).
- An estimate ends when its mean position is inside the Earth or the Moon (unless Gaussians are
  split).
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.inertia import rigid_bodies
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.estimation.estimator import (
    HEALTHY,
    N_COUNTERS,
    Estimates,
    EstimatorFactory,
    InitialEstimate,
    OrbitEstimates,
    Prediction,
    Rotation,
    empty_estimates,
)
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.kalman.gaussian_mixture import GaussianMixture, no_mixture
from cislunar.estimation.kalman.mukf_kernels import SIZE, FilterState, advance, predict_all
from cislunar.estimation.kalman.workspace import filter_constants
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.records import Measurements
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors
from cislunar.observation.target_surfaces import TargetSurfaces
from cislunar.runtime.threads import share_out


class MultiplicativeUKF:
    """Error-state multiplicative unscented Kalman filter of many targets (Paul & Fan, eq. 21).

    An `Estimator`. A target whose estimate becomes not finite, loses definiteness or enters a
    primary is marked in `failed`, and its estimates are NaN from then on; nothing is raised.

    Parameters
    ----------
    scene : Scene
        Observers, Sun and frames; index 0 is the time of the initial estimate.
    surfaces : TargetSurfaces
        Assumed shapes, materials and inertia.
    sensor : Sensor or sequence of Sensor
        Noise and field of view.
    initial : InitialEstimate
    process_noise : ProcessNoise
        Standard deviations that accumulate in `PROCESS_NOISE_PERIOD_S`; none by default.
    use_magnitude : bool
        Whether the update uses the magnitude as well as the angles.
    splitting : bool
        Whether an orbit estimate becomes a Gaussian mixture where it is nonlinear, see
        `cislunar.estimation.kalman.gaussian_mixture`.
    forces : NamedTuple
        Assumed force model, see `cislunar.dynamics.forces`.
    """

    def __init__(
        self,
        scene: Scene,
        surfaces: TargetSurfaces,
        sensor: Sensors,
        initial: InitialEstimate,
        *,
        process_noise: ProcessNoise | None = None,
        use_magnitude: bool = True,
        splitting: bool = False,
        forces: tuple = EARTH_MOON,
    ) -> None:
        initial.require_positive()
        n_targets = initial.translation.shape[0]
        self._scene = scene
        self._surfaces = surfaces
        self._bodies = rigid_bodies(surfaces.inertia)
        given = scene, sensor, process_noise, forces, use_magnitude, splitting
        self._constants = filter_constants(SIZE, *given)
        self._state = FilterState(
            np.array(initial.quaternion, dtype=float),
            np.array(initial.angular_velocity, dtype=float),
            np.array(initial.translation, dtype=float),
            np.tile(np.diag(initial.sigma), (n_targets, 1, 1)),
            np.zeros(n_targets, dtype=np.uint8),
            np.zeros((n_targets, N_COUNTERS), dtype=np.int64),
        )
        self._mixture = no_mixture(n_targets, splitting)
        self._index = 0

    @property
    def failed(self) -> NDArray[np.uint8]:
        """See `Estimator.failed`."""
        return self._state.failed

    @property
    def counters(self) -> NDArray[np.int64]:
        """See `Estimator.counters`."""
        return self._state.counters

    @property
    def estimated_parameters(self) -> BodyParameterPrior:
        """No body parameters."""
        return BodyParameterPrior()

    def predict(self) -> Prediction:
        """See `Estimator.predict`."""
        ahead = FilterState(*(part.copy() for part in self._state))
        mixture = GaussianMixture(*(part.copy() for part in self._mixture))
        predict_all(self._index, self._scene, self._bodies, self._constants, ahead, mixture)
        lower = ahead.root[:, 6:]
        covariance = lower @ np.swapaxes(lower, 1, 2)
        rotation = Rotation(ahead.quaternion, ahead.omega, ahead.root[:, :6, :6])
        return Prediction(
            self._index + 1, ahead.translation, covariance, ahead.quaternion, ahead.root, rotation
        )

    def orbits(self) -> OrbitEstimates:
        """See `Estimator.orbits`."""
        lower, translation = self._state.root[:, 6:], self._state.translation.copy()
        translation[self._state.failed != HEALTHY] = np.nan
        return OrbitEstimates(self._index, translation, lower @ np.swapaxes(lower, 1, 2))

    def advance(
        self, measurements: Measurements, *, covariance: bool = False, final: bool = True
    ) -> Estimates:
        """See `Estimator.advance`; the filter does the same at every step, `final` or not."""
        out = empty_estimates(measurements, covariance)
        model = (self._scene, self._surfaces, self._bodies, self._constants)
        given = (self._index + 1, *model, measurements, self._state, self._mixture, out)
        share_out(lambda start, stop: advance((start, stop), *given), len(self._state.failed))
        self._index += measurements.offset.shape[1] - 1
        return out


def mukf(
    *,
    process_noise: ProcessNoise | None = None,
    use_magnitude: bool = True,
    splitting: bool = False,
) -> EstimatorFactory:
    """Factory of the paper's filter for the tasking loop; see `MultiplicativeUKF`."""

    def make(scene, surfaces, sensor, initial, rng, forces):
        del rng  # the filter draws nothing
        return MultiplicativeUKF(
            scene,
            surfaces,
            sensor,
            initial,
            process_noise=process_noise,
            use_magnitude=use_magnitude,
            splitting=splitting,
            forces=forces,
        )

    return make
