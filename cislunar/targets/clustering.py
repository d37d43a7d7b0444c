"""k-means clustering of the sampled points into static targets (Paul & Fan, section 3).

The algorithm is scikit-learn's Lloyd iteration, run once (``n_init = 1``) from a chosen seeding.
Missions with equal Jacobi constant have equal points: the distinct points are clustered with their
multiplicity as weight, which is the same problem with a third of the rows.

The default seeding is scikit-learn's greedy variant of k-means++ (Arthur & Vassilvitskii 2007),
which tries ``2 + log(k)`` candidates for each center and keeps the best. For ten thousand clusters
of 76,000 distinct points the seeding takes 24 s of one core and the iterations 35 s; plain
k-means++ (one candidate) takes 6 s and 31 s and ends with 1.3 times the inertia, and random points
end with 47 times, because most points are concentrated around the Moon
(``benchmarks/clustering.py``).

The result does not depend on the machine, although the number of cores and the processor change the
last digits of a matrix product. Repeated points are identified, and points are ordered, by
coordinates rounded to `_ORDER_DECIMALS`. Seeding and iterations use points that are perturbed by up
to `GENERIC` in each coordinate, which breaks the ties of a symmetric grid by far more than rounding
can. The centers are means of the unperturbed points. Threads are limited to one.

Assumptions and limitations
---------------------------
- The mean of the points of a cluster need not lie in the region itself. Among a hundred clusters,
  one often holds the whole lobe of the lunar landers and has its center inside the Moon. The paper
  uses the centers without correction, and so does this module.
"""

import io
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from cislunar.errors import ConfigurationError, ConvergenceError
from cislunar.runtime import Array
from cislunar.runtime.arguments import require_choice

Phases = Callable[[str], Callable[[int, int], None]]

SEEDINGS = ("k-means++", "greedy k-means++", "random")
"""One candidate per center; scikit-learn's ``2 + log(k)`` candidates; random points by weight."""

DEFAULT_SEEDING = "greedy k-means++"

MAX_ITERATIONS = 300
TOLERANCE = 1e-6
"""Squared movement of the centers, relative to the variance of the points, that ends the
iterations."""

_ORDER_DECIMALS = 9
"""Decimals of a coordinate by which points are identified and ordered: 0.4 m."""

GENERIC = 1e-6
"""Largest perturbation of a coordinate, which breaks the ties of a symmetric grid: 0.4 km."""


class _Clusters(NamedTuple):
    """Result of a clustering: mean of each cluster's points (cluster, 3), nondimensional, rotating
    frame; number of its points with multiplicity (cluster,), never zero; cluster of each given
    point (point,); and `inertia`, the sum over all points of the squared distance to their center.
    """

    center: Array
    members: NDArray[np.int64]
    label: NDArray[np.int64]
    inertia: float


def _silent(phase: str) -> Callable[[int, int], None]:
    """No progress reports."""
    return lambda done, total: None


def cluster(
    position: ArrayLike,
    n_clusters: int,
    *,
    seed: int,
    seeding: str = DEFAULT_SEEDING,
    progress: Phases = _silent,
) -> _Clusters:
    """Cluster points with k-means.

    Parameters
    ----------
    position : array_like, shape (point, 3)
        Points, nondimensional; repeated points count with their multiplicity.
    n_clusters : int
        Number of clusters.
    seed : int
        Seed of the random numbers of the seeding (the only random step).
    seeding : str
        One of `SEEDINGS`.
    progress : callable
        Called with the name of a phase; returns a function of (done, at most) for its progress.

    Returns
    -------
    NamedTuple
        Independent of the machine: ``center``, shape (cluster, 3), the mean of the points of each
        cluster, nondimensional; ``members``, shape (cluster,), the number of its points with
        multiplicity; ``label``, shape (point,), the cluster of each point; ``inertia``, the sum of
        the squared distances of the points from their centers, nondimensional.

    Raises
    ------
    ConfigurationError
        If there are no points, one is not finite, the number of clusters is not between 1 and that
        of the distinct points, or the seeding is unknown.
    ConvergenceError
        If clusters stay empty.
    """
    from threadpoolctl import threadpool_limits

    points, weight, inverse = distinct_points(position)
    _require_count(n_clusters, len(points))
    rng = np.random.default_rng(seed)
    # Only differences of coordinates matter; relative to the mean they lose least to rounding.
    origin = np.average(points, axis=0, weights=weight)
    # Child streams of the seed are independent of its own.
    moves = np.random.default_rng(np.random.SeedSequence(seed).spawn(1)[0])
    moved = points - origin + moves.uniform(-GENERIC, GENERIC, points.shape)
    with threadpool_limits(limits=1):
        start = _seed_centers(moved, weight, n_clusters, rng, seeding, progress("first centers"))
        label = _lloyd(moved, weight, start, progress("k-means iterations"))
    center = origin + _means(points - origin, weight, label, n_clusters)
    members = np.bincount(label, weights=weight, minlength=n_clusters)
    inertia = float(np.sum(weight * np.sum((points - center[label]) ** 2, axis=1)))
    return _Clusters(center, np.rint(members).astype(np.int64), label[inverse], inertia)


