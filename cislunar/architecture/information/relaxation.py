"""Upper bound on the information of any architecture of N satellites, by concave relaxation.

With x(c) in 0 .. 1 the fraction of a satellite in orbit slot c, and F the mean information of all
choices y of N orbit slots (derivation: `docs/objectives.md`)::

    F(y) <= mean over i of sum over k of w(k, i) A(k, x, i) + g . (y - x)
         <= the same at x - g . x + the N largest entries of g,
    A(0, x, i) = 1/2 log det(I + sum over c of x(c) G(c, i)),
    A(k, x, i) = f(S, i) + sum over c of x(c) (f(S + c, i) - f(S, i)),

where g is the gradient, w are weights that add up to 1 for each item (of a softmin), and the
functions k > 0 belong to sets S of orbit slots and need an information f without nuisance states
(Nemhauser, Wolsey & Fisher, 1978). This is a bound for any x and w. Spectral projected gradients
(Birgin, Martinez & Raydan, 2000) with an exact line search minimize it over x with sum x = N.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.certified import Bound
from cislunar.architecture.information.kernels import along, slopes
from cislunar.architecture.information.objective import InformationObjective

_ROUNDING = 1e-9  # relative; larger than the rounding of sums of 1e5 terms
_CONVERGED = 1e-4  # excess of the tangent over the smooth function, as a share of the value
_SOFTNESS = 0.3  # scale of the softmin, nat
_HALVINGS = 12  # halvings of the line search
_BISECTIONS = 100  # bisections of the projection, to the last bit
_SPREAD = 0.1  # share of the start that is distributed over all orbit slots


class _Linear(NamedTuple):
    """Linear functions above the information: constant (item,) and gain (slot, item)."""

    start: NDArray[np.float64]
    gain: NDArray[np.float64]


class _Point(NamedTuple):
    """Fractions of orbit slots, sums of matrices (item, 21), and linear functions (k, item)."""

    share: NDArray[np.float64]
    base: NDArray[np.float64]
    linear: NDArray[np.float64]

    def along(self, fraction: float, change: "_Point") -> "_Point":
        """The point at a fraction of a change."""
        return _Point(*(here + fraction * by for here, by in zip(self, change, strict=True)))


def _projected(point: NDArray, number: int) -> NDArray[np.float64]:
    """The nearest point with entries in 0 .. 1 that add up to a number."""
    low, high = point.min() - 1.0, point.max()
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if np.clip(point - middle, 0.0, 1.0).sum() > number:
            low = middle
        else:
            high = middle
    return np.clip(point - high, 0.0, 1.0)


class _Relaxation:
    """The functions above the information, their softmin and its gradient."""

    def __init__(self, objective: InformationObjective, sets: Sequence[NDArray]) -> None:
        self.objective = objective
        submodular = objective.tables.nuisance == 0
        self.above = [self._over(np.sort(slots)) for slots in sets if submodular]

    def _over(self, slots: NDArray) -> _Linear:
        """The linear function over a set of orbit slots."""
        objective = self.objective
        base = objective.sums(slots)
        start = objective.item_values(base)
        gain = np.array([objective.item_values(base + own) for own in objective.tables.matrix])
        gain -= start
        gain[slots] = 0.0
        return _Linear(start, gain)

    def point(self, share: NDArray, relative: bool = False) -> _Point:
        """Sums and linear functions at given fractions, or their change with the fractions."""
        moved = np.flatnonzero(share)
        base = self.objective.sums(moved, share[moved])
        if relative:
            base -= self.objective.sums(moved[:0])
        linear = [share @ each.gain + (0.0 if relative else each.start) for each in self.above]
        return _Point(share, base, np.array(linear).reshape(len(linear), len(base)))

    def weights(self, at: _Point) -> tuple[NDArray, NDArray]:
        """Functions (k, item), log-determinants first, and their weights."""
        values = np.vstack([self.objective.item_values(at.base), at.linear])
        counts = np.exp((values.min(axis=0) - values) / _SOFTNESS)
        return values, counts / counts.sum(axis=0)

    def _slope(self, at: _Point, weight: NDArray) -> NDArray[np.float64]:
        """Weighted derivatives of the log-determinants by the entries of the sums (item, 21)."""
        found = np.empty_like(at.base)
        slopes(at.base, self.objective.tables.nuisance, found)
        return found * weight[0][:, None]

    def gradient(self, at: _Point, weight: NDArray) -> NDArray[np.float64]:
        """Derivatives of the mean over items by the fractions."""
        found = along(self.objective.tables.matrix, self._slope(at, weight))
        for each, counts in zip(self.above, weight[1:], strict=True):
            found += each.gain @ counts
        return found / self.objective.n_items

    def _rises(self, at: _Point, change: _Point) -> bool:
        """Whether the softmin increases along a change."""
        _, weight = self.weights(at)
        rise = np.sum(self._slope(at, weight) * change.base) + np.sum(weight[1:] * change.linear)
        return bool(rise >= 0.0)

    def step_length(self, at: _Point, change: _Point) -> float:
        """Fraction of a change, at most 1, up to which the softmin increases."""
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
    """Bound the information of all architectures with as many satellites as a known one, the orbit
    slots `orbit` (satellite,), where the steps start.

    The effort is limited by the number of steps, not by time. The steps end when the bound is
    within 1e-4 of the optimum of the relaxation, or when the known value is proven optimal. Each
    set of orbit slots in `over` adds linear functions to those of the empty set and of `orbit`; it
    makes the bound sharper and a step slower. The choice of the bound is the N orbit slots of the
    largest fractions."""
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
        fraction = relaxation.step_length(at, change)
        if fraction == 0.0:  # below the resolution of the line search
            length *= 0.5**_HALVINGS
            continue
        at = at.along(fraction, change)
        at = at._replace(share=np.clip(at.share, 0.0, 1.0))
        values, weight = relaxation.weights(at)
        new = relaxation.gradient(at, weight)
        curvature = -(change.share @ (new - gradient))
        if curvature > 0.0:
            length = fraction * (change.share @ change.share) / curvature
        gradient = new
    # the first of fractions equal to rounding
    choice = np.sort(np.argsort(-np.round(at.share, 9), kind="stable")[:number])
    return Bound(float(max(known, lowest)), taken, [(choice, np.ones_like(choice))])
