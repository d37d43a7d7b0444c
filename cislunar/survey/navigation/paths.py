"""Fitted orbits along their detections, and the derivatives of their paths."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.orbit_determination import Angles, OrbitFits, propagated_each
from cislunar.runtime import Array


class ObservedPath(NamedTuple):
    """A fitted orbit at the times of its detections.

    Attributes
    ----------
    rows : ndarray of int, shape (row,)
        Of the detections.
    angles : Angles
        The detections.
    way : ndarray, shape (row, 3)
        From the observers to the object, nondimensional, propagation frame.
    basis : ndarray, shape (row, 2, 3)
        Derivatives of the angles by the position of the object.
    by_state : ndarray, shape (row, 3, 6)
        Derivatives of positions by the state at the epoch.
    by_factor : ndarray, shape (row, 3, 0 or 1)
        Derivatives of positions by the factor of the radiation pressure on the object, in its
        standard deviations; see `cislunar.orbit_determination.by_radiation`.
    """

    rows: NDArray[np.int64]
    angles: Angles
    way: Array
    basis: Array
    by_state: Array
    by_factor: Array


def observed_paths(
    fits: OrbitFits,
    which: Sequence[int],
    detections: Callable[[NDArray[np.int64]], Angles],
    forces: tuple,
    radiation_sigma: float = 0.0,
) -> Iterator[tuple[int, ObservedPath]]:
    """Some orbits, each at the times of its detections.

    Parameters
    ----------
    fits : OrbitFits
    which : sequence of int
        Indices of the orbits.
    detections : callable
        Returns the detections with the given row numbers.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    radiation_sigma : float
        Standard deviation of the factor of the radiation pressure on an object; 0: it is known.

    Yields
    ------
    int, ObservedPath
        Index and path of each orbit that can be propagated to its detections.
    """
    some = list(which)
    rows = [fits.detections(k) for k in some]
    own = [detections(each) for each in rows]
    times = [each.time for each in own]
    moved = propagated_each(fits.state[some], fits.epoch[some], times, forces, radiation_sigma)
    for k, each, angles, (path, stm, by_factor) in zip(some, rows, own, moved, strict=True):
        if not np.all(np.isfinite(path)):
            continue
        way = path[:, :3] - angles.observer_position
        along = np.sum(way * angles.direction, axis=1)
        basis = angles.basis / along[:, None, None]
        yield k, ObservedPath(each, angles, way, basis, stm[:, :3], by_factor[:, :3])
