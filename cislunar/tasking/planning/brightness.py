"""Magnitudes of targets that tasking expects: those of spheres, or of their facets.

In the paper a sphere stands for a target. The facets of the target itself are brighter or fainter,
depending on the estimated attitude, see docs/tasking.md.

Assumptions and limitations
---------------------------
- The cubature points represent an almost unknown attitude, too. For an estimate with several
  modes they have its mean and covariance only.
- Shape, material and inertia are the assumed ones.
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude import grp
from cislunar.attitude.inertia import rigid_bodies
from cislunar.attitude.quaternion import compose
from cislunar.attitude.rigid_body import propagate_attitudes
from cislunar.compiled import njit, njit_noalloc
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.estimation.estimator import Prediction, Rotation
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import (
    SensorLimits,
    Sensors,
    extinction,
    limits_of,
    sensor_limits,
)
from cislunar.observation.sightline import METERS, dimming, lit_directions
from cislunar.observation.target_surfaces import TargetSurfaces, body_of
from cislunar.photometry.body_blocks import body_magnitudes
from cislunar.photometry.facet_blocks import (
    BLOCK_ROWS,
    LANES,
    MAGNITUDE,
    QUATERNION,
    RANGE,
    SUN,
    VIEW,
)
from cislunar.photometry.sphere import phase_angle, sphere_magnitude
from cislunar.runtime import Array, Flags
from cislunar.tasking.planning.information import TaskingModel

_SAMPLE_S = 900.0
"""Longest time that one attitude represents, s."""

_TURN_TOLERANCE = 1e-6
"""Tolerance of integrated attitudes, whose brightness is known no better."""


def sphere_magnitudes(
    prediction: Prediction, scene: Scene, *, radius_m: float, diffuse_reflection_coefficient: float
) -> Array:
    """Magnitude of the sphere that stands for a target, (observer, target): infinite if it is
    unlit, NaN for a target without an estimate. See `cislunar.photometry.sphere.sphere_magnitude`.
    """
    place = prediction.translation[:, :3]
    way = place - scene.observer_position[:, prediction.index, None]
    return sphere_magnitude(
        np.linalg.norm(way, axis=-1) * METERS,
        phase_angle(way, place - scene.sun_position[prediction.index]),
        radius_m=radius_m,
        diffuse_reflection_coefficient=diffuse_reflection_coefficient,
    )


def sphere_margins(
    prediction: Prediction,
    scene: Scene,
    sensor: Sensors,
    model: TaskingModel,
    *,
    eclipse: bool = False,
) -> Array:
    """Limiting magnitude less the magnitude of the sphere, mag, shape (observer, target). See
    `cislunar.tasking.planning.information.pair_information` for the arguments; with `eclipse` the
    shadows of Earth and Moon dim targets."""
    limits = sensor_limits(sensor, scene.observer_position.shape[0])
    magnitude = sphere_magnitudes(
        prediction,
        scene,
        radius_m=model.radius_m,
        diffuse_reflection_coefficient=model.diffuse_reflection_coefficient,
    )
    return _faintest(prediction.index, prediction.translation, scene, limits, eclipse) - magnitude


def _faintest(
    index: int, translation: Array, scene: Scene, limits: SensorLimits, eclipse: bool
) -> Array:
    """Faintest detectable magnitudes, corrected for air and shadow, at a time; (observer,
    target)."""
    seen = np.repeat(limits.limiting_magnitude[:, None], translation.shape[0], axis=1)
    earth = scene.primaries[index, 0]
    for o in np.flatnonzero(limits.ground):
        site, own = scene.observer_position[o, index], limits_of(limits, o)
        air = [extinction(*site, *(each[:3] - site), earth, own) for each in translation]
        seen[o] -= air
    if eclipse:
        at = slice(index, index + 1)
        place = translation[:, None, :3]
        seen -= dimming(place, scene.sun_position[at], scene.primaries[at])[:, 0]
    return seen


def facet_margins(
    prediction: Prediction,
    starts: NDArray[np.int64],
    stop: int,
    selected: Flags,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensors,
    forces: tuple,
    *,
    eclipse: bool = False,
) -> Array:
    """Limiting magnitude less the magnitude of the targets' facets at the expected attitudes.

    Parameters
    ----------
    prediction : Prediction
        Estimates at the interval's first measurement, with a `rotation`.
    starts : ndarray of int, shape (slot,)
        Steps of the slots' first measurements, counted from there.
    stop : int
        The step at which the last slot ends.
    selected : ndarray of bool, shape (slot, observer, target)
        Pairs to evaluate; other pairs have NaN.
    scene, surfaces, sensor, forces
        See `cislunar.tasking.closed_loop.run_closed_loop`.
    eclipse : bool
        Whether the shadows of Earth and Moon dim targets.

    Returns
    -------
    ndarray, shape (slot, observer, target, sample)
        mag, at the same number of equally weighted times and attitudes in each slot.

    Raises
    ------
    ConfigurationError
        If the force model does not cover the interval, or `sensor` is neither one sensor nor one
        for each observer.
    """
    lengths = np.diff(np.append(starts, stop))
    count = max(1, int(np.ceil(lengths.max() * scene.step_s / _SAMPLE_S - 1e-9)))
    # in the middle of equal parts of each slot
    middle = (np.arange(count) + 0.5) / count
    steps = (starts[:, None] + np.floor(middle * lengths[:, None]).astype(np.int64)).ravel()
    path = propagate_bundle(
        prediction.translation,
        scene.step,
        int(steps.max()),
        forces=forces,
        start=prediction.index * scene.step,
    )
    place, index = np.ascontiguousarray(path[:, steps].swapaxes(0, 1)), prediction.index + steps
    turned = _turned(prediction.rotation, steps * scene.step_s, surfaces)
    shape = steps.size, *selected.shape[1:], turned.shape[1] // steps.size
    margin = np.full(shape, np.nan)
    attitude = turned.reshape(place.shape[1], shape[-1], steps.size, 4).transpose(2, 0, 1, 3)
    _facet_magnitudes(
        index, place, np.ascontiguousarray(attitude), np.repeat(selected, count, axis=0),
        scene, surfaces, margin,
    )  # fmt: skip
    limits = sensor_limits(sensor, selected.shape[1])
    for i, k in enumerate(index):
        margin[i] = _faintest(k, place[i], scene, limits, eclipse)[..., None] - margin[i]
    by_slot = margin.reshape(starts.size, count, *shape[1:])
    return np.moveaxis(by_slot, 1, -1).reshape(*selected.shape, -1)


def _turned(rotation: Rotation, elapsed_s: Array, surfaces: TargetSurfaces) -> Array:
    """Attitudes at the points of a cubature at several times, shape (target, point * time, 4)."""
    n_targets = rotation.quaternion.shape[0]
    # columns of the root times sqrt(6), of either sign
    away = np.sqrt(6.0) * np.swapaxes(rotation.root, 1, 2)
    away = _finite(np.concatenate([away, -away], axis=1))
    n_points = away.shape[1]
    error = grp.to_quaternion(away[..., :3])
    quaternion = compose(error, _finite(rotation.quaternion)[:, None]).reshape(-1, 4)
    rate = (_finite(rotation.angular_velocity)[:, None] + away[..., 3:]).reshape(-1, 3)
    bodies = rigid_bodies(surfaces.inertia)
    bodies = bodies._replace(**{k: np.repeat(v, n_points, 0) for k, v in bodies._asdict().items()})
    times = np.append(0.0, elapsed_s)
    turned = np.empty((n_targets * n_points, times.size, 4))
    forced = np.zeros((n_targets * n_points, 3))
    given = times, bodies, forced, _TURN_TOLERANCE
    propagate_attitudes(*given, quaternion, rate, turned, np.empty((*turned.shape[:2], 3)))
    return turned[:, 1:].reshape(n_targets, -1, 4)


def _finite(values: Array) -> Array:
    """Values with zeros for those of estimates that have failed."""
    return np.where(np.isfinite(values), values, 0.0)


@njit(cache=True, error_model="numpy")
def _facet_magnitudes(index, place, quaternion, selected, scene, surfaces, out):
    """Magnitudes (time, observer, target, point) of the selected pairs, into `out`. `place` (time,
    target, 6), `quaternion` (time, target, point, 4), `selected` (time, observer, target)."""
    block, at = np.empty((BLOCK_ROWS, LANES)), np.empty((LANES, 2), np.int64)
    n_observers, n_points = selected.shape[1], quaternion.shape[2]
    for i in range(index.size):
        k = index[i]
        sun, to_inertial = scene.sun_position[k], scene.frame_axes[k]
        for j in range(place.shape[1]):
            count = 0
            for o in range(n_observers):
                if not selected[i, o, j]:
                    continue
                seen_from = scene.observer_position[o, k]
                light, view, distance, _ = lit_directions(place[i, j], seen_from, sun, to_inertial)
                for p in range(n_points):
                    for c in range(4):
                        block[QUATERNION + c, count] = quaternion[i, j, p, c]
                    block[SUN, count], block[SUN + 1, count], block[SUN + 2, count] = light
                    block[VIEW, count], block[VIEW + 1, count], block[VIEW + 2, count] = view
                    block[RANGE, count] = distance * METERS
                    at[count, 0], at[count, 1] = o, p
                    count += 1
                    if count == LANES:
                        _settle(block, at, count, i, j, surfaces, out)
                        count = 0
            if count > 0:
                _settle(block, at, count, i, j, surfaces, out)


@njit_noalloc
def _settle(block, at, count, i, j, surfaces, out):
    """Magnitudes of target j for the geometries of a block, into `out`."""
    body_magnitudes(
        block, count, body_of(surfaces, j), surfaces.irradiance_4pi, surfaces.fresnel_sqrt
    )
    for c in range(count):
        out[i, at[c, 0], j, at[c, 1]] = block[MAGNITUDE, c]
