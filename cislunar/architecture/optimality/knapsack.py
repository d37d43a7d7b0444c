"""Best choice of orbits and counts for a linear score: the subproblem of the optimality proof.

Exactly S of the candidate orbits are chosen, with one count each, so that the excess satellites
(count - 1) add up to E and the sum of the scores is largest. Without excess this is sorting;
otherwise it is a knapsack over (orbits used, excess used), exact in O(orbits S E counts).
"""

import numpy as np

from cislunar.compiled import njit

NO_CHOICE = -1.0e300  # score of an impossible choice


@njit(cache=True, nogil=True)
def best_choice(score, lowest, highest, forced, n_slots, excess, position, extra):
    """Best total score, or ``NO_CHOICE``; ``position`` and ``extra`` (slot,) are filled with the
    chosen orbits, ascending, and their excess satellites.

    ``score`` (orbit, count) is that of an orbit with ``count`` excess satellites, ``lowest`` and
    ``highest`` (orbit,) their range; orbits that are ``forced`` (orbit,) must be chosen."""
    if excess == 0:
        return _best_without_excess(score, lowest, forced, n_slots, position, extra)
    table = _prefix_table(score, lowest, highest, forced, n_slots, excess)
    n = score.shape[0]
    best = table[n, n_slots, excess]
    if best <= 0.5 * NO_CHOICE:
        return NO_CHOICE
    slots, left = n_slots, excess
    for i in range(n - 1, -1, -1):
        if not forced[i] and table[i + 1, slots, left] == table[i, slots, left]:
            continue
        for e in range(lowest[i], min(highest[i], left) + 1):
            if table[i, slots - 1, left - e] + score[i, e] == table[i + 1, slots, left]:
                slots -= 1
                left -= e
                position[slots] = i
                extra[slots] = e
                break
        if slots == 0:
            break
    return best


@njit(cache=True, nogil=True)
def _ranked(score, lowest, forced, n_slots):
    """Number and score of forced orbits; the others' best scores and positions, descending."""
    n = score.shape[0]
    total = 0.0
    n_forced = 0
    for i in range(n):
        if forced[i]:
            n_forced += 1
            total += score[i, 0] if lowest[i] == 0 else NO_CHOICE
    needed = n_slots - n_forced + 1  # one more than needed: the best one not chosen
    value = np.full(max(needed, 1), NO_CHOICE)
    where = np.full(max(needed, 1), -1)
    if needed < 1:
        return total, n_forced, value, where
    for i in range(n):
        s = score[i, 0]
        if forced[i] or lowest[i] > 0 or s <= value[needed - 1]:
            continue
        k = needed - 1
        while k > 0 and value[k - 1] < s:
            value[k] = value[k - 1]
            where[k] = where[k - 1]
            k -= 1
        value[k] = s
        where[k] = i
    return total, n_forced, value, where


@njit(cache=True, nogil=True)
def _best_without_excess(score, lowest, forced, n_slots, position, extra):
    total, n_forced, value, where = _ranked(score, lowest, forced, n_slots)
    if n_forced > n_slots:
        return NO_CHOICE
    chosen = 0
    for k in range(n_slots - n_forced):
        if where[k] < 0:
            return NO_CHOICE
        total += value[k]
        position[chosen] = where[k]
        chosen += 1
    for i in range(score.shape[0]):
        if forced[i]:
            position[chosen] = i
            chosen += 1
    position.sort()
    extra[:] = 0
    return max(total, NO_CHOICE)


@njit(cache=True, nogil=True)
def _prefix_table(score, lowest, highest, forced, n_slots, excess):
    """Best score of the first i orbits by slots and excess used."""
    n = score.shape[0]
    table = np.full((n + 1, n_slots + 1, excess + 1), NO_CHOICE)
    table[0, 0, 0] = 0.0
    for i in range(n):
        if not forced[i]:
            table[i + 1] = table[i]
        for slots in range(min(i + 1, n_slots)):
            for used in range(excess + 1):
                before = table[i, slots, used]
                if before <= 0.5 * NO_CHOICE:
                    continue
                for e in range(lowest[i], min(highest[i], excess - used) + 1):
                    s = before + score[i, e]
                    if s > table[i + 1, slots + 1, used + e]:
                        table[i + 1, slots + 1, used + e] = s
    return table


@njit(cache=True, nogil=True)
def conditional_bests(score, lowest, highest, forced, n_slots, excess):
    """Best score with each (orbit, count) in the choice, and with each orbit excluded. For the
    arguments see `best_choice`; ``NO_CHOICE`` or less where impossible."""
    n, counts = score.shape
    taken = np.full((n, counts), NO_CHOICE)
    left_out = np.full(n, NO_CHOICE)
    if excess == 0:
        _conditional_without_excess(score, lowest, forced, n_slots, taken, left_out)
        return taken, left_out
    before = _prefix_table(score, lowest, highest, forced, n_slots, excess)
    after = _prefix_table(score[::-1], lowest[::-1], highest[::-1], forced[::-1], n_slots, excess)
    for i in range(n):
        first, last = before[i], after[n - 1 - i]
        for slots in range(n_slots + 1):
            for used in range(excess + 1):
                b = first[slots, used]
                if b <= 0.5 * NO_CHOICE:
                    continue
                if not forced[i]:
                    left_out[i] = max(left_out[i], b + last[n_slots - slots, excess - used])
                if slots == n_slots:
                    continue
                for e in range(lowest[i], min(highest[i], excess - used) + 1):
                    total = b + score[i, e] + last[n_slots - slots - 1, excess - used - e]
                    taken[i, e] = max(taken[i, e], total)
    return taken, left_out


@njit(cache=True, nogil=True)
def _conditional_without_excess(score, lowest, forced, n_slots, taken, left_out):
    total, n_forced, value, where = _ranked(score, lowest, forced, n_slots)
    free = n_slots - n_forced
    if free < 0:
        return
    for k in range(free):
        total += value[k]
    for i in range(score.shape[0]):
        if lowest[i] > 0:
            continue
        chosen = forced[i]
        for k in range(free):
            chosen |= where[k] == i
        if chosen:
            taken[i, 0] = total
            if not forced[i]:
                left_out[i] = total - score[i, 0] + value[free]
        else:
            left_out[i] = total
            if free > 0:
                taken[i, 0] = total - value[free - 1] + score[i, 0]
