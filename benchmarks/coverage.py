"""Time of the search for the largest coverage of N satellites and its bound, from tables of bits.

    python benchmarks/coverage.py [--targets 100] [--phases 10] [--satellites 10]

The problem has a month of hours and some 70 orbits with satellites at free phases. The ratios refer
to the two inner loops: scores of all candidates against a product with the same table as a dense
matrix of doubles, and lazy greedy search against greedy search that evaluates every candidate each
time. The benchmark exits with an error if either differs in its result.
"""

import argparse
import sys
from time import perf_counter

import numpy as np
from _timing import best_time

from cislunar.architecture.coverage.certificate import certify_coverage, greedy_coverage
from cislunar.architecture.coverage.kernels import weighted_sums
from cislunar.architecture.coverage.objective import CoverageObjective
from cislunar.architecture.coverage.tables import coverage_tables
from cislunar.constants import TIME_UNIT_S
from cislunar.orbits.families import observer_library
from cislunar.visibility.counts import VisibilitySettings, observation_times

MEMBERS = {"Halo_L1_N": 15, "Halo_L2_N": 15, "Halo_L2_S": 15, "Halo_L3_N": 15, "Lyap_L3": 15}
CANDIDATES = 200  # in the dense matrix, which needs 64 times the memory


def synthetic_objective(n_targets: int, phases: int) -> CoverageObjective:
    """Union coverage of random targets by orbits of the library."""
    orbits = observer_library(MEMBERS)
    target = np.random.default_rng(1).uniform([-0.3, -1.0, -0.6], [1.7, 1.0, 0.6], (n_targets, 3))
    times = observation_times(30.0, 1.0)
    angle = -2.0 * np.pi * times * TIME_UNIT_S / (29.53 * 86_400.0)
    sun = 389.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    coverage_tables(orbits, target[:1], times[:2], sun[:2], VisibilitySettings(), phases=1)
    start = perf_counter()
    tables = coverage_tables(orbits, target, times, sun, VisibilitySettings(), phases=phases)
    seconds = perf_counter() - start
    size = tables.layers.nbytes / 1e6
    print(f"tables of {len(tables.orbit)} candidates{seconds:12.2f} s, {size:.0f} MB")
    return CoverageObjective(tables)


def greedy_each_time(objective: CoverageObjective, number: int) -> list[int]:
    """Greedy search without the bound from earlier gains."""
    chosen, ones = [], np.ones(0, dtype=np.int64)
    for _ in range(number):
        slots = np.r_[chosen, -1].astype(np.int64)
        ones = np.ones(slots.size, dtype=np.int64)
        found = objective.best_replacement(slots, ones, slots.size - 1, 1, 1, 0.0)
        chosen.append(found.orbit)
    return chosen


def main() -> None:
    """Print the times and ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=100)
    parser.add_argument("--phases", type=int, default=10)
    parser.add_argument("--satellites", type=int, default=10)
    arguments = parser.parse_args()
    objective = synthetic_objective(arguments.targets, arguments.phases)

    layers = objective.candidates.view(np.uint8)
    weight = np.random.default_rng(2).random((layers.shape[-1], 8))
    some = np.arange(min(CANDIDATES, len(layers)))
    dense = np.unpackbits(layers[some, 0], axis=1, bitorder="little").astype(float)
    packed = best_time(lambda: weighted_sums(layers, some, weight))
    product = best_time(lambda: dense @ weight.ravel())
    print(
        f"scores of {some.size} candidates     {1e3 * packed:12.2f} ms, "
        f"dense matrix {product / packed:.1f} times as long"
    )
    same = np.allclose(weighted_sums(layers, some, weight), dense @ weight.ravel(), rtol=1e-12)

    number = arguments.satellites
    lazy = best_time(lambda: greedy_coverage(objective, number))
    each = best_time(lambda: greedy_each_time(objective, number))
    print(
        f"lazy greedy to N = {number}      {1e3 * lazy:12.2f} ms, "
        f"all gains {each / lazy:.1f} times as long"
    )
    same &= greedy_coverage(objective, number)[0].tolist() == greedy_each_time(objective, number)

    certify_coverage(objective, number, steps=1)
    found = certify_coverage(objective, number)
    print(
        f"search and bound           {found.seconds:12.2f} s: greedy {found.greedy:.4f}, "
        f"found {found.value:.4f}, bound {found.bound:.4f}, gap {100 * found.gap:.2f} %"
    )
    if not same:
        sys.exit("the scores or the greedy choices differ")


if __name__ == "__main__":
    main()
