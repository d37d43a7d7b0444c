"""State of the targets of the batch estimator."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.inertia import RigidBodies, rigid_bodies
from cislunar.estimation.estimator import N_COUNTERS, InitialEstimate
from cislunar.estimation.kalman.gaussian_mixture import GaussianMixture, no_mixture
from cislunar.estimation.light_curves.batch_kernels import FitState
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.light_curves.hypotheses import Hypotheses, mixture_points, prior_hypotheses
from cislunar.estimation.light_curves.light_curve import LightCurveModel
from cislunar.estimation.light_curves.model_selection.in_loop import Selection
from cislunar.estimation.light_curves.row_blocks import ROTATION, ROW_COLUMNS
from cislunar.observation.sensor import Sensor
from cislunar.observation.target_surfaces import TargetSurfaces, body_of
from cislunar.runtime import Array


class BatchTracks(NamedTuple):
    """State of all targets: arrays by target, and lists of what belongs to one target. The orbit
    filter has means (target, 6), roots (target, 6, 6), mixtures and counters (target, 4); the fit
    of a light curve its model, modes, generator of random starts, points of the mixture, rows, and
    the selected model of the body, None without any."""

    translation: Array
    root: Array
    mixture: GaussianMixture
    counters: NDArray[np.int64]
    fit: FitState
    models: list[LightCurveModel]
    hypotheses: list[Hypotheses]
    rngs: list[np.random.Generator]
    points: list[tuple[Array, ...]]
    data: list[Array]
    selections: list[Selection | None]

    def make_room(self, j: int, rows: int) -> None:
        """Enlarge the data array of a target; it doubles, so that copies are rare."""
        capacity, needed = self.data[j].shape[0], int(self.fit.rows[j]) + rows
        if needed > capacity:
            grown = np.empty((max(needed, 2 * capacity), ROW_COLUMNS))
            grown[:capacity] = self.data[j]
            self.data[j] = grown


def starting_tracks(
    initial: InitialEstimate,
    surfaces: TargetSurfaces,
    rng: np.random.Generator,
    index: int,
    sensor: Sensor,
    settings: BatchSettings,
    splitting: bool,
) -> BatchTracks:
    """Tracks at their initial estimate, whose time is an index of the scene."""
    n_targets, root = initial.translation.shape[0], initial.roots(ROTATION)
    given = surfaces, rigid_bodies(surfaces.inertia), sensor, settings
    models = [
        _light_curve_model(j, initial, sigma, *given)
        for j, sigma in enumerate(initial.deviations())
    ]
    hypotheses = [prior_hypotheses(settings.modes, model.sigma.size) for model in models]
    fit = FitState(*np.zeros((len(FitState._fields), n_targets), dtype=np.int64))
    fit.points[:] = [_points_per_mode(model) for model in models]
    fit.epoch[:] = index
    return BatchTracks(
        np.array(initial.translation, dtype=float),
        root,
        no_mixture(n_targets, splitting),
        np.zeros((n_targets, N_COUNTERS), dtype=np.int64),
        fit,
        models,
        hypotheses,
        rng.spawn(n_targets),
        [_prior_points(*each) for each in zip(hypotheses, models, strict=True)],
        [np.empty((0, ROW_COLUMNS)) for _ in range(n_targets)],
        [None] * n_targets,
    )


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


def _light_curve_model(
    j: int,
    initial: InitialEstimate,
    sigma: Array,
    surfaces: TargetSurfaces,
    bodies: RigidBodies,
    sensor: Sensor,
    settings: BatchSettings,
) -> LightCurveModel:
    body = body_of(surfaces, j)
    rotation_kinds, of_rotation = settings.estimated_parameters.rotation_kinds()
    kinds, of_surface = settings.estimated_parameters.surface_kinds(body.areas.size)
    settings.estimated_parameters.require_possible(body.materials)
    return LightCurveModel(
        np.array(initial.quaternion[j], dtype=float),
        np.array(initial.angular_velocity[j], dtype=float),
        np.concatenate([sigma[:ROTATION], of_rotation, of_surface]),
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
