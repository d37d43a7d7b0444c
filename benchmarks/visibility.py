"""Time of one visibility test: compiled kernel against plain NumPy.

    python benchmarks/visibility.py [--orbits 8] [--targets 2000] [--threads N]

The problem has orbits of the library, sampled targets and the Sun at the paper's epoch; a test is
one combination of track, time and target. Compilation is not counted. The benchmark exits with an
error if the counts differ from those of NumPy.
"""

import argparse
import sys
from pathlib import Path
from time import process_time

import numba
import numpy as np
from _timing import best_time

from cislunar.constants import EPOCH_JD, LENGTH_UNIT_KM, MU, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.ephemeris.sampling import interpolate_sun, sample_ephemeris
from cislunar.orbits.families import observer_library
from cislunar.photometry.sphere import phase_angle, sphere_magnitude
from cislunar.targets.missions import load_missions
from cislunar.targets.sampling import sample_zero_velocity
from cislunar.visibility.counts import VisibilitySettings, observation_times
from cislunar.visibility.kernel import count_observations
from cislunar.visibility.phasing import distinct_phases
from cislunar.visibility.tracks import satellite_tracks

DAYS = 10.0
MISSIONS = Path(__file__).parents[1] / "config" / "missions.csv"


def make_scene(n_orbits: int, n_targets: int):
    """Tracks of orbits, targets within zero-velocity surfaces, and the Sun."""
    library = observer_library({"Halo_L2_S": 3, "Halo_L1_N": 3, "Butterfly_N": 3, "Lyap_L3": 3})
    rows = np.linspace(0, len(library.period) - 1, n_orbits).astype(int)
    times = observation_times(DAYS, 1.0)
    phase, _ = distinct_phases(10)
    track = satellite_tracks(library.state[rows], library.period[rows], phase, times)
    points = sample_zero_velocity(load_missions(MISSIONS)["jacobi"].to_numpy()).position
    chosen = np.random.default_rng(0).choice(len(points), n_targets, replace=False)
    sampled = sample_ephemeris(EPOCH_JD, DAYS)
    elapsed = (sampled.time_utc_jd - EPOCH_JD) * SECONDS_PER_DAY / TIME_UNIT_S
    return track, points[chosen], interpolate_sun(times, elapsed, sampled.sun_position)


def plain(track, target, sun, settings: VisibilitySettings):
    """Counts of one track in plain NumPy."""
    line = target - track[:, None]
    magnitude = sphere_magnitude(
        np.linalg.norm(line, axis=-1) * LENGTH_UNIT_KM * 1e3,
        phase_angle(line, target - sun[:, None]),
        radius_m=settings.target_radius_m,
        diffuse_reflection_coefficient=settings.diffuse_reflection_coefficient,
    )
    seen = magnitude < settings.limiting_magnitude
    bodies = (sun, np.array([1.0 - MU, 0.0, 0.0]), np.array([-MU, 0.0, 0.0]))
    for body, cosine in zip(bodies, settings.exclusion_deg.cosines, strict=True):
        toward = (body - track)[:, None]
        product = np.linalg.norm(toward, axis=-1) * np.linalg.norm(line, axis=-1)
        seen &= np.sum(toward * line, axis=-1) < cosine * product
    return seen.sum(axis=0)


def main() -> None:
    """Print the times and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--orbits", type=int, default=8)
    parser.add_argument("--targets", type=int, default=2000)
    parser.add_argument("--threads", type=int, default=numba.config.NUMBA_NUM_THREADS)
    arguments = parser.parse_args()
    numba.set_num_threads(arguments.threads)
    track, target, sun = make_scene(arguments.orbits, arguments.targets)
    settings = VisibilitySettings()

    def compiled():
        return count_observations(
            track, target, sun, settings.exclusion_deg.cosines, settings.faintness_at(len(sun)), MU
        )

    counts = compiled()
    tests = track[..., 0].size * len(target)
    compiled_ns = 1e9 * best_time(compiled) / tests
    start = process_time()
    compiled()
    processor_ns = 1e9 * (process_time() - start) / tests
    first = [plain(path, target, sun, settings) for path in track[:, 0]]
    plain_ns = 1e9 * best_time(lambda: plain(track[0, 0], target, sun, settings), 2)
    plain_ns /= track.shape[2] * len(target)
    different = np.abs(counts[:, 0] - first).sum() / (track[:, 0, :, 0].size * len(target))
    print(f"{len(target)} targets, {track[..., 0].size} observer positions, best of 3")
    print(f"compiled, {arguments.threads} threads  {compiled_ns:8.2f} ns per test")
    print(f"processor time       {processor_ns:8.2f} ns per test, summed over threads")
    print(f"NumPy, 1 thread      {plain_ns:8.2f} ns per test")
    print(f"time ratio           {plain_ns / compiled_ns:8.0f}")
    print(f"share of tests with different result: {different:.1e}")
    if different > 1e-4:
        sys.exit("the compiled counts differ from those of NumPy")


if __name__ == "__main__":
    main()
