"""Expected update of the estimates by pending measurements (taken, not yet received).

The information of pending measurements does not depend on their values. With the root L of the
present covariance, and the derivative G of an observation in units of L and of its noise
(`cislunar.tasking.planning.slot_observations`), the covariance once all of them are received is
P+ = L (I + sum P_d G G^T)^-1 L^T. The mean stays.

Assumptions and limitations
---------------------------
- Process noise between an observation and the present is neglected.
- Every observation counts by the mean over its outcomes, which exceeds its value if detection is
  uncertain.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import njit
from cislunar.dynamics.bundle import step_bundle
from cislunar.dynamics.forces import of_state
from cislunar.dynamics.tableau import STAGES8
from cislunar.estimation.dispersed_orbits import TRANSLATION_SIZE, dispersed_points
from cislunar.estimation.estimator import Prediction
from cislunar.estimation.triangular import cholesky, solve_lower
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors
from cislunar.tasking.planning.information import TaskingModel, tasking_constants
from cislunar.tasking.planning.slot_observations import observation_factor, observation_scratch


class PlannedObservations(NamedTuple):
    """Commanded observations of one measurement each, arrays (row,): `index` of the time in the
    scene, `target`, `observer`, and the `probability` that the observation detects its target, as
    far as brightness is concerned."""

    index: NDArray[np.int64]
    target: NDArray[np.int64]
    observer: NDArray[np.int64]
    probability: NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def _add_information(now, observations, points, scene, constants, forces, matrix):
    """Add the observations to the information matrices (target, 6, 6), latest first for each
    target. The sigma points (target, 6, 13) at time `now` are propagated backward."""
    slopes = np.empty((STAGES8, TRANSLATION_SIZE, points.shape[2]))
    stage = np.empty(points.shape[1:])
    factor, scratch = np.empty((TRANSLATION_SIZE, 2)), observation_scratch()
    at = np.full(points.shape[0], now)
    for observation in range(observations.index.size):
        j, k = observations.target[observation], observations.index[observation]
        own = of_state(forces, j)
        while at[j] > k:
            step_bundle(own, at[j] * scene.step, points[j], -scene.step, slopes, stage)
            at[j] -= 1
        observation_factor(
            points[j], observations.observer[observation], k, scene, constants, scratch, factor
        )
        for a in range(TRANSLATION_SIZE):
            for b in range(TRANSLATION_SIZE):
                product = factor[a, 0] * factor[b, 0] + factor[a, 1] * factor[b, 1]
                matrix[j, a, b] += observations.probability[observation] * product


@njit(cache=True, error_model="numpy")
def _shrink(covariance, matrix):
    """Replace covariances (target, 6, 6) by those after the information in units of their roots.
    With C C^T = I + M the result is (C^-1 L^T)^T (C^-1 L^T)."""
    for j in range(covariance.shape[0]):
        if not np.any(matrix[j]):
            continue
        root, own = covariance[j].copy(), matrix[j].copy()
        for a in range(TRANSLATION_SIZE):
            own[a, a] += 1.0
        if not (cholesky(root) and cholesky(own)):
            continue
        for a in range(TRANSLATION_SIZE):
            solve_lower(own, root[a])
        covariance[j] = root @ root.T


def expected_update(
    prediction: Prediction,
    observations: PlannedObservations,
    scene: Scene,
    sensor: Sensors,
    model: TaskingModel,
    forces: tuple,
) -> Prediction:
    """Prediction after the expected update by pending measurements.

    Parameters
    ----------
    prediction : Prediction
        Estimates at the next measurement time, from the received measurements.
    observations : PlannedObservations
        Pending observations before that time.
    scene, sensor, model
        See `cislunar.tasking.planning.information.pair_information`. ``model.measurements`` does
        not matter, since each row is one measurement.
    forces : NamedTuple
        Assumed force model, see `cislunar.dynamics.forces`.

    Returns
    -------
    Prediction
        With smaller covariances of the translation, and without a joint root.

    Raises
    ------
    ConfigurationError
        If `sensor` is neither one sensor nor one for each observer.
    """
    order = np.lexsort((observations.observer, -observations.index))
    in_order = PlannedObservations(*(column[order] for column in observations))
    covariance = np.array(prediction.covariance)
    n_targets = covariance.shape[0]
    constants = tasking_constants(model, sensor, scene.observer_position.shape[0])
    constants = constants._replace(measurements=1.0)
    points = np.empty((n_targets, TRANSLATION_SIZE, 2 * TRANSLATION_SIZE + 1))
    mean = np.ascontiguousarray(prediction.translation)
    dispersed_points(mean, covariance, constants.weights.spread, points)
    matrix = np.zeros((n_targets, TRANSLATION_SIZE, TRANSLATION_SIZE))
    given = points, scene, constants, forces, matrix
    _add_information(prediction.index, in_order, *given)
    _shrink(covariance, matrix)
    return prediction._replace(covariance=covariance, root=None)
