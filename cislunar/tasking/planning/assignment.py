"""One-to-one assignment of observers to targets that maximizes the information (section 4).

The information of a tasking is the sum over its pairs, so that the best tasking is a linear
assignment problem, which is solved exactly in microseconds. The paper searches instead with
Hyperopt's tree-structured Parzen estimator over one continuous weight per target: the targets with
the K largest weights are assigned to the observers in that order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from cislunar.errors import ConfigurationError
from cislunar.parzen import ParzenSearch
from cislunar.runtime import Array
from cislunar.runtime.arguments import array_of, count_of, require_choice

INFORMATION_DECIMALS = 9
"""Decimals of the information, nats, by which taskings are compared."""

IDLE = -1
"""Entry of an observer without a target."""

MAX_EVALUATIONS = 5000
"""Largest number of taskings a search tries at an epoch (Paul & Fan, table 3)."""

EARLY_STOP = 700
"""Number of taskings without progress after which a search ends (Paul & Fan, table 3)."""


@dataclass(frozen=True)
class Assignment:
    """A tasking: `target` (observer,) is the target of each observer, or `IDLE`; `information` the
    sum over the pairs, nats; `history` (evaluation,) the best information after each evaluation, a
    single entry for the methods that do not search."""

    target: NDArray[np.int64]
    information: float
    history: Array


def _exact(information: Array) -> NDArray[np.int64]:
    """Best assignment, by SciPy's shortest augmenting paths. SciPy copies a matrix to maximize."""
    np.negative(information, out=information)
    rows, columns = linear_sum_assignment(information)
    np.negative(information, out=information)
    target = np.full(information.shape[0], IDLE, dtype=np.int64)
    target[rows] = columns
    return target


def _greedy(information: Array) -> NDArray[np.int64]:
    """Take the best remaining pair until no pair is left."""
    target = np.full(information.shape[0], IDLE, dtype=np.int64)
    taken = np.zeros(information.shape[1], dtype=bool)
    # A stable sort breaks ties by observer, then target, on every platform.
    for flat in np.argsort(-information, axis=None, kind="stable"):
        observer, column = divmod(int(flat), information.shape[1])
        if target[observer] == IDLE and not taken[column]:
            target[observer] = column
            taken[column] = True
    return target


def _top(weights: Array, n_observers: int) -> NDArray[np.int64]:
    """Targets of the largest weights, in order, for as many observers as there are targets."""
    target = np.full(n_observers, IDLE, dtype=np.int64)
    ranked = np.argsort(-weights, kind="stable")[:n_observers]
    target[: ranked.size] = ranked
    return target


def total_information(information: ArrayLike, target: ArrayLike) -> float:
    """Information of a tasking: a sum over pairs, since the joint covariance is block-diagonal
    (Paul & Fan, eq. 60).

    Parameters
    ----------
    information : array_like, shape (observer, target)
        Of every pair.
    target : array_like of int, shape (observer,)
        Target of each observer, or `IDLE`.

    Returns
    -------
    float
        Nats.

    Raises
    ------
    ConfigurationError
        If the information is no matrix, or `target` does not have a target, or `IDLE`, for each
        observer.
    """
    matrix, given = _matrix(information), array_of("target", target, finite=False)
    least, most = min(IDLE, 0), matrix.shape[1] - 1
    possible = (given >= least) & (given <= most) & (given == np.floor(given))
    if given.shape != matrix.shape[:1] or not np.all(possible):
        raise ConfigurationError(
            f"target must be {len(matrix)} whole numbers up to {most}, or {IDLE}"
        )
    observers = np.flatnonzero(given != IDLE)
    return float(matrix[observers, given[observers].astype(np.int64)].sum())


def _matrix(information: ArrayLike) -> Array:
    """The information as a matrix of finite numbers."""
    matrix = array_of("information", information)
    if matrix.ndim != 2:
        raise ConfigurationError(f"information has shape {matrix.shape}; give (observer, target)")
    return matrix


def _random(
    information: Array, rng: np.random.Generator, max_evaluations: int, early_stop: int
) -> tuple[NDArray[np.int64], Array]:
    """Best of many random taskings."""
    return _best_of(
        information, lambda: rng.random(information.shape[1]), max_evaluations, early_stop
    )


def _compiled_tpe(
    information: Array, rng: np.random.Generator, max_evaluations: int, early_stop: int
) -> tuple[NDArray[np.int64], Array]:
    """The paper's search by the compiled sampler of the same algorithm."""
    n_targets = information.shape[1]
    zeros = np.zeros(n_targets)
    search = ParzenSearch(zeros, zeros + 1.0, zeros, rng)
    return _best_of(information, search.suggest, max_evaluations, early_stop, report=search.tell)


