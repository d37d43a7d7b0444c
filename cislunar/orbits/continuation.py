"""Pseudo-arclength continuation of symmetric periodic orbits.

Continuation in x alone (Paul & Fan, section 3) fails at every fold of a family in x. Continuation
in arc length of ``u = (x, z, vy, tau)`` does not, and serves all families.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from cislunar.constants import MU
from cislunar.errors import ConvergenceError
from cislunar.orbits.corrector import HalfOrbit, correct, hyperplane
from cislunar.runtime import Array

_MIN_STEP = 1e-7
MAX_STEP = 0.03
_MAX_TURN = 0.15
_EASY_TURN = 0.075
EASY_ITERATIONS = 3
MAX_ITERATIONS = 12
_MAX_CORRECTION = 0.15


class Point(NamedTuple):
    """A member of a branch, with the tangent of the branch there."""

    half: HalfOrbit
    tangent: Array
    """Unit tangent in (x, z, vy, tau), shape (4,), pointing along the continuation."""


Branch = list[Point]
Measure = Callable[[Point], float]


def _tangent_of(half: HalfOrbit, along: Array) -> Array:
    """Unit null vector (4,) of the Jacobian of a closed half orbit, oriented along `along`."""
    tangent = np.zeros(half.crossing.size)
    if half.planar:
        rows, columns = (list(each) for each in half.section.flat)
        tangent[columns] = np.linalg.svd(half.jacobian[np.ix_(rows, columns)])[2][-1]
    else:
        tangent = np.linalg.svd(half.jacobian)[2][-1]
    return tangent if tangent @ along >= 0.0 else -tangent


def continue_branch(
    start: HalfOrbit,
    direction: Array,
    stop: Callable[[Point], bool],
    *,
    mu: float = MU,
    first_step: float = 1e-3,
    max_step: float = MAX_STEP,
    max_points: int = 5000,
    partial: bool = False,
    easy_iterations: int = EASY_ITERATIONS,
) -> Branch:
    """Follow a branch from one member until a condition holds.

    Parameters
    ----------
    start : HalfOrbit
        First member.
    direction : ndarray, shape (4,)
        Sense of travel in (x, z, vy, tau); only its sign along the tangent matters.
    stop : callable
        Called with each new point; the first for which it is true ends the branch.
    mu : float
        Mass ratio.
    first_step, max_step : float
        Arc length steps, nondimensional.
    max_points : int
        Largest number of members.
    partial : bool
        Where the continuation fails, end the branch instead of raising an error.
    easy_iterations : int
        Largest number of corrector iterations after which the step grows.

    Returns
    -------
    list of Point
        In order, including `start`.

    Raises
    ------
    ConvergenceError
        If the step underflows or `max_points` is reached before `stop` holds.
    """
    branch = [Point(start, _tangent_of(start, direction))]
    step = first_step
    while not (len(branch) > 1 and stop(branch[-1])):
        if len(branch) >= max_points and partial:
            return branch
        if len(branch) >= max_points:
            raise ConvergenceError(
                f"continuation did not meet its stop condition in {max_points} members; "
                f"the last crossing is {branch[-1].half.crossing.tolist()}"
            )
        last = branch[-1]
        guess = last.half.crossing + step * last.tangent
        try:
            half = correct(
                guess,
                hyperplane(guess, last.tangent),
                mu,
                max_iterations=MAX_ITERATIONS,
                section=start.section,
            )
            tangent = _tangent_of(half, last.tangent)
            turn = np.arccos(min(1.0, float(tangent @ last.tangent)))
            # A correction much larger than the curvature suggests has converged to another family.
            correction = np.linalg.norm(half.crossing - guess) / step
        except ConvergenceError:
            turn = correction = np.inf
        if turn > _MAX_TURN or correction > _MAX_CORRECTION:
            step *= 0.5
            if step < _MIN_STEP and partial:
                return branch
            if step < _MIN_STEP:
                raise ConvergenceError(
                    f"continuation stalled after {len(branch)} members at crossing "
                    f"{last.half.crossing.tolist()}; end the family earlier (keep-out radii)"
                )
            continue
        branch.append(Point(half, tangent))
        if half.iterations <= easy_iterations and turn < _EASY_TURN:
            step = min(max_step, 1.4 * step)
    return branch


def interpolate(first: Point, second: Point, fraction: float) -> tuple[Array, Array]:
    """Cubic Hermite estimate of crossing and tangent between neighboring members of a branch."""
    u0, u1 = first.half.crossing, second.half.crossing
    chord = float(np.linalg.norm(u1 - u0))
    m0, m1 = chord * first.tangent, chord * second.tangent
    s = fraction
    crossing = (
        (1 + 2 * s) * (1 - s) ** 2 * u0
        + s * (1 - s) ** 2 * m0
        + s**2 * (3 - 2 * s) * u1
        - s**2 * (1 - s) * m1
    )
    tangent = (1 - s) * first.tangent + s * second.tangent
    return crossing, tangent / np.linalg.norm(tangent)


def between(first: Point, second: Point, fraction: float, mu: float = MU) -> Point:
    """Corrected member at a fraction, 0 to 1, of the distance between neighbors of a branch."""
    if fraction in (0.0, 1.0):
        return second if fraction else first
    guess, tangent = interpolate(first, second, fraction)
    half = correct(guess, hyperplane(guess, tangent), mu, section=first.half.section)
    return Point(half, _tangent_of(half, tangent))


def _bracketed_root(first: Point, second: Point, measure: Measure, mu: float) -> Point:
    """Member between neighbors at which the measure vanishes, taken as the best of all trials."""
    trials: list[tuple[float, Point]] = []

    def value(fraction: float) -> float:
        point = between(first, second, fraction, mu)
        found = measure(point)
        trials.append((abs(found), point))
        return found

    brentq(value, 0.0, 1.0, xtol=1e-15, rtol=1e-14)
    return min(trials, key=lambda trial: trial[0])[1]


def locate(
    branch: Branch, measure: Measure, mu: float = MU, *, limit: int | None = None
) -> list[tuple[int, Point]]:
    """Members of a branch (two or more) at which a measure changes sign, at most `limit`: the index
    of the member before each root, and the root, in order along the branch."""
    found: list[tuple[int, Point]] = []
    before = measure(branch[0])
    for i in range(len(branch) - 1):
        after = measure(branch[i + 1])
        if before == 0.0:
            found.append((i, branch[i]))
        elif before * after < 0.0:
            found.append((i, _bracketed_root(branch[i], branch[i + 1], measure, mu)))
        before = after
        if limit is not None and len(found) >= limit:
            return found
    if before == 0.0:
        found.append((len(branch) - 1, branch[-1]))
    return found


def split_at_extrema(branch: Branch, measure: Measure, mu: float = MU) -> Branch:
    """The branch with members added where the magnitude of a measure has a local minimum. A measure
    may reach zero twice between neighbors of equal sign (a family that attains a given Jacobi
    constant next to its fold). With the extremum inserted, `locate` finds both roots."""
    values = [measure(point) for point in branch]
    out = list(branch)
    for i in range(len(branch) - 2, 0, -1):
        a, b, c = values[i - 1 : i + 2]
        if a * b <= 0.0 or b * c <= 0.0 or abs(b) > min(abs(a), abs(c)):
            continue
        sign = np.sign(b)
        # The extremum lies on one of the two sides; both are searched.
        for k in (i, i - 1):
            first, second = branch[k], branch[k + 1]
            best = minimize_scalar(
                lambda s, first=first, second=second, sign=sign: (
                    sign * measure(between(first, second, s, mu))
                ),
                bounds=(0.0, 1.0),
                method="bounded",
                options={"xatol": 1e-6},
            )
            if best.fun < 0.0:
                out.insert(k + 1, between(first, second, float(best.x), mu))
                break
    return out


def join(backward: Branch, forward: Branch) -> Branch:
    """Concatenate two continuations of the same start in opposite senses."""
    turned = [Point(member.half, -member.tangent) for member in backward[:0:-1]]
    return turned + forward
