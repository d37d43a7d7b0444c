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

from copy import copy

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.inertia import rigid_bodies
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.forces import of_targets, require_targets
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
from cislunar.estimation.kalman.workspace import filter_constants, with_new_tracks
from cislunar.estimation.track_arrays import (
    joined_tracks,
    remaining_tracks,
    selected_tracks,
    starting_index,
    widened_roots,
)
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.records import Measurements, no_measurements
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors
from cislunar.observation.target_surfaces import TargetSurfaces, joined_surfaces, surfaces_of
from cislunar.runtime.threads import share_out

Array = NDArray[np.float64]


class MultiplicativeUKF:
    """Error-state multiplicative unscented Kalman filter of many targets (Paul & Fan, eq. 21).

    An `Estimator`. A target whose estimate becomes not finite, loses definiteness or enters a
    primary is marked in `failed`, and its estimates are NaN from then on; nothing is raised.

    Parameters
    ----------
    scene : Scene
        Observers, Sun and frames.
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
    index : int
        Time of the initial estimate, an index of the scene.
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
        index: int = 0,
    ) -> None:
        self._scene = scene
        given = scene, sensor, process_noise, forces, use_magnitude, splitting
        self._constants = filter_constants(SIZE, *given)
        self._begin(initial, surfaces, index)

    def _begin(self, initial: InitialEstimate, surfaces: TargetSurfaces, index: int) -> None:
        """Start the filter of these targets alone."""
        n_targets = initial.translation.shape[0]
        require_targets(self._constants.forces, n_targets)
        self._surfaces = surfaces
        self._bodies = rigid_bodies(surfaces.inertia)
        self._state = FilterState(
            np.array(initial.quaternion, dtype=float),
            np.array(initial.angular_velocity, dtype=float),
            np.array(initial.translation, dtype=float),
            initial.roots(),
            np.zeros(n_targets, dtype=np.uint8),
            np.zeros((n_targets, N_COUNTERS), dtype=np.int64),
        )
        self._mixture = no_mixture(n_targets, self._constants.curvature < np.inf)
        self._index = index

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

    def correct(self, shift: Array, covariance: Array) -> NDArray[np.bool_]:
        """See `Estimator.correct`."""
        # a gap keeps the Gaussian of its begin for a later split
        single = (self._state.failed == HEALTHY) & (self._mixture.count == 0)
        single &= self._mixture.since < 0
        root = widened_roots(self._state.root, covariance, single)
        translation = self._state.translation + np.where(single[:, None], shift, 0.0)
        self._state = self._state._replace(root=root, translation=translation)
        return single

    def add(
        self,
        initial: InitialEstimate,
        surfaces: TargetSurfaces,
        rng: np.random.Generator | None = None,
        *,
        index: int | None = None,
        forces: tuple | None = None,
    ) -> None:
        """See `Estimator.add`; the filter draws no random numbers."""
        start, n_new = starting_index(index, self._index), initial.translation.shape[0]
        counts = self._state.failed.size, n_new
        together = joined_surfaces([self._surfaces, surfaces])
        new = copy(self)
        constants, new._constants = with_new_tracks(self._constants, forces, *counts)
        new._begin(initial, surfaces, start)
        new.advance(no_measurements(n_new, self._index - start))
        self._constants, self._surfaces = constants, together
        self._bodies = joined_tracks(self._bodies, new._bodies)
        self._state = joined_tracks(self._state, new._state)
        self._mixture = joined_tracks(self._mixture, new._mixture)

    def remove(self, targets: ArrayLike) -> None:
        """See `Estimator.remove`."""
        left = remaining_tracks(self._state.failed.size, targets)
        forces = of_targets(self._constants.forces, left)
        self._constants = self._constants._replace(forces=forces)
        self._surfaces = surfaces_of(self._surfaces, left)
        self._bodies = selected_tracks(self._bodies, left)
        self._state = selected_tracks(self._state, left)
        self._mixture = selected_tracks(self._mixture, left)


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
