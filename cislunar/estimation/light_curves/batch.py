"""Batch estimator: orbit by a filter on angles, attitude by least squares on light curves.

docs/attitude.md derives the method. The orbit filter is the translation part of the paper's filter.

Assumptions and limitations
---------------------------
- The attitude has no process noise and no torque except one that is constant in the body frame. A
  window with a fading memory discounts old data, which helps against slow deviations.
- Lines of sight are those of the translational estimate at the time of each measurement and are not
  improved afterwards.
"""

from collections.abc import Sequence
from copy import copy, deepcopy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.inertia import TORQUE
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.forces import of_targets, require_targets
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import (
    HEALTHY,
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
from cislunar.estimation.kalman.gaussian_mixture import GaussianMixture
from cislunar.estimation.kalman.translation_filter import SIZE
from cislunar.estimation.kalman.workspace import filter_constants, with_new_tracks
from cislunar.estimation.light_curves.batch_kernels import (
    BatchConstants,
    advance_target,
    predict_target,
)
from cislunar.estimation.light_curves.batch_settings import PRESETS, BatchSettings
from cislunar.estimation.light_curves.batch_tracks import starting_tracks
from cislunar.estimation.light_curves.light_curve import Anchor, LightCurveModel
from cislunar.estimation.light_curves.model_selection.characterization import (
    Characterization,
    characterize,
)
from cislunar.estimation.light_curves.model_selection.in_loop import (
    parameter_deviations,
    report_points,
    reported_points,
    status_of,
    updated_selection,
)
from cislunar.estimation.light_curves.row_blocks import ROTATION
from cislunar.estimation.track_arrays import (
    joined_tracks,
    remaining_tracks,
    selected_tracks,
    starting_index,
)
from cislunar.observation.body_parameters import HOUR
from cislunar.observation.records import Measurements, no_measurements
from cislunar.observation.scene import Scene, require_measurements
from cislunar.observation.sensor import Sensors, sensor_limits, sensors_of
from cislunar.observation.target_surfaces import TargetSurfaces
from cislunar.runtime import Array
from cislunar.runtime.arguments import require_choice
from cislunar.runtime.threads import share_out


class BatchEstimator:
    """Angles-only unscented filter for the orbit, multi-start least squares for the attitude.

    An `Estimator`. A target whose translation becomes not finite, loses definiteness or enters a
    primary is marked in `failed`, and its estimates are NaN from then on; nothing is raised.

    Parameters
    ----------
    scene, surfaces, sensor, initial, splitting, forces, index
        See `cislunar.estimation.kalman.mukf.MultiplicativeUKF`. If the initial estimate has a
        covariance, the orbit filter uses that of position and velocity, and the prior of the
        rotation the standard deviations alone. All correlations with and within the rotation are
        neglected.
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
        index: int = 0,
    ) -> None:
        if process_noise is not None and np.any(process_noise.components()[:6] > 0.0):
            raise ConfigurationError(
                "process_noise: attitude_deg and angular_velocity_deg_h must be 0 for the batch "
                "estimator, which takes the rotation as free of noise; set window_hours and "
                "memory_hours instead"
            )
        self._settings = BatchSettings() if settings is None else settings
        self._scene, self._rng = scene, rng
        self._first_sensor = sensors_of(sensor, scene.observer_position.shape[0])[0]
        filtering = process_noise, forces, splitting
        self._constants = _batch_constants(self._settings, scene, sensor, *filtering)
        self._begin(initial, surfaces, rng, index)
        self._open = 0  # steps since the last tasking epoch

    def _begin(
        self,
        initial: InitialEstimate,
        surfaces: TargetSurfaces,
        rng: np.random.Generator,
        index: int,
    ) -> None:
        """Start the estimation of these targets alone."""
        require_estimates(initial, surfaces)
        require_targets(self._constants.translation.forces, initial.translation.shape[0])
        splitting = self._constants.translation.curvature < np.inf
        given = self._first_sensor, self._settings, splitting
        self._tracks = starting_tracks(initial, surfaces, rng, index, *given)
        self._index = index

    def __deepcopy__(self, memo: dict[int, Any]) -> "BatchEstimator":
        """An estimator with tracks of its own; it shares the constants, and the models of light
        curves, since nothing changes them."""
        new = copy(self)
        memo |= {id(model): model for model in self._tracks.models}
        new._rng, new._tracks = deepcopy(self._rng, memo), deepcopy(self._tracks, memo)
        return new

    @property
    def failed(self) -> NDArray[np.uint8]:
        """See `Estimator.failed`."""
        return self._tracks.fit.condition.astype(np.uint8)

    @property
    def counters(self) -> NDArray[np.int64]:
        """See `Estimator.counters`."""
        return self._tracks.counters

    def learned(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the body-parameter deviations from all rows used so far,
        (target, n) each, in the order and units of `BodyParameterPrior.named`; NaN for failed
        estimates. They are those of the models of the body if there is a choice between them."""
        tracks = self._tracks
        size = max(model.sigma.size for model in tracks.models) - ROTATION
        mean, sigma = np.full((2, len(tracks.models), size), np.nan)
        for j, (modes, model) in enumerate(zip(tracks.hypotheses, tracks.models, strict=True)):
            if tracks.fit.condition[j] != HEALTHY:
                continue
            live, unit = int(modes.count[0]), model.sigma[ROTATION:].copy()
            torque = model.rotation_kinds >= TORQUE
            unit[: torque.size][torque] = np.rad2deg(unit[: torque.size][torque]) * HOUR**2
            chosen = tracks.selections[j]
            if chosen is None:
                weight, u = modes.weight[:live], modes.u[:live, ROTATION:]
                root = np.linalg.inv(modes.root[:live])  # H = L L^T, so that H^-1 = L^-T L^-1
                variance = (root**2).sum(axis=1)[:, ROTATION:]
            else:
                weight, u, variance = parameter_deviations(chosen.selected, model)
            center = weight @ u
            spread = weight @ (variance + (u - center) ** 2)
            mean[j, : unit.size], sigma[j, : unit.size] = unit * center, unit * np.sqrt(spread)
        return mean, sigma

    @property
    def searches(self) -> NDArray[np.int64]:
        """Per target, number of searches for modes of the estimator's own model so far."""
        return np.array([modes.count[1] for modes in self._tracks.hypotheses])

    @property
    def attitude_status(self) -> NDArray[np.int64]:
        """Per target, status of the attitude, see
        `cislunar.estimation.light_curves.model_selection.characterization`."""
        tracks = self._tracks
        given = tracks.selections, tracks.hypotheses, tracks.points, tracks.fit.points.tolist()
        return np.array([status_of(*each) for each in zip(*given, strict=True)], dtype=np.int64)

    def characterizations(
        self, rngs: Sequence[np.random.Generator]
    ) -> list[Characterization | None]:
        """Per target, what its light curve tells of it; None for failed estimates and without a
        light curve. `rngs` has a generator for each target."""
        healthy = self._tracks.fit.condition == HEALTHY
        return [
            characterize(each.selected, *self.light_curve(j)[:2], rngs[j])
            if healthy[j] and each is not None
            else None
            for j, each in enumerate(self._tracks.selections)
        ]

    def light_curve(self, j: int) -> tuple[Array, LightCurveModel, Anchor]:
        """Rows of target j that are kept (n, ROW_COLUMNS), see
        `cislunar.estimation.light_curves.light_curve.cost`, with times since its initial estimate;
        the model that is fitted to them; and the information of the best mode from data no longer
        kept."""
        tracks = self._tracks
        modes = tracks.hypotheses[j]
        anchor = Anchor(modes.anchor_mean[0], modes.anchor_information[0], modes.anchor_offset[0])
        return tracks.data[j][: tracks.fit.rows[j]].copy(), tracks.models[j], anchor

    def predict(self) -> Prediction:
        """See `Estimator.predict`. The joint root is that of the mixture's second moments, without
        correlation between rotation and translation."""
        tracks = self._tracks
        n_targets = tracks.translation.shape[0]
        translation, root = tracks.translation.copy(), tracks.root.copy()
        mixture = GaussianMixture(*(part.copy() for part in tracks.mixture))
        mean, joint = np.empty((n_targets, 4)), np.zeros((n_targets, 12, 12))
        rate = np.full((n_targets, 3), np.nan)
        for j in range(n_targets):
            if tracks.fit.condition[j] != HEALTHY:
                translation[j] = np.nan
                continue
            points = tuple(part.copy() for part in tracks.points[j])
            predict_target(
                j, self._index, self._scene, self._constants, tracks.models[j], mixture,
                translation[j], root[j], points, tracks.fit.points[j], mean[j], rate[j], joint[j],
            )  # fmt: skip
        covariance = root @ np.swapaxes(root, 1, 2)
        rotation = Rotation(mean, rate, joint[:, :6, :6])
        return Prediction(self._index + 1, translation, covariance, mean, joint, rotation)

    def orbits(self) -> OrbitEstimates:
        """See `Estimator.orbits`."""
        return orbits_of(self._index, self._tracks, self._tracks.fit.condition)

    def advance(
        self,
        measurements: Measurements,
        *,
        covariance: bool = False,
        final: bool = True,
        histories: bool = True,
    ) -> Estimates:
        """See `Estimator.advance`. Light curves are fitted at the end of an interval, and, with
        `histories`, within it when they have grown."""
        tracks = self._tracks
        require_measurements(measurements, len(tracks.models), self._index, self._scene)
        out = empty_estimates(measurements, covariance, histories)
        observations = measurements.offset[:, -1] - measurements.offset[:, 0]
        for j, count in enumerate(observations):
            tracks.make_room(j, int(count))

        def work(start: int, stop: int) -> None:
            for j in range(start, stop):
                own = (
                    tracks.translation[j], tracks.root[j], tracks.counters[j],
                    tracks.hypotheses[j], tracks.points[j], tracks.data[j], tracks.rngs[j],
                )  # fmt: skip
                advance_target(
                    j, self._index + 1, self._scene, self._constants, tracks.models[j],
                    measurements, tracks.mixture, own, tracks.fit, out, self._open if final else 0,
                )  # fmt: skip

        n_steps = measurements.offset.shape[1] - 1
        self._open += n_steps
        share_out(work, observations.size)
        self._index += n_steps
        if final:
            self._open = 0
            if self._settings.model_selection.effort > 0:
                self._select_models(out)
        return out

    def correct(self, shift: Array, covariance: Array) -> NDArray[np.bool_]:
        """See `Estimator.correct`."""
        given = self._tracks.mixture, self._tracks.fit.condition, shift, covariance
        self._tracks, single = corrected_orbits(self._tracks, *given)
        return single

    def replace_orbits(self, targets: ArrayLike, translation: Array, covariance: Array) -> None:
        """See `Estimator.replace_orbits`."""
        given = self._tracks.mixture, targets, translation, covariance
        self._tracks = with_orbits(self._tracks, *given)

    def _select_models(self, out: Estimates) -> None:
        """Choose models of the bodies for the light curves at a tasking epoch, and report their
        mixtures from there on. The sigma and attitude of the last step are replaced. While the wide
        models of a body are among those chosen from, the estimator's own is not fitted."""
        tracks, settings = self._tracks, self._settings.model_selection
        for j, model in enumerate(tracks.models):
            rows = int(tracks.fit.rows[j])
            if tracks.fit.condition[j] != HEALTHY or rows == 0:
                continue
            rng = tracks.rngs[j].spawn(1)[0]
            data = tracks.data[j][:rows].copy()
            modes = tracks.hypotheses[j]
            fitted = 0 if tracks.fit.replaced[j] else modes.count[0]
            known = [u.copy() for u in modes.u[:fitted]]
            given = tracks.selections[j], data, model, rng, settings
            selection = updated_selection(*given, known)
            elapsed = (self._index - int(tracks.fit.epoch[j])) * self._scene.step_s
            room = tracks.points[j][2].size
            points, count = reported_points(selection, model, elapsed, room)
            tracks.selections[j], tracks.points[j] = selection, points
            tracks.fit.points[j], tracks.fit.replaced[j] = count, selection.selected.wide
            if out.sigma.shape[1] > 0:
                mean, rate = out.quaternion[j, -1], out.angular_velocity[j, -1]
                report_points(points, count, mean, rate, out.sigma[j, -1, :ROTATION])

    def add(
        self,
        initial: InitialEstimate,
        surfaces: TargetSurfaces,
        rng: np.random.Generator | None = None,
        *,
        index: int | None = None,
        forces: tuple | None = None,
    ) -> None:
        """See `Estimator.add`."""
        start, n_new = starting_index(index, self._index), initial.translation.shape[0]
        given = self._constants.translation, forces, len(self._tracks.models), n_new
        common, own = with_new_tracks(*given)
        new = copy(self)
        new._constants = self._constants._replace(translation=own)
        new._begin(initial, surfaces, self._rng if rng is None else rng, start)
        new.advance(no_measurements(n_new, self._index - start), final=False)
        self._constants = self._constants._replace(translation=common)
        self._tracks = joined_tracks(self._tracks, new._tracks)

    def remove(self, targets: ArrayLike) -> None:
        """See `Estimator.remove`."""
        left = remaining_tracks(len(self._tracks.models), targets)
        filtering = self._constants.translation
        filtering = filtering._replace(forces=of_targets(filtering.forces, left))
        self._constants = self._constants._replace(translation=filtering)
        self._tracks = selected_tracks(self._tracks, left)


def _batch_constants(settings, scene, sensor, process_noise, forces, splitting) -> BatchConstants:
    window, memory = (
        np.inf if hours is None else 3600.0 * hours
        for hours in (settings.window_hours, settings.memory_hours)
    )
    return BatchConstants(
        filter_constants(SIZE, scene, sensor, process_noise, forces, False, splitting),
        sensor_limits(sensor, scene.observer_position.shape[0]),
        settings.search_settings(),
        0.0 if settings.model_selection.effort else float(settings.refit_growth),
        window,
        memory,
        settings.use_non_detections,
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
        require_choice("settings", settings, PRESETS)
        settings = PRESETS[settings]
    given = {"settings": settings, "process_noise": process_noise, "splitting": splitting}

    def make(scene, surfaces, sensor, initial, rng, forces):
        return BatchEstimator(scene, surfaces, sensor, initial, rng, forces=forces, **given)

    chooses = settings.model_selection.effort > 0
    make.abilities = Abilities(
        settings.estimated_parameters, chooses, chooses or settings.most_searches > 1
    )
    return make
