"""What no schedule of an interval can exceed: prices on the observers' slots.

Let each slot of an observer have a price p >= 0. Without the rule that an observer looks at one
target at a time, every target j may take the looks A that are worth most to it less what they cost,
and the sum

    L(p) = sum of all p + sum_j max_A (F_j(A) - p(A))

is at least the worth of every schedule (Lagrangian relaxation; F_j as of
`cislunar.tasking.planning.schedule`). L is convex; from the worth of the schedule's own looks as
prices a subgradient with Polyak's step goes towards its least value, which the schedule's worth may
fall short of.

F_j being submodular, a look that alone is worth no more than its price is in no best A. What is
left is tried out in full; of a target with more than `MOST_CANDIDATES` such looks each slot counts
by its best ones alone, which only raises L.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cislunar.tasking.planning.looks import SlotLooks
from cislunar.tasking.planning.schedule import Chances, worth_of_looks

Array = NDArray[np.float64]

MOST_CANDIDATES = 12


@njit(cache=True, error_model="numpy")
def _alone(factor, share, chances, visible, out):
    """Worth of every look (slot, observer, target) alone, into `out`."""
    look = np.empty((1, 2), np.int64)
    for s in range(out.shape[0]):
        for o in range(out.shape[1]):
            for j in range(out.shape[2]):
                out[s, o, j] = 0.0
                if visible[s, o, j]:
                    look[0, 0], look[0, 1] = s, o
                    out[s, o, j] = worth_of_looks(factor, share, chances, j, look, 1)


@njit(cache=True, error_model="numpy")
def _best_looks(factor, share, chances, alone, price, most, j, chosen):
    """max_A (F_j(A) - p(A)) at most; the looks A (slot, observer) are marked in `chosen`."""
    n_slots, n_observers = price.shape
    looks, count = np.empty((n_slots * n_observers, 2), np.int64), 0
    for s in range(n_slots):
        for o in range(n_observers):
            if alone[s, o, j] > price[s, o]:
                looks[count, 0], looks[count, 1] = s, o
                count += 1
    chosen[:, :] = False
    if count > MOST_CANDIDATES:
        total = 0.0
        for s in range(n_slots):
            for _ in range(most):
                best, at = 0.0, -1
                for o in range(n_observers):
                    gain = alone[s, o, j] - price[s, o]
                    if gain > best and not chosen[s, o]:
                        best, at = gain, o
                if at >= 0:
                    chosen[s, at] = True
                    total += best
        return total
    best, at, some = 0.0, 0, np.empty((count, 2), np.int64)
    for mask in range(1, 2**count):
        n, cost, alike, bound = 0, 0.0, 0, 0.0
        for i in range(count):
            if mask >> i & 1:
                s, o = looks[i]
                alike = alike + 1 if n > 0 and some[n - 1, 0] == s else 1
                if alike > most:
                    break
                some[n, 0], some[n, 1] = s, o
                cost += price[s, o]
                bound += alone[s, o, j]
                n += 1
        if alike > most or bound - cost <= best:
            continue
        value = worth_of_looks(factor, share, chances, j, some, n) - cost
        if value > best:
            best, at = value, mask
    for i in range(count):
        if at >> i & 1:
            chosen[looks[i, 0], looks[i, 1]] = True
    return best


@njit(cache=True, error_model="numpy")
def _own_worth(factor, share, chances, target, price):
    """What each look of a schedule adds to the others of its target, into `price`."""
    looks, some = np.empty((target.size, 2), np.int64), np.empty((target.size, 2), np.int64)
    price[:, :] = 0.0
    for j in range(factor.shape[2]):
        count = 0
        for s in range(target.shape[0]):
            for o in range(target.shape[1]):
                if target[s, o] == j:
                    looks[count, 0], looks[count, 1] = s, o
                    count += 1
        if count == 0:
            continue
        whole = worth_of_looks(factor, share, chances, j, looks, count)
        for left in range(count):
            n = 0
            for i in range(count):
                if i != left:
                    some[n] = looks[i]
                    n += 1
            rest = worth_of_looks(factor, share, chances, j, some, n)
            price[looks[left, 0], looks[left, 1]] = max(0.0, whole - rest)


@njit(cache=True, error_model="numpy")
def _least_bound(factor, chances, visible, target, worth, most, steps):
    """Least L met with in so many steps."""
    share, alone = np.ones(factor.shape[:3]), np.empty(factor.shape[:3])
    _alone(factor, share, chances, visible, alone)
    price = np.empty(target.shape)
    _own_worth(factor, share, chances, target, price)
    chosen, used = np.empty(target.shape, np.bool_), np.empty(target.shape)
    least = np.inf
    for _ in range(steps):
        bound = np.sum(price)
        used[:, :] = 0.0
        for j in range(factor.shape[2]):
            given = factor, share, chances, alone, price, most, j, chosen
            bound += _best_looks(*given)
            used += chosen
        least = min(least, bound)
        away = used - 1.0
        for s in range(price.shape[0]):
            for o in range(price.shape[1]):
                if price[s, o] == 0.0 and away[s, o] < 0.0:
                    away[s, o] = 0.0
        squares = np.sum(away * away)
        if squares == 0.0 or least <= worth:
            break
        price = np.maximum(0.0, price + (bound - worth) / squares * away)
    return least


def schedule_bound(
    looks: SlotLooks,
    known: Chances,
    target: NDArray[np.int64],
    worth: float,
    *,
    observers_per_target: int = 1,
    steps: int = 30,
) -> float:
    """Upper bound of the worth of every schedule of an interval, nats.

    Where turning takes time it is that of schedules that turn at once.

    Parameters
    ----------
    looks, known, observers_per_target
        As of `cislunar.tasking.planning.schedule.plan_schedule`.
    target : ndarray of int, shape (slot, observer)
        A schedule, whose looks give the first prices.
    worth : float
        What it is worth.
    steps : int
        Of the prices.

    Returns
    -------
    float
    """
    factor = looks.factor
    visible = np.any(factor != 0.0, axis=(3, 4))
    given = factor, known, visible, np.ascontiguousarray(target), float(worth)
    return float(max(worth, _least_bound(*given, observers_per_target, steps)))
