"""Data sets of optimised architectures."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cislunar.architecture.coordinate_search import satellite_front
from cislunar.architecture.cost import CostFactors, CostFunction
from cislunar.architecture.hyperopt_search import hyperopt_search, stopping_evaluation
from cislunar.architecture.published import PUBLISHED, choose_members
from cislunar.architecture.result import SearchResult
from cislunar.architecture.tables import ArchitectureTables
from cislunar.campaign.netcdf import variable
from cislunar.campaign.observability import architecture_coverage
from cislunar.campaign.progress import Progress, logger, progress_log
from cislunar.campaign.provenance import provenance
from cislunar.errors import ConfigurationError

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


def _history(values: np.ndarray, satellites: np.ndarray) -> dict[str, xr.Variable]:
    return {
        "J_history": variable("evaluation", values, "1", "J of each evaluation"),
        "satellites_history": variable(
            "evaluation", satellites.astype(np.int32), "1", "total satellites of each evaluation"
        ),
    }


def _attributes(visibility: xr.Dataset, title: str, settings: Mapping, seed: int | None) -> dict:
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
    result = hyperopt_search(
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
        | _history(result.history, result.satellites_history)
        | {
            "trial_orbit": variable(
                ("evaluation", "slot"),
                result.orbit_history.astype(np.int32),
                "1",
                "orbit of each slot in each evaluation",
            ),
            "trial_satellites": variable(
                ("evaluation", "slot"),
                result.satellites_per_orbit_history.astype(np.int16),
                "1",
                "satellites of each slot in each evaluation",
            ),
        },
        attrs=_attributes(visibility, f"Scenario {scenario}, one {method} search", settings, seed),
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
    data |= _history(run["J_history"].values[:allowed], run["satellites_history"].values[:allowed])
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
    attributes["title"] = attributes["title"].replace("one", "the best")
    return xr.Dataset(data, attrs=attributes)


def published_dataset(
    tables: ArchitectureTables, visibility: xr.Dataset, *, scenario: str, seed: int, restarts: int
) -> xr.Dataset:
    """The paper's families and counts, with the members that serve J best.

    Parameters
    ----------
    tables : ArchitectureTables
        Tables of the scenario.
    visibility : xarray.Dataset
        ``visibility/{scenario}.nc``, for its attributes.
    scenario : str
        Scenario; the paper has A, B and C.
    seed, restarts : int
        Seed of the campaign and number of starts.

    Returns
    -------
    xarray.Dataset
        ``architecture/{scenario}/published.nc``.

    Raises
    ------
    ConfigurationError
        If the paper has no such scenario.
    """
    if scenario not in PUBLISHED:
        raise ConfigurationError(
            f"scenario {scenario} is not in the paper, which has {', '.join(PUBLISHED)}: there is "
            "no published architecture to evaluate"
        )
    result = choose_members(
        tables,
        PUBLISHED[scenario],
        rng=generator(seed, scenario, "published"),
        restarts=restarts,
        progress=progress_log("restarts"),
    )
    logger.info("J = %.4e with %d satellites", result.cost.value, result.n_satellites)
    return xr.Dataset(
        architecture_variables(result.orbit, result.satellites, result.cost)
        | _history(result.history, result.satellites_history),
        attrs=_attributes(
            visibility,
            f"Scenario {scenario}, published families and counts",
            {"restarts": restarts},
            seed,
        ),
    )


def front_dataset(
    tables: ArchitectureTables,
    visibility: xr.Dataset,
    orbits: xr.Dataset,
    targets: xr.Dataset,
    sun: xr.Dataset,
    *,
    scenario: str,
    seed: int,
    slots: int,
    front: Mapping[str, int],
    settings: Mapping[str, Any],
    progress: Progress | None = None,
) -> xr.Dataset:
    """Best J found for each number of satellites, and what such an architecture covers.

    Parameters
    ----------
    tables : ArchitectureTables
        Tables of the scenario.
    visibility, orbits, targets, sun : xarray.Dataset
        Data sets of the scenario.
    scenario : str
        Its name.
    seed, slots : int
        Seed of the campaign and number of orbits.
    front : mapping
        Configuration key `architecture.front`.
    settings : mapping
        Configuration keys `propagator` and `visibility`.
    progress : callable, optional
        Called with (totals done, totals).

    Returns
    -------
    xarray.Dataset
        ``architecture/{scenario}/front.nc``.
    """
    totals = list(range(front["fewest"], front["most"] + 1))
    found: list[SearchResult] = satellite_front(
        tables,
        totals,
        generator(seed, scenario, "front"),
        slots=slots,
        restarts=front["restarts"],
        progress=progress,
    )
    covered = [
        architecture_coverage(each.orbit, each.satellites, orbits, targets, sun, settings)
        for each in found
    ]
    return xr.Dataset(
        {
            "J": variable("total", [each.cost.value for each in found], "1", "best J found"),
            "orbit": variable(
                ("total", "slot"), np.array([each.orbit for each in found]), "1", "orbit index"
            ),
            "satellites": variable(
                ("total", "slot"),
                np.array([each.satellites for each in found]),
                "1",
                "satellites on the orbit",
            ),
            "union_coverage": variable(
                "total", [c.union_coverage for c in covered], "1", "share of target-hours seen"
            ),
            "target_days": variable(
                "total", [c.target_days for c in covered], "1", "share of target-days seen"
            ),
            "never_seen": variable(
                "total", [c.never_seen for c in covered], "1", "targets never seen"
            ),
        },
        coords={"total": variable("total", totals, "1", "satellites in all")},
        attrs=_attributes(
            visibility, f"Scenario {scenario}, best J by number of satellites", dict(front), seed
        ),
    )
