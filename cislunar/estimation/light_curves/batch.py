"""Batch estimator: orbit by a filter on angles, attitude by least squares on light curves.

docs/attitude.md derives the method. The orbit filter is the translation part of the paper's filter.

Assumptions and limitations
---------------------------
- The attitude has no process noise and no torque except one that is constant in the body frame. A
  window with a fading memory discounts old data, which helps against slow deviations.
- Lines of sight are those of the translational estimate at the time of each measurement and are not
  improved afterwards.
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.inertia import TORQUE, RigidBodies, rigid_bodies
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.errors import ConfigurationError
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
from cislunar.estimation.kalman.translation_filter import SIZE
from cislunar.estimation.kalman.workspace import filter_constants
from cislunar.estimation.light_curves.batch_kernels import (
    BatchConstants,
    FitState,
    advance_target,
    predict_target,
)
from cislunar.estimation.light_curves.batch_settings import PRESETS, BatchSettings
from cislunar.estimation.light_curves.hypotheses import Hypotheses, mixture_points, prior_hypotheses
from cislunar.estimation.light_curves.light_curve import Anchor, LightCurveModel
from cislunar.estimation.light_curves.row_blocks import COLUMNS, ROTATION
from cislunar.observation.body_parameters import HOUR, BodyParameterPrior
from cislunar.observation.records import Measurements
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensor, Sensors, sensor_limits, sensors_of
from cislunar.observation.target_surfaces import TargetSurfaces, body_of
from cislunar.runtime.threads import share_out

Array = NDArray[np.float64]


class BatchEstimator:
    """Angles-only unscented filter for the orbit, multi-start least squares for the attitude.

    An `Estimator`. A target whose translation becomes not finite, loses definiteness or enters a
    primary is marked in `failed`, and its estimates are NaN from then on; nothing is raised.

    Parameters
    ----------
    scene, surfaces, sensor, initial, splitting, forces
        See `cislunar.estimation.kalman.mukf.MultiplicativeUKF`.
    rng : numpy.random.Generator
        Random starts; every target has a stream of its own.
    settings : BatchSettings, optional
        Multi-start with eight modes, if omitted.
    process_noise : ProcessNoise, optional
        Of the translation alone; none if omitted.

    Raises
    ------
    ConfigurationError
        If there is process noise on attitude or angular velocity, or the light of a target does not
        depend on an estimated parameter.
    """

    def __init__(
        self,
        scene: Scene,
        surfaces: TargetSurfaces,
        sensor: Sensors,
        initial: InitialEstimate,
        rng: np.random.Generator,
        *,
        settings: BatchSettings | None = None,
        process_noise: ProcessNoise | None = None,
        splitting: bool = False,
        forces: tuple = EARTH_MOON,
    ) -> None:
        initial.require_positive()
        if process_noise is not None and np.any(process_noise.components()[:6] > 0.0):
            raise ConfigurationError(
                "process_noise: attitude_deg and angular_velocity_deg_h must be 0 for the batch "
                "estimator, which takes the rotation as free of noise; set window_hours and "
                "memory_hours instead"
            )
        settings = BatchSettings() if settings is None else settings
        self._scene, self._estimated_parameters = scene, settings.estimated_parameters
        filtering = process_noise, forces, splitting
        first = sensors_of(sensor, scene.observer_position.shape[0])[0]
        self._constants = _batch_constants(settings, scene, sensor, *filtering)
        self._translation = np.array(initial.translation, dtype=float)
        n_targets = self._translation.shape[0]
        self._root = np.tile(np.diag(initial.sigma[6:]), (n_targets, 1, 1))
        self._mixture = no_mixture(n_targets, splitting)
        bodies = rigid_bodies(surfaces.inertia)
        self._models = [
            _light_curve_model(j, surfaces, bodies, first, initial, settings)
            for j in range(n_targets)
        ]
        self._hypotheses = [
            prior_hypotheses(settings.modes, model.sigma.size) for model in self._models
        ]
        self._rngs = rng.spawn(n_targets)
        self._points = [
            _prior_points(*each) for each in zip(self._hypotheses, self._models, strict=True)
        ]
        self._data = [np.empty((0, COLUMNS)) for _ in range(n_targets)]
        self._state = FitState(*np.zeros((4, n_targets), dtype=np.int64))
        self._state.points[:] = [_points_per_mode(model) for model in self._models]
        self._counters = np.zeros((n_targets, N_COUNTERS), dtype=np.int64)
        self._index = 0
        self._open = 0  # steps since the last tasking epoch

    @property
    def failed(self) -> NDArray[np.uint8]:
        """See `Estimator.failed`."""
        return self._state.condition.astype(np.uint8)

    @property
    def counters(self) -> NDArray[np.int64]:
        """See `Estimator.counters`."""
        return self._counters

    @property
    def estimated_parameters(self) -> BodyParameterPrior:
        """See `Estimator.estimated_parameters`."""
        return self._estimated_parameters

    def learned(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the body-parameter deviations from all rows used so far,
        (target, n) each, in the order and units of `BodyParameterPrior.named`; NaN for failed
        estimates."""
        size = max(model.sigma.size for model in self._models) - ROTATION
        mean, sigma = np.full((2, len(self._models), size), np.nan)
        for j, (modes, model) in enumerate(zip(self._hypotheses, self._models, strict=True)):
            if self._state.condition[j] != HEALTHY:
                continue
            live, unit = int(modes.count[0]), model.sigma[ROTATION:].copy()
            torque = model.rotation_kinds >= TORQUE
            unit[: torque.size][torque] = np.rad2deg(unit[: torque.size][torque]) * HOUR**2
            weight, u = modes.weight[:live][:, None], modes.u[:live, ROTATION:]
            root = np.linalg.inv(modes.root[:live])  # H = L L^T, so that H^-1 = L^-T L^-1
            variance = (root**2).sum(axis=1)[:, ROTATION:]
            center = (weight * u).sum(axis=0)
            spread = (weight * (variance + (u - center) ** 2)).sum(axis=0)
            mean[j, : unit.size], sigma[j, : unit.size] = unit * center, unit * np.sqrt(spread)
        return mean, sigma

    @property
    def searches(self) -> NDArray[np.int64]:
        """Per target, number of searches for modes so far."""
        return np.array([modes.count[1] for modes in self._hypotheses])

    @property
    def light_curve_rows(self) -> NDArray[np.int64]:
        """Per target, number of rows (measurements and non-detections) of its light curve that are
        kept."""
        return self._state.rows.copy()

    def light_curve(self, j: int) -> tuple[Array, LightCurveModel, Anchor]:
        """Rows of target j that are kept (n, COLUMNS), see
        `cislunar.estimation.light_curves.light_curve.cost`; the model that is fitted to them; and
        the information of the best mode from data no longer kept."""
        modes = self._hypotheses[j]
        anchor = Anchor(modes.anchor_mean[0], modes.anchor_information[0], modes.anchor_offset[0])
        return self._data[j][: self._state.rows[j]].copy(), self._models[j], anchor

    def predict(self) -> Prediction:
        """See `Estimator.predict`. The joint root is that of the mixture's second moments, without
        correlation between rotation and translation."""
        n_targets = self._translation.shape[0]
        translation, root = self._translation.copy(), self._root.copy()
        mixture = GaussianMixture(*(part.copy() for part in self._mixture))
        mean, joint = np.empty((n_targets, 4)), np.zeros((n_targets, 12, 12))
        rate = np.full((n_targets, 3), np.nan)
        for j in range(n_targets):
            if self._state.condition[j] != HEALTHY:
                translation[j] = np.nan
                continue
            points = tuple(part.copy() for part in self._points[j])
            predict_target(
                j,
                self._index,
                self._scene,
                self._constants,
                self._models[j],
                mixture,
                translation[j],
                root[j],
                points,
                self._state.points[j],
                mean[j],
                rate[j],
                joint[j],
            )
        covariance = root @ np.swapaxes(root, 1, 2)
        rotation = Rotation(mean, rate, joint[:, :6, :6])
        return Prediction(self._index + 1, translation, covariance, mean, joint, rotation)

    def orbits(self) -> OrbitEstimates:
        """See `Estimator.orbits`."""
        translation = self._translation.copy()
        translation[self._state.condition != HEALTHY] = np.nan
        covariance = self._root @ np.swapaxes(self._root, 1, 2)
        return OrbitEstimates(self._index, translation, covariance)

    def advance(
        self, measurements: Measurements, *, covariance: bool = False, final: bool = True
    ) -> Estimates:
        """See `Estimator.advance`. Light curves are fitted at the end of an interval."""
        out = empty_estimates(measurements, covariance)
        observations = measurements.offset[:, -1] - measurements.offset[:, 0]
        for j, count in enumerate(observations):
            self._make_room(j, int(count))

        def work(start: int, stop: int) -> None:
            for j in range(start, stop):
                advance_target(
                    j,
                    self._index + 1,
                    self._scene,
                    self._constants,
                    self._models[j],
                    measurements,
                    self._mixture,
                    self._translation,
                    self._root,
                    self._hypotheses[j],
                    self._points[j],
                    self._data[j],
                    self._state,
                    self._counters,
                    self._rngs[j],
                    out,
                    self._open if final else 0,
                )

        n_steps = measurements.offset.shape[1] - 1
        self._open += n_steps
        share_out(work, observations.size)
        self._index += n_steps
        if final:
            self._open = 0
        return out

    def _make_room(self, j: int, rows: int) -> None:
        """Enlarge the data array of a target; it doubles, so that copies are rare."""
        capacity, needed = self._data[j].shape[0], int(self._state.rows[j]) + rows
        if needed > capacity:
            grown = np.empty((max(needed, 2 * capacity), COLUMNS))
            grown[:capacity] = self._data[j]
            self._data[j] = grown


