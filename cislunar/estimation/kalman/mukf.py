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
- Body parameters may be estimated as further states, and the variance of the magnitude, see
  `cislunar.estimation.kalman.parameter_states`.
- An estimate ends when its mean position is inside the Earth or the Moon (unless Gaussians are
  split).
"""

from copy import copy

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.inertia import TORQUE, rigid_bodies
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.forces import of_targets, require_targets
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import (
    HEALTHY,
    N_COUNTERS,
    Abilities,
    Estimates,
    EstimatorFactory,
    InitialEstimate,
    OrbitEstimates,
    Prediction,
    Rotation,
    empty_estimates,
    require_estimates,
)
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.kalman.filtered_orbits import corrected_orbits, orbits_of, with_orbits
from cislunar.estimation.kalman.gaussian_mixture import GaussianMixture, no_mixture
from cislunar.estimation.kalman.mukf_kernels import SIZE, FilterState, advance, predict_all
from cislunar.estimation.kalman.workspace import filter_constants, with_new_tracks
from cislunar.estimation.track_arrays import (
    joined_tracks,
    remaining_tracks,
    selected_tracks,
    starting_index,
)
from cislunar.observation.body_parameters import HOUR, BodyParameterPrior
from cislunar.observation.records import Measurements, no_measurements
from cislunar.observation.scene import Scene, require_measurements
from cislunar.observation.sensor import Sensors
from cislunar.observation.target_surfaces import (
    TargetSurfaces,
    body_of,
    joined_surfaces,
    surfaces_of,
)
from cislunar.runtime import Array
from cislunar.runtime.threads import share_out


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
    extra_magnitude_noise : float
        Standard deviation, mag, that the filter adds in quadrature to that of the sensor, for
        errors of the brightness model.
    noise_memory : float, optional
        Number of magnitudes over which the filter averages their variance, which is then estimated
        for each target; above 1. If omitted, the variance is known.
    estimated_parameters : BodyParameterPrior, optional
        Prior of the body parameters that are estimated as further states; none if omitted.
    forces : NamedTuple
        Assumed force model, see `cislunar.dynamics.forces`.
    index : int
        Time of the initial estimate, an index of the scene.

    Raises
    ------
    ConfigurationError
        If the added noise or the memory is out of range, body parameters or a variance of
        magnitudes are to be estimated without magnitudes, single facets are to be estimated, or the
        light of a target does not depend on an estimated parameter.
    """

    divisible = True

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
        extra_magnitude_noise: float = 0.0,
        noise_memory: float | None = None,
        estimated_parameters: BodyParameterPrior | None = None,
        forces: tuple = EARTH_MOON,
        index: int = 0,
    ) -> None:
        self._scene = scene
        self._prior = estimated_parameters or BodyParameterPrior()
        if not use_magnitude and (self._prior or extra_magnitude_noise or noise_memory):
            raise ConfigurationError(
                "use_magnitude = False: angles determine neither body parameters nor the noise of "
                "the magnitude; leave out estimated_parameters, extra_magnitude_noise and "
                "noise_memory"
            )
        if self._prior.log_facets > 0.0:
            raise ConfigurationError(
                f"log_facets = {self._prior.log_facets}: the filter has no states for single "
                "facets; leave it at 0, or use the batch estimator"
            )
        rotation, surface = self._prior.rotation_kinds(), self._prior.surface_kinds(0)
        self._parameter_sigma = np.append(rotation[1], surface[1])
        given = scene, sensor, process_noise, forces, use_magnitude, splitting
        noise = extra_magnitude_noise, noise_memory
        self._constants = filter_constants(SIZE, *given, *noise, (rotation[0], surface[0]))
        self._begin(initial, surfaces, index)

    def _begin(self, initial: InitialEstimate, surfaces: TargetSurfaces, index: int) -> None:
        """Start the filter of these targets alone."""
        n_targets = initial.translation.shape[0]
        require_estimates(initial, surfaces)
        require_targets(self._constants.forces, n_targets)
        for j in range(n_targets if self._prior else 0):
            self._prior.require_possible(body_of(surfaces, j).materials)
        self._surfaces = surfaces
        self._bodies = rigid_bodies(surfaces.inertia)
        constant = self._parameter_sigma.size
        root = np.zeros((n_targets, constant + SIZE, constant + SIZE))
        root[:, :constant, :constant] = np.diag(self._parameter_sigma)
        root[:, constant:, constant:] = initial.roots()
        self._state = FilterState(
            np.array(initial.quaternion, dtype=float),
            np.array(initial.angular_velocity, dtype=float),
            np.array(initial.translation, dtype=float),
            root,
            np.zeros(n_targets, dtype=np.uint8),
            np.zeros((n_targets, N_COUNTERS), dtype=np.int64),
            np.zeros((n_targets, constant)),
            np.ones(n_targets),
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

    def learned(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the body-parameter deviations, (target, n) each, in the
        order and units of `BodyParameterPrior.named`; NaN for failed estimates."""
        size = self._parameter_sigma.size
        unit = np.ones(size)
        torque = np.flatnonzero(self._constants.rotation_kinds >= TORQUE)
        unit[torque] = np.rad2deg(1.0) * HOUR**2
        mean = unit * self._state.parameters
        sigma = unit * np.sqrt((self._state.root[:, :size, :size] ** 2).sum(axis=2))
        ended = self._state.failed != HEALTHY
        mean[ended], sigma[ended] = np.nan, np.nan
        return mean, sigma

    @property
    def searches(self) -> NDArray[np.int64]:
        """Per target, number of searches for modes so far: none."""
        return np.zeros(self._state.failed.size, dtype=np.int64)

    @property
    def noise_factor(self) -> Array:
        """Per target, estimated factor on the assumed variance of a magnitude; 1 if it is known."""
        return self._state.noise_factor.copy()

    def predict(self) -> Prediction:
        """See `Estimator.predict`."""
        ahead = FilterState(*(part.copy() for part in self._state))
        mixture = GaussianMixture(*(part.copy() for part in self._mixture))
        predict_all(self._index, self._scene, self._bodies, self._constants, ahead, mixture)
        lower = ahead.root[:, -6:]
        covariance = lower @ np.swapaxes(lower, 1, 2)
        root = _root_of_motion(ahead.root)
        rotation = Rotation(ahead.quaternion, ahead.omega, root[:, :6, :6])
        return Prediction(
            self._index + 1, ahead.translation, covariance, ahead.quaternion, root, rotation
        )

    def orbits(self) -> OrbitEstimates:
        """See `Estimator.orbits`."""
        return orbits_of(self._index, self._state, self._state.failed)

    def advance(
        self,
        measurements: Measurements,
        *,
        covariance: bool = False,
        final: bool = True,
        histories: bool = True,
    ) -> Estimates:
        """See `Estimator.advance`; the filter does the same at every step in all cases."""
        n_targets = len(self._state.failed)
        require_measurements(measurements, n_targets, self._index, self._scene)
        out = empty_estimates(measurements, covariance)
        model = (self._scene, self._surfaces, self._bodies, self._constants)
        given = (self._index + 1, *model, measurements, self._state, self._mixture, out)
        share_out(lambda start, stop: advance((start, stop), *given), n_targets)
        self._index += measurements.offset.shape[1] - 1
        return out

    def correct(self, shift: Array, covariance: Array) -> NDArray[np.bool_]:
        """See `Estimator.correct`."""
        given = self._mixture, self._state.failed, shift, covariance
        self._state, single = corrected_orbits(self._state, *given)
        return single

    def replace_orbits(self, targets: ArrayLike, translation: Array, covariance: Array) -> None:
        """See `Estimator.replace_orbits`."""
        given = self._mixture, targets, translation, covariance
        self._state = with_orbits(self._state, *given)

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


def _root_of_motion(root: Array) -> Array:
    """Lower Cholesky factors (target, 12, 12) of the motion from those of all states, without the
    body parameters that precede it."""
    if root.shape[1] == SIZE:
        return root
    upper = np.linalg.qr(np.swapaxes(root[:, -SIZE:], 1, 2), mode="r")
    sign = np.where(np.diagonal(upper, axis1=1, axis2=2) < 0.0, -1.0, 1.0)
    return np.swapaxes(sign[:, :, None] * upper, 1, 2)


def mukf(
    *,
    process_noise: ProcessNoise | None = None,
    use_magnitude: bool = True,
    splitting: bool = False,
    extra_magnitude_noise: float = 0.0,
    noise_memory: float | None = None,
    estimated_parameters: BodyParameterPrior | None = None,
) -> EstimatorFactory:
    """Factory of the paper's filter for the tasking loop; see `MultiplicativeUKF`."""
    given = {
        "process_noise": process_noise, "use_magnitude": use_magnitude, "splitting": splitting,
        "extra_magnitude_noise": extra_magnitude_noise, "noise_memory": noise_memory,
        "estimated_parameters": estimated_parameters,
    }  # fmt: skip

    def make(scene, surfaces, sensor, initial, rng, forces):
        del rng  # the filter draws nothing
        return MultiplicativeUKF(scene, surfaces, sensor, initial, forces=forces, **given)

    make.abilities = Abilities(estimated_parameters or BodyParameterPrior())
    return make
