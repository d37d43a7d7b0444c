"""The best assignment without the information of all pairs.

Of many targets an observer can reach, few compete for it. Upper bounds of the information say which
pairs to compute first; the prices of the assignment found among them prove that no other pair
belongs into it, or name those that might, which are computed next. What results is the assignment
of the full matrix, not one near it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from cislunar.compiled import borrowing
from cislunar.estimation.estimator import Prediction
from cislunar.observation.scene import Scene, TargetSurfaces
from cislunar.observation.sensor import Sensors
from cislunar.tasking.planning.assignment import IDLE, Assignment, assign
from cislunar.tasking.planning.information import TaskingModel, information_bound, pair_information

Array = NDArray[np.float64]
Pairs = NDArray[np.bool_]

MARGIN = 1e-7
"""What another assignment must fall short by, nats, for rounding of the information of some hundred
pairs not to matter."""

FEWEST_PAIRS = 20_000
"""With fewer, little time is to be saved and all pairs are computed."""


def preselects(model: TaskingModel, method: str, n_pairs: int) -> bool:
    """Whether `assign_preselected` serves a tasking, and saves time.

    Parameters
    ----------
    model : TaskingModel
    method : str
        Of the assignment.
    n_pairs : int
        Observers times targets.

    Returns
    -------
    bool
    """
    plain = model.states == "translation" and model.detection is None
    return method == "exact" and plain and n_pairs >= FEWEST_PAIRS


def assign_preselected(
    prediction: Prediction,
    scene: Scene,
    surfaces: TargetSurfaces,
    sensor: Sensors,
    model: TaskingModel,
) -> Assignment:
    """The exact assignment of `pair_information`, from the information of few pairs.

    Parameters
    ----------
    prediction, scene, surfaces, sensor, model
        As for `cislunar.tasking.planning.information.pair_information`, with
        ``model.states == "translation"``.

    Returns
    -------
    Assignment
        That of ``assign(pair_information(...))``.
    """

    def compute(wanted: Pairs, gain: Array) -> None:
        pair_information(prediction, scene, surfaces, sensor, model, wanted=wanted, out=gain)

    return assign_by_bounds(information_bound(prediction, scene, sensor, model), compute)


def assign_by_bounds(bound: Array, compute: Callable[[Pairs, Array], None]) -> Assignment:
    """Best assignment of pairs whose information is bounded and can be computed.

    The assignment of the pairs computed so far has prices u of observers and v of targets, not
    negative, with u + v = information of its pairs and u + v >= information of all computed ones.
    No pair with u + v above its bound is part of any best assignment. If there is more than one
    within `MARGIN`, all pairs are computed, and ties settled as ever.

    Parameters
    ----------
    bound : ndarray, shape (observer, target)
        Upper bounds of the information, not negative, maybe infinite; zero says that it is zero.
    compute : callable
        Called with pairs, a mask (observer, target), and a matrix that receives the information of
        these.

    Returns
    -------
    Assignment
        That of the whole matrix.
    """
    gain, known = np.zeros(bound.shape), bound == 0.0
    wanted, beyond = np.empty(bound.shape, dtype=bool), np.zeros(bound.shape[1])
    # As many for each observer as there are observers would do, if all of them were in view.
    count = 2 * bound.shape[0]
    _mark(bound, known, np.zeros(bound.shape[0]), beyond, wanted)
    _keep_highest(bound, wanted, count)
    while np.any(wanted):
        compute(wanted, gain)
        known |= wanted
        columns = np.flatnonzero(gain.any(axis=0))
        few = gain[:, columns]
        best = assign(few)
        taken = columns[best.target[best.target != IDLE]]
        wanted[:] = False
        wanted[:, taken] = ~known[:, taken]
        if np.any(wanted):
            continue
        u, v = _prices(few, best.target)
        beyond[:] = 0.0
        beyond[columns] = v
        if _mark(bound, known, u, beyond, wanted):
            count *= 4
            _keep_highest(bound, wanted, count)
        elif _is_unique(few, u, v, best.target):
            target = np.append(columns, IDLE)[best.target]  # IDLE is the index of the last
            return Assignment(target, best.information, best.history)
        else:
            wanted = ~known
    return assign(gain)


@borrowing
def _mark(bound, known, u, v, wanted):
    """Mark pairs not known whose bound is above the prices, within `MARGIN`; whether there are."""
    found = False
    for o in range(bound.shape[0]):
        for j in range(bound.shape[1]):
            wanted[o, j] = (not known[o, j]) and u[o] + v[j] < bound[o, j] + MARGIN
            found |= wanted[o, j]
    return found


def _keep_highest(bound: Array, pairs: Pairs, count: int) -> None:
    """Of the pairs of each observer leave the `count` with the highest bounds."""
    for o in np.flatnonzero(pairs.sum(axis=1) > count):
        row = np.where(pairs[o], bound[o], -1.0)
        pairs[o] = False
        pairs[o, np.argpartition(-row, count - 1)[:count]] = True


def _prices(gain: Array, target: NDArray[np.int64]) -> tuple[Array, Array]:
    """Prices of observers, the highest there are, and of targets, of a best assignment.

    The price of an observer is what it brings at most, and less where another would take over its
    target: a shortest path.
    """
    paired = np.flatnonzero(target != IDLE)
    taken = target[paired]
    own = gain[paired, taken]
    loss = own - gain[:, taken]
    u = np.zeros(target.size)
    u[paired] = own
    for _ in range(target.size + 1):
        lower = np.minimum(u[paired], (u[:, None] + loss).min(axis=0))
        settled = np.all(lower >= u[paired] - 1e-3 * MARGIN)
        u[paired] = lower
        if settled:
            break
    v = np.zeros(gain.shape[1])
    v[taken] = own - u[paired]
    return u, v


def _is_unique(gain: Array, u: Array, v: Array, target: NDArray[np.int64]) -> bool:
    """Whether every other assignment falls short by more than `MARGIN`.

    Another one differs by observers who each take the target of the next, in a circle, or in a row
    that begins with a target let go and ends with one that was free, or none. It falls short
    by the sum of the slacks on its way, so that there is no other without such a way of
    small slacks.
    """
    slack, n, idle = u[:, None] + v - gain, target.size, target == IDLE
    if min(slack.min(initial=0.0), u.min(), v.min(initial=0.0)) < -MARGIN:
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
    near = csr_array(cost <= MARGIN)
    return connected_components(near, connection="strong", return_labels=False) == n + 1
