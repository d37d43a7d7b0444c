"""Upper bound of the value of all schedules of an interval, from prices of the observers' slots.

Let each slot of an observer have a price p >= 0. Without the constraint that an observer observes
one target at a time, every target j may take the observations A with the largest value less price,
and the sum

    L(p) = sum of all p + sum_j max_A (F_j(A) - p(A))

is at least the value of every schedule (Lagrangian relaxation; F_j as in
`cislunar.tasking.planning.schedule`). L is convex. The initial prices are the values of the
schedule's own observations; a subgradient method with Polyak's step lowers L from there.

F_j is submodular. An observation whose value alone is below its price is therefore in no best A.
The others are enumerated; for a target with more than `_MOST_CANDIDATES` of them each slot counts
by its best observations alone, which can only increase L.
"""

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import njit
from cislunar.tasking.planning.schedule import (
    DetectionProbabilities,
    observations_of,
    value_of_observations,
)
from cislunar.tasking.planning.slot_observations import SlotObservations

_MOST_CANDIDATES = 12


@njit(cache=True, error_model="numpy")
def _alone(factor, share, detection_probabilities, visible, out):
    """Value of every observation (slot, observer, target) alone, into `out`."""
    observation = np.empty((1, 2), np.int64)
    for s in range(out.shape[0]):
        for o in range(out.shape[1]):
            for j in range(out.shape[2]):
                out[s, o, j] = 0.0
                if visible[s, o, j]:
                    observation[0, 0], observation[0, 1] = s, o
                    out[s, o, j] = value_of_observations(
                        factor, share, detection_probabilities, j, observation, 1
                    )


@njit(cache=True, error_model="numpy")
def _best_observations(factor, share, detection_probabilities, alone, price, most, j, chosen):
    """Upper bound of max_A (F_j(A) - p(A)); marks the observations A (slot, observer) in
    `chosen`."""
    n_slots, n_observers = price.shape
    observations, count = np.empty((n_slots * n_observers, 2), np.int64), 0
    for s in range(n_slots):
        for o in range(n_observers):
            if alone[s, o, j] > price[s, o]:
                observations[count, 0], observations[count, 1] = s, o
                count += 1
    chosen[:, :] = False
    if count > _MOST_CANDIDATES:
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
                s, o = observations[i]
                alike = alike + 1 if n > 0 and some[n - 1, 0] == s else 1
                if alike > most:
                    break
                some[n, 0], some[n, 1] = s, o
                cost += price[s, o]
                bound += alone[s, o, j]
                n += 1
        if alike > most or bound - cost <= best:
            continue
        value = value_of_observations(factor, share, detection_probabilities, j, some, n) - cost
        if value > best:
            best, at = value, mask
    for i in range(count):
        if at >> i & 1:
            chosen[observations[i, 0], observations[i, 1]] = True
    return best


@njit(cache=True, error_model="numpy")
def _marginal_values(factor, share, detection_probabilities, target, price):
    """Value that each observation of a schedule adds to the others of its target, into `price`."""
    observations, some = np.empty((target.size, 2), np.int64), np.empty((target.size, 2), np.int64)
    price[:, :] = 0.0
    for j in range(factor.shape[2]):
        count = observations_of(target, -1, j, observations)
        if count == 0:
            continue
        whole = value_of_observations(
            factor, share, detection_probabilities, j, observations, count
        )
        for left in range(count):
            n = 0
            for i in range(count):
                if i != left:
                    some[n] = observations[i]
                    n += 1
            rest = value_of_observations(factor, share, detection_probabilities, j, some, n)
            price[observations[left, 0], observations[left, 1]] = max(0.0, whole - rest)


@njit(cache=True, error_model="numpy")
def _least_bound(factor, detection_probabilities, visible, target, achieved, most, steps):
    """Least L found in this number of steps."""
    share, alone = np.ones(factor.shape[:3]), np.empty(factor.shape[:3])
    _alone(factor, share, detection_probabilities, visible, alone)
    price = np.empty(target.shape)
    _marginal_values(factor, share, detection_probabilities, target, price)
    chosen, used = np.empty(target.shape, np.bool_), np.empty(target.shape)
    least = np.inf
    for _ in range(steps):
        bound = np.sum(price)
        used[:, :] = 0.0
        for j in range(factor.shape[2]):
            given = factor, share, detection_probabilities, alone, price, most, j, chosen
            bound += _best_observations(*given)
            used += chosen
        least = min(least, bound)
        away = used - 1.0
        for s in range(price.shape[0]):
            for o in range(price.shape[1]):
                if price[s, o] == 0.0 and away[s, o] < 0.0:
                    away[s, o] = 0.0
        squares = np.sum(away * away)
        if squares == 0.0 or least <= achieved:
            break
        price = np.maximum(0.0, price + (bound - achieved) / squares * away)
    return least


def schedule_bound(
    observations: SlotObservations,
    known: DetectionProbabilities,
    target: NDArray[np.int64],
    achieved: float,
    *,
    observers_per_target: int = 1,
    steps: int = 30,
) -> float:
    """Upper bound of the value of every schedule of an interval, nats, found in `steps` steps of
    the subgradient method from the prices of a schedule `target` (slot, observer), whose value is
    `achieved`. If slewing takes time, the bound is that of schedules without slewing times."""
    factor = observations.factor
    visible = np.any(factor != 0.0, axis=(3, 4))
    given = factor, known, visible, np.ascontiguousarray(target), float(achieved)
    return float(max(achieved, _least_bound(*given, observers_per_target, steps)))
