"""A realization of a survey of the campaign: day of the month, phases of the targets, and noise."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.stats import qmc

from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.settings.library import loop_settings, nominal_surfaces
from cislunar.campaign.settings.reading import merged, typed
from cislunar.campaign.settings.tree import StatedSurvey
from cislunar.campaign.survey.records import SurveyRecorder
from cislunar.campaign.tracking.cell import (
    CellInputs,
    Problem,
    cell_problem,
    realization_seeds,
    target_labels,
)
from cislunar.constants import TIME_UNIT_S
from cislunar.dynamics import (
    VELOCITY_UNIT_M_S,
    EphemerisForces,
    of_targets,
    propagate_many,
)
from cislunar.runtime.provenance import provenance
from cislunar.runtime.seeds import generator
from cislunar.survey import (
    ObjectDensity,
    PriorSources,
    SurveyModel,
    SurveyResult,
    SurveySettings,
    in_propagation_frame,
    run_survey,
    sample_prior,
)
from cislunar.targets import (
    TargetStates,
    load_target_states,
    objects_outside_families,
    replace_targets,
)

_ENTERING, _DEPLOYMENT = (0.1, 0.7), (0.2, 0.5)
"""Shares of the duration between which objects enter, and within which the deployment is."""

_DAYS = (1.0, 3.0, 7.0)
"""Days whose quality the table has, besides the last."""


def survey_realization(
    name: str,
    survey: StatedSurvey,
    number: int,
    inputs: CellInputs,
    points: ArrayLike,
    settings: Mapping[str, Any],
    *,
    propagator: str,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
    recorded: Callable[[xr.Dataset], None] | None = None,
) -> SurveyResult:
    """Run one realization of a survey.

    Parameters
    ----------
    name : str
        Name of the survey, for messages.
    survey : StatedSurvey
    number : int
        Number of the realization, which selects its day, the phases of the targets and all other
        random numbers.
    inputs : CellInputs
        Data sets, as for a tracking cell of the same architecture.
    points : array_like, shape (point, 3)
        Points within zero-velocity surfaces, nondimensional, rotating frame.
    settings : mapping
        Settings of the cells of the scenario.
    propagator : str
        Integrator of the observers.
    seed : int
        Seed of the campaign.
    progress : callable, optional
        Called with (blocks done, all blocks).
    recorded : callable, optional
        Called with the record of the realization for a replay
        (`cislunar.campaign.survey.SurveyRecorder.dataset`). Without it nothing is recorded.

    Returns
    -------
    SurveyResult

    Raises
    ------
    ConfigurationError, InputFileError
        If a setting is impossible, a data set is missing, or the table of the prior cannot be used.
    """
    own = dict(settings) | {
        "duration_hours": 24.0 * survey.duration_days,
        "start_day": survey.start_days * _van_der_corput(number),
        "monitored_seed": realization_seeds(seed, 1, number)[0],
    }
    available = inputs.tracked.sizes["target"]
    if survey.targets > available:
        several = np.arange(survey.targets) % available
        inputs = inputs._replace(tracked=inputs.tracked.isel(target=several))
    used = _settings(own, survey)
    cell_settings = typed(used, CellSettings, f"surveys.{name}")
    cell = Cell(survey.scenario, survey.architecture, "mukf", survey.targets, 60)
    loop = loop_settings(cell_settings, cell.interval_minutes)
    problem = cell_problem(cell, inputs, cell_settings, propagator, loop)
    chosen = SurveySettings(**{key: getattr(survey, key) for key in SurveyModel.model_fields})
    table = survey.prior_table
    sources = PriorSources(
        inputs.orbits["state"].values,
        inputs.orbits["period"].values,
        np.asarray(points, dtype=float),
        None if table is None else load_target_states(table).state,
    )
    own_seed = realization_seeds(seed, 1, number)[0]
    state, size = sample_prior(chosen.prior, sources, generator(own_seed, "prior"))
    density = ObjectDensity(
        in_propagation_frame(state, problem.forces),
        size,
        chosen.prior.expected_objects,
        forces=problem.forces,
        region=chosen.region,
        births_per_day=chosen.prior.births_per_day,
    )
    objects, outside = _objects(survey, problem, inputs, own_seed)
    objects, appears_hours = _appearing(survey, objects, problem.truth.forces, own_seed)
    record = None
    if recorded is not None:
        title = f"Survey {name}, realization {number}"
        used |= {"scenario": survey.scenario, "architecture": survey.architecture}
        labels = target_labels(inputs.tracked, problem.target_ids)
        names = [f"outside {k + 1}" if outside[k] else each for k, each in enumerate(labels)]
        attributes = provenance(title, settings=used, seed=seed)
        record = SurveyRecorder(
            problem, names, appears_hours, attributes, radiation_sigma=chosen.radiation_sigma
        )
    result = run_survey(
        problem.scene,
        problem.truth,
        objects,
        problem.target_ids,
        own_seed,
        density,
        chosen,
        sensor=problem.sensor,
        forces=problem.forces,
        outside=outside,
        appears_hours=appears_hours,
        eclipse=cell_settings.eclipse,
        observer_errors=cell_settings.observer_errors,
        body=nominal_surfaces(cell_settings, [[]]),
        progress=progress,
        record=record,
    )
    if recorded is not None:
        recorded(record.dataset())
    return result


def _van_der_corput(number: int) -> float:
    """Number of the van der Corput sequence of base 2, from 0."""
    return float(qmc.Halton(1, scramble=False).random(number + 1)[number, 0])


def _settings(settings: Mapping[str, Any], survey: StatedSurvey) -> dict[str, Any]:
    """The settings of the cells of a survey's scenario with the survey's changes of truth and
    observation, and its dynamics."""
    own = dict(settings) | {"step_s": survey.step_s}
    if survey.ephemeris:
        own = merged(own, {"dynamics": {"truth": "ephemeris", "filter": "ephemeris"}})
    return merged(own, survey.cell.model_dump())


def _appearing(
    survey: StatedSurvey, state: NDArray[np.float64], forces: tuple, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """States at the start, and hours from which the objects exist. The states of objects that are
    deployed together are those of one of them at the time of the deployment, each with a normal
    change of velocity, propagated back to the start."""
    rng, states = generator(seed, "appearing objects"), state.copy()
    hours = np.zeros(len(state))
    chosen = rng.permutation(len(state))[: survey.entering + survey.deployed]
    entering, together = chosen[: survey.entering], chosen[survey.entering :]
    hours[entering] = 24.0 * survey.duration_days * rng.uniform(*_ENTERING, entering.size)
    if together.size:
        hours[together] = when = 24.0 * survey.duration_days * rng.uniform(*_DEPLOYMENT)
        time = 3600.0 * when / TIME_UNIT_S
        given = {"forces": of_targets(forces, together[:1]), "method": "dop853"}
        there = propagate_many(state[together[:1]], [time], **given)[:, 0]
        there = np.repeat(there, together.size, axis=0)
        kick = survey.deployment_m_s * rng.standard_normal((together.size, 3))
        there[:, 3:] += kick / VELOCITY_UNIT_M_S
        states[together] = propagate_many(there, [-time], start=time, **given)[:, 0]
    return states, hours


def _objects(
    survey: StatedSurvey, problem: Problem, inputs: CellInputs, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """True states (object, 6) at the start, propagation frame, and which objects are on no orbit of
    the moving targets and of the observers."""
    placed, share = problem.epoch_state, survey.outside_families
    if share == 0.0:
        return placed, np.zeros(len(placed), dtype=bool)
    parts = [inputs.orbits, inputs.tracked]
    states, periods = (np.concatenate([each[key].values for each in parts])
                       for key in ("state", "period"))  # fmt: skip
    # orbits about the Moon alone close in neither frame, and have no stability index
    closed = periods > 0.0
    if "stability_index" in inputs.tracked:
        closed[inputs.orbits.sizes["orbit"] :] &= np.isfinite(inputs.tracked["stability_index"])
    forces = problem.truth.forces
    others = objects_outside_families(
        states[closed],
        periods[closed],
        generator(seed, "outside families"),
        count=round(share * len(placed)),
        days=survey.duration_days,
        forces=forces if isinstance(forces, EphemerisForces) else None,
    )
    others = TargetStates(
        others.name, others.family, in_propagation_frame(others.state, forces), others.period
    )
    names = target_labels(inputs.tracked, problem.target_ids)
    inside = TargetStates(names, names, placed, np.zeros(len(placed)))
    mixed = replace_targets(inside, others, share, generator(seed, "replaced objects"))
    return mixed.state, np.isin(mixed.name, others.name)


def realization_rows(result: SurveyResult) -> pd.DataFrame:
    """Quality of a realization after 1, 3 and 7 days and at the end.

    Columns of `SurveyResult.states`, and ``hours_to_catalog``, the median time from the first
    detection of an object to its correct confirmed orbit, over the objects with one by then and
    keep it to the end.
    """
    states, objects = result.states, result.objects
    last = states["day"].max()
    days = [day for day in _DAYS if day < last - 1e-9] + [last]
    rows = states[np.isclose(states["day"].to_numpy()[:, None], days).any(axis=1)].copy()
    since = 24.0 * (objects["cataloged"] - objects["detected"])
    rows["hours_to_catalog"] = [
        float(since[objects["cataloged"] <= day + 1e-9].median()) for day in rows["day"]
    ]
    return rows
