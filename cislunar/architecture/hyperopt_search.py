"""Sampling searches for an architecture: TPE, adaptive TPE and random (Paul & Fan, section 3).

They are Hyperopt's; TPE is also had from the compiled sampler of the same algorithm.
"""

import importlib.util
import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.objective import Objective
from cislunar.architecture.result import SearchResult
from cislunar.architecture.search_space import Range, build_space, hyperopt_space
from cislunar.errors import ConfigurationError
from cislunar.parzen import ParzenSearch

HYPEROPT_METHODS = ("tpe", "tpe-compiled", "atpe", "random")

# Random draws do not depend on earlier results, so they can be drawn many at a time.
_RANDOM_BATCH = 500


def _suggestion(method: str) -> Callable:
    from hyperopt import rand, tpe

    if method == "tpe":
        return partial(tpe.suggest, verbose=False)
    if method == "random":
        return rand.suggest
    if importlib.util.find_spec("lightgbm") is None:
        raise ConfigurationError(
            "optimizer 'atpe' needs the package lightgbm: pip install lightgbm, or choose 'tpe'"
        )
    from hyperopt import atpe

    return atpe.suggest


def stopping_evaluation(history: NDArray[np.float64], patience: int) -> int:
    """Evaluations that a stop after so many (``patience``) without improvement would have allowed,
    given the value of each, shape (evaluation,).
    """
    best = np.maximum.accumulate(history)
    improved = np.flatnonzero(np.r_[True, best[1:] > best[:-1]])
    gaps = np.diff(np.r_[improved, len(history)])
    stalled = np.flatnonzero(gaps > patience)
    return int(improved[stalled[0]] + patience + 1) if stalled.size else len(history)


def _run_hyperopt(
    method: str,
    space: Mapping[str, Range],
    loss: Callable[[Mapping[str, Any]], float],
    stalled: Callable[[], bool],
    rng: np.random.Generator,
    max_evaluations: int,
) -> None:
    """Evaluate what Hyperopt suggests."""
    from hyperopt import Trials, fmin

    logging.getLogger("hyperopt").setLevel(logging.WARNING)
    fmin(
        loss,
        hyperopt_space(space),
        algo=_suggestion(method),
        max_evals=max_evaluations,
        trials=Trials(),
        rstate=rng,
        early_stop_fn=lambda trials, *_: (stalled(), []),
        max_queue_len=_RANDOM_BATCH if method == "random" else 1,
        show_progressbar=False,
        verbose=False,
        return_argmin=False,
    )


def _run_compiled(
    space: Mapping[str, Range],
    loss: Callable[[Mapping[str, Any]], float],
    stalled: Callable[[], bool],
    rng: np.random.Generator,
    max_evaluations: int,
) -> None:
    """Evaluate what the compiled sampler suggests."""
    search = ParzenSearch(*zip(*space.values(), strict=True), rng)
    for _ in range(max_evaluations):
        values = search.suggest()
        search.tell(values, loss(dict(zip(space, values, strict=True))))
        if stalled():
            break


def hyperopt_search(
    objective: Objective,
    *,
    method: str,
    rng: np.random.Generator,
    n_slots: int = 10,
    labels: str = "stability_rank",
    max_evaluations: int = 10_000,
    early_stop: int | None = 500,
    progress: Callable[[int, int], None] | None = None,
) -> SearchResult:
    """Search for the architecture of largest value.

    Parameters
    ----------
    objective : Objective
        What makes an architecture better.
    method : str
        "tpe", "random", or "atpe" (needs lightgbm), all by Hyperopt; "tpe-compiled" is TPE by
        `cislunar.parzen`.
    rng : numpy.random.Generator
        Source of randomness.
    n_slots : int
        Number of orbits to choose.
    labels : str
        How an orbit is labelled, see `cislunar.architecture.search_space`.
    max_evaluations : int
        Evaluations at most (paper: 10 000).
    early_stop : int or None
        Stop after so many evaluations without improvement (paper: 500); None = never.
    progress : callable, optional
        Called with (evaluations done, `max_evaluations`).

    Returns
    -------
    SearchResult

    Raises
    ------
    ConfigurationError
        If the method or the labels are not known, or there are more slots than orbits.
    """
    if method not in HYPEROPT_METHODS:
        raise ConfigurationError(
            f"optimizer {method!r} is not known: use one of {list(HYPEROPT_METHODS)}"
        )
    space, decode = build_space(objective, n_slots=n_slots, labels=labels)
    tried: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
    history: list[float] = []

    def loss(sample: Mapping[str, Any]) -> float:
        orbit, satellites = decode(sample)
        value = objective.value(orbit, satellites)
        tried.append((orbit, satellites))
        history.append(value)
        if progress is not None:
            progress(len(history), max_evaluations)
        return -value

    def stalled() -> bool:
        # Evaluations come in batches for random search, so the patience is counted in them.
        since_best = len(history) - 1 - int(np.argmax(history))
        return early_stop is not None and since_best >= early_stop

    run = _run_compiled if method == "tpe-compiled" else partial(_run_hyperopt, method)
    run(space, loss, stalled, rng, max_evaluations)
    # A batch of random draws may run past the stop; draws beyond it do not count.
    allowed = len(history)
    if early_stop is not None:
        allowed = stopping_evaluation(np.array(history), early_stop)
    return SearchResult.from_trials(objective, tried[:allowed], history[:allowed])
