"""Upper bound on the coverage of any architecture of N satellites, by Lagrangian relaxation.

With x the choice of (orbit slot, count), a(c, e) the number of satellites of candidate c that see
element e, at most the fold k, and multipliers 0 <= m(e) <= 1, no architecture exceeds

    L(m) = k x sum over e of (1 - m(e)) + max over choices x of sum over c of x(c) s(c),
    s(c) = sum over e of m(e) a(c, e)

over k times the number of elements (`docs/objectives.md`). The choice is separable in its scores s:
the N largest ones for free phases, and otherwise a knapsack over (orbits, satellites); both are
exact. Steps along the weighted mean of the negative subgradients, k - sum of a x, with more weight
on recent ones, lower L (Held, Wolfe & Crowder, 1974; Camerini, Fratta & Maffioli, 1975). The union
of all candidates gives a second bound, which is sharper for large N. A candidate whose presence
keeps L below one element more than the best known architecture is removed permanently, which never
removes a better architecture.
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.certified import Bound
from cislunar.architecture.coverage.kernels import add_layers, times_seen, weighted_sums
from cislunar.architecture.coverage.objective import CoverageObjective
from cislunar.architecture.optimality.knapsack import NO_CHOICE, best_choice, conditional_bests

_ROUNDING = 1e-9  # relative; larger than the rounding of sums of 1e5 terms
_PATIENCE = 5  # steps without improvement of the bound before they are shortened
_SHORTEN = 0.7
_MEMORY = 0.9  # weight of the former direction; subgradients jump between near-equal choices
_FIX_EVERY = 10
_PROGRESS = 1e-3  # share of the distance to the value that counts as an improvement


class _Relaxation:
    """The remaining candidates, and the best choice among them for given multipliers."""

    def __init__(self, objective: CoverageObjective, n_slots: int, total: int) -> None:
        self.words = objective.candidates
        self.layers = self.words.view(np.uint8)
        self.reachable = np.unpackbits(objective.reachable.view(np.uint8), bitorder="little")
        self.counts = objective.max_satellites
        self.n_slots, self.excess = n_slots, total - n_slots
        active = np.arange(len(self.layers))
        self.active = active[active % self.counts <= self.excess]

    def best(self, multiplier: NDArray) -> tuple[float, NDArray, NDArray]:
        """Score, orbit slots and satellites of the best choice; ``NO_CHOICE`` if none remains."""
        weight = (multiplier * self.reachable).reshape(-1, 8)
        found = weighted_sums(self.layers, self.active, weight)
        slots, self.row = np.unique(self.active // self.counts, return_inverse=True)
        position, extra = np.zeros((2, self.n_slots), dtype=np.int64)
        if slots.size < self.n_slots:
            return NO_CHOICE, position, extra
        score = np.full((slots.size, min(self.counts, self.excess + 1)), -np.inf)
        score[self.row, self.active % self.counts] = found
        lowest = np.zeros(slots.size, dtype=np.int64)
        highest = np.full(slots.size, score.shape[1] - 1)
        unforced = np.zeros(slots.size, dtype=bool)
        self.arguments = score, lowest, highest, unforced, self.n_slots, self.excess
        total = best_choice(*self.arguments, position, extra)
        return total, slots[position], extra + 1

    def times_seen(self, orbit: NDArray, satellites: NDArray) -> NDArray[np.int64]:
        """Number of satellites of a choice that see each element, at most the fold per slot."""
        return times_seen(self.words, orbit * self.counts + satellites - 1, self.reachable.size)

    def keep(self, least: float) -> None:
        """Remove candidates that are in no choice of at least a score, for the last multipliers."""
        taken, _ = conditional_bests(*self.arguments)
        self.active = self.active[taken[self.row, self.active % self.counts] >= least]


def _seen_by_all(objective: CoverageObjective) -> int:
    """Number of elements that all candidates together see, with multiplicity up to the fold."""
    at_least = np.zeros((objective.tables.fold, objective.candidates.shape[-1]), dtype=np.uint64)
    for layer in objective.candidates:
        add_layers(at_least, layer)
    return int(np.bitwise_count(at_least).sum())


def _inside(direction: NDArray, multiplier: NDArray) -> NDArray[np.float64]:
    """A direction without components that leave the box 0 .. 1 of the multipliers."""
    outward = np.where(direction > 0.0, multiplier >= 1.0, multiplier <= 0.0)
    return np.where(outward, 0.0, direction)


def coverage_bound(
    objective: CoverageObjective, orbit: NDArray, satellites: NDArray, *, steps: int = 150
) -> Bound:
    """Bound the coverage of all architectures with as many orbit slots and satellites as a known
    one, `orbit` and `satellites` (slot,); a better one makes the bound converge faster. The effort
    is limited by the number of subgradient steps, so that the bound does not depend on the machine.
    """
    fold = objective.tables.fold
    known = round(objective.value(orbit, satellites) * objective.scale)
    relaxation = _Relaxation(objective, len(orbit), int(np.sum(satellites)))
    multiplier = np.where(relaxation.times_seen(orbit, satellites) <= fold, 1.0, 0.0)
    ceiling = _seen_by_all(objective)
    lowest, best, choices, mean = np.inf, multiplier, [], None
    length, stalled, step = 1.0, 0, 0
    for step in range(1, steps + 1):
        score, *choice = relaxation.best(multiplier)
        if score <= 0.5 * NO_CHOICE:  # no better architecture remains
            lowest = known
            break
        constant = fold * np.sum(1.0 - multiplier)
        bound = (constant + score) * (1.0 + _ROUNDING)
        stalled = 0 if bound < lowest - _PROGRESS * (lowest - known) else stalled + 1
        if bound < lowest:
            lowest, best = bound, multiplier
        if min(ceiling, np.floor(lowest)) <= known:
            break
        if step % _FIX_EVERY == 0:
            choices.append(tuple(choice))
            relaxation.keep((known + 1.0) * (1.0 - _ROUNDING) - constant)
        if stalled >= _PATIENCE:
            length, stalled, multiplier = length * _SHORTEN, 0, best
        downhill = fold - relaxation.times_seen(*choice)
        mean = downhill if mean is None else _MEMORY * mean + (1.0 - _MEMORY) * downhill
        direction = _inside(mean, multiplier)
        if not direction.any():
            mean = downhill
            direction = _inside(mean, multiplier)
        square = np.sum(direction**2)
        if square == 0.0:  # zero subgradient: L is at its minimum
            break
        change = length * (bound - known) / square * direction
        multiplier = np.clip(multiplier + change, 0.0, 1.0)
    return Bound(
        bound=max(known, min(ceiling, int(np.floor(lowest)))) / objective.scale,
        steps=step,
        choices=choices,
    )
