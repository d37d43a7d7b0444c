"""k-means clustering of the sampled points into static targets (Paul & Fan, section 3).

The algorithm is scikit-learn's Lloyd iteration, run once (``n_init = 1``) from a seeding of our
choice. What makes ten thousand clusters a matter of seconds, where the library called on all
points takes minutes, is that missions which share a Jacobi constant repeat each other's points:
the distinct points are clustered with their multiplicity as weight, which is the same problem in a
third of the rows.

The seeding is scikit-learn's own, the greedy variant of k-means++ (Arthur & Vassilvitskii 2007),
which tries ``2 + log(k)`` candidates for each center and keeps the best. For ten thousand clusters
of 76 000 distinct points it takes 24 s of one core, and the rounds after it 35 s; plain k-means++
(one candidate) takes 6 s and 31 s and ends with 1.3 times the inertia. Points drawn at random end
47 times above, since most points crowd around the Moon and leave the wide regions without a
center. ``benchmarks/clustering.py`` measures these and more.

The result is the same on any machine, whatever its number of cores and its processor, although
both change the last digits of a matrix product. The points of a symmetric grid are equally far from
many centers, and a tie broken the other way moves whole clusters. So repeated points are told, and
the points ordered, by coordinates rounded to `ORDER_DECIMALS`; seeding and rounds see each point
moved by up to `GENERIC` in every coordinate, which breaks ties by far more than rounding can; the
centers are means of the points where they are. Threads are limited to one.

Assumptions and limitations
---------------------------
- The mean of the points of a cluster need not lie in the region itself: among a hundred clusters,
  one often holds the whole lobe of the lunar landers, with its center inside the Moon, and a
  cluster that straddles a forbidden region may have its center there. The paper takes the centers
  as they come, and so does this module; `cislunar.targets.audit` finds them.
"""

import io
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from cislunar.errors import ConfigurationError, ConvergenceError

Array = NDArray[np.float64]
Phases = Callable[[str], Callable[[int, int], None]]

SEEDINGS = ("k-means++", "greedy k-means++", "random")
"""One candidate per center; scikit-learn's ``2 + log(k)`` candidates; points drawn by weight."""

DEFAULT_SEEDING = "greedy k-means++"

MAX_ITERATIONS = 300
TOLERANCE = 1e-6
"""Squared movement of the centers, relative to the variance of the points, that ends the rounds."""

ORDER_DECIMALS = 9
"""Decimals of a coordinate by which points are told apart and ordered: 0.4 m."""

GENERIC = 1e-6
"""Largest move of a coordinate that breaks the ties of a symmetric grid: 0.4 km."""


class Clusters(NamedTuple):
    """Result of a clustering.

    Attributes
    ----------
    center : ndarray, shape (cluster, 3)
        Mean of each cluster's points, nondimensional, rotating frame.
    members : ndarray of int, shape (cluster,)
        Points in each cluster, repeated ones counted each time; never zero.
    label : ndarray of int, shape (point,)
        Cluster of each point, in the order the points were given.
    inertia : float
        Sum over all points of the squared distance to their center, nondimensional.
    """

    center: Array
    members: NDArray[np.int64]
    label: NDArray[np.int64]
    inertia: float


def _silent(phase: str) -> Callable[[int, int], None]:
    """Progress that nobody asked for."""
    return lambda done, total: None


def cluster(
    position: ArrayLike,
    n_clusters: int,
    *,
    seed: int,
    seeding: str = DEFAULT_SEEDING,
    progress: Phases = _silent,
) -> Clusters:
    """Cluster points with k-means.

    Parameters
    ----------
    position : array_like, shape (point, 3)
        Points, nondimensional; repeated points weigh more.
    n_clusters : int
        Number of clusters.
    seed : int
        Seed of the random numbers of the seeding (the only random step).
    seeding : str
        One of `SEEDINGS`.
    progress : callable
        Called with the name of a phase; what it returns is called with (done, at most) there.

    Returns
    -------
    Clusters
        The same for the same arguments, whatever the number of cores.

    Raises
    ------
    ConfigurationError
        If `n_clusters` is not an integer from 1 to the number of distinct points, if a point is
        not finite, or if the seeding is unknown.
    """
    from threadpoolctl import threadpool_limits

    points, weight, inverse = distinct_points(position)
    _require_count(n_clusters, len(points))
    rng = np.random.default_rng(seed)
    # Differences of coordinates are what matters; about the mean they lose least to rounding.
    origin = np.average(points, axis=0, weights=weight)
    # Child streams of the seed are independent of its own.
    moves = np.random.default_rng(np.random.SeedSequence(seed).spawn(1)[0])
    moved = points - origin + moves.uniform(-GENERIC, GENERIC, points.shape)
    with threadpool_limits(limits=1):
        start = seed_centers(moved, weight, n_clusters, rng, seeding, progress("first centers"))
        label = _lloyd(moved, weight, start, progress("k-means iterations"))
    center = origin + _means(points - origin, weight, label, n_clusters)
    members = np.bincount(label, weights=weight, minlength=n_clusters)
    inertia = float(np.sum(weight * np.sum((points - center[label]) ** 2, axis=1)))
    return Clusters(center, np.rint(members).astype(np.int64), label[inverse], inertia)


