"""Confirmation of linked orbits, and the separation of their observers."""

import numpy as np
from nights import OBJECTS, SIGMA, night
from scipy.stats import kstest

from cislunar.dynamics import EARTH_MOON, propagate
from cislunar.orbit_determination import (
    CONVERGED,
    DIRECTION_ONLY,
    ORBIT,
    SEVERAL_ORBITS,
    AdmissibleRegion,
    ConfirmationRule,
    determined_by_one,
    fit_orbits,
    make_angles,
    separation_probability,
)


def test_confirmation_needs_observers_tracklets_and_a_determined_orbit():
    rule = ConfirmationRule()
    for observers, verdict, ratio, expected in (
        ([0, 1, 2], ORBIT, 30.0, True),
        ([0, 1, 2], SEVERAL_ORBITS, 30.0, False),
        ([0, 1, 2], ORBIT, 5.0, False),
        ([0, 0, 1, 1], ORBIT, 30.0, False),
        ([0, 0, 0, 1, 1], ORBIT, 30.0, True),
        ([0, 0, 0, 0, 1], ORBIT, 30.0, False),
        ([0] * 9, ORBIT, 90.0, False),
        ([0, 0, 0, 1, 1], DIRECTION_ONLY, 30.0, False),
    ):
        assert rule.confirms(observers, verdict, ratio) is expected
    assert not rule.confirms([0, 1, 2], ORBIT, 30.0, separation=0.002)
    for observers, verdict, ratio, expected in (
        ([0] * 5, ORBIT, 30.0, True),
        ([0] * 4, ORBIT, 30.0, False),
        ([0, 0, 0, 0, 1], ORBIT, 30.0, True),
        ([0] * 5, ORBIT, 5.0, False),
        ([0] * 5, SEVERAL_ORBITS, 30.0, False),
    ):
        assert rule.confirms(observers, verdict, ratio, 0.0, by_one=True) is expected


def test_the_separation_of_observers_is_uniform_for_one_object_and_rejects_two():
    """The probability of the extra sum of squares is uniform on (0, 1) for one object; detections
    of two objects by one observer each are rejected."""
    probability, rejected, rng = [], [], np.random.default_rng(8)
    angles, _ = night(OBJECTS[:1], [0.0, 4.0, 9.0, 15.0], 0.0, 100)
    angles = angles.rows(np.flatnonzero(angles.observer < 2))
    states = [propagate(OBJECTS[0], [t], method="dop853")[0, :3] for t in angles.time]
    exact = np.array(states) - angles.observer_position
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    for _ in range(150):
        noisy = exact + SIGMA * rng.normal(size=exact.shape)
        given = make_angles(angles.time, angles.observer, angles.observer_position, noisy, SIGMA)
        fit = fit_orbits(given, [np.arange(angles.time.size)], OBJECTS[:1], 0.0)
        probability += separation_probability(fit, given, forces=EARTH_MOON).tolist()
    assert kstest(probability, "uniform").pvalue > 1e-3
    for offset in (3e-4, 1e-3, 3e-3):
        pair = np.array([OBJECTS[0], OBJECTS[0] + [0.0, offset, 0.0, 0.0, 0.0, offset]])
        angles, origin = night(pair, [0.0, 3.0, 8.0], 0.0, 200)
        rows = np.flatnonzero((angles.observer < 2) & (angles.observer == origin))
        fit = fit_orbits(angles, [rows], pair[:1], 0.0)
        assert fit.status[0] == CONVERGED
        rejected += separation_probability(fit, angles, forces=EARTH_MOON).tolist()
    assert max(rejected) < 1e-6
    # one observer, or more than three, have no test
    angles, _ = night(OBJECTS[:1], [0.0, 3.0, 8.0], 0.0, 300)
    fit = fit_orbits(angles, [np.flatnonzero(angles.observer == 1)], OBJECTS[:1], 0.0)
    assert separation_probability(fit, angles, forces=EARTH_MOON).tolist() == [1.0]


def test_one_observer_determines_an_orbit_and_others_agree_with_it_or_not():
    """The probability is uniform on (0, 1) for one object; a tracklet of another object does not
    agree, and an hour of angles of one observer does not determine an orbit."""
    region, rng = AdmissibleRegion(), np.random.default_rng(3)

    def state(pair, hours, seed, kept):
        angles, origin = night(pair, hours, 0.0, seed)
        rows = np.flatnonzero(kept(angles, origin))
        fit = fit_orbits(angles, [rows], pair[:1], 0.0)
        assert fit.status[0] == CONVERGED
        return fit, angles, rows

    def first_and(other):
        """All angles of the first object by observer 0, and those of another by observer 1."""
        return lambda angles, origin: (
            (angles.observer == 0) & (origin == 0) | (angles.observer == 1) & (origin == other)
        )

    hours = [0.0, 4.0, 9.0, 15.0, 22.0]
    fit, angles, rows = state(OBJECTS[:1], hours, 100, first_and(0))
    exact = np.array([propagate(OBJECTS[0], [t], method="dop853")[0, :3] for t in angles.time])
    exact -= angles.observer_position
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    probability = []
    for _ in range(150):
        noisy = exact + SIGMA * rng.normal(size=exact.shape)
        given = make_angles(angles.time, angles.observer, angles.observer_position, noisy, SIGMA)
        one = fit_orbits(given, [rows], OBJECTS[:1], 0.0)
        determined, share = determined_by_one(one, given, region, forces=EARTH_MOON)
        assert determined.tolist() == [True]
        probability += share.tolist()
    assert kstest(probability, "uniform").pvalue > 1e-3
    pair = np.array([OBJECTS[0], OBJECTS[0] + [0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3]])
    fit, angles, _ = state(pair, hours, 200, first_and(1))
    assert determined_by_one(fit, angles, region, forces=EARTH_MOON)[1][0] < 1e-6
    fit, angles, _ = state(OBJECTS[:1], hours, 300, lambda angles, _: angles.observer == 1)
    determined, share = determined_by_one(fit, angles, region, forces=EARTH_MOON)
    assert (determined.tolist(), share.tolist()) == ([True], [1.0])
    fit, angles, _ = state(OBJECTS[:1], [0.0, 1.0], 300, first_and(0))
    assert determined_by_one(fit, angles, region, forces=EARTH_MOON)[0].tolist() == [False]
