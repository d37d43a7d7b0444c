"""Time of one evaluation of J: from tables against direct NumPy, at the size of scenario B.

    python benchmarks/architecture.py [--targets 2000] [--satellites 20]

Without tables an optimizer needs the direct evaluation: it propagates the satellites of the
architecture and tests every target at every hour. The benchmark also prints the time of one restart
of the coordinate search, at the sizes of scenarios B and C on synthetic tables. It exits with an
error if the two values of J differ by more than 1e-10.
"""

import argparse
import sys
from collections.abc import Callable
from time import perf_counter

import numpy as np
from visibility import plain

from cislunar.architecture.coordinate_search import coordinate_search
from cislunar.architecture.cost import CostFunction
from cislunar.architecture.tables import ArchitectureTables
from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics.cr3bp import primary_distances
from cislunar.orbits.families import OrbitSet, observer_library
from cislunar.visibility.counts import VisibilitySettings, count_visibility, observation_times
from cislunar.visibility.tracks import architecture_tracks

N_ORBITS, MAX_SATELLITES, N_SLOTS, N_STEPS = 302, 10, 10, 721
SETTINGS = VisibilitySettings()


def seconds(task: Callable[[], object]) -> float:
    """Wall time of a task."""
    start = perf_counter()
    task()
    return perf_counter() - start


def synthetic_tables(n_targets: int, rng: np.random.Generator) -> ArchitectureTables:
    """Synthetic tables of the campaign's size: half of the targets are rarely observed."""
    share = rng.beta(0.4, 2.0, (N_ORBITS, 1, n_targets)).astype(np.float32)
    satellites = np.arange(1, MAX_SATELLITES + 1)
    counts = (share * (N_STEPS * satellites[None, :, None])).astype(np.uint16)
    return ArchitectureTables(
        observations=counts,
        distance=rng.uniform(800.0, 2500.0, (N_ORBITS, 1)) * satellites,
        stability_index=1.0 + rng.exponential(1.0, N_ORBITS) ** 4,
        family=np.full(N_ORBITS, "synthetic"),
        n_steps=N_STEPS,
    )


def direct_cost(orbits: OrbitSet, satellites, target, times, sun) -> float:
    """J without tables, in NumPy."""
    tracks = architecture_tracks(orbits.state, orbits.period, satellites, times)
    logarithm = np.zeros(len(target))
    observed = 0
    for slot, n in enumerate(satellites):
        first = int(np.sum(satellites[:slot]))
        per_target = np.zeros(len(target))
        for path in tracks[first : first + n]:
            per_target += plain(path, target, sun, SETTINGS)
        observed += per_target.sum()
        logarithm += per_target / n
    scale = len(target) * len(times)
    logs = np.sum(np.log10(np.where(logarithm > 0.0, logarithm, 1.0)))
    earth, moon = primary_distances(tracks)
    stability = np.sum(satellites * orbits.stability_index)
    return abs(observed * logs / (np.sum(satellites) * stability * np.sum(earth + moon) * scale))


def against_direct(n_targets: int, n_satellites: int, rng: np.random.Generator) -> None:
    """Compare an evaluation from tables with a direct one, in value and time."""
    members = {"Halo_L1_N": 2, "Halo_L2_N": 2, "Halo_L2_S": 2, "Halo_L3_N": 2, "Lyap_L3": 2}
    orbits = observer_library(members)
    satellites = 1 + rng.multinomial(n_satellites - N_SLOTS, np.full(N_SLOTS, 1 / N_SLOTS))
    satellites = np.minimum(satellites, MAX_SATELLITES)
    target = rng.uniform([-0.3, -1.0, -0.6], [1.7, 1.0, 0.6], (n_targets, 3))
    times = observation_times(30.0, 1.0)
    angle = -2.0 * np.pi * times * TIME_UNIT_S / (29.53 * 86_400.0)
    sun = 389.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    real = count_visibility(orbits.state, orbits.period, target, times, sun, SETTINGS)
    tables = synthetic_tables(n_targets, rng)
    chosen = np.sort(rng.choice(N_ORBITS, N_SLOTS, replace=False))
    tables.observations[chosen] = real.observations
    tables.distance[chosen] = real.distance
    tables.stability_index[chosen] = orbits.stability_index
    cost = CostFunction(tables)
    value = cost.value(chosen, satellites)
    # Different orbits every time, so that the rows are not in the cache.
    tried = [
        (rng.choice(N_ORBITS, N_SLOTS, replace=False), rng.integers(1, 11, N_SLOTS))
        for _ in range(2000)
    ]
    each = min(seconds(lambda: [cost.value(*way) for way in tried]) for _ in range(3)) / len(tried)
    start = perf_counter()
    expected = direct_cost(orbits, satellites, target, times, sun)
    direct = perf_counter() - start
    print(f"J of {satellites.sum()} satellites and {n_targets} targets over {len(times)} steps")
    print(f"direct, NumPy        {direct:10.2f} s")
    print(f"from tables          {1e6 * each:10.1f} us")
    print(f"time ratio           {direct / each:10.0f}")
    difference = abs(value / expected - 1.0)
    print(f"relative difference  {difference:10.1e}")
    if difference > 1e-10:
        sys.exit("J from tables differs from the direct evaluation")


def search_times(rng: np.random.Generator) -> None:
    """Time restarts of the coordinate search."""
    for scenario, n_targets in (("B", 2000), ("C", 10_000)):
        cost = CostFunction(synthetic_tables(n_targets, rng))
        coordinate_search(cost, rng, n_slots=N_SLOTS, restarts=1)
        start = perf_counter()
        coordinate_search(cost, rng, n_slots=N_SLOTS, restarts=3)
        each = (perf_counter() - start) / 3
        print(f"coordinate search, size of scenario {scenario}: {each:.2f} s per restart")


def main() -> None:
    """Print the times and ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=2000)
    parser.add_argument("--satellites", type=int, default=20)
    arguments = parser.parse_args()
    rng = np.random.default_rng(1)
    against_direct(arguments.targets, arguments.satellites, rng)
    search_times(rng)


if __name__ == "__main__":
    main()
