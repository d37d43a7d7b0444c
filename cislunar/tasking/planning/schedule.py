"""The schedule of an interval: which observer looks at which target in which slot.

Looks A at target j are worth

    F_j(A) = E[f_j(A') + B 1{A' is not empty}],

A' being those of A that detect it, f_j the information of `cislunar.tasking.planning.looks` and B
the bonus of a target never detected. The looks of a target share its brightness: given that, they
detect it or not independently of each other (`cislunar.tasking.planning.detection`). Where
detection is not learned, all of A detect it. A schedule is worth the sum over targets.

Given the rest of the schedule, the best choice for one slot is a linear assignment with one
observer per target, and a set packing with several, both solved exactly. Slot after slot is chosen
so, again and again until nothing is gained. With one slot that is the optimum; with several it is
one that no change of a single slot improves.

Assumptions and limitations
---------------------------
- Of more than `MOST_TRIALS` looks at a target, the later ones count by the expected information
  matrix, an upper bound of what they bring.
- Where turning takes time, a slot is chosen for what it brings itself: that it delays the next one
  is seen only when that one is chosen. The best schedule met with is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.compiled import borrowing
from cislunar.estimation.triangular import cholesky
from cislunar.tasking.planning.assignment import IDLE, INFORMATION_DECIMALS, assign
from cislunar.tasking.planning.detection import LearnedDetection
from cislunar.tasking.planning.looks import SIZE, SlotLooks
from cislunar.tasking.planning.packing import best_packing

Array = NDArray[np.float64]
Chosen = NDArray[np.int64]

MOST_TRIALS = 6
"""Looks at a target in an interval that are followed through both outcomes."""

MOST_SWEEPS = 20
"""Times all slots are chosen anew; three or four suffice."""


class Chances(NamedTuple):
    """What tells how likely looks detect targets, for compiled code.

    `weight` (target, offset) are probabilities of the offsets, `detects` (slot, observer, target,
    offset) those that a look detects a target of that offset, `bonus` (target,) what a first
    detection is worth.
    """

    weight: Array
    detects: Array
    bonus: Array


def chances(detection: LearnedDetection | None, margin: Array) -> Chances:
    """Those of what has been learned, by margins (slot, observer, target, sample); or certainty."""
    n_targets = margin.shape[2]
    if detection is None:
        return Chances(
            np.ones((n_targets, 1)), np.ones((*margin.shape[:3], 1)), np.zeros(n_targets)
        )
    bonus = detection.model.never_detected_bonus * ~detection.detected
    return Chances(np.exp(detection.log_weight), detection.detects(margin), bonus)


@borrowing
def _information(factor, share, j, looks, trusted, matrix):
    """Information, nats, of looks (look, 2) of slot and observer, each counted by its trust."""
    matrix[:, :] = 0.0
    for i in range(SIZE):
        matrix[i, i] = 1.0
    for a in range(trusted.size):
        if trusted[a] > 0.0:
            own = factor[looks[a, 0], looks[a, 1], j]
            by = trusted[a] * share[looks[a, 0], looks[a, 1], j]
            for i in range(SIZE):
                for k in range(i + 1):
                    matrix[i, k] += by * (own[i, 0] * own[k, 0] + own[i, 1] * own[k, 1])
    cholesky(matrix)
    total = 0.0
    for i in range(SIZE):
        total += np.log(matrix[i, i])
    return total


@njit(cache=True, error_model="numpy")
def worth_of_looks(factor, share, chances, j, looks, count):
    """F_j of the first `count` of the looks (look, 2) of slot and observer."""
    n = min(count, MOST_TRIALS)
    n_offsets = chances.weight.shape[1]
    detects = np.empty((count, n_offsets))
    trusted, matrix = np.empty(count), np.empty((SIZE, SIZE))
    for a in range(count):
        trusted[a] = 0.0
        for b in range(n_offsets):
            detects[a, b] = chances.detects[looks[a, 0], looks[a, 1], j, b]
            trusted[a] += chances.weight[j, b] * detects[a, b]
    total = 0.0
    for outcome in range(2**n):
        probability = 0.0
        for b in range(n_offsets):
            product = chances.weight[j, b]
            for a in range(n):
                product *= detects[a, b] if outcome >> a & 1 else 1.0 - detects[a, b]
            probability += product
        if probability == 0.0:
            continue
        for a in range(n):
            trusted[a] = float(outcome >> a & 1)
        gain = _information(factor, share, j, looks, trusted, matrix)
        if outcome > 0:
            gain += chances.bonus[j]
        total += probability * gain
    return total


@borrowing
def _taken(target, but, j, looks):
    """Slots and observers at target j, the slot `but` left out; how many."""
    count = 0
    for s in range(target.shape[0]):
        for o in range(target.shape[1]):
            if s != but and target[s, o] == j:
                looks[count, 0], looks[count, 1] = s, o
                count += 1
    return count


@njit(cache=True, error_model="numpy")
def _columns_worth(factor, share, chances, target, slot, columns, observers, out):
    """What observers (column, k) at targets (column,) in a slot add to the rest of a schedule."""
    looks = np.empty((target.size + observers.shape[1], 2), np.int64)
    last, count, without = -1, 0, 0.0
    for c in range(columns.size):
        j = columns[c]
        if j != last:
            last, count = j, _taken(target, slot, j, looks)
            without = worth_of_looks(factor, share, chances, j, looks, count)
        more = count
        for o in observers[c]:
            if o >= 0:
                looks[more, 0], looks[more, 1] = slot, o
                more += 1
        out[c] = worth_of_looks(factor, share, chances, j, looks, more) - without


@njit(cache=True, error_model="numpy")
def _total(factor, share, chances, target):
    """What a schedule is worth."""
    looks, total = np.empty((target.size, 2), np.int64), 0.0
    for j in range(factor.shape[2]):
        count = _taken(target, -1, j, looks)
        if count > 0:
            total += worth_of_looks(factor, share, chances, j, looks, count)
    return total


@dataclass(frozen=True)
class SlotSchedule:
    """A schedule.

    Attributes
    ----------
    target : ndarray of int, shape (slot, observer)
        Target of each observer in each slot, or `IDLE`.
    worth : float
        The sum of F_j, nats.
    information : float
        That of the looks that are carried out if all detect their targets, nats.
    evaluations : int
        Assignments and set packings solved.
    gap : float
        The largest relative gap of these, 0 for assignments.
    """

    target: Chosen
    worth: float
    information: float
    evaluations: int
    gap: float


Shares = Callable[[Chosen], Array]
"""From a schedule to the shares (slot, observer, target) of slots left after turning."""


def plan_schedule(
    looks: SlotLooks,
    known: Chances,
    *,
    observers_per_target: int = 1,
    shares: Shares | None = None,
    carried_out: int | None = None,
) -> SlotSchedule:
    """Choose the looks of an interval, slot by slot until nothing is gained.

    Parameters
    ----------
    looks : SlotLooks
    known : Chances
    observers_per_target : int
        Observers that may look at a target in the same slot.
    shares : callable, optional
        Called with a schedule; gives the shares, shape (slot, observer, target), of each slot that
        are left after turning to each target. All of it, if omitted.
    carried_out : int, optional
        The first slots, whose `information` is wanted; all, if omitted.

    Returns
    -------
    SlotSchedule
    """
    factor = looks.factor
    n_slots, n_observers, _ = looks.margin.shape
    visible = np.any(factor != 0.0, axis=(3, 4))
    target = np.full((n_slots, n_observers), IDLE, dtype=np.int64)
    share = np.ones(looks.margin.shape)
    best, best_worth, evaluations, gap = target.copy(), 0.0, 0, 0.0
    for _ in range(MOST_SWEEPS):
        for slot in range(n_slots):
            if shares is not None:
                share = shares(target)
            columns, observers = _columns(visible[slot], observers_per_target)
            added = np.empty(columns.size)
            _columns_worth(factor, share, known, target, slot, columns, observers, added)
            target[slot], own_gap = _chosen(columns, observers, added, visible[slot].shape)
            gap, evaluations = max(gap, own_gap), evaluations + 1
        if shares is not None:
            share = shares(target)
        worth = _total(factor, share, known, target)
        if not worth > best_worth + 10.0**-INFORMATION_DECIMALS:
            break
        best, best_worth = target.copy(), worth
        if n_slots == 1:
            break
    if shares is not None:
        share = shares(best)
    certain = chances(None, looks.margin)
    information = _total(factor, share, certain, best[:carried_out])
    return SlotSchedule(best, best_worth, information, evaluations, gap)


def _columns(visible: NDArray[np.bool_], most: int) -> tuple[Chosen, Chosen]:
    """Targets (column,), rising, and their groups of observers (column, k), up to `most` each."""
    targets, groups = [], []
    for j in np.flatnonzero(visible.any(axis=0)):
        own = np.flatnonzero(visible[:, j])
        for size in range(1, min(most, own.size) + 1):
            for group in combinations(own.tolist(), size):
                targets.append(j)
                groups.append([*group, *(IDLE,) * (most - size)])
    return (
        np.array(targets, dtype=np.int64),
        np.array(groups, dtype=np.int64).reshape(len(targets), most),
    )


def _chosen(
    columns: Chosen, observers: Chosen, added: Array, shape: tuple[int, int]
) -> tuple[Chosen, float]:
    """Target of each observer in a slot, and the gap."""
    if observers.shape[1] > 1:
        packing = best_packing(columns, observers, added, shape[0])
        return packing.target, packing.gap
    matrix = np.zeros(shape)
    matrix[observers[:, 0], columns] = np.maximum(added, 0.0)
    return assign(matrix).target, 0.0
