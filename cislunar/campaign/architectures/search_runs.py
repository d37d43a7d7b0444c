"""Data sets of sampling searches: one run, and the best of several."""

import json
from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from cislunar.architecture.hyperopt_search import hyperopt_search, stopping_evaluation
from cislunar.architecture.objective import first_best
from cislunar.campaign.architectures.variables import (
    architecture_attributes,
    architecture_variables,
    dimensionless,
    history_variables,
)
from cislunar.campaign.architectures.visibility import cost_function
from cislunar.runtime import generator, logger, progress_log


def sampling_method(method: str, sampler: str) -> str:
    """Name of a method in `hyperopt_search`, given the `sampler` of TPE, "hyperopt" or
    "compiled"."""
    return "tpe-compiled" if (method, sampler) == ("tpe", "compiled") else method


def search_run_dataset(
    visibility: xr.Dataset,
    orbits: xr.Dataset,
    *,
    scenario: str,
    method: str,
    labels: str,
    run: int,
    seed: int,
    slots: int,
    max_evaluations: int,
    early_stop: int,
    sampler: str,
) -> xr.Dataset:
    """``architecture/{scenario}/runs/{method}_{labels}_{run}.nc``: a search, every trial.

    Random search runs to the full number of evaluations; its early stop is a prefix of that. The
    `sampler` of TPE is "hyperopt" or "compiled".
    """
    cost = cost_function(visibility, orbits)
    result = hyperopt_search(
        cost,
        method=sampling_method(method, sampler),
        rng=generator(seed, scenario, method, labels, run),
        n_slots=slots,
        labels=labels,
        max_evaluations=max_evaluations,
        early_stop=None if method == "random" else early_stop,
        progress=progress_log(f"{method} evaluations"),
    )
    logger.info("J = %.4e with %d satellites", result.value, result.n_satellites)
    settings = {
        "method": method, "labels": labels, "run": run, "slots": slots,
        "max_evaluations": max_evaluations, "early_stop": early_stop,
        "sampler": sampler,
    }  # fmt: skip
    each_slot = ("evaluation", "slot")
    return xr.Dataset(
        architecture_variables(result.orbit, result.satellites, cost)
        | history_variables(result.history, result.satellites_history)
        | dimensionless(
            trial_orbit=(each_slot, result.orbit_trials.astype(np.int32),
                         "orbit of each slot in each evaluation"),
            trial_satellites=(each_slot, result.satellites_trials.astype(np.int16),
                              "satellites of each slot in each evaluation"),
        ),
        attrs=architecture_attributes(
            visibility, f"Scenario {scenario}, {method} search", settings, seed
        ),
    )  # fmt: skip


def label_rows(runs: Sequence[xr.Dataset], scenario: str) -> pd.DataFrame:
    """Rows of ``tables/label_comparison.csv``: J of TPE by the labels of the orbits."""
    settings = [json.loads(run.attrs["settings"]) for run in runs]
    return pd.DataFrame({
        "scenario": scenario,
        "labels": [each["labels"] for each in settings],
        "run": [each["run"] for each in settings],
        "J": [float(run["J"]) for run in runs],
        "satellites": [int(run["satellites"].sum()) for run in runs],
        "evaluations": [run.sizes["evaluation"] for run in runs],
    })  # fmt: skip


def _stopped(run: xr.Dataset, early_stop: int) -> tuple[int, int]:
    """Evaluations until an early stop, and the best of them."""
    history = run["J_history"].values
    allowed = stopping_evaluation(history, early_stop)
    return allowed, first_best(history[:allowed])


def best_run_dataset(
    runs: Sequence[xr.Dataset], visibility: xr.Dataset, orbits: xr.Dataset, early_stop: int
) -> xr.Dataset:
    """``architecture/{scenario}/{method}.nc``: the best of several searches under the early stop.

    The best run is in the main variables; ``run_*`` have each run under the early stop (evaluations
    without improvement), ``full_*`` all its evaluations.
    """

    def of_runs(name: str, at: Sequence[int]) -> np.ndarray:
        return np.array([each[name].values[i] for each, i in zip(runs, at, strict=True)])

    stops = [_stopped(run, early_stop) for run in runs]
    at_stop = [best for _, best in stops]
    reached = of_runs("J_history", at_stop)
    chosen = first_best(reached)
    run, (allowed, best) = runs[chosen], stops[chosen]
    orbit, satellites = run["trial_orbit"].values[best], run["trial_satellites"].values[best]
    order = np.argsort(orbit, kind="stable")
    orbit, satellites = orbit[order].astype(np.int64), satellites[order].astype(np.int64)
    longest = max(allowed for allowed, _ in stops)
    histories = np.full((len(runs), longest), np.nan)
    for row, (each, (count, _)) in enumerate(zip(runs, stops, strict=True)):
        histories[row, :count] = each["J_history"].values[:count]
    full = [first_best(each["J_history"].values) for each in runs]
    data = architecture_variables(orbit, satellites, cost_function(visibility, orbits))
    data |= history_variables(
        run["J_history"].values[:allowed], run["satellites_history"].values[:allowed]
    )
    data |= dimensionless(
        run_J=("run", reached, "J reached by each run under the early stop"),
        run_orbit=(("run", "slot"), of_runs("trial_orbit", at_stop),
                   "orbits of the best of each run"),
        run_satellites=("run", of_runs("satellites_history", at_stop),
                        "satellites of the best of each run"),
        run_evaluations=("run", [allowed for allowed, _ in stops],
                         "evaluations until the early stop"),
        run_J_history=(("run", "run_evaluation"), histories, "J of each evaluation of each run"),
        full_J=("run", of_runs("J_history", full),
                "J reached over all evaluations made, early stop or not"),
        full_satellites=("run", of_runs("satellites_history", full),
                         "satellites of that architecture"),
        full_evaluations=("run", [each.sizes["evaluation"] for each in runs], "evaluations made"),
    )  # fmt: skip
    title = f"{run.attrs['title']}, the best of {len(runs)}"
    return xr.Dataset(data, attrs=run.attrs | {"title": title})
