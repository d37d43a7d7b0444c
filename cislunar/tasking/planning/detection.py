"""How likely a look detects a target, learned from what looks found.

A sphere stands for a target when tasking judges who can see it. Its facets make the target itself
brighter or fainter than the sphere by a magnitude that nobody knows beforehand, and let it flicker
about that. The offset b of each target has a distribution on a grid, at first N(0, prior^2); a look
that keeps clear of the bright bodies detects the target with the probability

    P_d = sum over b of p(b) Phi((limit - m - b) / flicker),

m being the magnitude of the sphere at the target's estimated place. A pair is then worth P_d times
its information, and a bonus while its target has never been detected, so that the best tasking is
still a linear assignment. Empty looks inform like this in the sensor management of random finite
sets, too (see arXiv:2410.02983).

Assumptions and limitations
---------------------------
- The looks of an interval share an attitude: those of one observer at one target count as one
  trial, of which the shares detected and faint are the outcome.
- A target's offset does not change; whether a look was clear of the bright bodies is known.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, logsumexp, ndtr

from cislunar.estimation.estimator import Prediction
from cislunar.observation.measurement import DETECTED, FAINT
from cislunar.observation.scene import Scene
from cislunar.observation.sightline import METRES
from cislunar.photometry.sphere import phase_angle, sphere_magnitude
from cislunar.tasking.planning.detection_model import DetectionModel

Array = NDArray[np.float64]

_GRID_STEPS_PER_PRIOR = 4
_GRID_PRIORS = 5


def sphere_magnitudes(
    prediction: Prediction, scene: Scene, *, radius_m: float, diffuse_reflection_coefficient: float
) -> Array:
    """Magnitude of the sphere that stands for a target, to every observer.

    Parameters
    ----------
    prediction : Prediction
        Estimates at the time of the look.
    scene : Scene
    radius_m, diffuse_reflection_coefficient : float
        As of `cislunar.photometry.sphere.sphere_magnitude`.

    Returns
    -------
    ndarray, shape (observer, target)
        Infinite for an unlit sphere, NaN for a target without an estimate.
    """
    place = prediction.translation[:, :3]
    way = place - scene.observer_position[:, prediction.index, None]
    return sphere_magnitude(
        np.linalg.norm(way, axis=-1) * METRES,
        phase_angle(way, place - scene.sun_position[prediction.index]),
        radius_m=radius_m,
        diffuse_reflection_coefficient=diffuse_reflection_coefficient,
    )


class LearnedDetection:
    """What is known of each target's brightness, carried on from epoch to epoch.

    Parameters
    ----------
    model : DetectionModel
    n_targets : int

    Attributes
    ----------
    grid : ndarray, shape (offset,)
        Offsets from the sphere, mag.
    log_weight : ndarray, shape (target, offset)
        Logarithms of their probabilities.
    detected : ndarray of bool, shape (target,)
        Whether any look has detected the target.
    """

    def __init__(self, model: DetectionModel, n_targets: int) -> None:
        half = _GRID_STEPS_PER_PRIOR * _GRID_PRIORS
        standard = np.arange(-half, half + 1) / _GRID_STEPS_PER_PRIOR
        self.model = model
        self.grid = model.prior_mag * standard
        prior = -0.5 * standard**2
        self.log_weight = np.tile(prior - logsumexp(prior), (n_targets, 1))
        self.detected = np.zeros(n_targets, dtype=bool)

    def probability(self, margin: ArrayLike, wanted: NDArray[np.bool_] | None = None) -> Array:
        """Probability of detecting each target.

        Parameters
        ----------
        margin : array_like, shape (observer, target)
            The sensor's limit less the sphere's magnitude; NaN counts as never seen.
        wanted : ndarray of bool, shape (observer, target), optional
            Pairs to tell of; others have 0.

        Returns
        -------
        ndarray, shape (observer, target)
        """
        margins = np.asarray(margin, dtype=float)
        chance, weight = np.zeros(margins.shape), np.exp(self.log_weight)
        some = ~np.isnan(margins) if wanted is None else wanted & ~np.isnan(margins)
        # an observer at a time: with all at once, memory would grow with their product
        for own, out, now in zip(margins, chance, some, strict=True):
            out[now] = np.sum(weight[now] * ndtr(self._excess(own[now])), axis=1)
        return chance

    def chance(self, target: NDArray, margin: ArrayLike) -> Array:
        """Probability that looks detect their targets, given target and margin, shape (look,)."""
        limit = np.where(np.isnan(margin), -np.inf, np.asarray(margin, dtype=float))
        return np.sum(np.exp(self.log_weight[target]) * ndtr(self._excess(limit)), axis=1)

    def _excess(self, margin: Array) -> Array:
        """Standard deviations by which offsets keep a look above the limit, (..., offset)."""
        return (margin[..., None] - self.grid) / self.model.flicker_mag

    def worth(self, information: ArrayLike, margin: ArrayLike) -> Array:
        """What every pair is worth to the tasking, nats.

        Parameters
        ----------
        information : array_like, shape (observer, target)
            Of a detection, nats; pairs without any are worth nothing.
        margin : array_like, shape (observer, target)
            As of `probability`.

        Returns
        -------
        ndarray, shape (observer, target)
        """
        gain = np.asarray(information, dtype=float)
        bonus = self.model.never_detected_bonus * ~self.detected
        return np.where(gain > 0.0, self.probability(margin, gain > 0.0) * (gain + bonus), 0.0)

    def learn(
        self, target: NDArray, observer: NDArray, fate: NDArray[np.uint8], margin: Array
    ) -> None:
        """Take in what became of the looks of an interval.

        Parameters
        ----------
        target, observer : ndarray of int, shape (look,)
            Of whom, and by whom.
        fate : ndarray of uint8, shape (look,)
            As of `cislunar.observation.measurement`; what was detected has `DETECTED` or above.
        margin : ndarray, shape (observer, target)
            As of `probability`.
        """
        n_observers, n_targets = margin.shape
        pair, size = observer * n_targets + target, n_observers * n_targets
        hits = np.bincount(pair, fate >= DETECTED, size).reshape(margin.shape)
        misses = np.bincount(pair, fate == FAINT, size).reshape(margin.shape)
        self.detected |= hits.any(axis=0)
        for o, j in np.argwhere((hits + misses > 0.0) & np.isfinite(margin)):
            share = hits[o, j] / (hits[o, j] + misses[o, j])
            excess = self._excess(margin[o, j])
            found = share * log_ndtr(excess) + (1.0 - share) * log_ndtr(-excess)
            self.log_weight[j] += found
            self.log_weight[j] -= logsumexp(self.log_weight[j])

    def offset(self) -> tuple[Array, Array]:
        """Mean and standard deviation of each target's offset, mag, shapes (target,)."""
        weight = np.exp(self.log_weight)
        mean = weight @ self.grid
        return mean, np.sqrt(np.maximum(weight @ self.grid**2 - mean**2, 0.0))
