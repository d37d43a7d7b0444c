"""Mutual information of every (observer, target) pair (Paul & Fan, section 4).

At a tasking epoch the estimates are carried to the next measurement time. The information of a
pair is (1/2) log(det P- / det P+) for one measurement of that target by that observer. The joint
covariance of the targets is block diagonal, so a tasking's information is the sum over its pairs.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.compiled import borrowing
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import Prediction
from cislunar.estimation.expected import expected_directions, expected_measurements
from cislunar.estimation.triangular import cholesky
from cislunar.estimation.unscented import (
    UnscentedWeights,
    information_gain,
    innovation_moments,
    sigma_points,
    unscented_weights,
)
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.observation.sensor import (
    SensorLimits,
    Sensors,
    extinction,
    limits_of,
    noise_variance_at,
    sensor_limits,
)
from cislunar.observation.sightline import METRES, in_clear_view, sphere_brighter, sphere_margin
from cislunar.photometry.facet_blocks import BLOCK_ROWS, LANES
from cislunar.photometry.sphere import faintness_per_squared_range
from cislunar.tasking.planning.detection_model import DetectionModel
from cislunar.tasking.planning.information_bound import bound_all

Array = NDArray[np.float64]

STATES = ("translation", "full")


@dataclass(frozen=True)
class TaskingModel:
    """What the tasking step believes about the targets.

    Attributes
    ----------
    diffuse_reflection_coefficient : float
        C_d of the sphere that stands in for a target when its visibility is judged.
    radius_m : float
        Radius of that sphere; 1 m has the area 4 pi m^2 of the targets' shape.
    states : {"translation", "full"}
        States whose information counts: position and velocity, as in the paper, by the two angles
        (the magnitude, 0.1 mag for 5 per cent of the range, would add next to nothing), or all
        twelve by angles and magnitude.
    track_gate : bool
        Give no information to a target whose predicted direction is uncertain by more than half
        the field of view: the telescope would not find it, and its covariance, however large,
        would attract one. Not in the paper.
    measurements : int
        Number of measurements, each as informative as the first, a pair is credited with; more
        than one divides the noise variance.
    detection : DetectionModel or None
        How likely a look detects its target is learned from what looks found, which the sphere's
        magnitude then begins from but does not decide; None: the sphere decides, as in the paper.

    Raises
    ------
    ConfigurationError
        If a value is impossible.
    """

    diffuse_reflection_coefficient: float = 0.5
    radius_m: float = 1.0
    states: str = "translation"
    track_gate: bool = True
    measurements: int = 1
    detection: DetectionModel | None = None

    def __post_init__(self) -> None:
        if self.states not in STATES:
            raise ConfigurationError(
                f"states = {self.states!r} is unknown: use one of {list(STATES)}"
            )
        if self.measurements < 1:
            raise ConfigurationError(f"measurements = {self.measurements} must be at least 1")
        faintness_per_squared_range(
            18.0,
            radius_m=self.radius_m,
            diffuse_reflection_coefficient=self.diffuse_reflection_coefficient,
        )


_WEIGHTS = unscented_weights(6), unscented_weights(12)


class _Belief(NamedTuple):
    """What the kernel needs of `TaskingModel` and sensors.

    `limits` and `faintness` are of all observers, or of the one of `belief_of_one`; variances are
    divided by `measurements`.
    """

    limits: SensorLimits
    faintness: Array
    measurements: float
    sphere: bool
    gate: bool
    full: bool
    six: UnscentedWeights
    twelve: UnscentedWeights


def belief_of(model: TaskingModel, sensor: Sensors, n_observers: int) -> _Belief:
    """What kernels of tasking need of sensors and model."""
    limits = sensor_limits(sensor, n_observers)
    faintness = [
        faintness_per_squared_range(
            float(limit),
            radius_m=model.radius_m,
            diffuse_reflection_coefficient=model.diffuse_reflection_coefficient,
        )
        for limit in limits.limiting_magnitude
    ]
    return _Belief(
        limits,
        np.array(faintness) * METRES**2,
        float(model.measurements),
        model.detection is None,
        model.track_gate,
        model.states == "full",
        *_WEIGHTS,
    )


@njit(cache=True, error_model="numpy", inline="always")
def belief_of_one(belief, o):
    """What holds for one observer, out of what holds for all."""
    return _Belief(
        limits_of(belief.limits, o),
        belief.faintness[o],
        belief.measurements,
        belief.sphere,
        belief.gate,
        belief.full,
        belief.six,
        belief.twelve,
    )


@borrowing
def observable(observer, place, sun, primaries, belief, variance):
    """Whether a place is in clear view, and the sphere that stands for a target bright enough.

    `belief` is that of the observer; the variances (3,) of its measurements of the sphere go into
    `variance`.
    """
    limits = belief.limits
    ox, oy, oz = observer[0], observer[1], observer[2]
    x, y, z = place[0], place[1], place[2]
    dx, dy, dz = x - ox, y - oy, z - oz
    if not in_clear_view(ox, oy, oz, dx, dy, dz, sun, limits, primaries):
        return False
    fx, fy, fz = x - sun[0], y - sun[1], z - sun[2]
    magnitude = limits.limiting_magnitude
    if limits.ground or limits.photons[0] > 0.0:
        margin = sphere_margin(dx, dy, dz, fx, fy, fz, belief.faintness)
        margin -= extinction(ox, oy, oz, dx, dy, dz, primaries[0], limits)
        # fainter than the limit nothing is measured
        magnitude -= max(0.0, margin)
        if belief.sphere and not margin > 0.0:
            return False
    elif belief.sphere and not sphere_brighter(dx, dy, dz, fx, fy, fz, belief.faintness):
        return False
    noise_variance_at(limits, magnitude, variance)
    for i in range(3):
        variance[i] /= belief.measurements
    return True


@borrowing
def _direction_sigma(cross, even, noise_variance, declination):
    """Largest standard deviation of the predicted direction on the sky, rad."""
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


@borrowing
def expect_look(points, observer, sky, belief, variance, expected, shift, cross, even):
    """Moments U and S of the directions of a look into `cross` and `even`, if it can be made.

    It can if the first of the sigma points `points` (6, n) is `observable` from `observer` and,
    where that is asked, the direction is known well enough to be found. `sky` are the axes of
    right ascension and declination, the place of the Sun, and those of Earth and Moon; `belief` and
    `variance` are as of `observable`.
    """
    axes, sun, primaries = sky
    if not observable(observer, points[:3, 0], sun, primaries, belief, variance):
        return False
    _, declination = expected_directions(points, observer, axes, expected)
    innovation_moments(expected, variance[1:], belief.six, shift, cross, even)
    sigma = _direction_sigma(cross, even, variance[1:], declination)
    return not belief.gate or sigma <= belief.limits.half_field


@njit(cache=True, error_model="numpy")
def _sigma_points(translation, covariance, joint_root, belief, wanted, points, all_points):
    """Sigma points of the targets wanted by any observer; false for those without an estimate.

    The root being triangular with the position first, only three columns of it shift the place.
    """
    root, usable = np.empty((6, 6)), np.zeros(translation.shape[0], np.bool_)
    for o in range(wanted.shape[0]):
        usable |= wanted[o]
    for j in range(translation.shape[0]):
        if not usable[j]:
            continue
        root[:, :] = covariance[j]
        usable[j] = np.isfinite(np.sum(translation[j])) and cholesky(root)
        if not usable[j]:
            continue
        sigma_points(translation[j, :3], root[:3, :3], belief.six.spread, points[j])
        if belief.full:
            sigma_points(translation[j], joint_root[j, 6:], belief.twelve.spread, all_points[j])
    return usable


@njit(cache=True, error_model="numpy")
def _fill(prediction, joint, scene, surfaces, belief, wanted, out):
    """Information of the wanted pairs, others left as they are; see `pair_information`.

    `joint` is mean attitudes (target, 4) and joint roots (target, 12, 12), if all states count.
    """
    index, translation, covariance = prediction
    quaternion, joint_root = joint
    n_targets = translation.shape[0]
    points = np.empty((n_targets, 3, 7))
    all_points = np.empty((n_targets if belief.full else 0, 6, 25))
    usable = _sigma_points(translation, covariance, joint_root, belief, wanted, points, all_points)
    expected, shift = np.empty((6, 2)), np.empty(2)
    cross, even = np.empty((3, 2)), np.empty((2, 2))
    all_expected, all_shift = np.empty((24, 3)), np.empty(3)
    all_cross, all_even = np.empty((12, 3)), np.empty((3, 3))
    block = np.empty((BLOCK_ROWS, LANES))
    sun, axes, variance = scene.sun_position[index], scene.observer_axes[index], np.empty(3)
    sky = axes, sun, scene.primaries[index]
    for o in range(out.shape[0]):
        observer, own = scene.observer_position[o, index], belief_of_one(belief, o)
        for j in range(n_targets):
            if not wanted[o, j]:
                continue
            out[o, j] = 0.0
            if not usable[j]:
                continue
            look = points[j], observer, sky, own, variance
            if not expect_look(*look, expected, shift, cross, even):
                continue
            if belief.full:
                expected_measurements(
                    all_points[j],
                    quaternion[j],
                    joint_root[j],
                    belief.twelve.spread,
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
                    all_expected, variance, belief.twelve, all_shift, all_cross, all_even
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
    wanted: NDArray[np.bool_] | None = None,
    out: Array | None = None,
) -> Array:
    """Mutual information of every pair, nats.

    A target is observable if the sphere of `model` at its estimated position is brighter than the
    sensor's limit and clear of the bright bodies; the information of any other pair is zero. Where
    detection is learned, being clear is enough.

    Parameters
    ----------
    prediction : Prediction
        Estimates at the next measurement time.
    scene, surfaces, sensor
        As for the filter. The surfaces matter to ``states="full"`` only.
    model : TaskingModel
        Settings.
    wanted : ndarray of bool, shape (observer, target), optional
        The pairs to compute; all, if omitted.
    out : ndarray, shape (observer, target), optional
        Where to put them; pairs not wanted keep what is there, which is zero if omitted.

    Returns
    -------
    ndarray, shape (observer, target)

    Raises
    ------
    ConfigurationError
        If the information of all states is wanted of an estimator that does not provide them.
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
    wanted = np.ones(shape, dtype=bool) if wanted is None else wanted
    translation = prediction.index, *_translation(prediction)
    belief = belief_of(model, sensor, shape[0])
    _fill(translation, joint, scene, surfaces, belief, wanted, out)
    return out