def _points_per_mode(model: LightCurveModel) -> int:
    """Two points for each parameter on which attitudes at other times depend."""
    return 2 * (ROTATION + model.rotation_kinds.size)


def _prior_points(hypotheses: Hypotheses, model: LightCurveModel) -> tuple[Array, ...]:
    """Attitude, rate, weight and rotation deviations of the mixture's points at the epoch, for all
    modes."""
    room = hypotheses.u.shape[0] * _points_per_mode(model)
    sizes = ((room, 4), (room, 3), (room,), (room, model.rotation_kinds.size))
    points = tuple(np.zeros(size) for size in sizes)
    mixture_points(hypotheses, model, *points)
    return points


def _batch_constants(
    settings: BatchSettings,
    scene: Scene,
    sensor: Sensors,
    process_noise: ProcessNoise | None,
    forces: tuple,
    splitting: bool,
) -> BatchConstants:
    window, memory = (
        np.inf if hours is None else 3600.0 * hours
        for hours in (settings.window_hours, settings.memory_hours)
    )
    return BatchConstants(
        filter_constants(SIZE, scene, sensor, process_noise, forces, False, splitting),
        sensor_limits(sensor, scene.observer_position.shape[0]),
        settings.search_settings(),
        float(settings.refit_growth),
        window,
        memory,
        settings.use_non_detections,
    )


