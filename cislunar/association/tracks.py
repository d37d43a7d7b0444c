"""Status of tracks: tentative, confirmed, lost or deleted, by the probability that they exist.

A track has a probability of existence r. An exposure that should have detected it with probability
P_D and did not lowers it (Musicki, Evans & Stankovic 1994, IEEE Transactions on Automatic Control
39, 1237),

    r <- r l / (1 - r + r l),   l = 1 - P_D P_G,

and a detection that the association accepts brings it close to one.

The exposures of a window are not independent, since a target that is dark in one is dark in the
next. The misses of a window therefore count once, with the largest detection probability among
them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.association.window import Association, Window
from cislunar.runtime import Array

TENTATIVE, CONFIRMED, LOST, DELETED = range(4)
TRACK_STATUS_NAMES = ("tentative", "confirmed", "lost", "deleted")

_CONFIRMED, _LOST, _DELETED = 0.95, 0.05, 1e-5
"""Probabilities of existence from which a track is confirmed, and below which a confirmed one is
lost or a tentative one deleted."""

_RANGE = 1e-6
"""A probability of existence stays this far from 0 and 1, so that it can change again."""


class TrackStatus(NamedTuple):
    """Status of tracks, whose arrays change in place.

    Attributes
    ----------
    existence : ndarray, shape (track,)
        Probability that the track is of an object.
    status : ndarray of uint8, shape (track,)
        TENTATIVE, CONFIRMED, LOST or DELETED.
    last : ndarray of int, shape (track,)
        Step of the last detection; -1 before the first.
    """

    existence: Array
    status: NDArray[np.uint8]
    last: NDArray[np.int64]

    def update(
        self,
        window: Window,
        rows: Association,
        begin: int,
        step: NDArray[np.int64],
        committed: int,
    ) -> None:
        """Use the associations of a window.

        Parameters
        ----------
        window : Window
        rows : Association
            Detections that tracks have taken.
        begin : int
            First step of the window.
        step : ndarray of int, shape (exposure,)
            Step of each exposure in the window.
        committed : int
            Steps of the window that are decided.
        """
        decided = step[window.seen[:, 0]] < committed
        miss = np.zeros(self.existence.size)
        np.minimum.at(miss, window.seen[decided, 1], window.log_miss[decided])
        weight = np.zeros(self.existence.size)
        np.add.at(weight, rows.track, rows.weight)
        hit = weight > 0.5
        # an accepted detection leads from the smallest to the largest probability
        ratio = np.where(hit, _RANGE**-2, np.exp(miss))
        r = self.existence
        r[:] = np.clip(r * ratio / (1.0 - r + r * ratio), _RANGE, 1.0 - _RANGE)
        np.maximum.at(self.last, rows.track, begin + step[rows.exposure])
        status = self.status
        status[r >= _CONFIRMED] = CONFIRMED
        status[(r < _LOST) & (status == CONFIRMED)] = LOST
        status[(r < _DELETED) & (status == TENTATIVE)] = DELETED


def known_tracks(n_tracks: int) -> TrackStatus:
    """Confirmed tracks of a catalog, before their first detection.

    Parameters
    ----------
    n_tracks : int
    """
    return TrackStatus(
        np.full(n_tracks, 1.0 - _RANGE),
        np.full(n_tracks, CONFIRMED, dtype=np.uint8),
        np.full(n_tracks, -1, dtype=np.int64),
    )
