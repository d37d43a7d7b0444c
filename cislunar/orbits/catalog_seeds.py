"""First members of catalog families other than the observers' and the targets'.

Vertical orbits grow from the linear motion out of the plane at L1, L2 and L3; axial orbits
bifurcate from Lyapunov orbits. Short and long period orbits grow from the two planar modes at L4,
low and distant prograde orbits from a circle about the Moon, and resonant orbits from an ellipse
about the Earth.
"""

from functools import lru_cache, partial

import numpy as np

from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.dynamics.cr3bp import equations_of_motion, libration_points, variational_matrix
from cislunar.errors import ConvergenceError
from cislunar.orbits.branches import Seed, lyapunov_bifurcation, opposite
from cislunar.orbits.continuation import Point, continue_branch, locate
from cislunar.orbits.corrector import AXIS, X, Z, at_x, correct, fix_coordinate, hyperplane

_VERTICAL_SPEED = 0.02
_AXIAL_SPEED = 5e-3
_TRIANGULAR_AMPLITUDE = 2e-3
_PROGRADE_RADIUS_KM = 4000.0
_MIRRORED_PERIOD = 1.35
_RESONANT_ECCENTRICITIES = (0.4, 0.5, 0.6, 0.3, 0.2, 0.7)
_RESONANT_SLACK = 0.03


def vertical_seed(point: int, mu: float = MU) -> Seed:
    """Small vertical orbit about L1, L2 or L3 where it crosses the x axis upwards."""
    x = libration_points(mu)[point - 1, 0]
    c2 = (1.0 - mu) / abs(x + mu) ** 3 + mu / abs(x - 1.0 + mu) ** 3
    guess = np.array([x, _VERTICAL_SPEED, 0.0, np.pi / np.sqrt(c2)])
    half = correct(guess, fix_coordinate(Z, _VERTICAL_SPEED), mu, section=AXIS)
    return Seed(half, np.eye(4)[Z])


def axial_seed(point: int, mu: float = MU) -> Seed:
    """First axial orbit, which bifurcates where dz/dvz over half a Lyapunov orbit vanishes."""
    guess = lyapunov_bifurcation(point, (2, 5), mu).half.crossing.copy()
    guess[Z] = _AXIAL_SPEED
    half = correct(guess, fix_coordinate(Z, _AXIAL_SPEED), mu, section=AXIS)
    return Seed(half, np.eye(4)[Z])


def triangular_seed(long_period: bool, mu: float = MU) -> Seed:
    """Small planar orbit about L4, at its crossing of x = x(L4) with y above that of L4. The two
    frequencies are those of the linear motion; the shorter period is near the Moon's."""
    point = libration_points(mu)[3]
    linear = variational_matrix(np.concatenate([point, np.zeros(3)]), mu)
    planar = [0, 1, 3, 4]
    values, vectors = np.linalg.eig(linear[np.ix_(planar, planar)])
    upward = np.flatnonzero(values.imag > 0.0)
    order = upward[np.argsort(values.imag[upward])]
    mode = order[0] if long_period else order[-1]
    vector = vectors[:, mode] / vectors[0, mode]
    # real part of vector * exp(i w t) at the phase where x is that of L4
    turned = 1j * vector
    turned *= np.sign(turned[1].real) * _TRIANGULAR_AMPLITUDE / abs(turned[1].real)
    y, vx, vy = turned[1:].real
    period = 2.0 * np.pi / values[mode].imag
    guess = np.array([point[1] + y, 0.0, vx, vy, 0.0, period])
    half = correct(guess, hyperplane(guess, np.eye(6)[0]), mu, section=at_x(float(point[0])))
    return Seed(half, np.eye(6)[0])


def low_prograde_seed(mu: float = MU) -> Seed:
    """Low prograde orbit about the Moon at its near side, from a circle; the family widens. It
    leads to the western low prograde orbits, which approach the Moon at their other crossing."""
    r = _PROGRADE_RADIUS_KM / LENGTH_UNIT_KM
    guess = np.array([1.0 - mu - r, 0.0, r - np.sqrt(mu / r), np.pi / (np.sqrt(mu / r**3) - 1.0)])
    return Seed(correct(guess, fix_coordinate(X, guess[X]), mu), -np.eye(4)[X])


def jacobi_slope(member: Point, mu: float = MU) -> float:
    """Change of the Jacobi constant along a branch, per unit of its arc length."""
    state = member.half.state
    force = equations_of_motion([*state[:3], 0.0, 0.0, 0.0], mu)[3:]
    gradient = np.concatenate([2.0 * force, -2.0 * state[3:]])
    return float(gradient[list(member.half.section.start)] @ member.tangent[:-1])


@lru_cache(maxsize=8)
def _prograde_fold(mu: float = MU) -> Point:
    """Prograde orbit with the largest Jacobi constant of the branch that no circle leads to.
    Without the asymmetry of the Earth's gravity this branch would bifurcate symmetrically from the
    low orbits. A western orbit, mirrored at the plane through the Moon, leads to it. From the fold
    the eastern low prograde orbits continue in one direction, the distant prograde orbits in the
    other."""
    low = low_prograde_seed(mu)
    western = continue_branch(
        low.half, low.direction, lambda member: member.half.period > _MIRRORED_PERIOD, mu=mu
    )[-1].half
    x, _, vy, half_period = western.crossing
    guess = np.array([2.0 * (1.0 - mu) - x, 0.0, -vy, half_period])
    half = correct(guess, fix_coordinate(X, guess[X]), mu)
    slope = partial(jacobi_slope, mu=mu)
    branch = continue_branch(half, -np.eye(4)[X], lambda member: slope(member) <= 0.0, mu=mu)
    return locate(branch[-2:], slope, mu, limit=1)[0][1]


def eastern_seed(mu: float = MU) -> Seed:
    """The fold, in the direction of the eastern low prograde orbits."""
    fold = _prograde_fold(mu)
    return Seed(fold.half, -fold.tangent)


def distant_prograde_seed(mu: float = MU) -> Seed:
    """The fold at its Earth-side crossing, in the direction of the distant prograde orbits. They
    approach the Moon at their other crossing."""
    there = opposite(_prograde_fold(mu))
    crossing = there.half.crossing
    return Seed(correct(crossing, fix_coordinate(X, crossing[X]), mu), there.tangent)


def resonant_seed(p: int, q: int, mu: float = MU, *, moonward: bool = True) -> Seed:
    """Planar orbit of p revolutions about the Earth in q revolutions of the Moon, at perigee. It
    starts from a Kepler ellipse with its perigee on the Moon's side of the Earth, or opposite; the
    family continues to larger perigees."""
    semi_major = (p / q) ** (-2.0 / 3.0) * (1.0 - mu) ** (1.0 / 3.0)
    side = 1.0 if moonward else -1.0
    for eccentricity in _RESONANT_ECCENTRICITIES:
        perigee = semi_major * (1.0 - eccentricity)
        speed = np.sqrt((1.0 - mu) * (2.0 / perigee - 1.0 / semi_major))
        guess = np.array([-mu + side * perigee, 0.0, side * (speed - perigee), np.pi * q])
        try:
            half = correct(guess, fix_coordinate(X, guess[X]), mu)
        except ConvergenceError:
            continue
        # near the Moon the corrector may converge to another family
        if abs(half.crossing[3] / guess[3] - 1.0) < _RESONANT_SLACK:
            return Seed(half, side * np.eye(4)[X])
    raise ConvergenceError(f"no {p}:{q} resonant orbit near an ellipse about the Earth")
