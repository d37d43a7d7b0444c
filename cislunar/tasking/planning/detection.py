"""How likely a look detects a target, learned from what looks found.

A target is brighter or fainter than expected (`cislunar.tasking.planning.brightness`) by a
magnitude that nobody knows beforehand, and flickers about that. The offset b of each target has a
distribution on a grid, at first N(0, prior^2); a look that keeps clear of the bright bodies detects
the target with the probability

    P_d = sum over b of p(b) D(b),    D(b) = mean over m of Phi((limit - m - b) / flicker),

m being the magnitudes expected: that of the sphere at the target's estimated place, or those of its
facets at several times and attitudes. A pair is then worth P_d times its information, and a bonus
while its target has never been detected, so that the best tasking is still a linear assignment.
Empty looks inform like this in the sensor management of random finite sets, too (see
arXiv:2410.02983).

Assumptions and limitations
---------------------------
- The looks of an interval share an attitude: those of one observer at one target count as one
  trial, of which the shares detected and faint are the outcome.
- A target's offset does not change; whether a look was clear of the bright bodies is known.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp, ndtr

from cislunar.compiled import borrowing
from cislunar.observation.measurement import DETECTED, FAINT
from cislunar.tasking.planning.detection_model import DetectionModel

Array = NDArray[np.float64]

_GRID_STEPS_PER_PRIOR = 2
_GRID_PRIORS = 5

_LEAST_CHANCE = 1e-12
"""Of detecting or missing a target, whatever its offset: no outcome is impossible."""

_CERTAIN = 8.5
"""Beyond so many flickers Phi is 0 or 1 but for 1e-17."""

_NODES_PER_FLICKER = 64
"""Of the margins at which chances are tabulated; cubics between them are off by 2e-9 at most."""


class LearnedDetection:
    """What is known of each target's brightness, carried on from epoch to epoch.

    Parameters
    ----------
    model : DetectionModel
    n_targets : int

    Attributes
    ----------
    grid : ndarray, shape (offset,)
        Offsets from what is expected, mag.
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
        # Phi((margin - b) / flicker) at margins out to where all are 0 or 1
        far = self.grid[-1] + _CERTAIN * model.flicker_mag
        half = int(np.ceil(far * _NODES_PER_FLICKER / model.flicker_mag)) + 2
        margin = np.arange(-half, half + 1) * (model.flicker_mag / _NODES_PER_FLICKER)
        self._chances = ndtr((margin[:, None] - self.grid) / model.flicker_mag)

    def detects(self, margin: ArrayLike, wanted: NDArray[np.bool_] | None = None) -> Array:
        """Probability that looks detect their targets, for each offset these may have.

        Parameters
        ----------
        margin : array_like, shape (..., sample)
            The sensor's limit less the magnitude expected, at equally likely times and attitudes;
            NaN counts as never seen.
        wanted : ndarray of bool, shape (...), optional
            Looks to tell of; others have 0.

        Returns
        -------
        ndarray, shape (..., offset)
        """
        margins = np.ascontiguousarray(margin, dtype=float)
        pairs = margins.shape[:-1]
        some = np.ones(pairs, dtype=bool) if wanted is None else wanted
        out = np.zeros((*pairs, self.grid.size))
        _mean_chances(
            margins.reshape(some.size, -1), np.ravel(some), self._chances,
            _NODES_PER_FLICKER / self.model.flicker_mag, out.reshape(some.size, -1),
        )  # fmt: skip
        return out

    def probability(self, detects: Array) -> Array:
        """Probability of detecting each target.

        Parameters
        ----------
        detects : ndarray, shape (observer, target, offset)
            As of `detects`.

        Returns
        -------
        ndarray, shape (observer, target)
        """
        return np.einsum("ojb,jb->oj", detects, np.exp(self.log_weight))

    def chance(self, target: NDArray, detects: Array) -> Array:
        """Probability that looks detect their targets, shape (look,), by `detects` of each."""
        return np.sum(np.exp(self.log_weight[target]) * detects, axis=1)

    def worth(self, information: ArrayLike, detects: Array) -> Array:
        """What every pair is worth to the tasking, nats.

        Parameters
        ----------
        information : array_like, shape (observer, target)
            Of a detection, nats; pairs without any are worth nothing.
        detects : ndarray, shape (observer, target, offset)
            As of `detects`.

        Returns
        -------
        ndarray, shape (observer, target)
        """
        gain = np.asarray(information, dtype=float)
        bonus = self.model.never_detected_bonus * ~self.detected
        return np.where(gain > 0.0, self.probability(detects) * (gain + bonus), 0.0)

    def learn(
        self, target: NDArray, observer: NDArray, fate: NDArray[np.uint8], detects: Array
    ) -> None:
        """Take in what became of the looks of an interval.

        Parameters
        ----------
        target, observer : ndarray of int, shape (look,)
            Of whom, and by whom.
        fate : ndarray of uint8, shape (look,)
            As of `cislunar.observation.measurement`; what was detected has `DETECTED` or above.
        detects : ndarray, shape (observer, target, offset)
            As of `detects`.
        """
        pairs = detects.shape[:2]
        pair, size = observer * pairs[1] + target, pairs[0] * pairs[1]
        hits = np.bincount(pair, fate >= DETECTED, size).reshape(pairs)
        misses = np.bincount(pair, fate == FAINT, size).reshape(pairs)
        self.detected |= hits.any(axis=0)
        for o, j in np.argwhere(hits + misses > 0.0):
            share = hits[o, j] / (hits[o, j] + misses[o, j])
            chance = np.clip(detects[o, j], _LEAST_CHANCE, 1.0 - _LEAST_CHANCE)
            self.log_weight[j] += share * np.log(chance) + (1.0 - share) * np.log1p(-chance)
            self.log_weight[j] -= logsumexp(self.log_weight[j])

    def offset(self) -> tuple[Array, Array]:
        """Mean and standard deviation of each target's offset, mag, shapes (target,)."""
        weight = np.exp(self.log_weight)
        mean = weight @ self.grid
        return mean, np.sqrt(np.maximum(weight @ self.grid**2 - mean**2, 0.0))


@borrowing
def _mean_chances(margin, wanted, chances, nodes_per_mag, out):
    """Mean over samples of the chances at each margin, (look, sample) to (look, offset).

    `chances` (margin, offset) at margins about zero, between which goes a cubic through four.
    """
    middle, last = chances.shape[0] // 2, chances.shape[0] - 3
    for i in range(margin.shape[0]):
        if not wanted[i]:
            continue
        for s in range(margin.shape[1]):
            at = margin[i, s] * nodes_per_mag + middle
            if at >= last:
                for b in range(out.shape[1]):
                    out[i, b] += 1.0
            elif at >= 1.0:
                k = int(at)
                t = at - k
                before = -t * (t - 1.0) * (t - 2.0) / 6.0
                here = (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0
                there = -(t + 1.0) * t * (t - 2.0) / 2.0
                after = (t + 1.0) * t * (t - 1.0) / 6.0
                for b in range(out.shape[1]):
                    out[i, b] += (before * chances[k - 1, b] + here * chances[k, b]) + (
                        there * chances[k + 1, b] + after * chances[k + 2, b]
                    )
        for b in range(out.shape[1]):
            # a cubic may leave the range of what it goes through
            out[i, b] = min(max(out[i, b] / margin.shape[1], 0.0), 1.0)