def _light_curve_model(
    j: int,
    surfaces: TargetSurfaces,
    bodies: RigidBodies,
    sensor: Sensor,
    initial: InitialEstimate,
    settings: BatchSettings,
) -> LightCurveModel:
    body = body_of(surfaces, j)
    rotation_kinds, of_rotation = settings.estimated_parameters.rotation_kinds()
    kinds, of_surface = settings.estimated_parameters.surface_kinds(body.areas.size)
    settings.estimated_parameters.require_possible(body.materials)
    return LightCurveModel(
        np.array(initial.quaternion[j], dtype=float),
        np.array(initial.angular_velocity[j], dtype=float),
        np.concatenate([initial.sigma[:ROTATION], of_rotation, of_surface]),
        rotation_kinds,
        kinds,
        bodies.inertia[j],
        bodies.inverse[j],
        bool(bodies.spherical[j] and rotation_kinds.size == 0),
        body,
        bool(surfaces.irradiance_4pi),
        bool(surfaces.fresnel_sqrt),
        float((settings.magnitude_noise_factor * sensor.magnitude_noise) ** 2),
        float(settings.noise_freedom or 0.0),
    )


def batch(
    settings: BatchSettings | str = "default",
    *,
    process_noise: ProcessNoise | None = None,
    splitting: bool = False,
) -> EstimatorFactory:
    """Factory of the batch estimator for the tasking loop; see `BatchEstimator`. `settings` may be
    the name of one of the `PRESETS`."""
    if isinstance(settings, str):
        if settings not in PRESETS:
            raise ConfigurationError(
                f"batch preset {settings!r} is unknown: use one of {', '.join(PRESETS)}"
            )
        settings = PRESETS[settings]

    def make(scene, surfaces, sensor, initial, rng, forces):
        return BatchEstimator(
            scene,
            surfaces,
            sensor,
            initial,
            rng,
            settings=settings,
            process_noise=process_noise,
            splitting=splitting,
            forces=forces,
        )

    make.estimated_parameters = settings.estimated_parameters
    return make
