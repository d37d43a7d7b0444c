"""Where cluster centers lie: a check of static targets against the regions they stand for.

The mean of a set that is not convex need not belong to it. The paper keeps the centers as k-means
gives them; so does this library, and counts those that no mission could visit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.dynamics.cr3bp import primary_distances
from cislunar.targets.zero_velocity import reachable


class CenterAudit(NamedTuple):
    """Flags for each center.

    Attributes
    ----------
    inside_earth, inside_moon : ndarray of bool, shape (cluster,)
        The center lies below the surface of the body.
    forbidden : ndarray of bool, shape (cluster,)
        The center lies outside of the region of every mission that has points in its cluster.
    """

    inside_earth: NDArray[np.bool_]
    inside_moon: NDArray[np.bool_]
    forbidden: NDArray[np.bool_]


def audit_centers(
    center: ArrayLike,
    label: ArrayLike,
    jacobi: ArrayLike,
    region: str = "moon",
    mu: float = MU,
) -> CenterAudit:
    """Find the centers that lie where their missions cannot go.

    Parameters
    ----------
    center : array_like, shape (cluster, 3)
        Cluster centers, nondimensional, rotating frame.
    label : array_like of int, shape (point,)
        Cluster of each point.
    jacobi : array_like, shape (point,)
        Jacobi constant of the mission each point was sampled for.
    region : str
        Region that was sampled, see `cislunar.targets.zero_velocity.reachable`.
    mu : float
        Mass ratio.

    Returns
    -------
    CenterAudit
    """
    centers = np.asarray(center, dtype=float)
    d, r = primary_distances(centers, mu)
    # Regions are nested: what is closed to the lowest Jacobi constant is closed to all.
    lowest = np.full(len(centers), np.inf)
    np.minimum.at(lowest, np.asarray(label), np.asarray(jacobi, dtype=float))
    return CenterAudit(
        inside_earth=d < EARTH_RADIUS_KM / LENGTH_UNIT_KM,
        inside_moon=r < MOON_RADIUS_KM / LENGTH_UNIT_KM,
        forbidden=~reachable(centers, lowest, region, mu),
    )
