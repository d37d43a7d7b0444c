"""Tasking methods on the same problems: information against evaluations and time.

The problems are those of a run with exact tasking: the information of all pairs at its epochs.
Every budget is a separate search with its own clock; searches of one run share their random
numbers, so that a larger budget continues the smaller one.
"""

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.cell import CellInputs, cell_loop
from cislunar.runtime import Array, Progress, counted, generator, variable
from cislunar.runtime.provenance import provenance
from cislunar.tasking.planning.assignment import assign
from cislunar.tasking.recording import collect

SEARCHES = ("tpe", "random")
_DIRECT = ("exact", "greedy")

_TIMED_CALLS = 20


def _timed(information: Array, method: str, **budget: Any) -> tuple[Any, float]:
    start = time.perf_counter()
    found = assign(information, method, **budget)
    return found, time.perf_counter() - start


def _direct(pairs: Sequence[Array]) -> dict[str, Array]:
    """Information and time of the methods that do not search, shape (method, epoch)."""
    information = np.empty((len(_DIRECT), len(pairs)))
    elapsed = np.empty_like(information)
    for m, method in enumerate(_DIRECT):
        for e, matrix in enumerate(pairs):
            timed = [_timed(matrix, method) for _ in range(_TIMED_CALLS)]
            information[m, e] = timed[0][0].information
            elapsed[m, e] = np.median([seconds for _, seconds in timed])
    return {"direct_information": information, "direct_elapsed": elapsed}


def compared_dataset(
    cell: Cell,
    inputs: CellInputs,
    settings: Mapping[str, Any],
    comparison: Mapping[str, Any],
    *,
    propagator: str,
    seed: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compare the tasking methods: ``task2/tasking/{scenario}_{architecture}_nt{n}.nc``.

    See `cell_loop` for the arguments; `comparison` is the configuration key
    `task2.tasking_comparison`.
    """
    first = {**settings, "seeds": 1, "tasking": {**settings["tasking"], "method": "exact"}}
    loop, problem = cell_loop(
        cell, inputs, first, propagator=propagator, seed=seed, keep_information=True
    )
    kept, _ = collect(loop.pieces(), 1, loop.lengths)
    epochs = list(comparison["epochs"])
    pairs = [kept["pair_information"][0, epoch] for epoch in epochs]
    dims = ("search", "epoch", "run", "budget")
    described = {
        "information": (dims, "nat", "information reached"),
        "elapsed": (dims, "s", "time of the search"),
        "evaluations": (dims, "1", "taskings tried"),
        "history": ((*dims[:3], "evaluation"), "nat", "best information so far"),
        "direct_information": (("direct", "epoch"), "nat", "information of the tasking"),
        "direct_elapsed": (("direct", "epoch"), "s", "time of one assignment, median"),
    }
    found = _search_all(pairs, cell, comparison, seed, progress) | _direct(pairs)
    coords = {
        "search": variable("search", list(SEARCHES), "1", "method that searches"),
        "direct": variable("direct", list(_DIRECT), "1", "method that does not search"),
        "epoch": variable("epoch", epochs, "1", "tasking epoch"),
        "budget": variable("budget", sorted(comparison["evaluations"]), "1", "evaluations allowed"),
        "observers": variable((), len(problem.observer_slot), "1", "observers"),
        "targets": variable((), cell.targets, "1", "monitored targets"),
    }
    title = f"Tasking methods compared, scenario {cell.scenario}, {cell.architecture} architecture"
    used = {**first, **cell._asdict(), "comparison": dict(comparison)}
    return xr.Dataset(
        {name: variable(own[0], found[name], *own[1:]) for name, own in described.items()},
        coords,
        provenance(title, settings=used, seed=seed),
    )


def _search_all(
    pairs: Sequence[Array],
    cell: Cell,
    comparison: Mapping[str, Any],
    seed: int,
    progress: Progress | None,
) -> dict[str, Array]:
    """All searches: information, time, and the course of the longest one."""
    budgets, runs = sorted(comparison["evaluations"]), comparison["runs"]
    allowed = {"tpe": comparison["tpe_evaluations"], "random": budgets[-1]}
    called = {"tpe": "tpe-compiled"} if comparison["sampler"] == "compiled" else {}
    shape = (len(SEARCHES), len(pairs), runs, len(budgets))
    found = {
        "information": np.full(shape, np.nan),
        "elapsed": np.full(shape, np.nan),
        "evaluations": np.zeros(shape, dtype=np.int32),
        "history": np.full((*shape[:3], budgets[-1]), np.nan),
    }
    cases = [at for at in np.ndindex(shape) if budgets[at[3]] <= allowed[SEARCHES[at[0]]]]
    for at in counted(cases, progress):
        method, (_, e, r, b) = SEARCHES[at[0]], at
        reached, found["elapsed"][at] = _timed(
            pairs[e],
            called.get(method, method),
            rng=generator(seed, cell.scenario, cell.architecture, cell.targets, method, e, r),
            max_evaluations=budgets[b],
            early_stop=comparison["early_stop"],
        )
        found["information"][at] = reached.information
        found["evaluations"][at] = reached.history.size
        found["history"][at[:3]][: reached.history.size] = reached.history
    return found


def concatenate_comparisons(compared: Sequence[xr.Dataset]) -> xr.Dataset:
    """All compared cells along a dimension `cell`: ``task2/tasking_comparison.nc``."""
    whole = xr.concat(list(compared), dim="cell", combine_attrs="drop_conflicts", join="exact")
    # The cells differ in their number of targets, which is a variable of its own.
    return whole.assign_attrs(
        title="Tasking methods compared", settings=compared[0].attrs["settings"]
    )
