"""Checks of settings of tasking and tracking that depend on each other and on the scenarios."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from typing import Any

from cislunar.architecture.published import PUBLISHED
from cislunar.attitude.inertia import inertia_matrix
from cislunar.campaign.settings import cells
from cislunar.campaign.settings.cell_settings import cell_settings, observer_sensors, true_settings
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.families import StatedVariant, stated_variants, swept_cells
from cislunar.campaign.settings.reading import typed
from cislunar.campaign.settings.scenarios import (
    require_scenario,
    scenario_settings,
    tracked_count,
)
from cislunar.errors import ConfigurationError, placed
from cislunar.observation import ICOSAHEDRON, BodyParameterPrior, BodySpec, require_freedom
from cislunar.photometry import PhotometryModel
from cislunar.runtime import is_multiple, require_multiple, shortened_interval


def check_tracking(study: Mapping[str, Any], config: Mapping[str, Any]) -> None:
    """Refuse settings of `task2` and its variants that do not fit each other or the scenarios.
    `config` is `study` with the variants and scenarios of its families."""
    task2 = config["task2"]
    _check_cell("task2.", task2, config)
    for key, scenario, _ in _target_counts(config):
        require_scenario(f"task2.{key}", scenario, config)
    stated = list(stated_variants(study))
    _check_architectures(config, stated)
    settings = {name: scenario_settings(config, name) for name in config["scenarios"]}
    for name, own in settings.items():
        _check_cell(f"scenarios.{name}.settings.task2.", own["task2"], own)
    for variant in stated:
        own = settings[cells.variant_place(task2, variant.name)[0]]
        _check_cell(f"{variant.key}: ", own["task2"], own, variant.name)
    for value in task2["intervals"]["minutes"]:
        if not is_multiple(60.0 * value, task2["step_s"]):
            raise ConfigurationError(
                f"configuration key 'task2.intervals.minutes': {value} min is no multiple of "
                f"'task2.step_s' = {task2['step_s']} s"
            )
    _check_counts(config, stated)
    cells.replayed_cell(task2)
    if task2["tasking_comparison"]["scenario"] is not None:
        _check_comparison(task2, settings[task2["tasking_comparison"]["scenario"]]["task2"])


def shortened_intervals(config: Mapping[str, Any]) -> list[str]:
    """A warning, each once, of the cells that end within a tasking interval."""

    @cache
    def duration(scenario: str, variant: str) -> float:
        own = scenario_settings(config, scenario)["task2"]
        return cell_settings(own, variant)["duration_hours"]

    found = (
        shortened_interval(duration(cell.scenario, cell.variant), cell.interval_minutes)
        for cell in cells.campaign_cells(config["task2"])
    )
    return [each for each in dict.fromkeys(found) if each]


def _target_counts(config: Mapping[str, Any]) -> Iterator[tuple[str, str, list[int]]]:
    """Lists of numbers of targets: key within `task2`, scenario and numbers."""
    task2 = config["task2"]
    by_scenario = {
        "target_counts": task2["target_counts"],
        "intervals.target_counts": task2["intervals"]["target_counts"],
    }
    for name, counts in task2["other_architectures"].items():
        by_scenario[f"other_architectures.{name}"] = counts
    for key, counts in by_scenario.items():
        for scenario, targets in counts.items():
            yield f"{key}.{scenario}", scenario, targets


def _check_counts(config: Mapping[str, Any], stated: Iterable[StatedVariant]) -> None:
    """Refuse more moving targets than a scenario has, and cells that cannot be run."""
    task2, compared = config["task2"], config["task2"]["tasking_comparison"]
    available = {name: tracked_count(config, name) for name in config["scenarios"]}
    counts = [(f"task2.{key}", scenario, n) for key, scenario, n in _target_counts(config)]
    for variant in stated:
        scenario, _ = cells.variant_place(task2, variant.name)
        counts.append((f"{variant.family}.targets", scenario, variant.entry["targets"]))
        for other, n in variant.entry.get("other_scenarios", {}).items():
            key = f"{variant.family}.other_scenarios"
            require_scenario(key, other, config)
            counts.append((f"{key}.{other}", other, n))
    counts.append(("task2.tasking_comparison.targets", compared["scenario"], compared["targets"]))
    for name, sweep in config["sweeps"].items():
        counts.append((f"sweeps.{name}.targets", sweep["scenario"], sweep.get("targets", ())))
    for key, scenario, targets in counts:
        most = max(targets, default=0)
        if scenario is not None and most > available[scenario]:
            raise ConfigurationError(
                f"configuration key '{key}': {most} targets, but scenario {scenario} has "
                f"{available[scenario]} moving targets; lower it or add rows to its table"
            )
    swept = [cell for name in config["sweeps"] for cell in swept_cells(config, name)]

    @cache
    def settings_of(scenario: str, variant: str) -> CellSettings:
        own = scenario_settings(config, scenario)["task2"]
        return typed(cell_settings(own, variant), CellSettings)

    for cell in cells.campaign_cells(task2) + swept:
        own = settings_of(cell.scenario, cell.variant)
        cells.check_cell(cell, own, available[cell.scenario])
        slots = PUBLISHED.get(cell.scenario) if cell.architecture == "published" else None
        if slots and own.sensors:  # the observers of others are not known yet
            observer_sensors(own, sum(count for _, count in slots))


def _check_architectures(config: Mapping[str, Any], stated: Iterable[StatedVariant]) -> None:
    """Refuse scenarios and architectures of variants and of the comparison that do not exist."""
    task2 = config["task2"]
    variants, compared = task2["variants"], task2["tasking_comparison"]
    places = {"task2.variants": (variants["scenario"], variants["architecture"])}
    places["task2.tasking_comparison"] = (compared["scenario"], compared["architecture"])
    for variant in stated:
        places[variant.family] = cells.variant_place(task2, variant.name)
    for key, (scenario, architecture) in places.items():
        if scenario is None:
            continue
        require_scenario(f"{key}.scenario", scenario, config)
        if not cells.has_architecture(scenario, architecture):
            raise ConfigurationError(
                f"configuration key '{key}.architecture' = {architecture!r}: the paper has "
                f"no architecture for scenario {scenario!r}"
            )


def _check_cell(
    place: str, task2: Mapping[str, Any], config: Mapping[str, Any], variant: str = ""
) -> None:
    """Refuse settings of a cell or a variant that do not fit each other or the scenario."""
    settings = typed(cell_settings(task2, variant), CellSettings)
    days = config["visibility"]["duration_days"]
    require_consistent(place, settings, task2["interval_minutes"], days)


def require_consistent(
    place: str,
    settings: CellSettings,
    minutes: float,
    days: float,
    interval: str = "task2.interval_minutes",
) -> None:
    """Refuse settings of a cell that do not fit each other, the tasking interval or the ephemeris.

    Parameters
    ----------
    place : str
        Beginning of the keys of the settings in messages.
    settings : CellSettings
    minutes, days : float
        Tasking interval, min, and duration of the ephemeris, d.
    interval : str
        Key of the tasking interval.

    Raises
    ------
    ConfigurationError
        If two settings exclude each other; the message names the keys.
    InputFileError
        If the text of the materials cannot be used.
    """
    step, hours = settings.step_s, settings.duration_hours

    def named(*section: str) -> Callable[[str], str]:
        return lambda key: f"configuration key '{place}{'.'.join([*section, key])}'"

    key = named()
    require_multiple(key("duration_hours"), hours, 3600.0, step)
    require_multiple(key("record_minutes"), settings.record_minutes, 60.0, step)
    if not is_multiple(60.0 * minutes, step):
        raise ConfigurationError(
            f"{key('step_s')} = {step} s does not divide '{interval}' = {minutes}"
        )
    tasking = settings.tasking
    tasking.require_possible(step, tasking.method, tasking.states, named("tasking"))
    settings.communication.require_possible(step, hours, tasking.states, named("communication"))
    association, late = settings.association, settings.communication.late
    dimmed = settings.eclipse or bool(settings.stations)
    association.require_possible(late, dimmed, tasking.bound_steps, named("association"))
    if settings.eclipse and settings.batch.use_non_detections:
        # shipped variants may exclude the settings of a user's cells
        omit = ", or omit all variants: task2.variants.scenario: null" if ": " in place else ""
        raise ConfigurationError(
            f"{key('batch.use_non_detections')}: a target in shadow is not detected either, which "
            f"the estimator would take for a faint attitude; leave out 'eclipse'{omit}"
        )
    if association.in_field and settings.batch.use_non_detections:
        raise ConfigurationError(
            f"{key('batch.use_non_detections')}: with association.detections = 'all-in-field' a "
            "bright target may be lost as well, which the estimator would take for a faint "
            "attitude; leave one of them out"
        )
    _check_fusion(place, settings)
    _check_detection(place, settings)
    start = settings.start_day
    if hours > 24.0 * (days - start):
        raise ConfigurationError(
            f"{key('duration_hours')} = {hours} exceeds the ephemeris, which covers "
            f"'visibility.duration_days' = {days}"
            + (f", from '{place}start_day' = {start} on" if start else "")
        )
    material = settings.material
    if not (
        material.diffuse_weight * material.diffuse_albedo
        or material.specular_weight * material.normal_reflectance
    ):
        raise ConfigurationError(
            f"{key('material')} = {material.model_dump()} reflects nothing: raise "
            "diffuse_weight and diffuse_albedo, or specular_weight and normal_reflectance"
        )
    true, sampled = true_settings(settings), settings.truth.parameter_sigma.model_dump()
    law = PhotometryModel(reflection=settings.truth.reflection).law
    for name, prior, of, number in (
        ("batch.estimated_parameters", settings.batch.estimated_parameters, settings, 0),
        ("truth.parameter_sigma", BodyParameterPrior(**sampled), true, law),
    ):
        with placed(key(name), ConfigurationError):
            # of the body of all targets that no table describes
            found = of.body.named("task2.body").surfaces([""], of.material).values()
            prior.require_possible([each.as_array() for each in found], number)
    estimated = settings.batch.estimated_parameters
    if settings.filter.estimate_parameters and (not estimated or estimated.log_facets > 0.0):
        raise ConfigurationError(
            f"{key('filter.estimate_parameters')} needs standard deviations above 0 in "
            "'batch.estimated_parameters', and none in log_facets, whose states would be too many"
        )
    with placed(key("truth.parameter_freedom"), ConfigurationError):
        require_freedom(BodyParameterPrior(**sampled), settings.truth.parameter_freedom)
    _check_body(f"{place}body", settings.body)
    _check_body(f"{place}truth.body", true.body)


def _check_detection(place: str, settings: CellSettings) -> None:
    """Refuse hypothesized maneuvers that are not at times of measurements, and what excludes the
    recovery of orbits or a search."""
    minutes, step_s = settings.maneuver_detection.spacing_minutes, settings.step_s
    # without a test, no multiple of a step is needed
    if settings.maneuver_detection.false_alarms_per_target_day or 60.0 * minutes < step_s:
        name = f"configuration key '{place}maneuver_detection.spacing_minutes'"
        require_multiple(name, minutes, 60.0, step_s)
    if settings.maneuver_detection.recover and settings.observer_errors.treatment != "none":
        raise ConfigurationError(
            f"configuration key '{place}maneuver_detection.recover': orbits are not estimated anew "
            "where the errors of observers are estimated or considered; set "
            "observer_errors.treatment to 'none', or recover to false"
        )
    late = settings.communication.late or settings.association.in_field
    if settings.maneuver_detection.search_share > 0.0 and late:
        raise ConfigurationError(
            f"configuration key '{place}maneuver_detection.search_share' = "
            f"{settings.maneuver_detection.search_share}: a search needs measurements at once, of "
            "the targets that are observed; set it to 0, or leave out delays and "
            "association.detections = 'all-in-field'"
        )


def _check_fusion(place: str, settings: CellSettings) -> None:
    """Refuse what catalogs of single observers do not support."""
    if settings.fusion == "common":
        return
    if settings.observer_errors.treatment != "none":
        raise ConfigurationError(
            f"configuration key '{place}observer_errors.treatment' = "
            f"{settings.observer_errors.treatment!r}: the errors of observers are treated in one "
            f"estimate of all, but fusion = {settings.fusion!r}; set fusion to 'common'"
        )
    if settings.maneuver_detection.false_alarms_per_target_day is not None:
        raise ConfigurationError(
            f"configuration key '{place}maneuver_detection.false_alarms_per_target_day': one "
            f"estimate of all observers is tested, but fusion = {settings.fusion!r}; set fusion to "
            "'common'"
        )
    if settings.association.in_field:
        raise ConfigurationError(
            f"configuration key '{place}association.detections' = 'all-in-field': detections are "
            f"associated with one catalog, but fusion = {settings.fusion!r} has one for each "
            "observer; set fusion to 'common'"
        )
    for key, unfit in (
        ("tasking.states", settings.tasking.states != "translation"),
        ("batch.estimated_parameters", settings.batch.estimated_parameters),
        ("batch.model_selection", settings.batch.model_selection.effort),
    ):
        if unfit:
            raise ConfigurationError(
                f"configuration key '{place}{key}': fusion = {settings.fusion!r} exchanges "
                "position and velocity, and no more than attitude and rate besides; leave one of "
                "them out"
            )
    if settings.dynamics.truth == "ephemeris" and settings.dynamics.filter == "cr3bp":
        raise ConfigurationError(
            f"configuration key '{place}dynamics.filter': fusion = {settings.fusion!r} needs a "
            "force model that all targets share; set it to 'ephemeris'"
        )


def _check_body(place: str, body: BodySpec) -> None:
    """Refuse an icosahedron without a size, and an impossible inertia."""
    if body.shape == ICOSAHEDRON and body.radius_m is None:
        raise ConfigurationError(
            f"configuration key '{place}.radius_m': an icosahedron has no size of its own; "
            "give the radius of the sphere of equal area"
        )
    with placed(f"configuration key '{place}.inertia'", ConfigurationError):
        inertia_matrix(1.0 if body.inertia is None else body.inertia)


def _check_comparison(task2: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
    """Refuse epochs and budgets of the comparison of tasking methods that do not fit the run."""
    compared = task2["tasking_comparison"]
    if not compared["targets"]:
        raise ConfigurationError(
            "configuration key 'task2.tasking_comparison.targets' is empty: give at least one "
            "number of targets"
        )
    n_epochs = math.ceil(60.0 * settings["duration_hours"] / task2["interval_minutes"] - 1e-9)
    if max(compared["epochs"]) >= n_epochs:
        raise ConfigurationError(
            f"configuration key 'task2.tasking_comparison.epochs' = {compared['epochs']}: a run "
            f"has {n_epochs} tasking epochs, counted from 0"
        )
    if min(compared["evaluations"]) > compared["tpe_evaluations"]:
        raise ConfigurationError(
            "configuration key 'task2.tasking_comparison.tpe_evaluations' = "
            f"{compared['tpe_evaluations']} is below every entry of 'evaluations'"
        )
