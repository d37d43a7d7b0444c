"""Rule by which a linked orbit is confirmed."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.orbit_determination.verdicts import ORBIT
from cislunar.runtime.settings_fields import Count, Number, Section, setting


class ConfirmationRule(Section):
    """When a linked orbit is confirmed; otherwise it stays a candidate.

    A confirmed orbit is the only one that its detections permit, all directions of state space are
    determined, and its likelihood ratio is large enough. It also has tracklets of at least
    `observers_alone` observers, or it has at least `tracklets` tracklets, and at least
    `observers` observers with `tracklets_each` of them each.
    """

    # fmt: off

    observers_alone: Count = setting(
        "number of observers that is sufficient", "1", default=3)
    observers: Count = setting(
        "number of observers with several tracklets each that is sufficient", "1", default=2)
    tracklets_each: Count = setting("tracklets that each of these needs", "1", default=2)
    tracklets: Count = setting("tracklets that these need in all", "1", default=5)
    least_log_ratio: Number = setting(
        "least logarithm of the likelihood ratio to false alarms", "1", default=10)

    # fmt: on

    def confirms(self, observers: ArrayLike, verdict: str, log_ratio: float) -> bool:
        """Whether an orbit is confirmed.

        Parameters
        ----------
        observers : array_like of int, shape (tracklet,)
            Observers of its tracklets.
        verdict : str
            See `cislunar.orbit_determination.verdicts`.
        log_ratio : float
            Score of the orbit (`cislunar.orbit_determination.scores`).
        """
        counts: NDArray[np.int64] = np.unique(np.asarray(observers), return_counts=True)[1]
        several = counts >= self.tracklets_each
        enough = counts.size >= self.observers_alone or (
            np.count_nonzero(several) >= self.observers and counts.sum() >= self.tracklets
        )
        return bool(enough and verdict == ORBIT and log_ratio >= self.least_log_ratio)