def distinct_points(position: ArrayLike) -> tuple[Array, Array, NDArray[np.int64]]:
    """Distinct points and how often each occurs.

    Parameters
    ----------
    position : array_like, shape (point, 3)
        Points.

    Returns
    -------
    points : ndarray, shape (distinct, 3)
        In lexicographic order of the coordinates rounded to `ORDER_DECIMALS`; points that agree in
        these count as one, at the place of the first.
    weight : ndarray, shape (distinct,)
        Multiplicity, as float.
    inverse : ndarray of int, shape (point,)
        Row of `points` that each given point is.

    Raises
    ------
    ConfigurationError
        If there is no point, or one that is not finite.
    """
    p = np.asarray(position, dtype=float)
    if p.ndim != 2 or not len(p) or not np.all(np.isfinite(p)):
        raise ConfigurationError(
            f"targets: the points to cluster must be a finite array (point, 3), got shape {p.shape}"
        )
    # Adding zero makes zeros of either sign equal.
    _, first, inverse, count = np.unique(
        np.round(p, ORDER_DECIMALS) + 0.0,
        axis=0,
        return_index=True,
        return_inverse=True,
        return_counts=True,
    )
    return p[first], count.astype(float), inverse.reshape(-1)


class _CountedDraws(np.random.RandomState):
    """The random numbers of k-means++, which draws once for each further center.

    scikit-learn does not tell how far its seeding is; this does, and changes no number.
    """

    def __init__(self, seed: int, total: int, progress: Callable[[int, int], None]) -> None:
        super().__init__(seed)
        self._done, self._total, self._progress = 1, total, progress

    def uniform(self, *arguments, **keywords):
        self._done += 1
        self._progress(min(self._done, self._total), self._total)
        return super().uniform(*arguments, **keywords)


def seed_centers(
    points: Array,
    weight: Array,
    n_clusters: int,
    rng: np.random.Generator,
    seeding: str,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Array:
    """First centers of a k-means iteration.

    Parameters
    ----------
    points : ndarray, shape (distinct, 3)
        Distinct points.
    weight : ndarray, shape (distinct,)
        Their weights.
    n_clusters : int
        Number of centers.
    rng : numpy.random.Generator
        Source of the draws.
    seeding : str
        One of `SEEDINGS`.
    progress : callable
        Called with (centers found, centers).

    Returns
    -------
    ndarray, shape (n_clusters, 3)
        Distinct members of `points`.

    Raises
    ------
    ConfigurationError
        If the seeding is unknown.
    """
    from sklearn.cluster import kmeans_plusplus

    if seeding not in SEEDINGS:
        raise ConfigurationError(f"seeding: {seeding!r} is not one of {', '.join(SEEDINGS)}")
    if n_clusters == len(points):
        return points.copy()
    if seeding == "random":
        drawn = rng.choice(len(points), n_clusters, replace=False, p=weight / weight.sum())
        return points[drawn]
    start, _ = kmeans_plusplus(
        points,
        n_clusters,
        sample_weight=weight,
        random_state=_CountedDraws(int(rng.integers(2**31)), n_clusters, progress),
        n_local_trials=1 if seeding == "k-means++" else None,
    )
    return start


def _require_count(n_clusters: int, distinct: int) -> None:
    """Refuse numbers of clusters that cannot be had."""
    if isinstance(n_clusters, bool) or not isinstance(n_clusters, (int, np.integer)):
        raise ConfigurationError(f"targets: {n_clusters!r} must be a whole number of clusters")
    if not 1 <= n_clusters <= distinct:
        raise ConfigurationError(
            f"targets: {n_clusters} clusters cannot be made of {distinct} distinct points; "
            f"ask for 1 to {distinct}, or sample the missions more finely"
        )


class _Iterations(io.StringIO):
    """What scikit-learn prints of its iterations, turned into progress."""

    def __init__(self, progress: Callable[[int, int], None]) -> None:
        super().__init__()
        self._done, self._progress = 0, progress

    def write(self, text: str) -> int:
        if text.startswith("Iteration"):
            self._done += 1
            self._progress(self._done, MAX_ITERATIONS)
        return len(text)


def _lloyd(
    points: Array, weight: Array, start: Array, progress: Callable[[int, int], None]
) -> NDArray[np.int64]:
    """Cluster of each point after Lloyd's iteration to convergence, with no cluster left empty."""
    from sklearn.cluster import KMeans

    for _ in range(10):
        means = KMeans(
            len(start), init=start, n_init=1, max_iter=MAX_ITERATIONS, tol=TOLERANCE, verbose=1
        )
        with redirect_stdout(_Iterations(progress)):
            fit = means.fit(points, sample_weight=weight)
        label = fit.labels_.astype(np.int64)
        empty = np.flatnonzero(np.bincount(label, minlength=len(start)) == 0)
        if not empty.size:
            return label
        # Start again with the empty ones at the points that are worst served.
        distance, _ = cKDTree(fit.cluster_centers_).query(points)
        start = fit.cluster_centers_.copy()
        start[empty] = points[np.argsort(-weight * distance**2, kind="stable")[: empty.size]]
    raise ConvergenceError(
        f"targets: {empty.size} of {len(start)} clusters stay empty; ask for fewer"
    )


def _means(points: Array, weight: Array, label: NDArray[np.int64], n_clusters: int) -> Array:
    """Weighted mean of each cluster, shape (n_clusters, 3)."""
    total = np.bincount(label, weights=weight, minlength=n_clusters)
    sums = [
        np.bincount(label, weights=weight * points[:, axis], minlength=n_clusters)
        for axis in range(points.shape[1])
    ]
    return np.stack(sums, axis=-1) / total[:, None]
