"""Attributables and tracklets against differences, repeated measurements and brute force."""

from itertools import pairwise

import numpy as np
from detected_object import HALO, OBSERVERS, observed, paths, turned
from nights import HOUR, SIGMA

from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics import propagate
from cislunar.orbit_determination import attributables, form_tracklets, make_angles


def test_attributables_are_direction_and_rate_in_axes_that_do_not_rotate():
    """Against differences of exact directions, and the covariance against repeated measurements."""
    rng = np.random.default_rng(9)
    minutes = np.array([0.0, 2.0, 5.0, 10.0])
    times = minutes / 60.0 * HOUR
    state = HALO
    place = paths(OBSERVERS, times, np.zeros(4, int))
    way = propagate(state, times, method="dop853")[:, :3] - place
    exact = attributables(
        make_angles(times, np.zeros(4, int), place, way, SIGMA), [np.arange(4)], degree=2
    )
    t = exact.time[0]

    def inertial(vector, moment):
        return turned(vector, moment - t)

    step = 1e-6
    ends = []
    for moment in (t - step, t + step):
        there = propagate(state, [moment], method="dop853")[0, :3]
        here = propagate(OBSERVERS[0], [moment], method="dop853")[0, :3]
        line = inertial(there - here, moment)
        ends.append((line / np.linalg.norm(line), inertial(here, moment)))
    sigma = np.sqrt(np.diag(exact.covariance[0]))
    rate = (ends[1][0] - ends[0][0]) / (2.0 * step)
    offset = exact.basis[0] @ (0.5 * (ends[0][0] + ends[1][0]))
    assert np.abs(offset / sigma[:2]).max() < 0.02
    assert np.abs(exact.basis[0] @ (exact.rate[0] - rate) / sigma[2:]).max() < 0.02
    velocity = (ends[1][1] - ends[0][1]) / (2.0 * step)
    assert np.linalg.norm(exact.observer_velocity[0] - velocity) * 1023.0 < 0.5  # m/s
    drawn = []
    unit = way / np.linalg.norm(way, axis=1, keepdims=True)
    for _ in range(600):
        noisy = unit + SIGMA * rng.normal(size=unit.shape)
        one = attributables(
            make_angles(times, np.zeros(4, int), place, noisy, SIGMA), [np.arange(4)], degree=2
        )
        drawn.append(
            np.concatenate([exact.basis[0] @ one.direction[0],
                            exact.basis[0] @ (one.rate[0] - exact.rate[0])])
        )  # fmt: skip
    ratio = np.cov(np.transpose(drawn)) / np.outer(sigma, sigma)
    np.testing.assert_allclose(
        ratio, exact.covariance[0] / np.outer(sigma, sigma), atol=6.0 * np.sqrt(2.0 / 600)
    )


def test_tracklets_are_all_pairs_that_brute_force_finds():
    rng = np.random.default_rng(10)
    n = 40
    times = np.sort(rng.integers(0, 6, n)) * 10.0 / 60.0 * HOUR
    owners = rng.integers(0, 2, n)
    direction = np.array([1.0, 0.0, 0.0]) + rng.normal(scale=4e-3, size=(n, 3))
    magnitude = rng.uniform(14.0, 18.0, n)
    angles = make_angles(times, owners, np.zeros((n, 3)), direction, SIGMA, magnitude=magnitude)
    found = {tuple(rows) for rows in (r.tolist() for r in form_tracklets(angles, rate=0.0))}
    expected = set()
    for a in range(n):
        for b in range(n):
            seconds = (times[b] - times[a]) * TIME_UNIT_S
            if owners[a] != owners[b] or not 0.0 < seconds <= 900.0:
                continue
            apart = np.arccos(np.clip(angles.direction[a] @ angles.direction[b], -1.0, 1.0))
            if apart / SIGMA <= 3.5 * seconds and abs(magnitude[a] - magnitude[b]) <= 1.5:
                expected.add((a, b))
    chained = {(a, b) for rows in found for a, b in pairwise(rows)}
    assert chained == expected and len(expected) > 10
    # four detections of one object are one tracklet
    straight = observed(HALO, [0.0], [0], rng, visits=(0.0, 10.0, 20.0, 30.0))
    assert [rows.tolist() for rows in form_tracklets(straight)] == [[0, 1, 2, 3]]
