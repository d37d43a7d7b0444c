"""Probability that an observation detects a target, learned from detection outcomes.

The magnitude of a target differs from the expected one by an unknown offset and by a random
flicker; docs/tasking.md defines the model and the value of a pair. Non-detections are informative
in the same way in the sensor management of random finite sets (see arXiv:2410.02983).

Assumptions and limitations
---------------------------
- The observations of an interval share an attitude: those of one target by one observer count as
  one trial, whose outcome is the shares detected and faint.
- A target's offset does not change. Whether an observation was clear of the bright bodies is known.
- Pending trials (outcome not received) change the bonus of a first detection only. Given that none
  of them detects the target, further observations are as likely to detect it as without them.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp, ndtr

from cislunar.compiled import njit_noalloc
from cislunar.observation.measurement import DETECTED, FAINT
from cislunar.runtime import Array
from cislunar.tasking.planning.detection_model import DetectionModel

_GRID_STEPS_PER_PRIOR = 2
_GRID_PRIORS = 5

_LEAST_PROBABILITY = 1e-12
"""Of detecting or missing a target, whatever its offset: no outcome is impossible."""

_CERTAIN = 8.5
"""Number of flickers beyond which Phi is 0 or 1 within 1e-17."""

_NODES_PER_FLICKER = 64
"""Number of margins per flicker at which probabilities are tabulated; the error of the cubic
interpolation is at most 2e-9."""


class LearnedDetection:
    """Learned brightness of each target, updated from epoch to epoch.

    Attributes
    ----------
    grid : ndarray, shape (offset,)
        Offsets from the expected magnitude, mag.
    log_weight : ndarray, shape (target, offset)
        Logarithms of their probabilities.
    detected : ndarray of bool, shape (target,)
        Whether any observation has detected the target.
    """

    def __init__(self, model: DetectionModel, n_targets: int) -> None:
        half = _GRID_STEPS_PER_PRIOR * _GRID_PRIORS
        standard = np.arange(-half, half + 1) / _GRID_STEPS_PER_PRIOR
        self.model = model
        self.grid = model.prior_mag * standard
        prior = -0.5 * standard**2
        self.log_weight = np.tile(prior - logsumexp(prior), (n_targets, 1))
        self.detected = np.zeros(n_targets, dtype=bool)
        self._missed = np.ones_like(self.log_weight)
        # Phi((margin - b) / flicker) at margins out to where all are 0 or 1
        far = self.grid[-1] + _CERTAIN * model.flicker_mag
        half = int(np.ceil(far * _NODES_PER_FLICKER / model.flicker_mag)) + 2
        margin = np.arange(-half, half + 1) * (model.flicker_mag / _NODES_PER_FLICKER)
        self._table = ndtr((margin[:, None] - self.grid) / model.flicker_mag)

    def detects(self, margin: ArrayLike, selected: NDArray[np.bool_] | None = None) -> Array:
        """Probability that observations detect their targets, for each possible offset, (...,
        offset). `margin` (..., sample) is the sensor's limit less the expected magnitude, at
        equally likely times and attitudes; NaN counts as never detected. Observations not
        `selected` (...) have 0."""
        margins = np.ascontiguousarray(margin, dtype=float)
        pairs = margins.shape[:-1]
        some = np.ones(pairs, dtype=bool) if selected is None else selected
        out = np.zeros((*pairs, self.grid.size))
        _mean_probabilities(
            margins.reshape(some.size, -1), np.ravel(some), self._table,
            _NODES_PER_FLICKER / self.model.flicker_mag, out.reshape(some.size, -1),
        )  # fmt: skip
        return out

    def probability(self, detects: Array) -> Array:
        """Probability of detecting each target, shape (observer, target), from `detects`."""
        return np.einsum("ojb,jb->oj", detects, np.exp(self.log_weight))

    def probability_at(self, target: NDArray, detects: Array) -> Array:
        """Probability that observations detect their targets, shape (row,), from each one's
        `detects`."""
        return np.sum(np.exp(self.log_weight[target]) * detects, axis=1)

    def pair_values(self, information: ArrayLike, detects: Array) -> Array:
        """Value of every pair for tasking (observer, target), nats, given the information of a
        detection, nats, and `detects` (observer, target, offset). Pairs without information have no
        value."""
        gain = np.asarray(information, dtype=float)
        return np.where(gain > 0.0, self.probability(detects) * (gain + self.bonus()), 0.0)

    def bonus(self) -> Array:
        """Value of a first detection, nats, shape (target,): `never_detected_bonus` times the
        probability that no pending trial detects the target; 0 for detected targets."""
        found = np.sum(np.exp(self.log_weight) * (1.0 - self._missed), axis=1)
        return self.model.never_detected_bonus * ~self.detected * np.maximum(1.0 - found, 0.0)

    def expect(self, trials: Iterable[tuple[NDArray, Array]]) -> None:
        """State all pending trials: for each interval their targets, shape (trial,), and their
        `detects` (trial, offset)."""
        self._missed = np.ones_like(self.log_weight)
        for target, detects in trials:
            np.multiply.at(self._missed, target, 1.0 - detects)

    def learn(
        self, target: NDArray, observer: NDArray, outcome: NDArray[np.uint8], detects: Array
    ) -> None:
        """Update the offsets with the outcomes of the observations of an interval, shape (row,),
        see `cislunar.observation.measurement`; detected targets have `DETECTED` or above. `detects`
        has the shape (observer, target, offset)."""
        pairs = detects.shape[:2]
        pair, size = observer * pairs[1] + target, pairs[0] * pairs[1]
        hits = np.bincount(pair, outcome >= DETECTED, size).reshape(pairs)
        misses = np.bincount(pair, outcome == FAINT, size).reshape(pairs)
        self.detected |= hits.any(axis=0)
        for o, j in np.argwhere(hits + misses > 0.0):
            share = hits[o, j] / (hits[o, j] + misses[o, j])
            clipped = np.clip(detects[o, j], _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY)
            self.log_weight[j] += share * np.log(clipped) + (1.0 - share) * np.log1p(-clipped)
            self.log_weight[j] -= logsumexp(self.log_weight[j])

    def offset(self) -> tuple[Array, Array]:
        """Mean and standard deviation of each target's offset, mag, shapes (target,)."""
        weight = np.exp(self.log_weight)
        mean = weight @ self.grid
        return mean, np.sqrt(np.maximum(weight @ self.grid**2 - mean**2, 0.0))


@njit_noalloc
def _mean_probabilities(margin, selected, table, nodes_per_mag, out):
    """Mean over samples of the probabilities at each margin, (row, sample) to (row, offset).
    `table` (margin, offset) has equidistant margins about zero; the interpolation is cubic."""
    middle, last = table.shape[0] // 2, table.shape[0] - 3
    for i in range(margin.shape[0]):
        if not selected[i]:
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
                    out[i, b] += (before * table[k - 1, b] + here * table[k, b]) + (
                        there * table[k + 1, b] + after * table[k + 2, b]
                    )
        for b in range(out.shape[1]):
            # a cubic may leave the range of its nodes
            out[i, b] = min(max(out[i, b] / margin.shape[1], 0.0), 1.0)
