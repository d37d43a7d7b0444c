"""Conversion of arcs between the frames of the library and the messages and tables of
`cislunar.exchange`."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.dynamics.bounds import require_nondimensional
from cislunar.dynamics.ephemeris import UNITS
from cislunar.dynamics.frames import BARYCENTER, recenter
from cislunar.ephemeris.bodies import tabulate_bodies
from cislunar.ephemeris.kernel import DEFAULT_KERNEL
from cislunar.ephemeris.time_scales import tdb_after, tdb_since
from cislunar.exchange.inertial import (
    Epoch,
    inertial_covariances,
    inertial_states,
    origin_of,
    rotating_states,
)
from cislunar.exchange.key_values import CENTERS
from cislunar.exchange.oem import Segment
from cislunar.runtime.arguments import Array, array_of

COMMENTS = (
    "States of the circular restricted three-body problem of Earth and Moon,",
    f"mass ratio {MU}, distance {LENGTH_UNIT_KM} km, unit of time {TIME_UNIT_S:.6f} s.",
    "At the epoch of the run x points from the Earth to the ephemeris Moon and z",
    "along its orbital momentum; from then on the frame turns uniformly about z.",
    "These are the axes of that frame, turned into the ICRF by the ephemeris at the epoch.",
    "The Moon of these states is on that circle: it is not the ephemeris Moon.",
)
"""Definition of the states of the circular problem, for the header of a message."""

EPHEMERIS_COMMENTS = ("States in dynamics with Earth, Moon and Sun from an ephemeris, ICRF axes.",)
"""Definition of the states in ephemeris dynamics."""

GEOMETRIC_DIRECTIONS = "Simulated directions, without light time and aberration"
"""Definition of simulated observations."""


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
        Origin, one of `cislunar.exchange.CENTERS`.
    covariance : array_like, shape (time, 6, 6), optional
        Nondimensional, rotating frame.

    Returns
    -------
    Segment

    Raises
    ------
    ConfigurationError
        If the center is unknown, an array is not finite or of the wrong shape, or `state` is in
        another unit.
    """
    times = array_of("elapsed_s", elapsed_s, ("time",))
    given = array_of("state", state, (times.size, 6))
    require_nondimensional("state", given[:1])  # the states of a lost estimate may be far away
    states = inertial_states(given, times, epoch, center)
    found = Segment(name, object_id or name, center, tdb_after(epoch.tdb_s, times), states)
    if covariance is None:
        return found
    matrices = array_of("covariance", covariance, (times.size, 6, 6))
    return _with_covariance(found, inertial_covariances(matrices, times, epoch))


def _with_covariance(found: Segment, covariance: Array) -> Segment:
    symmetric = (covariance + np.swapaxes(covariance, -1, -2)) / 2.0
    return found._replace(covariance_tdb_s=found.tdb_s, covariance=symmetric)


def inertial_arc(
    name: str,
    state: ArrayLike,
    tdb_s: ArrayLike,
    *,
    object_id: str = "",
    center: str = "EARTH",
    covariance: ArrayLike | None = None,
    kernel: str | Path = DEFAULT_KERNEL,
) -> Segment:
    """An arc of ephemeris dynamics in the ICRF, for messages and tables.

    Parameters
    ----------
    name, object_id, center
        See `arc`; Earth and Moon are those of the ephemeris.
    state : array_like, shape (time, 6)
        Nondimensional, barycentric frame with J2000 axes.
    tdb_s : array_like, shape (time,)
        TDB seconds past J2000.
    covariance : array_like, shape (time, 6, 6), optional
        Nondimensional, J2000 axes.
    kernel : str or Path
        Ephemeris of the dynamics, which has the positions of Earth and Moon.

    Returns
    -------
    Segment

    Raises
    ------
    ConfigurationError, InputFileError
        If the center is unknown, an array is not finite or of the wrong shape, or the kernel is
        missing or does not cover the arc.
    """
    times = array_of("tdb_s", tdb_s, ("time",))
    origin_of(center)
    moved = array_of("state", state, (times.size, 6)) * UNITS
    if (origin := CENTERS[center]) != BARYCENTER:
        table = tabulate_bodies(float(times.min()), float(times.max()), kernel)
        moved = recenter(moved, table, times, old=BARYCENTER, new=origin)
    found = Segment(name, object_id or name, center, times, moved)
    if covariance is None:
        return found
    matrices = array_of("covariance", covariance, (times.size, 6, 6))
    return _with_covariance(found, matrices * np.outer(UNITS, UNITS))


def rotating_arc(segment: Segment, epoch: Epoch) -> tuple[Array, Array]:
    """States of an arc in the rotating frame of an epoch.

    Parameters
    ----------
    segment : Segment
    epoch : Epoch

    Returns
    -------
    elapsed_s : ndarray, shape (time,)
        Times since the epoch, s of UTC.
    state : ndarray, shape (time, 6)
        Nondimensional, rotating frame.

    Raises
    ------
    ConfigurationError
        If the center of the segment is unknown.
    """
    elapsed = tdb_since(epoch.tdb_s, segment.tdb_s)
    return elapsed, rotating_states(segment.state, elapsed, epoch, segment.center)
