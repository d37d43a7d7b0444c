"""Information of all possible observations in the slots of a tasking interval.

The sigma points of every target's position and velocity are propagated to the first measurement of
each slot. In units of the covariance's root at the first one, an observation of target j by
observer o adds G G^T to the information matrix, which begins as identity: with U and S of
`cislunar.estimation.unscented.innovation_moments` and V V^T = S, G is U V^-T. The information of
observations A together is f_j(A) = (1/2) log det(I + sum_{a in A} G_a G_a^T), nats.

Assumptions and limitations
---------------------------
- Process noise between the slots of an interval is neglected.
- A slot is evaluated at its first measurement, as an interval is.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import copy_into, njit_alloc, njit_noalloc
from cislunar.estimation.dispersed_orbits import TRANSLATION_SIZE, carry_points, dispersed_points
from cislunar.estimation.estimator import Prediction
from cislunar.estimation.triangular import cholesky, solve_lower
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors
from cislunar.runtime import Array
from cislunar.tasking.planning.brightness import sphere_margins
from cislunar.tasking.planning.information import (
    TaskingModel,
    constants_of_observer,
    expect_observation,
    tasking_constants,
)


class SlotObservations(NamedTuple):
    """Observations of all pairs in the slots of an interval: `factor` (slot, observer, target, 6,
    2) is G, zero where the target is not observable; `margin` (slot, observer, target) the sensor's
    limit less the magnitude of the sphere that stands for the target; `direction` (slot, observer,
    target, 3) the unit vectors from observer to target, propagation frame."""

    factor: Array
    margin: Array
    direction: Array


@njit_alloc
def observation_scratch():
    """Scratch arrays of `observation_factor`."""
    moments = (
        np.empty((2 * TRANSLATION_SIZE, 2)),
        np.empty(2),
        np.empty((TRANSLATION_SIZE, 2)),
        np.empty((2, 2)),
    )
    return np.empty(3), *moments


@njit_noalloc
def observation_factor(points, o, index, scene, constants, scratch, out):
    """Factor (6, 2) of an observation by observer o at a time, from sigma points (6, 13); zero if
    it is not possible."""
    _, _, _, cross, even = scratch
    geometry = scene.observer_axes[index], scene.sun_position[index], scene.primaries[index]
    observer = scene.observer_position[o, index]
    out[:, :] = 0.0
    if not np.isfinite(np.sum(points)):
        return
    if not expect_observation(
        points, observer, geometry, constants_of_observer(constants, o), *scratch
    ):
        return
    if not cholesky(even):
        return
    for i in range(TRANSLATION_SIZE):
        solve_lower(even, cross[i])
    if np.isfinite(np.sum(cross)):
        copy_into(out, cross)


@njit_alloc
def _factors(index, points, scene, constants, out):
    """Factors (observer, target, 6, 2) of observations at a time, from sigma points (target, 6,
    13)."""
    scratch = observation_scratch()
    for o in range(out.shape[0]):
        for j in range(points.shape[0]):
            observation_factor(points[j], o, index, scene, constants, scratch, out[o, j])


def slot_observations(
    prediction: Prediction,
    starts: NDArray[np.int64],
    scene: Scene,
    sensor: Sensors,
    model: TaskingModel,
    forces: tuple,
    *,
    eclipse: bool = False,
) -> SlotObservations:
    """Observations of all pairs in the slots of an interval, given the estimates at its first
    measurement and the steps of the slots' first measurements, counted from there and rising. See
    `cislunar.tasking.planning.information.pair_information`; ``model.states == "translation"``.
    With `eclipse` the shadows of Earth and Moon dim targets."""
    n_targets, n_observers = prediction.translation.shape[0], scene.observer_position.shape[0]
    shape = starts.size, n_observers, n_targets
    factor, margin = np.empty((*shape, TRANSLATION_SIZE, 2)), np.empty(shape)
    direction = np.empty((*shape, 3))
    points = np.empty((n_targets, TRANSLATION_SIZE, 2 * TRANSLATION_SIZE + 1))
    mean, covariance = (
        np.ascontiguousarray(each) for each in (prediction.translation, prediction.covariance)
    )
    constants, now = tasking_constants(model, sensor, n_observers), 0
    dispersed_points(mean, covariance, constants.weights.spread, points)
    for s, step in enumerate(starts):
        index = prediction.index + int(step)
        carry_points(points, prediction.index + now, int(step) - now, scene.step, forces)
        now = int(step)
        _factors(index, points, scene, constants, factor[s])
        place = np.ascontiguousarray(points[:, :, 0])
        then = prediction._replace(index=index, translation=place)
        margin[s] = sphere_margins(then, scene, sensor, model, eclipse=eclipse)
        if eclipse:
            factor[s][~(margin[s] > (0.0 if model.detection is None else -np.inf))] = 0.0
        way = place[:, :3] - scene.observer_position[:, index, None]
        direction[s] = way / np.linalg.norm(way, axis=-1, keepdims=True)
    return SlotObservations(factor, margin, direction)
