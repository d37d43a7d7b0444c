"""Times and inertia of methods to cluster the sampled points into static targets.

    python benchmarks/clustering.py [--targets 100 2000 10000] [--seed 1] [--repeated]

Inertia is given relative to that of scikit-learn's own seeding (greedy k-means++) on the distinct
points. Everything runs on one thread, as in the library. ``--repeated`` adds the usual call of
scikit-learn on all sampled points, including repeated ones (minutes).
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.spatial import cKDTree
from sklearn.cluster import BisectingKMeans, KMeans, MiniBatchKMeans, kmeans_plusplus
from threadpoolctl import threadpool_limits

from cislunar.targets.clustering import DEFAULT_SEEDING, SEEDINGS, cluster, distinct_points
from cislunar.targets.missions import load_missions
from cislunar.targets.sampling import sample_zero_velocity

TABLE = Path(__file__).parents[1] / "config" / "missions.csv"


def seed_on_subsample(points, weight, n_clusters, seed):
    """Greedy k-means++ on three points per center, drawn by weight; then Lloyd on all."""
    rng = np.random.default_rng(seed)
    size = min(3 * n_clusters, len(points))
    drawn = rng.choice(len(points), size, replace=False, p=weight / weight.sum())
    start, _ = kmeans_plusplus(points[drawn], n_clusters, random_state=seed)
    return KMeans(n_clusters, init=start, n_init=1).fit(points, sample_weight=weight)


def mini_batches(points, weight, n_clusters, seed):
    """Mini-batch k-means seeded on three points per center."""
    model = MiniBatchKMeans(n_clusters, n_init=1, init_size=3 * n_clusters, random_state=seed)
    return model.fit(points, sample_weight=weight)


def bisecting(points, weight, n_clusters, seed):
    """Bisecting k-means; for many clusters of distinct points it finds no point to split."""
    return BisectingKMeans(n_clusters, random_state=seed).fit(points, sample_weight=weight)


def elkan(points, weight, n_clusters, seed):
    """Greedy k-means++, then Elkan's iteration (needs memory for a bound per point and center)."""
    model = KMeans(n_clusters, n_init=1, algorithm="elkan", random_state=seed)
    return model.fit(points, sample_weight=weight)


ALTERNATIVES: dict[str, Callable] = {
    "k-means++ on a subsample": seed_on_subsample,
    "mini-batches": mini_batches,
    "bisecting": bisecting,
    "elkan": elkan,
}


def true_inertia(points, weight, center) -> float:
    """Weighted sum of squared distances to the nearest center."""
    distance, _ = cKDTree(center).query(points)
    return float(np.sum(weight * distance**2))


def report(name: str, seconds: float, inertia: float, reference: float) -> None:
    """Print the time and inertia of one method."""
    ratio = inertia / reference
    print(
        f"  {name:30s} {seconds:7.1f} s  inertia {inertia:11.5g}  inertia ratio {ratio:8.3f}",
        flush=True,
    )


def main() -> None:
    """Run all methods and print their times and inertia."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, nargs="+", default=[100, 2000, 10000])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--repeated", action="store_true")
    arguments = parser.parse_args()

    start = perf_counter()
    missions = load_missions(TABLE)
    sampled = sample_zero_velocity(missions["jacobi"], names=missions["mission"].tolist())
    points, weight, _ = distinct_points(sampled.position)
    print(
        f"{len(missions)} missions: {len(sampled.position)} points, {len(points)} distinct, "
        f"sampled in {perf_counter() - start:.1f} s"
    )
    for n_clusters in arguments.targets:
        print(f"{n_clusters} clusters")
        found = {}
        for name in SEEDINGS:
            start = perf_counter()
            result = cluster(sampled.position, n_clusters, seed=arguments.seed, seeding=name)
            found[name] = perf_counter() - start, result
        reference = found[DEFAULT_SEEDING][1].inertia
        for name, (seconds, result) in found.items():
            report(name, seconds, result.inertia, reference)
        for name, method in ALTERNATIVES.items():
            if name == "elkan" and n_clusters * len(points) > 2e8:
                continue
            start = perf_counter()
            try:
                with threadpool_limits(limits=1):
                    model = method(points, weight, n_clusters, arguments.seed)
            except ValueError as error:
                print(f"  {name:30s}  fails: {error}")
                continue
            seconds = perf_counter() - start
            inertia = true_inertia(points, weight, model.cluster_centers_)
            report(name, seconds, inertia, reference)
        if arguments.repeated:
            start = perf_counter()
            model = KMeans(n_clusters, n_init=1, random_state=arguments.seed)
            center = model.fit(sampled.position).cluster_centers_
            seconds = perf_counter() - start
            report(
                "repeated points, all threads",
                seconds,
                true_inertia(points, weight, center),
                reference,
            )
        result = found[DEFAULT_SEEDING][1]
        print(f"  members {result.members.min()} to {result.members.max()}")


if __name__ == "__main__":
    main()
