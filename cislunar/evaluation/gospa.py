"""Errors of a set of tracks against a set of targets (GOSPA), and the quality of a catalog.

The generalized optimal subpattern assignment metric with alpha = 2 (Rahmathullah, Garcia-Fernandez
& Svensson 2017, 20th International Conference on Information Fusion) is

    d = [ min over assignments of ( sum of d_i^p + c^p / 2 (missed + false) ) ]^(1/p),           (1)

d_i being the distance of an assigned pair, at most c. Unlike OSPA it counts every missed target and
every false track, and divides by no number of targets.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from cislunar.detection.exposures import FALSE_ALARM
from cislunar.errors import ConfigurationError


class Gospa(NamedTuple):
    """A GOSPA distance and its parts.

    Attributes
    ----------
    distance : float
        Equation (1), in the unit of the positions.
    localization, missed, false : float
        Parts of the p-th power of the distance, which add to it.
    n_missed, n_false : int
        Targets without a track, tracks without a target.
    target, track : ndarray of int, shape (pair,)
        The assigned pairs.
    """

    distance: float
    localization: float
    missed: float
    false: float
    n_missed: int
    n_false: int
    target: NDArray[np.int64]
    track: NDArray[np.int64]


def gospa(targets: ArrayLike, tracks: ArrayLike, cutoff: float, order: float = 2.0) -> Gospa:
    """Generalized optimal subpattern assignment metric with alpha = 2.

    Parameters
    ----------
    targets, tracks : array_like, shapes (n, dimension) and (m, dimension)
        True and estimated positions in one frame and unit; either may be empty.
    cutoff : float
        Distance c from which a track is none of a target's, in the same unit.
    order : float
        p, at least 1.

    Returns
    -------
    Gospa

    Raises
    ------
    ConfigurationError
        If the cutoff or the order is impossible, or a position is not finite.
    """
    if not (cutoff > 0.0 and np.isfinite(cutoff)):
        raise ConfigurationError(f"cutoff = {cutoff} must be positive and finite")
    if not (order >= 1.0 and np.isfinite(order)):
        raise ConfigurationError(f"order = {order} must be at least 1 and finite")
    true, found = (np.asarray(each, dtype=float) for each in (targets, tracks))
    shapes = [each.shape for each in (true, found) if each.size]
    if any(len(shape) != 2 or shape[1] != shapes[0][1] for shape in shapes):
        raise ConfigurationError(
            f"positions have shapes {true.shape} and {found.shape}; give (n, dimension) and "
            "(m, dimension)"
        )
    if not (np.all(np.isfinite(true)) and np.all(np.isfinite(found))):
        raise ConfigurationError("a position is not finite: leave ended tracks out")
    n, m = true.shape[0], found.shape[0]
    pairs = np.zeros((2, 0), dtype=np.int64)
    power = np.zeros(0)
    if n and m:
        cost = np.minimum(cdist(true, found), cutoff) ** order
        pairs = np.array(linear_sum_assignment(cost))
        # a pair at the cutoff costs as much as a missed target and a false track
        pairs = pairs[:, cost[tuple(pairs)] < cutoff**order]
        power = cost[tuple(pairs)]
    half = 0.5 * cutoff**order
    n_missed, n_false = n - pairs.shape[1], m - pairs.shape[1]
    parts = float(power.sum()), half * n_missed, half * n_false
    return Gospa(sum(parts) ** (1.0 / order), *parts, n_missed, n_false, *pairs)


class CatalogQuality(NamedTuple):
    """Quality of the tracks of a catalog.

    Attributes
    ----------
    purity : float
        Share of the detections in tracks that are of the target that most are of.
    wrong_associations : int
        Detections in tracks of another target, or of none.
    false_tracks : int
        Tracks most of whose detections are false alarms.
    fragments : float
        Tracks for each target that has one.
    """

    purity: float
    wrong_associations: int
    false_tracks: int
    fragments: float


def catalog_quality(track: Sequence[int], origin: Sequence[int]) -> CatalogQuality:
    """Purity and fragmentation of a catalog.

    Parameters
    ----------
    track, origin : sequence of int, shape (row,)
        Of every detection that a track has taken: the track, and the target that the detection is
        of, or `FALSE_ALARM`.

    Returns
    -------
    CatalogQuality

    Raises
    ------
    ConfigurationError
        If there is not one track and one origin for each detection.
    """
    tracks, origins = np.asarray(track), np.asarray(origin)
    if tracks.shape != origins.shape or tracks.ndim != 1:
        raise ConfigurationError(
            f"track and origin have shapes {tracks.shape} and {origins.shape}; give one of each "
            "for every detection"
        )
    of_target: dict[int, int] = {}
    right = wrong = false_tracks = 0
    for own in np.unique(tracks):
        names, counts = np.unique(origins[tracks == own], return_counts=True)
        # of equal counts that of a target, since half of the detections are not most
        main = int(names[np.lexsort((names == FALSE_ALARM, -counts))[0]])
        if main == FALSE_ALARM:
            false_tracks += 1
            wrong += int(counts.sum())
            continue
        right += int(counts.max())
        wrong += int(counts.sum() - counts.max())
        of_target[main] = of_target.get(main, 0) + 1
    return CatalogQuality(
        purity=right / tracks.size if tracks.size else np.nan,
        wrong_associations=wrong,
        false_tracks=false_tracks,
        fragments=float(np.mean(list(of_target.values()))) if of_target else np.nan,
    )