def distinct_points(position: ArrayLike) -> tuple[Array, Array, NDArray[np.int64]]:
    """Distinct points and their multiplicities.

    Parameters
    ----------
    position : array_like, shape (point, 3)
        Points.

    Returns
    -------
    points : ndarray, shape (distinct, 3)
        In lexicographic order of the coordinates rounded to nine decimals; points that agree in
        these are identified with the first of them.
    weight : ndarray, shape (distinct,)
        Multiplicity, as float.
    inverse : ndarray of int, shape (point,)
        Row of `points` of each given point.

    Raises
    ------
    ConfigurationError
        If there are no points, or one is not finite.
    """
    p = np.asarray(position, dtype=float)
    if p.ndim != 2 or not len(p) or not np.all(np.isfinite(p)):
        raise ConfigurationError(
            f"targets: the points to cluster must be a finite array (point, 3), got shape {p.shape}"
        )
    # Adding zero makes zeros of either sign equal.
    _, first, inverse, count = np.unique(
        np.round(p, _ORDER_DECIMALS) + 0.0,
        axis=0,
        return_index=True,
        return_inverse=True,
        return_counts=True,
    )
    return p[first], count.astype(float), inverse.reshape(-1)


class _CountedDraws(np.random.RandomState):
    """Random numbers of k-means++, which draws once per center, with a progress report that
    scikit-learn does not have; no number changes."""

    def __init__(self, seed: int, total: int, progress: Callable[[int, int], None]) -> None:
        super().__init__(seed)
        self._done, self._total, self._progress = 1, total, progress

    def uniform(self, *arguments, **keywords):
        self._done += 1
        self._progress(min(self._done, self._total), self._total)
        return super().uniform(*arguments, **keywords)


def _seed_centers(
    points: Array,
    weight: Array,
    n_clusters: int,
    rng: np.random.Generator,
    seeding: str,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Array:
    """Initial centers (n_clusters, 3) of a k-means iteration, distinct members of the weighted
    `points` (distinct, 3); `seeding` is one of `SEEDINGS`."""
    from sklearn.cluster import kmeans_plusplus

    require_choice("seeding", seeding, SEEDINGS)
    if n_clusters == len(points):
        return points.copy()
    if seeding == "random":
        sample = rng.choice(len(points), n_clusters, replace=False, p=weight / weight.sum())
        return points[sample]
    start, _ = kmeans_plusplus(
        points,
        n_clusters,
        sample_weight=weight,
        random_state=_CountedDraws(int(rng.integers(2**31)), n_clusters, progress),
        n_local_trials=1 if seeding == "k-means++" else None,
    )
    return start


def _require_count(n_clusters: int, distinct: int) -> None:
    """Refuse an impossible number of clusters."""
    if isinstance(n_clusters, bool) or not isinstance(n_clusters, (int, np.integer)):
        raise ConfigurationError(f"targets: {n_clusters!r} must be a whole number of clusters")
    if not 1 <= n_clusters <= distinct:
        raise ConfigurationError(
            f"targets: {n_clusters} clusters cannot be made of {distinct} distinct points; "
            f"request 1 to {distinct}, or sample the missions more finely"
        )


class _Iterations(io.StringIO):
    """Converts scikit-learn's printed iterations to progress reports."""

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
    """Cluster of each point after Lloyd's iteration to convergence, without empty clusters."""
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
        # Restart with the empty clusters at the points that contribute most to the inertia.
        distance, _ = cKDTree(fit.cluster_centers_).query(points)
        start = fit.cluster_centers_.copy()
        start[empty] = points[np.argsort(-weight * distance**2, kind="stable")[: empty.size]]
    raise ConvergenceError(
        f"targets: {empty.size} of {len(start)} clusters stay empty; request fewer"
    )


def _means(points: Array, weight: Array, label: NDArray[np.int64], n_clusters: int) -> Array:
    """Weighted mean of each cluster, shape (n_clusters, 3)."""
    total = np.bincount(label, weights=weight, minlength=n_clusters)
    sums = [
        np.bincount(label, weights=weight * points[:, axis], minlength=n_clusters)
        for axis in range(points.shape[1])
    ]
    return np.stack(sums, axis=-1) / total[:, None]
