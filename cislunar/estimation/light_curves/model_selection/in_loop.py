"""The choice between models of a body in the tasking loop, at tasking epochs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cislunar.attitude.attitude_integrator import TURN_OF_LONG_STEP
from cislunar.attitude.grp import to_quaternion
from cislunar.attitude.quaternion import (
    attitude_matrix,
    compose,
    from_rotation_vector,
    to_body,
    to_inertial,
)
from cislunar.estimation.light_curves.hypotheses import (
    Hypotheses,
    mixture_points,
    prior_hypotheses,
)
from cislunar.estimation.light_curves.light_curve import LightCurveModel
from cislunar.estimation.light_curves.mixture import (
    mixture_moments,
    step_points,
    weighted_deviations,
)
from cislunar.estimation.light_curves.model_selection.body_models import (
    SelectedModel,
    with_body_model,
)
from cislunar.estimation.light_curves.model_selection.characterization import (
    AMBIGUOUS,
    UNKNOWN_BODY,
    UNKNOWN_FACTOR,
    agreement,
)
from cislunar.estimation.light_curves.model_selection.selection import (
    narrowed,
    refitted,
    select_model,
)
from cislunar.estimation.light_curves.model_selection.settings import ModelSelectionSettings
from cislunar.estimation.light_curves.row_blocks import ROTATION
from cislunar.runtime import Array

_SEARCH_GROWTH, _FIT_GROWTH = 2.5, 1.25
"""Factors by which a light curve grows until all models are searched again, and until the modes
are fitted again if the models of `WIDE` were not left out."""

_FRAME_ANGLE = np.sqrt(3.0) * np.deg2rad(5.0)
"""Angle, rad, of six equally weighted rotations, two about each axis, with which the body frame of
an unknown shape has a standard deviation of 5 deg about each axis (empirical)."""


class Selection(NamedTuple):
    """Last selection of a target.

    Attributes
    ----------
    selected : SelectedModel
    searched, fitted : int
        Numbers of rows of the light curve at the last search and at the last fit.
    """

    selected: SelectedModel
    searched: int
    fitted: int


def updated_selection(
    last: Selection | None,
    data: Array,
    model: LightCurveModel,
    rng: np.random.Generator,
    settings: ModelSelectionSettings,
    modes: Sequence[Array] = (),
) -> Selection:
    """Selection for a light curve that may have grown.

    All models are searched when the light curve has grown by a factor of 2.5. In between, if the
    models of `WIDE` were left out at the last search, those of `EXACT` are fitted again with any
    new row; otherwise all likely modes are fitted again after a growth by a factor of 1.25. All
    models are searched as soon as `narrowed` or `refitted` tells that these fits do not suffice. A
    search begins with the last fits. For `modes` see `select_model`."""
    rows = len(data)
    if last is not None and rows == last.fitted:
        return last
    previous = None if last is None else last.selected
    if last is not None and rows < _SEARCH_GROWTH * last.searched:
        if not last.selected.wide:
            fitted, explained = narrowed(last.selected, data, model, settings, modes)
        elif rows < _FIT_GROWTH * last.fitted:
            return last
        else:
            fitted, explained = refitted(last.selected, data, model, rng, settings)
        if explained:
            return Selection(fitted, last.searched, rows)
        known = fitted.candidates + last.selected.candidates
        previous = fitted._replace(candidates=known)
    return Selection(select_model(data, model, rng, settings, previous, modes), rows, rows)


def reported_points(
    selection: Selection, model: LightCurveModel, elapsed_s: float, room: int
) -> tuple[tuple[Array, ...], int]:
    """Attitude, angular velocity, weight and rotation deviations of the points of a selection at a
    time after the epoch, in arrays of at least `room` points, and the number of points. Those of an
    unknown body are widened, and have an uncertain body frame if its shape is unknown."""
    quaternion, omega, weight, deviations = _points_of(selection.selected, model)
    step_points(quaternion, omega, deviations, elapsed_s, model, TURN_OF_LONG_STEP)
    if selection.selected.unknown_body:
        quaternion, omega = widened_points(quaternion, omega, weight)
    points = quaternion, omega, weight, deviations
    if selection.selected.unknown_shape:
        points = _of_uncertain_frames(*points)
    count = points[2].size
    out = tuple(np.zeros((max(count, room), *each.shape[1:])) for each in points)
    for array, each in zip(out, points, strict=True):
        array[:count] = each
    return out, count


def _points_of(selected: SelectedModel, model: LightCurveModel) -> tuple[Array, ...]:
    """Weighted points of the posterior at the epoch, with its mean and covariance: attitudes (n,
    4), angular velocities (n, 3), weights (n,) and rotation deviations (n, m)."""
    parts = []
    for candidate, share in zip(selected.candidates, selected.weight, strict=True):
        own = with_body_model(model, candidate.body)
        modes = prior_hypotheses(1, own.sigma.size)
        modes.u[0] = candidate.minimum.u
        modes.root[0] = np.linalg.cholesky(candidate.minimum.information)
        size = 2 * (ROTATION + own.rotation_kinds.size)
        shapes = (size, 4), (size, 3), (size,), (size, own.rotation_kinds.size)
        quaternion, omega, weight, deviations = (np.empty(shape) for shape in shapes)
        mixture_points(modes, own, quaternion, omega, weight, deviations)
        parts.append((quaternion, omega, weight * share, deviations))
    return tuple(np.concatenate(each) for each in zip(*parts, strict=True))


def parameter_deviations(
    selected: SelectedModel, model: LightCurveModel
) -> tuple[Array, Array, Array]:
    """Weights (mode,), means and variances (mode, n) of the body-parameter deviations that a
    light-curve model estimates, in its prior standard deviations. A deviation that a model of the
    body does not have is 0."""
    n_rotation, n = model.rotation_kinds.size, model.sigma.size - ROTATION
    mean, variance = np.zeros((2, selected.weight.size, n))
    for k, each in enumerate(selected.candidates):
        own = with_body_model(model, each.body)
        _, to, of = np.intersect1d(model.surface_kinds, own.surface_kinds, return_indices=True)
        to, of = (np.append(np.arange(n_rotation), n_rotation + index) for index in (to, of))
        unit = own.sigma[ROTATION + of] / model.sigma[ROTATION + to]
        mean[k, to] = unit * each.minimum.u[ROTATION + of]
        variance[k, to] = unit**2 * np.diag(np.linalg.inv(each.minimum.information))[ROTATION + of]
    return selected.weight, mean, variance


def widened_points(quaternion: Array, omega: Array, weight: Array) -> tuple[Array, Array]:
    """Attitudes and angular velocities of points whose deviations from the mean are larger by
    `UNKNOWN_FACTOR`, as GRP (up to rotations of 180 deg, beyond which the shorter rotation counts).
    Angular velocities are scaled in the inertial frame, so that modes that differ in attitude alone
    keep their common rate. Their mean in the body frames, which deviate more, is smaller."""
    center, rate, differences = np.empty(4), np.empty(3), np.empty((weight.size, ROTATION))
    mixture_moments(quaternion, omega, weight, center, rate, differences)
    wide = compose(to_quaternion(UNKNOWN_FACTOR * differences[:, :3]), center)
    inertial = to_inertial(quaternion, omega)
    mean = weight @ inertial
    return wide, to_body(wide, mean + UNKNOWN_FACTOR * (inertial - mean))


def _of_uncertain_frames(
    quaternion: Array, omega: Array, weight: Array, deviations: Array
) -> tuple[Array, ...]:
    """The points in body frames that are rotated about each axis, with the variance of an uncertain
    frame. Angular velocities are rotated as well, so that the rotations remain constant in time."""
    parts = []
    for axis in range(3):
        for angle in (_FRAME_ANGLE, -_FRAME_ANGLE):
            turn = from_rotation_vector(angle * np.eye(3)[axis])
            turned = compose(turn, quaternion), omega @ attitude_matrix(turn).T
            parts.append((*turned, weight / 6.0, deviations))
    return tuple(np.concatenate(each) for each in zip(*parts, strict=True))


def report_points(
    points: tuple[Array, ...], count: int, quaternion: Array, omega: Array, sigma: Array
) -> None:
    """Write mean attitude (4,), mean angular velocity (3,) and standard deviations (6,) of the
    points into the last three arguments."""
    differences = np.empty((count, ROTATION))
    weight = points[2][:count]
    mixture_moments(points[0][:count], points[1][:count], weight, quaternion, omega, differences)
    weighted_deviations(differences, weight, sigma)


def status_of(
    selection: Selection | None, hypotheses: Hypotheses, points: tuple[Array, ...], count: int
) -> int:
    """Status of the attitude: `UNKNOWN_BODY` if there is a selection and the body is unknown; else
    `AMBIGUOUS` if the modes disagree about the present attitude, given by `count` points, or there
    is no selection and the best mode is suspect. A target without a light curve is `UNIQUE`."""
    if selection is not None and selection.selected.unknown_body:
        return UNKNOWN_BODY
    if selection is None and hypotheses.count[2]:
        return AMBIGUOUS
    of_mode = 2 * (ROTATION + points[3].shape[1])
    mode = points[0][:count].reshape(-1, of_mode, 4)
    mode = (mode * np.sign(mode @ mode[:, 0, :, None])).sum(axis=1)  # the points are close together
    mode /= np.linalg.norm(mode, axis=1, keepdims=True)
    return agreement(mode, points[2][:count].reshape(-1, of_mode).sum(axis=1))
