"""Correction of measured magnitudes for the shadows of Earth and Moon.

A magnitude measured in a penumbra is fainter by the dimming -2.5 log10(nu) with the visible share
nu of the Sun's disc (`cislunar.observation.sightline.sunlit_share`), which depends on the position.
The true position is not known. The dimming is therefore expected from the prediction at the
beginning of the interval: from the points x +- sqrt(6) P_i with the columns P_i of the Cholesky
factor of the covariance of position and velocity, propagated to the time of the measurement, each
with the weight 1/12 (the cubature rule of third degree; I. Arasaratnam and S. Haykin, IEEE
Transactions on Automatic Control 54, 2009, eq. 32). Their mean is subtracted from the magnitude and
their variance is added to its variance, so that a measurement near the edge of a shadow counts as
uncertain.

Assumptions and limitations
---------------------------
- The prediction lacks the measurements of the interval and process noise within it.
- The dimming is at most 5 mag, since a detected target is not in the umbra.
- Errors of the dimming at consecutive times are correlated, but count as independent.
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.dynamics.forces import of_targets
from cislunar.estimation.dispersed_orbits import TRANSLATION_SIZE, carry_points, dispersed_points
from cislunar.estimation.estimator import Prediction
from cislunar.observation.records import Measurements, rows_of
from cislunar.observation.scene import Scene
from cislunar.observation.sightline import sunlit_share
from cislunar.runtime import Array

_LEAST_SHARE = 0.01
"""Visible share of the Sun's disc at the largest dimming, 5 mag."""


def expected_dimming(
    prediction: Prediction,
    targets: NDArray[np.int64],
    n_steps: int,
    scene: Scene,
    forces: tuple,
) -> tuple[Array, Array]:
    """Mean and variance of the dimming of targets by shadows, given their estimates.

    Parameters
    ----------
    prediction : Prediction
        Estimates of all targets at the first of the times.
    targets : ndarray of int, shape (n,)
        Targets.
    n_steps : int
        Number of the scene's times from ``prediction.index`` on.
    scene : Scene
        Sun, Earth and Moon.
    forces : tuple
        Assumed force model of all targets.

    Returns
    -------
    mean, variance : ndarray, shape (n, n_steps)
        Magnitude and its square. Both are exactly zero if every point is in full light, and for an
        estimate that has ended.
    """
    here = slice(prediction.index, prediction.index + n_steps)
    points = np.empty((targets.size, TRANSLATION_SIZE, 2 * TRANSLATION_SIZE + 1))
    mean, covariance = prediction.translation[targets], prediction.covariance[targets]
    dispersed_points(mean, covariance, np.sqrt(float(TRANSLATION_SIZE)), points)
    own = of_targets(forces, targets)
    place = np.empty((targets.size, 2 * TRANSLATION_SIZE, n_steps, 3))
    for i in range(n_steps):
        if i > 0:
            carry_points(points, prediction.index + i - 1, 1, scene.step, own)
        place[:, :, i] = points[:, :3, 1:].swapaxes(1, 2)
    sky = scene.sun_position[here], scene.primaries[here]
    share = sunlit_share(place.reshape(-1, n_steps, 3), *sky).reshape(place.shape[:3])
    share = np.where(np.isfinite(share), share, 1.0)
    dimmed = -2.5 * np.log10(np.maximum(share, _LEAST_SHARE)) + 0.0
    return dimmed.mean(axis=1), dimmed.var(axis=1)


def without_dimming(
    measurements: Measurements, prediction: Prediction, scene: Scene, forces: tuple
) -> tuple[Measurements, NDArray[np.bool_]]:
    """The measurements of an interval, corrected for the expected dimming by shadows.

    Parameters
    ----------
    measurements : Measurements
        Observations with magnitudes as they are measured, those of the first step at
        ``prediction.index``.
    prediction, scene, forces
        See `expected_dimming`.

    Returns
    -------
    Measurements
        Magnitudes less the expected dimming, with its variance added to theirs.
    shaded : ndarray of bool, shape (row,)
        Whether the target of an observation may be in a shadow.
    """
    target, step = rows_of(measurements)
    tasked, at = np.unique(target, return_inverse=True)
    n_steps = measurements.offset.shape[1] - 1
    mean, variance = expected_dimming(prediction, tasked, n_steps, scene, forces)
    value, noise = measurements.value.copy(), measurements.variance.copy()
    value[:, 0] -= mean[at, step]
    noise[:, 0] += variance[at, step]
    return measurements._replace(value=value, variance=noise), mean[at, step] > 0.0
