"""Upper bound on the coverage of any architecture of N satellites, by Lagrangian relaxation.

With x the choice of (place, count), a(c, e) the satellites of candidate c that see element e, at
most the fold k, and z(e) how often element e counts, the largest coverage is that of

    max sum of z(e)   with   0 <= z(e) <= k,   z(e) <= sum over c of a(c, e) x(c),   x a choice

over k times the number of elements. Multipliers 0 <= m(e) <= 1 of the coupling give

    L(m) = k x sum over e of (1 - m(e)) + max over choices x of sum over c of x(c) s(c),
    s(c) = sum over e of m(e) a(c, e),

which no architecture exceeds. The choice is separable in its scores s: the N largest ones at free
phases, and a knapsack over (orbits, satellites) in the paper's slots, both exact. Steps along
the mean of the negative subgradients so far, k - sum of a x, with the recent ones weighing most,
lower L (Held, Wolfe & Crowder, 1974; Camerini, Fratta & Maffioli, 1975). What all candidates
together see is a second bound, which is the sharper one when N is large.

A candidate whose presence keeps L below one element more than the best known architecture is left
out for good: that never removes a better architecture, and it makes the steps cheap.
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.certified import Bound
from cislunar.architecture.coverage.kernels import (
    add_layers,
    blend,
    count_ones,
    inside,
    moved,
    times_seen,
    weighted_sums,
)
from cislunar.architecture.coverage.objective import CoverageObjective
from cislunar.architecture.optimality.knapsack import (
    NO_CHOICE,
    best_choice,
    conditional_bests,
)

_ROUNDING = 1e-9  # relative; sums of 1e5 terms in double precision stay far within
_PATIENCE = 5  # steps without a lower bound before they are shortened
_SHORTEN = 0.7
_MEMORY = 0.9  # share of the former direction: the subgradients jump between near-equal choices
_FIX_EVERY = 10
_PROGRESS = 1e-3  # share of the distance to the value that counts as a lower bound


class _Relaxation:
    """The candidates left, and the best choice among them for given multipliers."""

    def __init__(self, objective: CoverageObjective, n_slots: int, total: int) -> None:
        self.words = objective.candidates
        self.layers = self.words.view(np.uint8)
        self.reachable = np.unpackbits(objective.reachable.view(np.uint8), bitorder="little")
        self.counts = objective.max_satellites
        self.n_slots, self.excess = n_slots, total - n_slots
        active = np.arange(len(self.layers))
        self.active = active[active % self.counts <= self.excess]

    def best(self, multiplier: NDArray) -> tuple[float, NDArray, NDArray]:
        """Score, places and satellites of the best choice; ``NO_CHOICE`` where none is left."""
        weight = (multiplier * self.reachable).reshape(-1, 8)
        found = weighted_sums(self.layers, self.active, weight)
        places, self.row = np.unique(self.active // self.counts, return_inverse=True)
        position, extra = np.zeros((2, self.n_slots), dtype=np.int64)
        if places.size < self.n_slots:
            return NO_CHOICE, position, extra
        score = np.full((places.size, min(self.counts, self.excess + 1)), -np.inf)
        score[self.row, self.active % self.counts] = found
        lowest = np.zeros(places.size, dtype=np.int64)
        highest = np.full(places.size, score.shape[1] - 1)
        unforced = np.zeros(places.size, dtype=bool)
        self.arguments = score, lowest, highest, unforced, self.n_slots, self.excess
        total = best_choice(*self.arguments, position, extra)
        return total, places[position], extra + 1

    def times_seen(self, orbit: NDArray, satellites: NDArray) -> NDArray[np.int64]:
        """Satellites of a choice that see each element, at most the fold at each place."""
        return times_seen(self.words, orbit * self.counts + satellites - 1, self.reachable.size)

    def keep(self, least: float) -> None:
        """Leave out the candidates in no choice of at least a score, by the last multipliers."""
        taken, _ = conditional_bests(*self.arguments)
        self.active = self.active[taken[self.row, self.active % self.counts] >= least]


def _seen_by_all(objective: CoverageObjective) -> int:
    """Elements all candidates together see, each as often as the fold asks."""
    at_least = np.zeros((objective.tables.fold, objective.candidates.shape[-1]), dtype=np.uint64)
    for layer in objective.candidates:
        add_layers(at_least, layer)
    return count_ones(at_least.ravel())


def coverage_bound(
    objective: CoverageObjective, orbit: NDArray, satellites: NDArray, *, steps: int = 150
) -> Bound:
    """Bound the coverage of all architectures of as many places and satellites as a known one.

    The number of steps, not a time, limits the effort: the bound does not depend on the machine.

    Parameters
    ----------
    objective : CoverageObjective
        Coverage over its tables.
    orbit, satellites : ndarray of int64, shape (slot,)
        The best architecture known: the better, the faster the bound falls.
    steps : int
        Most subgradient steps.

    Returns
    -------
    Bound
    """
    fold = objective.tables.fold
    known = round(objective.value(orbit, satellites) * objective.scale)
    relaxation = _Relaxation(objective, len(orbit), int(np.sum(satellites)))
    multiplier = np.where(relaxation.times_seen(orbit, satellites) <= fold, 1.0, 0.0)
    ceiling = _seen_by_all(objective)
    lowest, best, choices, mean = np.inf, multiplier, [], None
    length, idle, step, direction = 1.0, 0, 0, np.empty(multiplier.size)
    for step in range(1, steps + 1):
        score, *choice = relaxation.best(multiplier)
        if score <= 0.5 * NO_CHOICE:  # nothing better is left
            lowest = known
            break
        constant = fold * np.sum(1.0 - multiplier)
        bound = (constant + score) * (1.0 + _ROUNDING)
        idle = 0 if bound < lowest - _PROGRESS * (lowest - known) else idle + 1
        if bound < lowest:
            lowest, best = bound, multiplier
        if min(ceiling, np.floor(lowest)) <= known:
            break
        if step % _FIX_EVERY == 0:
            choices.append(tuple(choice))
            relaxation.keep((known + 1.0) * (1.0 - _ROUNDING) - constant)
        if idle >= _PATIENCE:
            length, idle, multiplier = length * _SHORTEN, 0, best
        downhill = fold - relaxation.times_seen(*choice)
        if mean is None:
            mean = downhill.astype(float)
        else:
            blend(mean, _MEMORY, downhill)
        inside(mean, multiplier, direction)
        if not direction.any():
            mean[:] = downhill
            inside(mean, multiplier, direction)
        square = np.sum(direction**2)
        if square == 0.0:  # a subgradient that leads nowhere: L is at its least
            break
        multiplier = moved(multiplier, length * (bound - known) / square, direction)
    return Bound(
        bound=max(known, min(ceiling, int(np.floor(lowest)))) / objective.scale,
        steps=step,
        choices=choices,
    )
