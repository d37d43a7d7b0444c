"""Correction and continuation of symmetric periodic orbits."""

from itertools import pairwise

import numpy as np
import pytest

from cislunar.constants import MU
from cislunar.dynamics.cr3bp import equations_of_motion, jacobi_constant, libration_points
from cislunar.dynamics.propagation import propagate
from cislunar.errors import ConvergenceError
from cislunar.orbits.branches import lyapunov_seed, opposite
from cislunar.orbits.continuation import between, continue_branch, locate
from cislunar.orbits.corrector import (
    HALF_PERIOD,
    VY,
    X,
    Z,
    correct,
    fix_coordinate,
    hyperplane,
    shoot,
)
from cislunar.orbits.extent import follow_branch

HALO_GUESS = np.array([1.036, -0.190, -0.132, 0.85])


@pytest.fixture(scope="module")
def lyapunov():
    return follow_branch("Lyap_L2", MU, 1837.4, 6578.0, None)


def test_corrected_orbit_closes_after_a_full_period():
    half = correct(HALO_GUESS, fix_coordinate(X, HALO_GUESS[X]))
    assert half.crossing[X] == pytest.approx(HALO_GUESS[X], abs=1e-15)
    end = propagate(half.state, [half.period], method="dop853")[0]
    assert np.abs(end - half.state).max() < 1e-10
    # The mirror theorem: the far crossing is perpendicular.
    assert np.abs(half.end[[1, 3, 5]]).max() < 2e-12
    assert not half.planar


def test_jacobian_of_a_half_orbit_against_differences():
    half = shoot(HALO_GUESS)
    for k in range(4):
        offset = 1e-6 * np.eye(4)[k]
        ahead, behind = shoot(HALO_GUESS + offset), shoot(HALO_GUESS - offset)
        difference = (ahead.end - behind.end)[[1, 3, 5]] / 2e-6
        assert np.allclose(half.jacobian[:, k], difference, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("index", [X, Z, VY, HALF_PERIOD])
def test_every_coordinate_can_be_fixed(index):
    half = correct(HALO_GUESS, fix_coordinate(index, HALO_GUESS[index]))
    assert half.crossing[index] == pytest.approx(HALO_GUESS[index], abs=1e-14)


def fix_jacobi(value):
    """Constraint JC(u) = value."""

    def constraint(u):
        # grad JC = 2 grad U - 2 v; at rest, the equations of motion return grad U
        force = equations_of_motion([u[X], 0.0, u[Z], 0.0, 0.0, 0.0], MU)
        gradient = np.array([2.0 * force[3], 2.0 * force[5], -2.0 * u[VY], 0.0])
        return float(jacobi_constant([u[X], 0.0, u[Z], 0.0, u[VY], 0.0])) - value, gradient

    return constraint


def test_jacobi_constant_can_be_fixed():
    half = correct(HALO_GUESS, fix_jacobi(3.04))
    assert jacobi_constant(half.state) == pytest.approx(3.04, abs=1e-12)
    _, gradient = fix_jacobi(3.04)(half.crossing)
    for k in range(4):
        offset = 1e-6 * np.eye(4)[k]
        ahead = fix_jacobi(3.04)(half.crossing + offset)[0]
        behind = fix_jacobi(3.04)(half.crossing - offset)[0]
        assert gradient[k] == pytest.approx((ahead - behind) / 2e-6, abs=1e-8)


def test_planar_orbits_stay_in_the_plane():
    half = lyapunov_seed(1).half
    assert half.planar
    assert np.all(half.end[[2, 5]] == 0.0)


@pytest.mark.parametrize("point", [1, 2, 3])
def test_small_lyapunov_orbits_have_the_linear_period(point):
    x = libration_points()[point - 1, 0]
    c2 = (1 - MU) / abs(x + MU) ** 3 + MU / abs(x - 1 + MU) ** 3
    omega = np.sqrt((2 - c2 + np.sqrt(9 * c2**2 - 8 * c2)) / 2)
    gaps = [
        lyapunov_seed(point, amplitude=amplitude).half.period - 2 * np.pi / omega
        for amplitude in (2e-3, 1e-3)
    ]
    # The difference to the linear period grows with the square of the amplitude.
    assert abs(gaps[1]) < 1e-3
    assert gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.02)


def test_a_poor_guess_raises():
    with pytest.raises(ConvergenceError, match="start closer"):
        correct([0.5, 0.3, 5.0, 1.0], fix_coordinate(X, 0.5))


def test_continuation_members_are_periodic_and_ordered(lyapunov):
    xs = [member.half.crossing[X] for member in lyapunov]
    assert np.all(np.diff(xs) > 0.0)
    for before, after in pairwise(lyapunov):
        assert np.abs(after.half.end[[1, 3]]).max() < 1e-10
        assert before.tangent @ after.tangent > np.cos(0.15)


def test_continuation_passes_a_fold_in_x():
    branch = follow_branch("Halo_L1", MU, 1500.0, 6578.0, None)
    xs = np.array([member.half.crossing[X] for member in branch])
    fold = xs.argmax()
    assert 0 < fold < len(xs) - 1
    assert xs[fold] == pytest.approx(0.93352, abs=2e-5)


def test_tangent_is_the_derivative_along_the_branch(lyapunov):
    first, second = lyapunov[10:12]
    middle = between(first, second, 0.5)
    chord = between(first, second, 0.51).half.crossing - between(first, second, 0.49).half.crossing
    assert middle.tangent @ chord / np.linalg.norm(chord) == pytest.approx(1.0, abs=1e-8)


def test_locate_finds_the_given_value(lyapunov):
    found = locate(lyapunov, lambda member: member.half.period - 5.0)
    assert len(found) == 1
    assert found[0][1].half.period == pytest.approx(5.0, abs=1e-11)


def test_opposite_crossing_is_the_same_orbit_with_the_right_tangent(lyapunov):
    first, second = lyapunov[20:22]
    middle = between(first, second, 0.5)
    there = opposite(middle)
    half = correct(there.half.crossing, hyperplane(there.half.crossing, there.tangent))
    assert np.abs(half.crossing - there.half.crossing).max() < 1e-11
    chord = (
        opposite(between(first, second, 0.51)).half.crossing
        - opposite(between(first, second, 0.49)).half.crossing
    )
    assert there.tangent @ chord / np.linalg.norm(chord) == pytest.approx(1.0, abs=1e-8)


def test_unmet_stop_condition_is_reported():
    seed = lyapunov_seed(2)
    with pytest.raises(ConvergenceError, match="5 members"):
        continue_branch(seed.half, seed.direction, lambda _: False, max_points=5)
