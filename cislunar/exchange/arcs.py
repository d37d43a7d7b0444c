"""Conversion of arcs between the rotating frame and the messages and tables of
`cislunar.exchange`."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.ephemeris.time_scales import tdb_after, tdb_since
from cislunar.exchange.inertial import Epoch, inertial_covariances, inertial_states, rotating_states
from cislunar.exchange.oem import Segment

Array = NDArray[np.float64]

COMMENTS = (
    "States of the circular restricted three-body problem of Earth and Moon,",
    f"mass ratio {MU}, distance {LENGTH_UNIT_KM} km, unit of time {TIME_UNIT_S:.6f} s.",
    "At the epoch of the run x points from the Earth to the ephemeris Moon and z",
    "along its orbital momentum; from then on the frame turns uniformly about z.",
    "These are the axes of that frame, turned into the ICRF by the ephemeris at the epoch.",
    "The Moon of these states is on that circle: it is not the ephemeris Moon.",
)
"""Definition of the states, for the header of a message."""


def arc(
    name: str,
    state: ArrayLike,
    elapsed_s: ArrayLike,
    epoch: Epoch,
    *,
    object_id: str = "",
    center: str = "EARTH",
    covariance: ArrayLike | None = None,
) -> Segment:
    """An arc in the ICRF, for messages and tables.

    Parameters
    ----------
    name : str
        Name of the object.
    state : array_like, shape (time, 6)
        Nondimensional, rotating frame.
    elapsed_s : array_like, shape (time,)
        Times since the epoch, s of UTC (see `cislunar.ephemeris.time_scales.tdb_after`).
    epoch : Epoch
        Epoch and axes, from `cislunar.exchange.inertial.epoch_at`.
    object_id : str
        International designator; `name` if omitted.
    center : str
        Origin, one of `cislunar.exchange.inertial.CENTERS`.
    covariance : array_like, shape (time, 6, 6), optional
        Nondimensional, rotating frame.
    """
    times = np.asarray(elapsed_s, dtype=float)
    found = Segment(
        name,
        object_id or name,
        center,
        tdb_after(epoch.tdb_s, times),
        inertial_states(state, times, epoch, center),
    )
    if covariance is None:
        return found
    turned = inertial_covariances(covariance, times, epoch)
    symmetric = (turned + np.swapaxes(turned, -1, -2)) / 2.0
    return found._replace(covariance_tdb_s=found.tdb_s, covariance=symmetric)


def rotating_arc(segment: Segment, epoch: Epoch) -> tuple[Array, Array]:
    """States of an arc in the rotating frame.

    Parameters
    ----------
    segment : Segment
        The arc.
    epoch : Epoch
        Epoch and axes of the rotating frame.

    Returns
    -------
    elapsed_s : ndarray, shape (time,)
        Times since the epoch, s of UTC.
    state : ndarray, shape (time, 6)
        Nondimensional, rotating frame.
    """
    elapsed = tdb_since(epoch.tdb_s, segment.tdb_s)
    return elapsed, rotating_states(segment.state, elapsed, epoch, segment.center)
