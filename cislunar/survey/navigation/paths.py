"""Fitted orbits along their detections, and the derivatives of their paths."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.orbit_determination import Angles, OrbitFits, by_radiation, propagated
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
    along : ndarray, shape (row,)
        The same along the measured directions.
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
    along: Array
    basis: Array
    by_state: Array
    by_factor: Array


def observed_path(
    fits: OrbitFits, k: int, angles: Angles, forces: tuple, radiation_sigma: float = 0.0
) -> ObservedPath | None:
    """Orbit k at the times of its detections.

    Parameters
    ----------
    fits : OrbitFits
    k : int
    angles : Angles
        The detections of the orbit alone.
    forces : NamedTuple
        CR3BP or ephemeris forces.
    radiation_sigma : float
        Standard deviation of the factor of the radiation pressure on an object; 0: it is known.

    Returns
    -------
    ObservedPath or None
        None if the orbit cannot be propagated to its detections.
    """
    start = fits.state[[k]], fits.epoch[[k]]
    path, stm = (each[0] for each in propagated(*start, angles.time, forces))
    if not np.all(np.isfinite(path)):
        return None
    way = path[:, :3] - angles.observer_position
    along = np.sum(way * angles.direction, axis=1)
    return ObservedPath(
        fits.detections(k),
        angles,
        way,
        along,
        angles.basis / along[:, None, None],
        stm[:, :3],
        by_radiation(*start, angles.time, path[None], forces, radiation_sigma)[0, :, :3],
    )
