"""Admissible region of a tracklet, and starts from pairs of tracklets."""

import numpy as np
from detected_object import HALO, OBSERVERS, observed

from cislunar.constants import MU
from cislunar.dynamics import EARTH_MOON, jacobi_constant, propagate
from cislunar.orbit_determination import (
    AdmissibleRegion,
    attributables,
    is_admissible,
    pair_starts,
    sample_region,
)


def test_the_region_is_that_of_the_jacobi_constant():
    angles = observed(HALO, [0.0], [0], np.random.default_rng(11), sigma=1e-9)
    tracklet = attributables(angles, [np.arange(2)])
    region = AdmissibleRegion(least_jacobi=2.9)
    bank = sample_region(tracklet, 0, region, n_ranges=60, n_rates=25)
    time = tracklet.time[0]
    assert np.all(is_admissible(bank, time, EARTH_MOON, region))
    assert jacobi_constant(bank).min() < 2.95
    truth = propagate(HALO, [time])[0]
    gap = np.linalg.norm(bank - truth, axis=1)
    assert gap.min() < 0.1
    # every sample has the measured direction and rate, seen from the mean place of the observer
    later = [propagate(state, [1e-5])[0] for state in bank[::200]]
    here = propagate(OBSERVERS[0], [time + 1e-5])[0, :3]
    for state in later:
        line = state[:3] - here
        own = truth[:3] + 1e-5 * truth[3:] - here
        cosine = line @ own / np.linalg.norm(line) / np.linalg.norm(own)
        assert np.sqrt(2.0 * max(0.0, 1.0 - cosine)) < 1e-6 / min(np.linalg.norm(line), 1.0)


def test_pairs_of_one_object_are_joined_and_others_are_not():
    rng = np.random.default_rng(12)
    states = [
        HALO,
        [1.05, 0.1, 0.0, 0.0, -0.4, 0.02],
        HALO * [1, 1, -1, 1, 1, 1],
        [0.82, 0.0, 0.05, 0.0, 0.15, 0.0],
    ]
    parts = [observed(np.array(s), [0.0, 1.5], [0, 1], rng) for s in states]
    n = len(states)
    columns = [np.concatenate(c) for c in zip(*(p[:-1] for p in parts), strict=True)]
    order = np.argsort(columns[0], kind="stable")
    angles = type(parts[0])(*(c[order] for c in columns), 0.0)
    place = np.argsort(order, kind="stable").reshape(n, 2, 2)
    tracklets = attributables(angles, [*place[:, 0], *place[:, 1]])
    owner = {tuple(rows): k for k in range(n) for rows in place[k].tolist()}
    own = np.array([owner[tuple(rows.tolist())] for rows in tracklets.detections])
    pairs = np.array([(i, j) for i in range(n) for j in range(n, 2 * n)])
    starts = pair_starts(tracklets, pairs, AdmissibleRegion())
    joined = {(own[i], own[j]) for i, j in zip(starts.first, starts.second, strict=True)}
    assert {(k, k) for k in range(n)} <= joined and len(joined) <= n + 2
    for first, time, state in zip(starts.first, starts.time, starts.state, strict=True):
        truth = propagate(np.array(states[own[first]]), [time])[0]
        if (own[first], own[first]) in joined and np.linalg.norm(state - truth) < 0.02:
            break
    else:
        raise AssertionError("no start is near its object")


def test_polar_orbits_about_the_earth_are_admissible_and_wide_retrograde_ones_are_not():
    # the Jacobi constant of a circular orbit is 1/a + 2 sqrt(a) cos(i), but for the Moon
    for a, inclination, admissible in ((0.9, 90.0, True), (1.6, 90.0, True), (0.9, 180.0, False)):
        speed, angle = np.sqrt((1.0 - MU) / a), np.deg2rad(inclination)
        state = np.array([0.0, a, 0.0, -speed * np.cos(angle), 0.0, speed * np.sin(angle)])
        state += np.array([-MU, 0.0, 0.0, a, 0.0, 0.0])
        found = is_admissible(state[None], 0.0, EARTH_MOON, AdmissibleRegion())
        assert found.tolist() == [admissible]
