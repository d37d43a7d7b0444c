"""Union coverage against loops over targets, times and satellites."""

import math

import numpy as np
import pytest
from oracles.visibility import sun_at, visible

from cislunar.architecture.coverage.measures import coverage, gaps
from cislunar.constants import TIME_UNIT_S
from cislunar.observation.sensor import ExclusionAngles
from cislunar.orbits.catalog import periodic_orbits
from cislunar.visibility.counts import VisibilitySettings, observation_times
from cislunar.visibility.tracks import architecture_tracks, satellite_tracks

SETTINGS = VisibilitySettings(limiting_magnitude=17.0)


def by_loops(track, target, times, sun, settings):
    """The four measures, one (target, time, satellite) at a time."""
    seen = {}
    for k in range(len(times)):
        for s in range(len(track)):
            row = visible(track[s, k : k + 1], target, sun[k : k + 1], settings)[0]
            for j in np.flatnonzero(row):
                seen[int(j), k] = seen.get((int(j), k), 0) + 1
    hours = times * TIME_UNIT_S / 3600.0
    days = max(1, math.ceil(hours[-1] / 24.0 - 1e-9))
    on_day = {(j, min(int((hours[k] + 1e-6) // 24), days - 1)) for j, k in seen}
    return (
        len(seen) / (len(target) * len(times)),
        len(on_day) / (len(target) * days),
        len(target) - len({j for j, _ in seen}),
        sum(seen.values()) / len(seen) if seen else 0.0,
    )


@pytest.mark.parametrize("days, hours", [(3.0, 6.0), (2.5, 6.0), (0.5, 3.0)])
def test_measures_are_those_of_loops(days, hours):
    rng = np.random.default_rng(21)
    times = observation_times(days, hours)
    track = rng.normal(size=(4, len(times), 3)) * [0.6, 0.6, 0.3] + [0.6, 0.0, 0.0]
    target = np.vstack([rng.uniform(-1.2, 1.2, (40, 3)), [[20.0, 0.0, 0.0]]])
    sun = sun_at(times)
    found = coverage(track, target, times, sun, SETTINGS)
    expected = by_loops(track, target, times, sun, SETTINGS)
    assert found.never_seen >= 1
    assert 0.0 < found.union_coverage < found.target_days < 1.0
    np.testing.assert_allclose(
        [
            found.union_coverage, found.target_days, found.never_seen, found.observers_per_covered
        ],
        expected, rtol=1e-14,
    )  # fmt: skip


def test_everything_seen_and_nothing_seen():
    times = observation_times(2.0, 12.0)
    track = np.tile([0.5, 0.5, 0.5], (3, len(times), 1))
    target, sun = np.array([[0.9, 0.1, 0.0], [0.2, 0.3, 0.4]]), sun_at(times)
    all_seen = coverage(
        track, target, times, sun,
        VisibilitySettings(limiting_magnitude=99.0, exclusion_deg=ExclusionAngles(0.0, 0.0, 0.0)),
    )  # fmt: skip
    assert all_seen == type(all_seen)(1.0, 1.0, 0, 3.0)
    blind = coverage(track, target, times, sun, VisibilitySettings(limiting_magnitude=-20.0))
    assert blind == type(blind)(0.0, 0.0, 2, 0.0)


def test_tracks_of_an_architecture_are_its_satellites_slot_by_slot():
    orbits = periodic_orbits("Halo_L2_S", jacobi=3.05)
    times = observation_times(1.0, 6.0)
    track = architecture_tracks(orbits.state, orbits.period, [3, 1], times)
    assert track.shape == (4, 5, 3)
    for j in range(3):
        expected = satellite_tracks(orbits.state[:1], orbits.period[:1], [j / 3], times)[0, 0]
        np.testing.assert_allclose(track[j], expected, atol=1e-12)
    np.testing.assert_allclose(track[3, 0], orbits.state[1, :3], atol=1e-15)
    ahead = architecture_tracks(orbits.state, orbits.period, [2, 1], times, phase=[0.25, 0.0])
    expected = satellite_tracks(orbits.state[:1], orbits.period[:1], [0.25, 0.75], times)[0]
    np.testing.assert_allclose(ahead[:2], expected, atol=1e-12)


def test_gaps_are_runs_of_unseen_samples():
    seen = np.array([[0, 0, 1, 0, 1, 1, 0, 0, 0, 1], [1] * 10, [0] * 10]).T
    found = gaps(seen, 2.0)
    np.testing.assert_allclose(found.longest_h, [6.0, 0.0, 20.0])
    np.testing.assert_allclose(found.mean_h, [4.0, 0.0, 20.0])
    # a wait falls evenly from the length of a gap to nothing
    np.testing.assert_allclose(found.wait_h, [(16 + 4 + 36) / 40.0, 0.0, 10.0])
