"""Data sets of optimised architectures."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cislunar.architecture.cost import CostFactors, CostFunction
from cislunar.architecture.hyperopt_search import stopping_evaluation
from cislunar.architecture.optimize import optimize
from cislunar.architecture.tables import ArchitectureTables
from cislunar.campaign.data.netcdf import variable
from cislunar.campaign.data.progress import logger, progress_log
from cislunar.campaign.data.provenance import provenance

LAMBDA_MEANING = (
    "1 / satellites",
    "1 / sum of satellites x stability index",
    "cumulative observability",
    "observations per target",
    "proximity to Earth and Moon",
    "1 if all orbits differ",
)


def generator(seed: int, *names: Any) -> np.random.Generator:
    """Random numbers of one job, independent of every other job's.

    Parameters
    ----------
    seed : int
        Seed of the campaign.
    *names
        What tells the job from the others (scenario, method, run).

    Returns
    -------
    numpy.random.Generator
    """
    words = [byte for name in names for byte in (*str(name).encode(), 0)]
    return np.random.default_rng(np.random.SeedSequence([seed, *words]))


def architecture_variables(
    orbit: np.ndarray, satellites: np.ndarray, cost: CostFactors
) -> dict[str, xr.Variable]:
    """Variables that describe one architecture.

    Parameters
    ----------
    orbit, satellites : ndarray of int, shape (slot,)
        The architecture.
    cost : CostFactors
        J and its factors.

    Returns
    -------
    dict
    """
    described = {
        "orbit": variable("slot", orbit, "1", "index into orbits/families.nc"),
        "satellites": variable("slot", satellites, "1", "satellites on the orbit"),
        "J": variable((), cost.value, "1", "figure of merit J; larger is better"),
    }
    for k, meaning in enumerate(LAMBDA_MEANING):
        described[f"lambda_{k + 1}"] = variable((), cost.factors[k], "1", meaning)
    return described


def history_variables(values: np.ndarray, satellites: np.ndarray) -> dict[str, xr.Variable]:
    """Variables that describe how a search went.

    Parameters
    ----------
    values : ndarray, shape (evaluation,)
        J of each evaluation.
    satellites : ndarray of int, shape (evaluation,)
        Total satellites of each evaluation.

    Returns
    -------
    dict
    """
    return {
        "J_history": variable("evaluation", values, "1", "J of each evaluation"),
        "satellites_history": variable(
            "evaluation", satellites.astype(np.int32), "1", "total satellites of each evaluation"
        ),
    }


def architecture_attributes(
    visibility: xr.Dataset, title: str, settings: Mapping[str, Any], seed: int
) -> dict[str, Any]:
    """Global attributes of an architecture's data set.

    Parameters
    ----------
    visibility : xarray.Dataset
        ``visibility/{scenario}.nc``, whose photometric settings are handed on.
    title : str
        What the file holds.
    settings : mapping
        Configuration slice.
    seed : int
        Seed of the campaign.

    Returns
    -------
    dict
    """
    kept = ("diffuse_reflection_coefficient", "visibility_magnitude", "n_steps")
    return provenance(title, settings=settings, seed=seed) | {
        key: visibility.attrs[key] for key in kept
    }


def search_run_dataset(
    tables: ArchitectureTables,
    visibility: xr.Dataset,
    *,
    scenario: str,
    method: str,
    labels: str,
    run: int,
    seed: int,
    slots: int,
    max_evaluations: int,
    early_stop: int,
) -> xr.Dataset:
    """One Hyperopt search, every trial kept.

    Random search runs to the full number of evaluations; its early stop is a prefix of that.

    Parameters
    ----------
    tables : ArchitectureTables
        Tables of the scenario.
    visibility : xarray.Dataset
        ``visibility/{scenario}.nc``, for its attributes.
    scenario, method, labels : str
        Scenario, Hyperopt method and kind of labels.
    run, seed : int
        Number of the run and seed of the campaign.
    slots, max_evaluations, early_stop : int
        Settings of the search.

    Returns
    -------
    xarray.Dataset
        ``architecture/{scenario}/runs/{method}_{labels}_{run}.nc``.
    """
    result = optimize(
        tables,
        method=method,
        rng=generator(seed, scenario, method, labels, run),
        n_slots=slots,
        labels=labels,
        max_evaluations=max_evaluations,
        early_stop=None if method == "random" else early_stop,
        progress=progress_log(f"{method} evaluations"),
    )
    logger.info("J = %.4e with %d satellites", result.cost.value, result.n_satellites)
    settings = {
        "method": method,
        "labels": labels,
        "run": run,
        "slots": slots,
        "max_evaluations": max_evaluations,
        "early_stop": early_stop,
    }
    return xr.Dataset(
        architecture_variables(result.orbit, result.satellites, result.cost)
        | history_variables(result.history, result.satellites_history)
        | {
            "trial_orbit": variable(
                ("evaluation", "slot"),
                result.orbit_trials.astype(np.int32),
                "1",
                "orbit of each slot in each evaluation",
            ),
            "trial_satellites": variable(
                ("evaluation", "slot"),
                result.satellites_trials.astype(np.int16),
                "1",
                "satellites of each slot in each evaluation",
            ),
        },
        attrs=architecture_attributes(
            visibility, f"Scenario {scenario}, {method} search", settings, seed
        ),
    )


def _stopped(run: xr.Dataset, early_stop: int) -> tuple[int, int]:
    """Evaluations an early stop allows, and the best of them."""
    history = run["J_history"].values
    allowed = stopping_evaluation(history, early_stop)
    return allowed, int(np.argmax(history[:allowed]))


def best_run_dataset(runs: Sequence[xr.Dataset], early_stop: int, cost: CostFunction) -> xr.Dataset:
    """The best of several searches under the early stop, with the spread over all of them.

    Parameters
    ----------
    runs : sequence of xarray.Dataset
        Data sets of `search_run_dataset`.
    early_stop : int
        Evaluations without improvement after which a search stops.
    cost : CostFunction
        J on the scenario's tables.

    Returns
    -------
    xarray.Dataset
        ``architecture/{scenario}/{method}.nc``: the best run in the main variables; ``run_*`` for
        each run under the early stop, ``full_*`` for all its evaluations.
    """
    stops = [_stopped(run, early_stop) for run in runs]
    reached = np.array(
        [each["J_history"].values[best] for each, (_, best) in zip(runs, stops, strict=True)]
    )
    chosen = int(np.argmax(reached))
    run, (allowed, best) = runs[chosen], stops[chosen]
    order = np.argsort(run["trial_orbit"].values[best], kind="stable")
    orbit = run["trial_orbit"].values[best][order].astype(np.int64)
    satellites = run["trial_satellites"].values[best][order].astype(np.int64)
    longest = max(allowed for allowed, _ in stops)
    histories = np.full((len(runs), longest), np.nan)
    for row, (each, (count, _)) in enumerate(zip(runs, stops, strict=True)):
        histories[row, :count] = each["J_history"].values[:count]
    full = [int(np.argmax(each["J_history"].values)) for each in runs]

    def of_runs(name: str, where: Sequence[int]) -> np.ndarray:
        return np.array([each[name].values[i] for each, i in zip(runs, where, strict=True)])

    data = architecture_variables(orbit, satellites, cost(orbit, satellites))
    data |= history_variables(
        run["J_history"].values[:allowed], run["satellites_history"].values[:allowed]
    )
    data |= {
        "run_J": variable("run", reached, "1", "J reached by each run under the early stop"),
        "run_orbit": variable(
            ("run", "slot"),
            of_runs("trial_orbit", [best for _, best in stops]),
            "1",
            "orbits of the best of each run",
        ),
        "run_satellites": variable(
            "run",
            of_runs("satellites_history", [best for _, best in stops]),
            "1",
            "satellites of the best of each run",
        ),
        "run_evaluations": variable(
            "run", [allowed for allowed, _ in stops], "1", "evaluations until the early stop"
        ),
        "run_J_history": variable(
            ("run", "run_evaluation"), histories, "1", "J of each evaluation of each run"
        ),
        "full_J": variable(
            "run",
            of_runs("J_history", full),
            "1",
            "J reached over all evaluations made, early stop or not",
        ),
        "full_satellites": variable(
            "run",
            of_runs("satellites_history", full),
            "1",
            "satellites of that architecture",
        ),
        "full_evaluations": variable(
            "run", [each.sizes["evaluation"] for each in runs], "1", "evaluations made"
        ),
    }
    attributes = dict(runs[chosen].attrs)
    attributes["title"] = f"{attributes['title']}, the best of {len(runs)}"
    return xr.Dataset(data, attrs=attributes)
