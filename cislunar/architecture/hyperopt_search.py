"""Sampling searches for an architecture: TPE, adaptive TPE and random (Paul & Fan, section 3).

TPE and adaptive TPE are Hyperopt's; a compiled sampler of the same TPE algorithm is available as
well. Random samples are NumPy's, with the same distributions as Hyperopt's.
"""

import importlib.util
import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.objective import IMPROVES, Objective
from cislunar.architecture.result import SearchResult
from cislunar.architecture.search_space import Range, build_space, hyperopt_space
from cislunar.errors import ConfigurationError
from cislunar.parzen import ParzenSearch
from cislunar.runtime.arguments import require_choice

_HYPEROPT_METHODS = ("tpe", "tpe-compiled", "atpe", "random")


def _suggestion(method: str) -> Callable:
    from hyperopt import tpe

    if method == "tpe":
        return partial(tpe.suggest, verbose=False)
    if importlib.util.find_spec("lightgbm") is None:
        raise ConfigurationError(
            "optimizer 'atpe' needs the package lightgbm: pip install lightgbm, or choose 'tpe'"
        )
    from hyperopt import atpe

    return atpe.suggest


class _Patience:
    """Detects a number of consecutive evaluations without improvement by `IMPROVES`. The same
    architecture with permuted slots differs by rounding, which is no improvement."""

    def __init__(self, patience: int | None) -> None:
        self._patience, self._best, self._done, self._since = patience, -np.inf, 0, 0
        self.stop: int | None = None
        """Number of evaluations at which the search stops, once known."""

    def tell(self, value: float) -> None:
        """Record the value of the next evaluation."""
        self._done += 1
        self._since += 1
        if value > self._best * IMPROVES:
            self._best, self._since = value, 0
        if self.stop is None and self._patience is not None and self._since >= self._patience:
            self.stop = self._done


def stopping_evaluation(history: NDArray[np.float64], patience: int) -> int:
    """Number of evaluations after which a search with this ``patience`` would have stopped, given
    the value of each evaluation, shape (evaluation,)."""
    watch = _Patience(patience)
    for value in history.tolist():
        watch.tell(value)
    return len(history) if watch.stop is None else watch.stop


def _run_hyperopt(
    method: str,
    space: Mapping[str, Range],
    loss: Callable[[Mapping[str, Any]], float],
    stalled: Callable[[], bool],
    rng: np.random.Generator,
    max_evaluations: int,
) -> None:
    """Evaluate the suggestions of Hyperopt."""
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
        show_progressbar=False,
        verbose=False,
        return_argmin=False,
    )


class _RandomSearch:
    """Independent samples, each label with its own distribution; interface of `ParzenSearch`."""

    def __init__(self, low, high, categories, rng: np.random.Generator) -> None:
        self._low, self._high, self._rng = np.array(low), np.array(high), rng
        self._whole = np.array(categories) > 0

    def suggest(self) -> list[float]:
        """The next sample."""
        draw = self._rng.uniform(self._low, self._high)
        return np.where(self._whole, np.floor(draw), draw).tolist()

    def tell(self, values: list[float], loss: float) -> None:
        """Ignore the loss."""


def _run_own(
    sampler: type[ParzenSearch] | type[_RandomSearch],
    space: Mapping[str, Range],
    loss: Callable[[Mapping[str, Any]], float],
    stalled: Callable[[], bool],
    rng: np.random.Generator,
    max_evaluations: int,
) -> None:
    """Evaluate the suggestions of a sampler of this library."""
    search = sampler(*zip(*space.values(), strict=True), rng)
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
        The objective to maximize.
    method : str
        "tpe" or "atpe" (needs lightgbm) by Hyperopt; "tpe-compiled", TPE by `cislunar.parzen`;
        "random".
    rng : numpy.random.Generator
        Source of randomness.
    n_slots : int
        Number of orbits to choose.
    labels : str
        Encoding of an orbit, see `cislunar.architecture.search_space`.
    max_evaluations : int
        Largest number of evaluations (paper: 10,000).
    early_stop : int or None
        Stop after this number of consecutive evaluations without an improvement beyond rounding
        (`cislunar.architecture.objective.IMPROVES`; paper: 500); None = never.
    progress : callable, optional
        Called with (evaluations done, `max_evaluations`).
    """
    require_choice("optimizer", method, _HYPEROPT_METHODS)
    space, decode = build_space(objective, n_slots=n_slots, labels=labels)
    tried: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
    history: list[float] = []
    watch = _Patience(early_stop)

    def loss(sample: Mapping[str, Any]) -> float:
        orbit, satellites = decode(sample)
        value = objective.value(orbit, satellites)
        tried.append((orbit, satellites))
        history.append(value)
        watch.tell(value)
        if progress is not None:
            progress(len(history), max_evaluations)
        return -value

    own = {"tpe-compiled": ParzenSearch, "random": _RandomSearch}
    run = partial(_run_own, own[method]) if method in own else partial(_run_hyperopt, method)
    run(space, loss, lambda: watch.stop is not None, rng, max_evaluations)
    return SearchResult.from_trials(objective, tried, history)