def _best_of(
    information: Array,
    suggest: Callable[[], Array],
    max_evaluations: int,
    early_stop: int,
    report: Callable[[Array, float], None] | None = None,
) -> tuple[NDArray[np.int64], Array]:
    """Best tasking by suggested weights, and the course of the search; `report` receives the
    losses."""
    n_observers = information.shape[0]
    best, best_value, last_progress, history = None, -np.inf, 0, []
    for evaluation in range(max_evaluations):
        weights = suggest()
        target = _top(weights, n_observers)
        value = total_information(information, target)
        if report is not None:
            report(weights, -value)
        if value > best_value:
            best, best_value, last_progress = target, value, evaluation
        history.append(best_value)
        if evaluation - last_progress >= early_stop:
            break
    return best, np.array(history)


def _tpe(
    information: Array, rng: np.random.Generator, max_evaluations: int, early_stop: int
) -> tuple[NDArray[np.int64], Array]:
    """The paper's search: Hyperopt's TPE over a weight in [0, 1] per target."""
    # Hyperopt takes a second to import and only this method needs it.
    from hyperopt import Trials, fmin, hp, tpe
    from hyperopt.early_stop import no_progress_loss

    n_observers, n_targets = information.shape

    def loss(weights: tuple[float, ...]) -> float:
        return -total_information(information, _top(np.array(weights), n_observers))

    labels = [f"w{j:04d}" for j in range(n_targets)]
    trials = Trials()
    fmin(
        loss,
        [hp.uniform(label, 0.0, 1.0) for label in labels],
        algo=tpe.suggest,
        max_evals=max_evaluations,
        trials=trials,
        rstate=np.random.default_rng(rng.integers(2**32)),
        early_stop_fn=no_progress_loss(early_stop),
        show_progressbar=False,
        verbose=False,
    )
    losses = np.array(trials.losses(), dtype=float)
    values = trials.vals
    best = int(np.argmin(losses))
    weights = np.array([values[label][best] for label in labels])
    return _top(weights, n_observers), np.maximum.accumulate(-losses)


_DIRECT: dict[str, Callable] = {"exact": _exact, "greedy": _greedy}
_SEARCHES: dict[str, Callable] = {"tpe": _tpe, "tpe-compiled": _compiled_tpe, "random": _random}
METHODS = ("exact", "tpe", "tpe-compiled", "greedy", "random")


def assign(
    information: ArrayLike,
    method: str = "exact",
    *,
    rng: np.random.Generator | None = None,
    max_evaluations: int = MAX_EVALUATIONS,
    early_stop: int = EARLY_STOP,
) -> Assignment:
    """Assign observers to targets, one to one.

    Surplus observers are idle, and so is an observer whose target has no information. Information
    is rounded to `INFORMATION_DECIMALS`, so that no tasking depends on the last digits; ties are
    broken by the order of observers and targets.

    Parameters
    ----------
    information : array_like, shape (observer, target)
        Information of every pair, nats; negative values count as none.
    method : {"exact", "tpe", "tpe-compiled", "greedy", "random"}
        `exact` is optimal. `tpe` is the paper's method by Hyperopt, `tpe-compiled` the same
        algorithm by `cislunar.parzen`; `random` evaluates random taskings. These three return the
        best tasking found.
    rng : numpy.random.Generator, optional
        Required by the three methods that search.
    max_evaluations : int
        Largest number of taskings that a search evaluates; 1 makes `random` a single random
        tasking.
    early_stop : int
        Number of taskings without progress after which a search ends.

    Returns
    -------
    Assignment

    Raises
    ------
    ConfigurationError
        If the information is no matrix of finite numbers, the method is unknown, or a method that
        searches has no `rng` or a number of taskings below 1.
    """
    # an idle observer is better than a pair of negative value
    matrix = np.maximum(np.round(_matrix(information), INFORMATION_DECIMALS), 0.0)
    require_choice("method", method, METHODS)
    if method in _DIRECT:
        target, history = _DIRECT[method](matrix), None
    else:
        count_of("max_evaluations", max_evaluations)
        count_of("early_stop", early_stop)
        if rng is None:
            raise ConfigurationError(f"method = {method!r} needs a random generator: give rng")
        target, history = _SEARCHES[method](matrix, rng, max_evaluations, early_stop)
    pairs = np.flatnonzero(target != IDLE)
    target[pairs[matrix[pairs, target[pairs]] <= 0.0]] = IDLE
    value = total_information(matrix, target)
    return Assignment(target, value, np.array([value]) if history is None else history)


def values_in_field(value: Array, direction: Array, half_field: Array) -> Array:
    """Value of each target plus those of its neighbors in the field of view about it.

    A target counts in every field that contains it, also if several observers measure it. The field
    is the circle within the square field of view.

    Parameters
    ----------
    value : ndarray, shape (observer, target)
        Value of an observation of the target alone; not positive if it is not observable.
    direction : ndarray, shape (observer, target, 3)
        Unit vectors from observer to target; NaN for a target without an estimate.
    half_field : ndarray, shape (observer,)
        Half the field of view, rad.

    Returns
    -------
    ndarray, shape (observer, target)
        Unchanged where the target itself is not observable.
    """
    found = value.copy()
    for o, least in enumerate(np.cos(half_field)):
        seen = np.flatnonzero(value[o] > 0.0)
        toward = direction[o, seen]
        found[o, seen] = (toward @ toward.T >= least) @ value[o, seen]
    return found
