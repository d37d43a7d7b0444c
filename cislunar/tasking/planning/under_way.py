"""What tasking may count on before it has come: looks taken and not yet received.

Nobody knows yet what they measured, but how much they will tell does not depend on that: the
information of a look is that of its geometry, and of the chance that it detected its target. With L
the root of the covariance now, and G the look's derivative in units of L and of its noise (see
`cislunar.tasking.planning.looks`), taken where the target was then,

    P+ = L (I + sum P_d G G^T)^-1 L^T

is what will be known of the state now once all of them have come. The estimate itself stays.

Assumptions and limitations
---------------------------
- Process noise between look and now is left out.
- Every look counts, by the mean of its outcomes: more than it is worth where detection is unsure.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.dynamics.bundle import step_bundle
from cislunar.dynamics.forces import of_state
from cislunar.dynamics.tableau import STAGES8
from cislunar.estimation.estimator import Prediction
from cislunar.estimation.triangular import cholesky, solve_lower
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors
from cislunar.tasking.planning.information import TaskingModel, belief_of
from cislunar.tasking.planning.looks import SIZE, look_factor, look_scratch, spread_points


class PlannedLooks(NamedTuple):
    """Looks that were commanded; arrays, shape (look,).

    Attributes
    ----------
    index : ndarray of int
        Of the time in the scene.
    target, observer : ndarray of int
    chance : ndarray
        Probability that it detects its target, as far as brightness goes.
    """

    index: NDArray[np.int64]
    target: NDArray[np.int64]
    observer: NDArray[np.int64]
    chance: NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def _gather(now, looks, points, scene, belief, forces, matrix):
    """Add the looks to the information matrices (target, 6, 6), the latest first of each target.

    The sigma points (target, 6, 13), those of time `now`, are carried back on the way.
    """
    slopes, stage = np.empty((STAGES8, SIZE, points.shape[2])), np.empty(points.shape[1:])
    factor, scratch = np.empty((SIZE, 2)), look_scratch()
    at = np.full(points.shape[0], now)
    for look in range(looks.index.size):
        j, k = looks.target[look], looks.index[look]
        own = of_state(forces, j)
        while at[j] > k:
            step_bundle(own, at[j] * scene.step, points[j], -scene.step, slopes, stage)
            at[j] -= 1
        look_factor(points[j], looks.observer[look], k, scene, belief, scratch, factor)
        for a in range(SIZE):
            for b in range(SIZE):
                told = factor[a, 0] * factor[b, 0] + factor[a, 1] * factor[b, 1]
                matrix[j, a, b] += looks.chance[look] * told


@njit(cache=True, error_model="numpy")
def _shrink(covariance, matrix):
    """Replace covariances (target, 6, 6) by what is left after information in units of their roots.

    With C C^T = I + M what is left is (C^-1 L^T)^T (C^-1 L^T).
    """
    for j in range(covariance.shape[0]):
        if not np.any(matrix[j]):
            continue
        root, own = covariance[j].copy(), matrix[j].copy()
        for a in range(SIZE):
            own[a, a] += 1.0
        if not (cholesky(root) and cholesky(own)):
            continue
        for a in range(SIZE):
            solve_lower(own, root[a])
        covariance[j] = root @ root.T


def credited(
    prediction: Prediction,
    looks: PlannedLooks,
    scene: Scene,
    sensor: Sensors,
    model: TaskingModel,
    forces: tuple,
) -> Prediction:
    """What will be known of position and velocity once looks under way have come.

    Parameters
    ----------
    prediction : Prediction
        Estimates at the next measurement time, by what has been received.
    looks : PlannedLooks
        Before that time.
    scene, sensor, model
        As for `cislunar.tasking.planning.information.pair_information`.
    forces : NamedTuple
        Force model, see `cislunar.dynamics.forces`.

    Returns
    -------
    Prediction
        The same with smaller covariances of the translation, and without a joint root.
    """
    order = np.lexsort((looks.observer, -looks.index))
    in_order = PlannedLooks(*(column[order] for column in looks))
    covariance = np.array(prediction.covariance)
    n_targets, belief = (
        covariance.shape[0],
        belief_of(model, sensor, scene.observer_position.shape[0]),
    )
    points = np.empty((n_targets, SIZE, 2 * SIZE + 1))
    mean = np.ascontiguousarray(prediction.translation)
    spread_points(mean, covariance, belief.six.spread, points)
    matrix = np.zeros((n_targets, SIZE, SIZE))
    given = points, scene, belief, forces, matrix
    _gather(prediction.index, in_order, *given)
    _shrink(covariance, matrix)
    return prediction._replace(covariance=covariance, root=None)
