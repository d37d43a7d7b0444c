"""The best assignment without the information of all pairs. Upper bounds of the information select
the pairs to compute first. The prices of the assignment found among them prove that no other pair
belongs to it, or select further pairs to compute. The result equals the assignment of the full
matrix."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from cislunar.compiled import njit_noalloc
from cislunar.estimation.estimator import Prediction
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import Sensors
from cislunar.observation.target_surfaces import TargetSurfaces
from cislunar.runtime import Array
from cislunar.tasking.planning.assignment import (
    IDLE,
    INFORMATION_DECIMALS,
    Assignment,
    assign,
)
from cislunar.tasking.planning.information import TaskingModel, information_bound, pair_information

Pairs = NDArray[np.bool_]

_MARGIN = 1e-7
"""Least amount, nats, by which a pair that is left out falls short of the prices."""

_TIE = 0.5 * 10.0**-INFORMATION_DECIMALS
"""Amount, nats, within which assignments of rounded information are equal."""

FEWEST_PAIRS = 20_000
"""Number of pairs below which all are computed, since little time would be saved."""


def preselects(model: TaskingModel, method: str, n_pairs: int) -> bool:
    """Whether `assign_preselected` applies to `n_pairs` pairs and this method, and saves time."""
    plain = model.states == "translation" and model.detection is None
    return method == "exact" and plain and n_pairs >= FEWEST_PAIRS


def assign_preselected(
    prediction: Prediction,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensors,
    model: TaskingModel,
) -> Assignment:
    """Assignment of ``assign(pair_information(...))`` from the information of few pairs. See
    `cislunar.tasking.planning.information.pair_information` for the arguments; ``model.states ==
    "translation"``."""

    def compute(selected: Pairs, gain: Array) -> None:
        pair_information(prediction, scene, surfaces, sensor, model, selected=selected, out=gain)

    return assign_by_bounds(information_bound(prediction, scene, sensor, model), compute)


def assign_by_bounds(bound: Array, compute: Callable[[Pairs, Array], None]) -> Assignment:
    """Best assignment of pairs, given upper bounds (observer, target) of their information.

    `compute` is called with a mask of pairs and with `bound`, in which their information replaces
    the bounds. The assignment of the pairs computed so far has nonnegative prices u of observers
    and v of targets, with u + v = information of its pairs and u + v >= information of all computed
    pairs. No pair with u + v above its bound is part of any best assignment. If there is more than
    one best assignment of the rounded information, all pairs are computed, and `assign` breaks the
    ties.
    """
    known, selected = bound == 0.0, np.empty(bound.shape, dtype=bool)
    beyond = np.zeros(bound.shape[1])
    # As many per observer as there are observers would suffice, if all were in view.
    count = 2 * bound.shape[0]
    _mark(bound, known, np.zeros(bound.shape[0]), beyond, selected)
    _keep_highest(bound, selected, count)
    while np.any(selected):
        compute(selected, bound)
        known |= selected
        columns = np.flatnonzero((known & (bound > 0.0)).any(axis=0))
        few = bound[:, columns]
        few[~known[:, columns]] = 0.0
        np.round(few, INFORMATION_DECIMALS, out=few)
        best = assign(few)
        taken = columns[best.target[best.target != IDLE]]
        selected[:] = False
        selected[:, taken] = ~known[:, taken]
        if np.any(selected):
            continue
        u, v = _prices(few, best.target)
        beyond[:] = 0.0
        beyond[columns] = v
        if _mark(bound, known, u, beyond, selected):
            count *= 4
            _keep_highest(bound, selected, count)
        elif _is_unique(few, u, v, best.target):
            target = np.append(columns, IDLE)[best.target]  # IDLE is the index of the last
            return Assignment(target, best.information, best.history)
        else:
            compute(~known, bound)
            del few, known, selected  # the matrix may fill the memory
            break
    return assign(bound)


@njit_noalloc
def _mark(bound, known, u, v, selected):
    """Mark pairs not known whose bound exceeds the prices, within `_MARGIN`; whether there are
    any."""
    found = False
    for o in range(bound.shape[0]):
        for j in range(bound.shape[1]):
            selected[o, j] = (not known[o, j]) and u[o] + v[j] < bound[o, j] + _MARGIN
            found |= selected[o, j]
    return found


def _keep_highest(bound: Array, pairs: Pairs, count: int) -> None:
    """Of the pairs of each observer leave the `count` with the highest bounds."""
    for o in np.flatnonzero(pairs.sum(axis=1) > count):
        row = np.where(pairs[o], bound[o], -1.0)
        pairs[o] = False
        pairs[o, np.argpartition(-row, count - 1)[:count]] = True


def _prices(gain: Array, target: NDArray[np.int64]) -> tuple[Array, Array]:
    """Prices of observers, the largest possible, and of targets, of a best assignment. The price of
    an observer is its information, and less where another one could take its target: a shortest
    path."""
    paired = np.flatnonzero(target != IDLE)
    taken = target[paired]
    own = gain[paired, taken]
    loss = own - gain[:, taken]
    u = np.zeros(target.size)
    u[paired] = own
    for _ in range(target.size + 1):
        lower = np.minimum(u[paired], (u[:, None] + loss).min(axis=0))
        settled = np.all(lower >= u[paired] - 1e-3 * _TIE)
        u[paired] = lower
        if settled:
            break
    v = np.zeros(gain.shape[1])
    v[taken] = own - u[paired]
    return u, v


def _is_unique(gain: Array, u: Array, v: Array, target: NDArray[np.int64]) -> bool:
    """Whether every other assignment falls short by more than `_TIE`. Another assignment differs
    by a cycle of observers that each take the target of the next, or by a path from a released
    target to a free target or none; it falls short by the sum of the slacks along the way."""
    slack, n, idle = u[:, None] + v - gain, target.size, target == IDLE
    if min(slack.min(initial=0.0), u.min(), v.min(initial=0.0)) < -_TIE:
        return False
    paired = np.flatnonzero(~idle)
    free = np.ones(v.size, dtype=bool)
    free[target[paired]] = False
    cost = np.full((n + 1, n + 1), np.inf)
    cost[:n, paired] = slack[:, target[paired]]
    cost[np.arange(n), np.arange(n)] = np.inf
    to_free = np.where(free & (gain > 0.0), slack, np.inf).min(axis=1, initial=np.inf)
    cost[:n, n] = np.minimum(to_free, np.where(idle, np.inf, u))
    cost[n, :n] = 0.0
    cost[n, paired] = v[target[paired]]
    near = csr_array(cost <= _TIE)
    return connected_components(near, connection="strong", return_labels=False) == n + 1
