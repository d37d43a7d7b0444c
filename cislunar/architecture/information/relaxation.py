"""Upper bound on the information of any architecture of N satellites, by concave relaxation.

With x(c) in 0 .. 1 how much of a satellite flies at place c,

    F(x) = mean over items i of 1/2 log det(I + sum over c of x(c) G(c, i))

is concave (also the log-determinant of a Schur complement, which is operator concave and monotone),
and agrees with the objective where x is a choice. At any x a tangent therefore lies above it:

    F(y) <= F(x) + g . (y - x) <= F(x) - g . x + the N largest entries of g,   g = grad F(x),

for all choices y of N places: a bound whatever x is. Spectral projected gradients (Birgin,
Martinez & Raydan, 2000) with an exact line search lead to the x where it is least, the maximum of F
over sum x = N. What is left between it and the best choice is the gap of integrality, which only
branching would close.

Where all states count F is submodular, and F(S) and the N largest gains over any S are a second
bound (Nemhauser, Wolsey & Fisher, 1978), the sharper one where N is small.
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.certified import Bound
from cislunar.architecture.information.kernels import along, gains, slopes
from cislunar.architecture.information.objective import InformationObjective

_ROUNDING = 1e-9  # relative; sums of 1e5 terms in double precision stay far within
_CONVERGED = 1e-4  # share of the value by which the tangent still exceeds it
_HALVINGS = 12  # of the line search
_BISECTIONS = 100  # of the projection: to the last bit
_SPREAD = 0.1  # share of the start that is spread over all places


def _projected(wanted: NDArray, number: int) -> NDArray[np.float64]:
    """The nearest point with entries in 0 .. 1 that add up to a number."""
    low, high = wanted.min() - 1.0, wanted.max()
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if np.clip(wanted - middle, 0.0, 1.0).sum() > number:
            low = middle
        else:
            high = middle
    return np.clip(wanted - high, 0.0, 1.0)


def _slope(objective: InformationObjective, base: NDArray) -> NDArray[np.float64]:
    """Derivatives of the mean information by the entries of the sums (item, 21)."""
    found = np.empty_like(base)
    slopes(base, objective.tables.nuisance, found)
    return found / objective.n_items


def _step(
    objective: InformationObjective, base: NDArray, change: NDArray
) -> tuple[float, NDArray[np.float64]]:
    """How far along a change of the sums information rises, at most all the way; the sums there."""
    low, high = 0.0, 1.0
    for halving in range(_HALVINGS):
        middle = 1.0 if halving == 0 else 0.5 * (low + high)
        there = base + middle * change
        if np.sum(_slope(objective, there) * change) >= 0.0:
            low = middle
            if halving == 0:
                break
        else:
            high = middle
    return low, base + low * change


def _by_gains(objective: InformationObjective, place: NDArray, number: int) -> float:
    """Bound from the gains over the satellites at some places."""
    base, tables = objective.sums(place), objective.tables
    values = objective.item_values(base)
    gain = gains(base, values, tables.matrix, np.arange(objective.n_orbits), tables.nuisance)
    gain[place] = 0.0
    return float(np.mean(values) + np.sort(gain)[-number:].sum() / objective.n_items)


def information_bound(
    objective: InformationObjective, orbit: NDArray, *, steps: int = 200
) -> Bound:
    """Bound the information of all architectures of as many satellites as a known one.

    Steps, not a time, limit the effort; they end once the bound is within 1e-4 of what the
    relaxation itself reaches, or the known value is proven.

    Parameters
    ----------
    objective : InformationObjective
        Information over its tables.
    orbit : ndarray of int64, shape (satellite,)
        The places of the best architecture known, where the steps begin.
    steps : int
        Most steps.

    Returns
    -------
    Bound
        With the N places of the largest shares as a choice.
    """
    matrix, number = objective.tables.matrix, len(orbit)
    known = objective.value(orbit, np.ones_like(orbit))
    share = np.full(objective.n_orbits, _SPREAD * number / objective.n_orbits)
    share[orbit] += 1.0 - _SPREAD
    share = _projected(share, number)
    everywhere = np.arange(objective.n_orbits)
    base = objective.sums(everywhere, share)
    lowest, length, taken = np.inf, None, 0
    if objective.tables.nuisance == 0:
        over = (np.sort(orbit), np.sort(orbit)[:0])
        lowest = min(_by_gains(objective, place, number) for place in over) * (1.0 + _ROUNDING)
    gradient = along(matrix, _slope(objective, base))
    while taken < steps:
        taken += 1
        reached = float(np.mean(objective.item_values(base)))
        tangent = reached - gradient @ share + np.sort(gradient)[-number:].sum()
        lowest = min(lowest, tangent * (1.0 + _ROUNDING))
        if lowest <= known or tangent - reached <= _CONVERGED * known:
            break
        if length is None:
            length = 1.0 / np.max(np.abs(gradient))
        direction = _projected(share + length * gradient, number) - share
        moved = np.flatnonzero(direction)
        change = objective.sums(moved, direction[moved]) - objective.sums(moved[:0])
        way, base = _step(objective, base, change)
        if way == 0.0:
            break
        share = np.clip(share + way * direction, 0.0, 1.0)
        new = along(matrix, _slope(objective, base))
        curvature = -(direction @ (new - gradient))
        length = way * (direction @ direction) / curvature if curvature > 0.0 else length
        gradient = new
    # the first of those equal to rounding
    choice = np.sort(np.argsort(-np.round(share, 9), kind="stable")[:number])
    return Bound(float(max(known, lowest)), taken, [(choice, np.ones_like(choice))])
