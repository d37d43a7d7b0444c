"""Upper bound on the information of any architecture of N satellites, by concave relaxation.

With x(c) in 0 .. 1 how much of a satellite flies at place c,

    L(x, i) = 1/2 log det(I + sum over c of x(c) G(c, i))

is concave (also the log-determinant of a Schur complement, which is operator concave and monotone),
and is the information about item i where x is a choice. Where all states count the information f(i)
is submodular, and over any set S of places another function of x lies above it for every choice,

    A(x, i) = f(S, i) + sum over c of x(c) (f(S + c, i) - f(S, i))

(Nemhauser, Wolsey & Fisher, 1978). Over no places it is the sharper one for items that few places
see: of those a tenth of a satellite has the tenth, but nearly all of the logarithm. The least of
these functions is concave, and so is a smooth one below it, the softmin; with its weights w, which
add up to 1 for each item, a tangent lies above the mean information F of all choices y of N places:

    F(y) <= mean over i of sum over k of w(k, i) A(k, x, i) + g . (y - x)
         <= the same at x - g . x + the N largest entries of g

with A(0) = L and g the gradient: a bound whatever x and w are. Spectral projected gradients
(Birgin, Martinez & Raydan, 2000) with an exact line search lead to the x where it is least over
sum x = N.
What is left between it and the best choice is the gap of integrality, which only branching would
close.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.certified import Bound
from cislunar.architecture.information.kernels import along, slopes
from cislunar.architecture.information.objective import InformationObjective

_ROUNDING = 1e-9  # relative; sums of 1e5 terms in double precision stay far within
_CONVERGED = 1e-4  # share of the value by which the tangent still exceeds the smooth function
_SOFTNESS = 0.3  # of the softmin, nat
_HALVINGS = 12  # of the line search
_BISECTIONS = 100  # of the projection: to the last bit
_SPREAD = 0.1  # share of the start that is spread over all places


class _Linear(NamedTuple):
    """Linear functions above the information: of each item (item,), and by place (place, item)."""

    start: NDArray[np.float64]
    gain: NDArray[np.float64]


class _Point(NamedTuple):
    """Shares of places, the sums of matrices (item, 21), and the linear functions (k, item)."""

    share: NDArray[np.float64]
    base: NDArray[np.float64]
    linear: NDArray[np.float64]

    def along(self, way: float, change: "_Point") -> "_Point":
        """A part of the way along a change."""
        return _Point(*(here + way * by for here, by in zip(self, change, strict=True)))


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


class _Relaxation:
    """The functions above the information, their softmin and its gradient."""

    def __init__(self, objective: InformationObjective, sets: Sequence[NDArray]) -> None:
        self.objective = objective
        submodular = objective.tables.nuisance == 0
        self.above = [self._over(np.sort(places)) for places in sets if submodular]

    def _over(self, places: NDArray) -> _Linear:
        """The linear functions over a set of places."""
        objective = self.objective
        base = objective.sums(places)
        start = objective.item_values(base)
        gain = np.array([objective.item_values(base + own) for own in objective.tables.matrix])
        gain -= start
        gain[places] = 0.0
        return _Linear(start, gain)

    def point(self, share: NDArray, relative: bool = False) -> _Point:
        """Sums and linear functions at some shares, or their change with a change of shares."""
        moved = np.flatnonzero(share)
        base = self.objective.sums(moved, share[moved])
        if relative:
            base -= self.objective.sums(moved[:0])
        linear = [share @ each.gain + (0.0 if relative else each.start) for each in self.above]
        return _Point(share, base, np.array(linear).reshape(len(linear), len(base)))

    def weights(self, at: _Point) -> tuple[NDArray, NDArray]:
        """The functions (k, item), log-determinants first, and how much each counts."""
        values = np.vstack([self.objective.item_values(at.base), at.linear])
        counts = np.exp((values.min(axis=0) - values) / _SOFTNESS)
        return values, counts / counts.sum(axis=0)

    def _slope(self, at: _Point, weight: NDArray) -> NDArray[np.float64]:
        """Weighted derivatives of the log-determinants by the entries of the sums (item, 21)."""
        found = np.empty_like(at.base)
        slopes(at.base, self.objective.tables.nuisance, found)
        return found * weight[0][:, None]

    def gradient(self, at: _Point, weight: NDArray) -> NDArray[np.float64]:
        """Derivatives of the mean over items by the shares."""
        found = along(self.objective.tables.matrix, self._slope(at, weight))
        for each, counts in zip(self.above, weight[1:], strict=True):
            found += each.gain @ counts
        return found / self.objective.n_items

    def _rises(self, at: _Point, change: _Point) -> bool:
        """Whether the softmin rises along a change."""
        _, weight = self.weights(at)
        rise = np.sum(self._slope(at, weight) * change.base) + np.sum(weight[1:] * change.linear)
        return bool(rise >= 0.0)

    def way(self, at: _Point, change: _Point) -> float:
        """How far along a change the softmin rises, at most all the way."""
        if self._rises(at.along(1.0, change), change):
            return 1.0
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if self._rises(at.along(middle, change), change):
                low = middle
            else:
                high = middle
        return low


def information_bound(
    objective: InformationObjective,
    orbit: NDArray,
    *,
    steps: int = 200,
    over: Sequence[NDArray] = (),
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
    over : sequence of ndarray of int64
        Further sets of places over which the information has a linear function above it, beside
        none and those known. Each makes the bound sharper and a step longer.

    Returns
    -------
    Bound
        With the N places of the largest shares as a choice.
    """
    number = len(orbit)
    known = objective.value(orbit, np.ones_like(orbit))
    share = np.full(objective.n_orbits, _SPREAD * number / objective.n_orbits)
    share[orbit] += 1.0 - _SPREAD
    relaxation = _Relaxation(objective, [orbit[:0], orbit, *over])
    at = relaxation.point(_projected(share, number))
    lowest, length, taken = np.inf, None, 0
    for each in relaxation.above:
        most = np.mean(each.start) + np.sort(np.mean(each.gain, axis=1))[-number:].sum()
        lowest = min(lowest, float(most) * (1.0 + _ROUNDING))
    values, weight = relaxation.weights(at)
    gradient = relaxation.gradient(at, weight)
    while taken < steps:
        taken += 1
        more = float(np.sort(gradient)[-number:].sum() - gradient @ at.share)
        tangent = float(np.sum(weight * values)) / objective.n_items + more
        lowest = min(lowest, tangent * (1.0 + _ROUNDING))
        if lowest <= known or more <= _CONVERGED * known:
            break
        if length is None:
            length = 1.0 / np.max(np.abs(gradient))
        change = relaxation.point(_projected(at.share + length * gradient, number) - at.share, True)
        way = relaxation.way(at, change)
        if way == 0.0:  # too far to tell: the next steps begin shorter
            length *= 0.5**_HALVINGS
            continue
        at = at.along(way, change)
        at = at._replace(share=np.clip(at.share, 0.0, 1.0))
        values, weight = relaxation.weights(at)
        new = relaxation.gradient(at, weight)
        curvature = -(change.share @ (new - gradient))
        if curvature > 0.0:
            length = way * (change.share @ change.share) / curvature
        gradient = new
    # the first of those equal to rounding
    choice = np.sort(np.argsort(-np.round(at.share, 9), kind="stable")[:number])
    return Bound(float(max(known, lowest)), taken, [(choice, np.ones_like(choice))])
