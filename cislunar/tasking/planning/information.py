"""Mutual information of every (observer, target) pair (Paul & Fan, section 4): (1/2) log(det P- /
det P+) for one measurement of that target by that observer at the next measurement time. The joint
covariance of the targets is block diagonal, so that a tasking's information is the sum over its
pairs."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import njit, njit_noalloc
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import Prediction
from cislunar.estimation.expected import expected_directions, expected_measurements
from cislunar.estimation.triangular import cholesky
from cislunar.estimation.unscented import (
    UNSCENTED_WEIGHTS,
    UnscentedWeights,
    information_gain,
    innovation_moments,
    sigma_points,
)
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import (
    SensorLimits,
    Sensors,
    extinction,
    limits_of,
    noise_variance_at,
    sensor_limits,
)
from cislunar.observation.sightline import METERS, in_clear_view, sphere_brighter, sphere_margin
from cislunar.observation.target_surfaces import TargetSurfaces
from cislunar.photometry.facet_blocks import BLOCK_ROWS, LANES
from cislunar.photometry.sphere import faintness_per_squared_range
from cislunar.runtime.arguments import Array, count_of, require_choice
from cislunar.tasking.planning.detection_model import DetectionModel
from cislunar.tasking.planning.information_bound import bound_all

STATES = ("translation", "full")


@dataclass(frozen=True)
class TaskingModel:
    """Assumptions of the tasking step on the targets.

    Attributes
    ----------
    diffuse_reflection_coefficient : float
        C_d of the sphere that stands for a target when its visibility is evaluated.
    radius_m : float
        Radius of that sphere, m; 1 m gives the area 4 pi m^2 of the targets' shape.
    states : {"translation", "full"}
        States whose information counts: position and velocity, as in the paper, by the two angles
        (the magnitude, with 0.1 mag for 5 % of the range, would add almost nothing), or all twelve
        by angles and magnitude.
    pointing_uncertainty_gate : bool
        Whether a target has no information if its predicted direction is uncertain by more than
        half the field of view, so that the telescope would not find it. Not in the paper.
    measurements : int
        Number of expected measurements of a pair, each as informative as the first; more than one
        divides the noise variance.
    detection : DetectionModel or None
        Model of the learned probability of detection, for which the sphere's magnitude is only the
        expectation; None: the sphere decides, as in the paper.

    Raises
    ------
    ConfigurationError
        If `states` is unknown, `measurements` is not a whole number of at least 1, or the radius or
        the coefficient is not positive.
    """

    diffuse_reflection_coefficient: float = 0.5
    radius_m: float = 1.0
    states: str = "translation"
    pointing_uncertainty_gate: bool = True
    measurements: int = 1
    detection: DetectionModel | None = None

    def __post_init__(self) -> None:
        require_choice("states", self.states, STATES)
        count_of("measurements", self.measurements)
        self.faintness(18.0)

    def faintness(self, limiting_magnitude: float) -> float:
        """`cislunar.photometry.sphere.faintness_per_squared_range` of the sphere, per squared unit
        of length."""
        return METERS**2 * faintness_per_squared_range(
            limiting_magnitude,
            radius_m=self.radius_m,
            diffuse_reflection_coefficient=self.diffuse_reflection_coefficient,
        )


class _TaskingConstants(NamedTuple):
    """Constants of `TaskingModel` and sensors for the kernels. `limits` and `faintness` are those
    of all observers, or of one (`constants_of_observer`); variances are divided by `measurements`.
    """

    limits: SensorLimits
    faintness: Array
    measurements: float
    sphere: bool
    gate: bool
    full: bool
    weights: UnscentedWeights


def tasking_constants(model: TaskingModel, sensor: Sensors, n_observers: int) -> _TaskingConstants:
    """Constants of sensors and model for the kernels of tasking."""
    limits = sensor_limits(sensor, n_observers)
    return _TaskingConstants(
        limits,
        np.array([model.faintness(float(limit)) for limit in limits.limiting_magnitude]),
        float(model.measurements),
        model.detection is None,
        model.pointing_uncertainty_gate,
        model.states == "full",
        UNSCENTED_WEIGHTS,
    )


@njit(cache=True, error_model="numpy", inline="always")
def constants_of_observer(constants, o):
    """Constants of one observer, from those of all."""
    return _TaskingConstants(
        limits_of(constants.limits, o),
        constants.faintness[o],
        constants.measurements,
        constants.sphere,
        constants.gate,
        constants.full,
        constants.weights,
    )


@njit_noalloc
def observable(observer, place, sun, primaries, constants, variance):
    """Whether a position is in clear view, and the sphere that stands for a target bright enough.
    `constants` are those of the observer; `variance` (3,) receives the variances of its measurement
    of the sphere."""
    limits = constants.limits
    ox, oy, oz = observer[0], observer[1], observer[2]
    x, y, z = place[0], place[1], place[2]
    dx, dy, dz = x - ox, y - oy, z - oz
    if not in_clear_view(ox, oy, oz, dx, dy, dz, sun, limits, primaries):
        return False
    fx, fy, fz = x - sun[0], y - sun[1], z - sun[2]
    magnitude = limits.limiting_magnitude
    if limits.ground or limits.photons[0] > 0.0:
        margin = sphere_margin(dx, dy, dz, fx, fy, fz, constants.faintness)
        margin -= extinction(ox, oy, oz, dx, dy, dz, primaries[0], limits)
        # fainter than the limit nothing is measured
        magnitude -= max(0.0, margin)
        if constants.sphere and not margin > 0.0:
            return False
    elif constants.sphere and not sphere_brighter(dx, dy, dz, fx, fy, fz, constants.faintness):
        return False
    noise_variance_at(limits, magnitude, variance)
    for i in range(3):
        variance[i] /= constants.measurements
    return True


@njit_noalloc
def _direction_sigma(cross, even, noise_variance, declination):
    """Largest standard deviation of the predicted direction, rad."""
    scale = np.cos(declination)
    a = even[0, 0] - noise_variance[0]
    b = even[0, 1]
    c = even[1, 1] - noise_variance[1]
    for i in range(cross.shape[0]):
        a += cross[i, 0] * cross[i, 0]
        b += cross[i, 0] * cross[i, 1]
        c += cross[i, 1] * cross[i, 1]
    a *= scale * scale
    b *= scale
    return np.sqrt(0.5 * (a + c) + np.sqrt(0.25 * (a - c) ** 2 + b * b))


@njit_noalloc
def expect_observation(
    points, observer, geometry, constants, variance, expected, shift, cross, even
):
    """Moments U and S of the direction of an observation into `cross` and `even`; whether it is
    possible: the first of the sigma points `points` (6, n) is `observable` from `observer` and
    passes the pointing-uncertainty gate, if there is one. `geometry` has the axes of right
    ascension and declination, the position of the Sun, and those of Earth and Moon."""
    axes, sun, primaries = geometry
    if not observable(observer, points[:3, 0], sun, primaries, constants, variance):
        return False
    _, declination = expected_directions(points, observer, axes, expected)
    innovation_moments(expected, variance[1:], constants.weights, shift, cross, even)
    sigma = _direction_sigma(cross, even, variance[1:], declination)
    return not constants.gate or sigma <= constants.limits.half_field


@njit(cache=True, error_model="numpy")
def _sigma_points(translation, covariance, joint_root, constants, selected, points, all_points):
    """Sigma points of the targets selected by any observer; False for those without an estimate.
    The root is triangular with the position first, so that only three of its columns shift the
    position."""
    root, usable = np.empty((6, 6)), np.zeros(translation.shape[0], np.bool_)
    for o in range(selected.shape[0]):
        usable |= selected[o]
    for j in range(translation.shape[0]):
        if not usable[j]:
            continue
        root[:, :] = covariance[j]
        usable[j] = np.isfinite(np.sum(translation[j])) and cholesky(root)
        if not usable[j]:
            continue
        sigma_points(translation[j, :3], root[:3, :3], constants.weights.spread, points[j])
        if constants.full:
            sigma_points(translation[j], joint_root[j, 6:], constants.weights.spread, all_points[j])
    return usable


@njit(cache=True, error_model="numpy")
def _fill(prediction, joint, scene, surfaces, constants, selected, out):
    """Information of the selected pairs, others left as they are; see `pair_information`. `joint`
    has mean attitudes (target, 4) and joint roots (target, 12, 12), if all states count."""
    index, translation, covariance = prediction
    quaternion, joint_root = joint
    n_targets = translation.shape[0]
    points = np.empty((n_targets, 3, 7))
    all_points = np.empty((n_targets if constants.full else 0, 6, 25))
    usable = _sigma_points(
        translation, covariance, joint_root, constants, selected, points, all_points
    )
    expected, shift = np.empty((6, 2)), np.empty(2)
    cross, even = np.empty((3, 2)), np.empty((2, 2))
    all_expected, all_shift = np.empty((24, 3)), np.empty(3)
    all_cross, all_even = np.empty((12, 3)), np.empty((3, 3))
    block = np.empty((BLOCK_ROWS, LANES))
    sun, axes, variance = scene.sun_position[index], scene.observer_axes[index], np.empty(3)
    geometry = axes, sun, scene.primaries[index]
    for o in range(out.shape[0]):
        observer, own = scene.observer_position[o, index], constants_of_observer(constants, o)
        for j in range(n_targets):
            if not selected[o, j]:
                continue
            out[o, j] = 0.0
            if not usable[j]:
                continue
            observation = points[j], observer, geometry, own, variance
            if not expect_observation(*observation, expected, shift, cross, even):
                continue
            if constants.full:
                expected_measurements(
                    all_points[j],
                    quaternion[j],
                    joint_root[j],
                    constants.weights.spread,
                    observer,
                    axes,
                    sun,
                    scene.frame_axes[index],
                    surfaces,
                    j,
                    block,
                    all_expected,
                )
                innovation_moments(
                    all_expected, variance, constants.weights, all_shift, all_cross, all_even
                )
                gain = information_gain(all_cross, all_even)
            else:
                gain = information_gain(cross, even)
            if gain > 0.0 and gain < np.inf:
                out[o, j] = gain


def pair_information(
    prediction: Prediction,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensors,
    model: TaskingModel,
    *,
    selected: NDArray[np.bool_] | None = None,
    out: Array | None = None,
) -> Array:
    """Mutual information of every pair.

    A target is observable if the sphere of `model` at its estimated position is brighter than the
    sensor's limit and clear of the bright bodies; the information of any other pair is zero. If
    detection is learned, the brightness is not required.

    Parameters
    ----------
    prediction : Prediction
        Estimates at the next measurement time; with a joint root if ``model.states`` is "full".
    scene, surfaces, sensor
        As for the estimator. The surfaces matter to ``states="full"`` only.
    model : TaskingModel
    selected : ndarray of bool, shape (observer, target), optional
        The pairs to compute; all, if omitted.
    out : ndarray, shape (observer, target), optional
        Output array, in which other pairs are left as they are; zeros if omitted.

    Returns
    -------
    ndarray, shape (observer, target)
        Nats; `out`, if it is given.

    Raises
    ------
    ConfigurationError
        If ``model.states`` is "full" and the estimator has no joint Gaussian estimate.
    """
    full = model.states == "full"
    if full and (prediction.root is None or prediction.quaternion is None):
        raise ConfigurationError(
            "states = 'full' needs an estimator with a joint Gaussian estimate: use 'translation'"
        )
    n_targets = prediction.translation.shape[0]
    joint = np.empty((n_targets, 0)), np.empty((n_targets, 0, 0))
    if full:
        joint = prediction.quaternion, prediction.root
    shape = scene.observer_position.shape[0], n_targets
    out = np.zeros(shape) if out is None else out
    selected = np.ones(shape, dtype=bool) if selected is None else selected
    translation = prediction.index, *_translation(prediction)
    constants = tasking_constants(model, sensor, shape[0])
    _fill(translation, joint, scene, surfaces, constants, selected, out)
    return out


def _translation(prediction: Prediction) -> tuple[Array, Array]:
    """Mean and covariance of position and velocity as contiguous arrays."""
    return (
        np.ascontiguousarray(prediction.translation),
        np.ascontiguousarray(prediction.covariance),
    )


def information_bound(
    prediction: Prediction, scene: Scene, sensor: Sensors, model: TaskingModel
) -> Array:
    """Upper bound of `pair_information` for ``model.states == "translation"``, nats (observer,
    target): infinite where there is no bound, zero for a target without an estimate. See
    `cislunar.tasking.planning.information_bound`."""
    out = np.empty((scene.observer_position.shape[0], prediction.translation.shape[0]))
    constants = tasking_constants(model, sensor, out.shape[0])
    limits = constants.limits
    bound_all(
        (prediction.index, *_translation(prediction)),
        scene,
        (
            limits.noise_variance[:, 1:] / constants.measurements,
            limits.cosines,
            constants.faintness,
        ),
        constants.weights,
        limits.half_field if constants.gate else np.full(out.shape[0], np.inf),
        out,
    )
    return out
