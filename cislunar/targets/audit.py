"""Audit of cluster centers: a check of static targets against the regions that they represent.

The mean of a non-convex set need not belong to it. The paper uses the centers of k-means without
correction. So does this library, but it counts those that no mission could visit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.dynamics.cr3bp import primary_distances
from cislunar.targets.zero_velocity import reachable


class _CenterAudit(NamedTuple):
    """Flags (cluster,) of centers: below the surface of the Earth or of the Moon, or outside of the
    region of every mission with points in the cluster (`forbidden`)."""

    inside_earth: NDArray[np.bool_]
    inside_moon: NDArray[np.bool_]
    forbidden: NDArray[np.bool_]


def audit_centers(
    center: ArrayLike, label: ArrayLike, jacobi: ArrayLike, region: str = "moon", mu: float = MU
) -> _CenterAudit:
    """Find the centers that lie where their missions cannot go.

    Parameters
    ----------
    center : array_like, shape (cluster, 3)
        Cluster centers, nondimensional, rotating frame.
    label : array_like of int, shape (point,)
        Cluster of each point.
    jacobi : array_like, shape (point,)
        Jacobi constant of the mission for which each point was sampled.
    region : str
        Sampled region, see `cislunar.targets.zero_velocity.reachable`.
    mu : float
        Mass ratio.
    """
    centers = np.asarray(center, dtype=float)
    d, r = primary_distances(centers, mu)
    # Regions are nested: a point forbidden for the lowest Jacobi constant is forbidden for all.
    lowest = np.full(len(centers), np.inf)
    np.minimum.at(lowest, np.asarray(label), np.asarray(jacobi, dtype=float))
    return _CenterAudit(
        inside_earth=d < EARTH_RADIUS_KM / LENGTH_UNIT_KM,
        inside_moon=r < MOON_RADIUS_KM / LENGTH_UNIT_KM,
        forbidden=~reachable(centers, lowest, region, mu),
    )