def _translation(prediction: Prediction) -> tuple[Array, Array]:
    """Mean and covariance of position and velocity as the kernels take them."""
    return (
        np.ascontiguousarray(prediction.translation),
        np.ascontiguousarray(prediction.covariance),
    )


def information_bound(
    prediction: Prediction, scene: Scene, sensor: Sensors, model: TaskingModel
) -> Array:
    """Upper bound of the information of position and velocity of every pair, nats.

    Far cheaper than `pair_information`: no sigma points are sent through the measurement. See
    `cislunar.tasking.planning.information_bound`.

    Parameters
    ----------
    prediction, scene, sensor, model
        As for `pair_information`, with ``model.states == "translation"``.

    Returns
    -------
    ndarray, shape (observer, target)
        Infinite where nothing can be said, zero of a target without an estimate.
    """
    out = np.empty((scene.observer_position.shape[0], prediction.translation.shape[0]))
    belief = belief_of(model, sensor, out.shape[0])
    limits = belief.limits
    bound_all(
        (prediction.index, *_translation(prediction)),
        scene,
        (limits.noise_variance[:, 1:] / belief.measurements, limits.cosines, belief.faintness),
        belief.six,
        limits.half_field if belief.gate else np.full(out.shape[0], np.inf),
        out,
    )
    return out
