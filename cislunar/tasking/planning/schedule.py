"""The schedule of an interval: the target of each observer in each slot (docs/tasking.md).

The value of observations A of target j is F_j(A) = E[f_j(A') + B 1{A' is not empty}], where A' are
those of A that detect it, f_j is the information of `cislunar.tasking.planning.slot_observations`
and B the bonus of a target never detected. Given the brightness of a target, its observations
detect it independently of each other. The value of a schedule is the sum over targets.

Assumptions and limitations
---------------------------
- Of more than `_MOST_TRIALS` observations of a target, the later ones count by the expected
  information matrix, an upper bound of their value.
- If slewing takes time, a slot is chosen for its own value: the delay of the next slot is
  considered only when that one is chosen. The best schedule found is returned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import njit, njit_noalloc
from cislunar.estimation.dispersed_orbits import TRANSLATION_SIZE
from cislunar.estimation.triangular import cholesky
from cislunar.runtime import Array
from cislunar.tasking.planning.assignment import IDLE, INFORMATION_DECIMALS, assign, values_in_field
from cislunar.tasking.planning.detection import LearnedDetection
from cislunar.tasking.planning.packing import best_packing
from cislunar.tasking.planning.slot_observations import SlotObservations

Chosen = NDArray[np.int64]

_MOST_TRIALS = 6
"""Observations of a target in an interval whose outcomes are enumerated."""

_MOST_SWEEPS = 20
"""Largest number of sweeps over all slots; three or four suffice."""


class DetectionProbabilities(NamedTuple):
    """Probabilities of detection for compiled code. `weight` (target, offset) are probabilities of
    the offsets, `detects` (slot, observer, target, offset) those that an observation detects a
    target of that offset, `bonus` (target,) is the value of a first detection."""

    weight: Array
    detects: Array
    bonus: Array


def detection_probabilities(
    detection: LearnedDetection | None, margin: Array
) -> DetectionProbabilities:
    """Learned probabilities for margins (slot, observer, target, sample); 1 without learning."""
    n_targets = margin.shape[2]
    if detection is None:
        return DetectionProbabilities(
            np.ones((n_targets, 1)), np.ones((*margin.shape[:3], 1)), np.zeros(n_targets)
        )
    detects = detection.detects(margin)
    return DetectionProbabilities(np.exp(detection.log_weight), detects, detection.bonus())


@njit_noalloc
def _information(factor, share, j, observations, trusted, matrix):
    """Information, nats, of observations (row, 2) of slot and observer, each weighted by its
    trust."""
    matrix[:, :] = 0.0
    for i in range(TRANSLATION_SIZE):
        matrix[i, i] = 1.0
    for a in range(trusted.size):
        if trusted[a] > 0.0:
            own = factor[observations[a, 0], observations[a, 1], j]
            by = trusted[a] * share[observations[a, 0], observations[a, 1], j]
            for i in range(TRANSLATION_SIZE):
                for k in range(i + 1):
                    matrix[i, k] += by * (own[i, 0] * own[k, 0] + own[i, 1] * own[k, 1])
    cholesky(matrix)
    total = 0.0
    for i in range(TRANSLATION_SIZE):
        total += np.log(matrix[i, i])
    return total


@njit(cache=True, error_model="numpy")
def value_of_observations(factor, share, detection_probabilities, j, observations, count):
    """F_j of the first `count` of the observations (row, 2) of slot and observer."""
    n = min(count, _MOST_TRIALS)
    n_offsets = detection_probabilities.weight.shape[1]
    detects = np.empty((count, n_offsets))
    trusted, matrix = np.empty(count), np.empty((TRANSLATION_SIZE, TRANSLATION_SIZE))
    for a in range(count):
        trusted[a] = 0.0
        for b in range(n_offsets):
            detects[a, b] = detection_probabilities.detects[
                observations[a, 0], observations[a, 1], j, b
            ]
            trusted[a] += detection_probabilities.weight[j, b] * detects[a, b]
    total = 0.0
    for outcome in range(2**n):
        probability = 0.0
        for b in range(n_offsets):
            product = detection_probabilities.weight[j, b]
            for a in range(n):
                product *= detects[a, b] if outcome >> a & 1 else 1.0 - detects[a, b]
            probability += product
        if probability == 0.0:
            continue
        for a in range(n):
            trusted[a] = float(outcome >> a & 1)
        gain = _information(factor, share, j, observations, trusted, matrix)
        if outcome > 0:
            gain += detection_probabilities.bonus[j]
        total += probability * gain
    return total


@njit_noalloc
def observations_of(target, but, j, observations):
    """Slots and observers at target j except in the slot `but`; their number."""
    count = 0
    for s in range(target.shape[0]):
        for o in range(target.shape[1]):
            if s != but and target[s, o] == j:
                observations[count, 0], observations[count, 1] = s, o
                count += 1
    return count


@njit(cache=True, error_model="numpy")
def _column_values(factor, share, detection_probabilities, target, slot, columns, observers, out):
    """Values that observers (column, k) at targets (column,) in a slot add to the rest of a
    schedule."""
    observations = np.empty((target.size + observers.shape[1], 2), np.int64)
    last, count, without = -1, 0, 0.0
    for c in range(columns.size):
        j = columns[c]
        if j != last:
            last, count = j, observations_of(target, slot, j, observations)
            without = value_of_observations(
                factor, share, detection_probabilities, j, observations, count
            )
        more = count
        for o in observers[c]:
            if o >= 0:
                observations[more, 0], observations[more, 1] = slot, o
                more += 1
        out[c] = (
            value_of_observations(factor, share, detection_probabilities, j, observations, more)
            - without
        )


@njit(cache=True, error_model="numpy")
def _total(factor, share, detection_probabilities, target):
    """Value of a schedule."""
    observations, total = np.empty((target.size, 2), np.int64), 0.0
    for j in range(factor.shape[2]):
        count = observations_of(target, -1, j, observations)
        if count > 0:
            total += value_of_observations(
                factor, share, detection_probabilities, j, observations, count
            )
    return total


@dataclass(frozen=True)
class _SlotSchedule:
    """Result of `plan_schedule`."""

    target: Chosen
    value: float
    information: float
    evaluations: int
    gap: float


Shares = Callable[[Chosen], Array]
"""From a schedule to the shares (slot, observer, target) of slots that remain after slewing."""


def plan_schedule(
    observations: SlotObservations,
    known: DetectionProbabilities,
    *,
    observers_per_target: int = 1,
    shares: Shares | None = None,
    carried_out: int | None = None,
    half_field: Array | None = None,
) -> _SlotSchedule:
    """Choose the observations of an interval, slot by slot until nothing is gained.

    Parameters
    ----------
    observations : SlotObservations
    known : DetectionProbabilities
    observers_per_target : int
        Largest number of observers of a target in the same slot.
    shares : callable, optional
        Called with a schedule; returns the shares, shape (slot, observer, target), of each slot
        that remain after slewing to each target. The whole slot, if omitted.
    carried_out : int, optional
        Number of first slots whose `information` is computed; all, if omitted.
    half_field : ndarray, shape (observer,), optional
        Half the fields of view, rad, if all targets in a field count, for groups of one observer.

    Returns
    -------
    dataclass
        ``target``, shape (slot, observer), the target of each observer or `IDLE`; ``value``, the
        sum of the expected information of all targets, nats; ``information`` of the observations
        to be carried out if all detect their targets, nats; ``evaluations``, the number of
        assignments and set packings solved; ``gap``, the largest relative gap of the set packings,
        0 for assignments.

    Raises
    ------
    CislunarError
        If the solver finds no packing of groups of observers.
    """
    factor = observations.factor
    n_slots, n_observers, _ = observations.margin.shape
    visible = np.any(factor != 0.0, axis=(3, 4))
    target = np.full((n_slots, n_observers), IDLE, dtype=np.int64)
    share = np.ones(observations.margin.shape)
    best, best_value, evaluations, gap = target.copy(), 0.0, 0, 0.0
    for _ in range(_MOST_SWEEPS):
        for slot in range(n_slots):
            if shares is not None:
                share = shares(target)
            columns, observers = _columns(visible[slot], observers_per_target)
            added = np.empty(columns.size)
            _column_values(factor, share, known, target, slot, columns, observers, added)
            if half_field is not None:
                alone = np.count_nonzero(observers != IDLE, axis=1) == 1
                pairs = observers[alone, 0], columns[alone]
                gain = np.zeros(visible[slot].shape)
                gain[pairs] = added[alone]
                counted = values_in_field(gain, observations.direction[slot], half_field)
                added[alone] = counted[pairs]
            target[slot], own_gap = _chosen(columns, observers, added, visible[slot].shape)
            gap, evaluations = max(gap, own_gap), evaluations + 1
        if shares is not None:
            share = shares(target)
        value = _total(factor, share, known, target)
        if not value > best_value + 10.0**-INFORMATION_DECIMALS:
            break
        best, best_value = target.copy(), value
        if n_slots == 1:
            break
    if shares is not None:
        share = shares(best)
    certain = detection_probabilities(None, observations.margin)
    information = _total(factor, share, certain, best[:carried_out])
    return _SlotSchedule(best, best_value, information, evaluations, gap)


@njit(cache=True, error_model="numpy")
def _columns(visible, most):
    """Targets (column,), rising, and their groups of observers (column, k), up to `most` each, by
    size and in lexicographic order."""
    n_targets, total = visible.shape[1], 0
    for j in range(n_targets):
        own, groups_of_size = np.count_nonzero(visible[:, j]), 1
        for size in range(1, min(most, own) + 1):
            groups_of_size = groups_of_size * (own - size + 1) // size
            total += groups_of_size
    targets = np.empty(total, np.int64)
    groups = np.full((total, most), IDLE)
    place, column = np.empty(most, np.int64), 0
    for j in range(n_targets):
        own = np.flatnonzero(visible[:, j])
        for size in range(1, min(most, own.size) + 1):
            for k in range(size):
                place[k] = k
            moved = 0
            while moved >= 0:
                targets[column] = j
                for k in range(size):
                    groups[column, k] = own[place[k]]
                column += 1
                # the last observer with another one after it and the following members
                moved = size - 1
                while moved >= 0 and place[moved] == own.size - size + moved:
                    moved -= 1
                if moved >= 0:
                    place[moved] += 1
                    for k in range(moved + 1, size):
                        place[k] = place[k - 1] + 1
    return targets, groups


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
