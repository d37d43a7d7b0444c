"""Initial orbits from tracklets of moving observers, and verdicts on what is determined."""

import numpy as np
import pytest
from detected_object import HALO, OBSERVERS, RETROGRADE, observed

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics import propagate
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import (
    CONTRADICTORY,
    DIRECTION_ONLY,
    NO_ORBIT,
    ORBIT,
    attributables,
    implied_size,
    initial_orbits,
)
from cislunar.photometry import phase_angle, sphere_magnitude

SUN = np.array([300.0, 240.0, 0.0])


@pytest.mark.parametrize(
    ("hours", "owners"),
    [([0.0, 0.25], [0, 1]), ([0.0, 3.0], [0, 1]), ([0.0, 8.0, 14.0], [0, 0, 0]),
     ([0.0, 5.0, 9.0, 20.0], [0, 1, 0, 1])],
)  # fmt: skip
@pytest.mark.parametrize("state", [HALO, RETROGRADE + np.array([0, 0, 0.05, 0, 0, 0.02])])
def test_periodic_orbits_are_found_by_one_and_by_two_moving_observers(state, hours, owners):
    angles = observed(state, hours, owners, np.random.default_rng(5))
    found = initial_orbits(angles, epoch=0.0)
    assert found.verdict in (ORBIT, "several orbits")
    error = found.fits.state - state
    squared = np.einsum("ki,kij,kj->k", error, np.linalg.inv(found.fits.covariance), error)
    assert squared.min() < 25.0
    assert found.verdict != ORBIT or squared[0] < 25.0


def test_a_search_continues_from_the_solutions_for_nearly_the_same_angles():
    angles = observed(HALO, [0.0, 3.0], [0, 1], np.random.default_rng(5))
    found = initial_orbits(angles, epoch=0.0)
    again = initial_orbits(angles, epoch=0.0, known=found)
    np.testing.assert_array_equal(again.fits.state, found.fits.state)
    np.testing.assert_array_equal(again.log_evidence, found.log_evidence)
    # by another realization of the noise
    other = observed(HALO, [0.0, 3.0], [0, 1], np.random.default_rng(6))
    anew, continued = (initial_orbits(other, epoch=0.0, known=each) for each in (None, found))
    assert continued.verdict == anew.verdict
    np.testing.assert_allclose(continued.log_evidence, anew.log_evidence, atol=1e-3)
    sigma = np.sqrt(np.diagonal(anew.fits.covariance, axis1=1, axis2=2))
    assert np.all(np.abs(continued.fits.state - anew.fits.state) < 1e-2 * sigma)
    # nothing to continue from
    empty = found._replace(fits=found.fits.take([]))
    np.testing.assert_array_equal(
        initial_orbits(other, epoch=0.0, known=empty).fits.state, anew.fits.state
    )


def test_the_verdict_says_what_is_determined():
    rng = np.random.default_rng(6)
    one = observed(HALO, [0.0], [0], rng)
    assert initial_orbits(one).verdict == DIRECTION_ONLY
    # half an hour of one observer bends too little to give the range
    half_hour = observed(HALO, [0.0], [0], rng, visits=(0.0, 10.0, 20.0, 30.0))
    assert initial_orbits(half_hour).verdict == DIRECTION_ONLY
    # tracklets of two different objects
    pieces = [observed(state, [h], [k], rng) for state, h, k in
              ((HALO, 0.0, 0), (RETROGRADE + 0.05, 1.0, 1), (HALO, 2.0, 0))]  # fmt: skip
    mixed = type(one)(
        *(np.concatenate(columns) for columns in zip(*(p[:-1] for p in pieces), strict=True)), 0.0
    )
    wrong = initial_orbits(mixed)
    assert wrong.verdict == CONTRADICTORY and len(wrong.fits.state) == 0
    # directions of a point that moves as no orbit with a permitted energy
    fast = HALO.copy()
    fast[3:] = [0.0, 4.0, 3.0]
    hyperbolic = observed(fast, [0.0, 1.0, 2.0], [0, 1, 0], rng)
    assert initial_orbits(hyperbolic).verdict in (NO_ORBIT, CONTRADICTORY)


def test_the_solution_that_moves_along_with_the_observer_is_not_returned():
    angles = observed(HALO, [0.0, 8.0, 14.0], [0, 0, 0], np.random.default_rng(7))
    for fit in initial_orbits(angles, epoch=0.0).fits.state:
        assert np.linalg.norm(fit[:3] - OBSERVERS[0, :3]) * LENGTH_UNIT_KM > 2500.0


def test_brightness_excludes_orbits_of_impossible_size():
    rng = np.random.default_rng(8)
    hours, owners = [0.0, 1.0], [0, 1]
    plain = observed(HALO, hours, owners, rng)
    way = propagate(HALO, plain.time, method="dop853")[:, :3] - plain.observer_position
    meters = np.linalg.norm(way, axis=1) * LENGTH_UNIT_KM * 1e3
    phase = phase_angle(way, plain.observer_position + way - SUN)
    for radius, verdict in ((1.0, ORBIT), (0.01, NO_ORBIT)):
        angles = plain._replace(
            magnitude=sphere_magnitude(meters, phase, radius_m=radius),
            sun=np.tile(SUN, (meters.size, 1)),
        )
        size, scatter = implied_size(way, angles)
        assert size == pytest.approx(radius**2) and scatter < 1e-12
        assert initial_orbits(angles).verdict == verdict


def test_bad_input_is_refused_in_one_line():
    angles = observed(HALO, [0.0, 1.0], [0, 1], np.random.default_rng(14))
    with pytest.raises(ConfigurationError, match="no row"):
        initial_orbits(angles.rows([]))
    with pytest.raises(ConfigurationError, match="2 observers"):
        attributables(angles, [np.arange(4)])
    with pytest.raises(ConfigurationError, match="two different times"):
        attributables(angles, [np.array([1])])
    assert attributables(angles, []).time.size == 0
