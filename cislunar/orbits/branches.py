"""Branches of periodic orbits, from linear seeds through their bifurcations.

Lyapunov orbits grow from the linear motion about L1, L2 and L3. Halo orbits bifurcate from them
where the out-of-plane shear of the half-period map vanishes; butterflies and dragonflies bifurcate
from the L2 halos at period doublings. No stored initial guess is used. The ``*_seed`` functions
return the first member of a branch and the direction of its continuation; they raise a
`ConvergenceError` if the first member or the bifurcation is not found.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.dynamics.cr3bp import libration_points
from cislunar.orbits.continuation import Branch, Point, continue_branch, locate
from cislunar.orbits.corrector import (
    HALF_PERIOD,
    HalfOrbit,
    X,
    Z,
    correct,
    fix_coordinate,
    hyperplane,
    shoot,
)
from cislunar.runtime import Array

_LYAPUNOV_AMPLITUDE = 1e-3
_HALO_HEIGHT = {1: 1e-3, 2: 1e-3, 3: 5e-3}
_DOUBLING_OFFSET = 2e-3
_RESONANT_ECCENTRICITY = 0.5
_DRO_RADIUS_KM = 4000.0


class Seed(NamedTuple):
    """First member of a family and the direction of its continuation."""

    half: HalfOrbit
    direction: Array
    """Sense of the continuation in (x, z, vy, tau), shape (4,)."""


def lyapunov_seed(point: int, mu: float = MU, amplitude: float = _LYAPUNOV_AMPLITUDE) -> Seed:
    """Smallest planar Lyapunov orbit about L1, L2 or L3, of half width `amplitude` in x, at its
    outer crossing: on the Earth side of L1, the far side of L2 and the outer side of L3, where x is
    monotone along the family."""
    x_point = libration_points(mu)[point - 1, 0]
    c2 = (1.0 - mu) / abs(x_point + mu) ** 3 + mu / abs(x_point - 1.0 + mu) ** 3
    omega = np.sqrt((2.0 - c2 + np.sqrt(9.0 * c2**2 - 8.0 * c2)) / 2.0)
    ratio = (omega**2 + 1.0 + 2.0 * c2) / (2.0 * omega)
    side = 1.0 if point == 2 else -1.0
    guess = np.array(
        [x_point + side * amplitude, 0.0, -side * ratio * omega * amplitude, np.pi / omega]
    )
    half = correct(guess, fix_coordinate(X, guess[X]), mu)
    return Seed(half, side * np.eye(4)[X])


@lru_cache(maxsize=32)
def halo_seed(point: int, mu: float = MU) -> Seed:
    """First northern halo orbit about point 1, 2 or 3, near the Lyapunov family, with z > 0."""
    bifurcation = halo_bifurcation(point, mu)
    guess = bifurcation.half.crossing.copy()
    guess[Z] = _HALO_HEIGHT[point]
    half = correct(guess, fix_coordinate(Z, guess[Z]), mu)
    return Seed(half, np.eye(4)[Z])


@lru_cache(maxsize=32)
def halo_bifurcation(point: int, mu: float = MU) -> Point:
    """Member of the Lyapunov family about point 1, 2 or 3 from which the halo orbits bifurcate."""
    return lyapunov_bifurcation(point, (5, 2), mu)


def lyapunov_bifurcation(point: int, entry: tuple[int, int], mu: float) -> Point:
    """First member of the Lyapunov family about point 1, 2 or 3 at which an out-of-plane entry of
    the half-period map vanishes: the shear d(vz)/dz, entry (5, 2), where orbits symmetric about the
    xz-plane (halos) bifurcate; dz/d(vz), entry (2, 5), where axial orbits do."""

    def shear(member: Point) -> float:
        return float(member.half.stm[entry])

    seed = lyapunov_seed(point, mu)
    sign = np.sign(seed.half.stm[entry])
    branch = continue_branch(
        seed.half, seed.direction, lambda member: sign * shear(member) <= 0.0, mu=mu
    )
    return locate(branch[-2:], shear, mu, limit=1)[0][1]


def opposite(member: Point) -> Point:
    """The same orbit at its other perpendicular crossing; only crossing and tangent are valid."""
    crossing, end, block = member.half.crossing, member.half.end, [0, 2, 4]
    there = np.array([end[0], end[2], end[4], crossing[HALF_PERIOD]])
    # x, z and vy are stationary in time at a perpendicular crossing, by symmetry.
    moved = member.half.stm[np.ix_(block, block)] @ member.tangent[:3]
    along = np.append(moved, member.tangent[HALF_PERIOD])
    return Point(member.half._replace(crossing=there), along / np.linalg.norm(along))


def _doubling_determinant(member: Point, mu: float = MU) -> float:
    """Determinant that vanishes where orbits of twice the period bifurcate from a branch. The
    bordered Jacobian of the member traversed twice is singular where another branch, symmetric
    about the same crossing, passes through. The member's tangent must be oriented along the branch.
    """
    jacobian, tangent, _ = _double_cover(member, mu)
    return float(np.linalg.det(np.vstack([jacobian, tangent])))


def _double_cover(member: Point, mu: float) -> tuple[Array, Array, Array]:
    """Jacobian, tangent and crossing of a member that is traversed twice."""
    double = np.array([1.0, 1.0, 1.0, 2.0])
    crossing = member.half.crossing * double
    tangent = member.tangent * double
    return shoot(crossing, mu).jacobian, tangent / np.linalg.norm(tangent), crossing


def _doubled_seed(member: Point, sign_of_x: float, mu: float) -> Seed:
    """First member of the branch of twice the period through a branch point."""
    jacobian, tangent, crossing = _double_cover(member, mu)
    null_space = np.linalg.svd(jacobian)[2][-2:]
    # One direction of the null space is the tangent of the doubled parent; the other leaves it.
    direction = null_space.T @ np.array([null_space[1] @ tangent, -(null_space[0] @ tangent)])
    direction /= np.linalg.norm(direction)
    if direction[X] * sign_of_x < 0.0:
        direction = -direction
    guess = crossing + _DOUBLING_OFFSET * direction
    return Seed(correct(guess, hyperplane(guess, direction), mu), direction)


@lru_cache(maxsize=32)
def _halo_l2_to_doublings(mu: float) -> tuple[Branch, list[Point], list[Point]]:
    """The L2 halo branch and its period doublings about the perilune and the apolune."""
    seed = halo_seed(2, mu)
    counts = {"perilune": 0, "apolune": 0}
    last: dict[str, float] = {}

    def both_met(member: Point) -> bool:
        for name, view in (("perilune", opposite(member)), ("apolune", member)):
            value = _doubling_determinant(view, mu)
            if name in last and last[name] * value < 0.0:
                counts[name] += 1
            last[name] = value
        return counts["perilune"] >= 1 and counts["apolune"] >= 2

    branch = continue_branch(seed.half, seed.direction, both_met, mu=mu)
    perilune = locate(
        branch, lambda member: _doubling_determinant(opposite(member), mu), mu, limit=1
    )
    apolune = locate(branch, lambda member: _doubling_determinant(member, mu), mu, limit=2)
    return branch, [p for _, p in perilune], [p for _, p in apolune]


@lru_cache(maxsize=32)
def dragonfly_seed(mu: float = MU) -> Seed:
    """First northern dragonfly orbit, at its perpendicular perilune. It belongs to the first period
    doubling of the L2 halos that is symmetric about the perilune; the doubling about the apolune,
    0.008 in period away, is another family."""
    return _doubled_seed(opposite(_halo_l2_to_doublings(mu)[1][0]), -1.0, mu)


@lru_cache(maxsize=32)
def butterfly_seed(mu: float = MU) -> Seed:
    """First northern butterfly orbit, at the perpendicular apolune that moves outwards. It belongs
    to the second period doubling of the L2 halos that is symmetric about the apolune, in their
    near-rectilinear part."""
    return _doubled_seed(_halo_l2_to_doublings(mu)[2][1], 1.0, mu)


def retrograde_seed(mu: float = MU) -> Seed:
    """Distant retrograde orbit at its Earth-side crossing, from a circle about the Moon. The
    family continues towards the Earth."""
    r = _DRO_RADIUS_KM / LENGTH_UNIT_KM
    guess = np.array([1.0 - mu - r, 0.0, np.sqrt(mu / r) + r, np.pi / (np.sqrt(mu / r**3) + 1.0)])
    return Seed(correct(guess, fix_coordinate(X, guess[X]), mu), -np.eye(4)[X])


def resonant_seed(mu: float = MU, moonward: bool = True) -> Seed:
    """Planar 3:1 resonant orbit at perigee: three prograde revolutions per revolution of the Moon,
    eccentricity 0.5. The perigee crossing lies on the Moon's side of the Earth (`moonward`, the
    unstable branch) or opposite (the stable one); the family continues to larger perigees."""
    semi_major = 3.0 ** (-2.0 / 3.0) * (1.0 - mu) ** (1.0 / 3.0)
    perigee = semi_major * (1.0 - _RESONANT_ECCENTRICITY)
    speed = np.sqrt((1.0 - mu) * (2.0 / perigee - 1.0 / semi_major))
    side = 1.0 if moonward else -1.0
    guess = np.array([-mu + side * perigee, 0.0, side * (speed - perigee), np.pi])
    return Seed(correct(guess, fix_coordinate(X, guess[X]), mu), side * np.eye(4)[X])
