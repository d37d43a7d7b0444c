"""What looks in the slots of a tasking interval would tell, before they are chosen.

The sigma points of every target's position and velocity are carried to the first measurement of
each slot, so that all looks speak of the state at the first one, in units of its covariance's root.
There a look at target j from observer o adds G G^T to the information matrix, which begins as
identity: with U and S of `cislunar.estimation.unscented.innovation_moments` and V V^T = S, G is
U V^-T. Looks A together bring

    f_j(A) = (1/2) log det(I + sum_{a in A} G_a G_a^T)

nats, for a single one what `cislunar.tasking.planning.information` says.

Assumptions and limitations
---------------------------
- Process noise between the slots of an interval is left out.
- A slot is judged by its first measurement, as an interval is.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.compiled import allocating, borrowing, put
from cislunar.dynamics.bundle import step_bundle
from cislunar.dynamics.forces import of_state
from cislunar.dynamics.tableau import STAGES8
from cislunar.estimation.estimator import Prediction
from cislunar.estimation.triangular import cholesky, solve_lower
from cislunar.estimation.unscented import sigma_points
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors
from cislunar.tasking.planning.brightness import sphere_margins
from cislunar.tasking.planning.information import (
    TaskingModel,
    belief_of,
    belief_of_one,
    expect_look,
)

Array = NDArray[np.float64]

SIZE = 6


class SlotLooks(NamedTuple):
    """Looks of all pairs in the slots of an interval.

    Attributes
    ----------
    factor : ndarray, shape (slot, observer, target, 6, 2)
        G of a look, zero where the target is not to be seen.
    margin : ndarray, shape (slot, observer, target)
        The sensor's limit less the magnitude of the sphere that stands for the target.
    direction : ndarray, shape (slot, observer, target, 3)
        From observer to target, unit vectors.
    """

    factor: Array
    margin: Array
    direction: Array


@njit(cache=True, error_model="numpy")
def spread_points(mean, covariance, spread, points):
    """Sigma points (target, 6, 13) of all targets; NaN for those without an estimate."""
    root = np.empty((SIZE, SIZE))
    for j in range(mean.shape[0]):
        root[:, :] = covariance[j]
        if np.isfinite(np.sum(mean[j])) and cholesky(root):
            sigma_points(mean[j], root, spread, points[j])
        else:
            points[j, :, :] = np.nan


@njit(cache=True, error_model="numpy")
def _carry(points, index, count, step, forces):
    """Carry sigma points (target, 6, 13) over some steps from time `index` on."""
    slopes, stage = np.empty((STAGES8, SIZE, points.shape[2])), np.empty(points.shape[1:])
    for j in range(points.shape[0]):
        own = of_state(forces, j)
        for k in range(index, index + count):
            step_bundle(own, k * step, points[j], step, slopes, stage)


@allocating
def look_scratch():
    """Scratch arrays of `look_factor`."""
    moments = np.empty((2 * SIZE, 2)), np.empty(2), np.empty((SIZE, 2)), np.empty((2, 2))
    return np.empty(3), *moments


@borrowing
def look_factor(points, o, index, scene, belief, scratch, out):
    """Factor (6, 2) of a look of observer o at a time, from sigma points (6, 13); zero for none."""
    _, _, _, cross, even = scratch
    sky = scene.observer_axes[index], scene.sun_position[index], scene.primaries[index]
    observer = scene.observer_position[o, index]
    out[:, :] = 0.0
    if not np.isfinite(np.sum(points)):
        return
    if not expect_look(points, observer, sky, belief_of_one(belief, o), *scratch):
        return
    if not cholesky(even):
        return
    for i in range(SIZE):
        solve_lower(even, cross[i])
    if np.isfinite(np.sum(cross)):
        put(out, cross)


@allocating
def _factors(index, points, scene, belief, out):
    """Factors (observer, target, 6, 2) of looks at a time, from sigma points (target, 6, 13)."""
    scratch = look_scratch()
    for o in range(out.shape[0]):
        for j in range(points.shape[0]):
            look_factor(points[j], o, index, scene, belief, scratch, out[o, j])


def slot_looks(
    prediction: Prediction,
    starts: NDArray[np.int64],
    scene: Scene,
    sensor: Sensors,
    model: TaskingModel,
    forces: tuple,
    *,
    eclipse: bool = False,
) -> SlotLooks:
    """Looks of all pairs in the slots of an interval.

    Parameters
    ----------
    prediction : Prediction
        Estimates at the interval's first measurement.
    starts : ndarray of int, shape (slot,)
        Steps of the slots' first measurements, counted from there and rising.
    scene, sensor, model
        As for `cislunar.tasking.planning.information.pair_information`, with
        ``model.states == "translation"``.
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.
    eclipse : bool
        Whether the shadows of Earth and Moon dim targets.

    Returns
    -------
    SlotLooks
    """
    n_targets, n_observers = prediction.translation.shape[0], scene.observer_position.shape[0]
    shape = starts.size, n_observers, n_targets
    factor, margin = np.empty((*shape, SIZE, 2)), np.empty(shape)
    direction = np.empty((*shape, 3))
    points = np.empty((n_targets, SIZE, 2 * SIZE + 1))
    mean, covariance = (
        np.ascontiguousarray(each) for each in (prediction.translation, prediction.covariance)
    )
    belief, now = belief_of(model, sensor, n_observers), 0
    spread_points(mean, covariance, belief.six.spread, points)
    for s, step in enumerate(starts):
        index = prediction.index + int(step)
        _carry(points, prediction.index + now, int(step) - now, scene.step, forces)
        now = int(step)
        _factors(index, points, scene, belief, factor[s])
        place = np.ascontiguousarray(points[:, :, 0])
        then = prediction._replace(index=index, translation=place)
        margin[s] = sphere_margins(then, scene, sensor, model, eclipse=eclipse)
        if eclipse:
            factor[s][~(margin[s] > (0.0 if model.detection is None else -np.inf))] = 0.0
        way = place[:, :3] - scene.observer_position[:, index, None]
        direction[s] = way / np.linalg.norm(way, axis=-1, keepdims=True)
    return SlotLooks(factor, margin, direction)
