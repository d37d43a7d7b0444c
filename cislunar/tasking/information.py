"""Mutual information of every (observer, target) pair (Paul & Fan, section 4).

At a tasking epoch the estimates are carried to the next measurement time. The information of a
pair is (1/2) log(det P- / det P+) for one measurement of that target by that observer. The joint
covariance of the targets is block diagonal, so a tasking's information is the sum over its pairs.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import Prediction
from cislunar.estimation.kalman.mukf_kernels import (
    WEIGHTS,
    FilterConstants,
    make_workspace,
    predicted_measurements,
)
from cislunar.estimation.triangular import cholesky
from cislunar.estimation.unscented import (
    information_gain,
    innovation_moments,
    unscented_weights,
)
from cislunar.observation.measurement import (
    Sensor,
    direction_angles,
    occulted,
    outside_exclusion,
    wrap_angle,
)
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.photometry.sphere import faintness_per_squared_range

Array = NDArray[np.float64]

STATES = ("translation", "full")
_TRANSLATION_WEIGHTS = unscented_weights(6)
_METRES = 1000.0 * LENGTH_UNIT_KM


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


@njit(cache=True, error_model="numpy")
def _sphere_visible(observer, x, y, z, sun, faintness, limits, mu):
    """Whether the sphere at (x, y, z) can be observed from a point (compiled)."""
    ox, oy, oz = observer[0], observer[1], observer[2]
    dx, dy, dz = x - ox, y - oy, z - oz
    if not outside_exclusion(ox, oy, oz, dx, dy, dz, sun, limits.cosines, mu):
        return False
    if limits.occultation and occulted(ox, oy, oz, dx, dy, dz, mu):
        return False
    fx, fy, fz = x - sun[0], y - sun[1], z - sun[2]
    squared = dx * dx + dy * dy + dz * dz
    cosine = (dx * fx + dy * fy + dz * fz) / np.sqrt(squared * (fx * fx + fy * fy + fz * fz))
    cosine = min(1.0, max(-1.0, cosine))
    alpha = np.arccos(cosine)
    return np.sin(alpha) + (np.pi - alpha) * cosine > faintness * squared


@njit(cache=True, error_model="numpy")
def _direction_differences(points, observer, axes, differences):
    """Angles of the outer sigma points less the central ones; its declination (compiled)."""
    ra0, dec0 = 0.0, 0.0
    for i in range(points.shape[0]):
        dx = points[i, 0] - observer[0]
        dy = points[i, 1] - observer[1]
        dz = points[i, 2] - observer[2]
        ra, dec = direction_angles(dx, dy, dz, axes)
        if i == 0:
            ra0, dec0 = ra, dec
        else:
            differences[i - 1, 0] = wrap_angle(ra - ra0)
            differences[i - 1, 1] = dec - dec0
    return dec0


@njit(cache=True, error_model="numpy")
def _direction_sigma(cross, even, noise_variance, declination):
    """Largest standard deviation of the predicted direction on the sky, rad (compiled)."""
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


@njit(cache=True, error_model="numpy")
def _fill(
    index,
    translation,
    covariance,
    quaternion,
    root12,
    full,
    gate,
    faintness,
    scene,
    surfaces,
    limits,
    constants,
    weights,
    out,
):
    """Information of all pairs (compiled); see `pair_information`."""
    work = make_workspace(3)
    root = np.empty((6, 6))
    points = np.empty((13, 6))
    differences, shift = np.empty((12, 2)), np.empty(2)
    cross, even = np.empty((6, 2)), np.empty((2, 2))
    sun, axes = scene.sun_position[index], scene.observer_axes[index]
    angle_noise = constants.noise_variance[1:]
    out[:, :] = 0.0
    for j in range(translation.shape[0]):
        if not np.isfinite(np.sum(translation[j])):
            continue
        root[:, :] = covariance[j]
        if not cholesky(root):
            continue
        for c in range(6):
            points[0, c] = translation[j, c]
            for i in range(6):
                points[1 + i, c] = translation[j, c] + weights.spread * root[c, i]
                points[7 + i, c] = translation[j, c] - weights.spread * root[c, i]
        for o in range(out.shape[0]):
            observer = scene.observer_position[o, index]
            x, y, z = points[0, 0], points[0, 1], points[0, 2]
            if not _sphere_visible(observer, x, y, z, sun, faintness, limits, constants.forces.mu):
                continue
            declination = _direction_differences(points, observer, axes, differences)
            innovation_moments(differences, angle_noise, weights, shift, cross, even)
            sigma = _direction_sigma(cross, even, angle_noise, declination)
            if gate and not sigma <= limits.half_field:
                continue
            if full:
                predicted_measurements(
                    quaternion[j],
                    translation[j],
                    root12[j],
                    o,
                    index,
                    j,
                    scene,
                    surfaces,
                    constants,
                    work,
                )
                innovation_moments(
                    work.predicted,
                    constants.noise_variance,
                    constants.weights,
                    work.measured_shift,
                    work.cross,
                    work.even,
                )
                gain = information_gain(work.cross, work.even)
            else:
                gain = information_gain(cross, even)
            if gain > 0.0 and gain < np.inf:
                out[o, j] = gain


def pair_information(
    prediction: Prediction,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensor,
    model: TaskingModel,
    forces: tuple,
) -> Array:
    """Mutual information of every pair, nats.

    A target is observable if the sphere of `model` at its estimated position is brighter than the
    sensor's limit and clear of the bright bodies; the information of any other pair is zero.

    Parameters
    ----------
    prediction : Prediction
        Estimates at the next measurement time.
    scene, surfaces, sensor
        As for the filter. The surfaces matter to ``states="full"`` only.
    model : TaskingModel
        Settings.
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.

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
    unused = np.empty((n_targets, 0)), np.empty((n_targets, 0, 0))
    limits = sensor.limits()
    constants = FilterConstants(
        forces,
        np.zeros(12),
        limits.noise_variance / model.measurements,
        limits.half_field,
        True,
        WEIGHTS,
    )
    faintness = faintness_per_squared_range(
        sensor.limiting_magnitude,
        radius_m=model.radius_m,
        diffuse_reflection_coefficient=model.diffuse_reflection_coefficient,
    )
    out = np.empty((scene.observer_position.shape[0], n_targets))
    _fill(
        prediction.index,
        np.ascontiguousarray(prediction.translation),
        np.ascontiguousarray(prediction.covariance),
        prediction.quaternion if full else unused[0],
        prediction.root if full else unused[1],
        full,
        model.track_gate,
        faintness * _METRES**2,
        scene,
        surfaces,
        limits,
        constants,
        _TRANSLATION_WEIGHTS,
        out,
    )
    return out
