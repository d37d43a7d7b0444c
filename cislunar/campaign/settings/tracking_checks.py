"""What ties the keys of sensor tasking and tracking to each other and to the scenarios."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cislunar.architecture.published import PUBLISHED
from cislunar.attitude.inertia import inertia_matrix
from cislunar.campaign.settings.cell_tree import CellSettings, Tasking
from cislunar.campaign.settings.cells import (
    MOST_STEPS,
    SCHEDULE_KEYS,
    campaign_cells,
    cell_settings,
    check_cell,
    has_architecture,
    in_mode,
    is_multiple,
    true_settings,
    variant_place,
    wanted_body,
)
from cislunar.campaign.settings.families import StatedVariant, stated_variants, swept_cells
from cislunar.campaign.settings.observing.sensors import observer_sensors
from cislunar.campaign.settings.reading import typed
from cislunar.campaign.settings.scenarios import scenario_settings, tracked_count
from cislunar.errors import ConfigurationError
from cislunar.observation.body_spread import BodySpread
from cislunar.photometry.materials import Material, group_materials
from cislunar.photometry.spacecraft import MODELS

Array = NDArray[np.float64]


def check_tracking(study: Mapping[str, Any], config: Mapping[str, Any]) -> None:
    """Check what ties the keys of `task2` to each other and to the rest, variants included.

    `study` is the configuration, `config` the same with what its families make. An `InputFileError`
    if a scenario's table of moving targets is missing or faulty.
    """
    task2, scenarios = config["task2"], config["scenarios"]
    _check_times("task2.", task2, config)
    for key, scenario, _ in _target_counts(config):
        _require_scenario(f"task2.{key}", scenario, scenarios)
    stated = list(stated_variants(study))
    _check_architectures(config, stated)
    settings = {name: scenario_settings(config, name) for name in scenarios}
    for name, own in settings.items():
        _check_times(f"scenarios.{name}.settings.task2.", own["task2"], own)
    for variant in stated:
        own = settings[variant_place(task2, variant.name)[0]]
        _check_times(f"{variant.key}: ", cell_settings(own["task2"], variant.name), own)
    minutes = [("interval_minutes", task2["interval_minutes"])]
    for key, value in minutes + [("intervals.minutes", m) for m in task2["intervals"]["minutes"]]:
        if not is_multiple(60.0 * value, task2["step_s"]):
            raise ConfigurationError(
                f"configuration key 'task2.{key}': {value} min is no multiple of "
                f"'task2.step_s' = {task2['step_s']} s"
            )
    _check_counts(config, stated)
    if task2["tasking_comparison"]["scenario"] is not None:
        _check_comparison(task2, settings[task2["tasking_comparison"]["scenario"]]["task2"])


def _target_counts(config: Mapping[str, Any]) -> Iterator[tuple[str, str, list[int]]]:
    """Every list of numbers of targets: its key within `task2`, and whose targets they are."""
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
        scenario, _ = variant_place(task2, variant.name)
        counts.append((f"{variant.family}.targets", scenario, variant.entry["targets"]))
        for other, n in variant.entry.get("other_scenarios", {}).items():
            key = f"{variant.family}.other_scenarios"
            _require_scenario(key, other, config["scenarios"])
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
    for cell in campaign_cells(task2) + swept:
        own = cell_settings(scenario_settings(config, cell.scenario)["task2"], cell.variant)
        check_cell(cell, own, available[cell.scenario])
        slots = PUBLISHED.get(cell.scenario) if cell.architecture == "published" else None
        if slots and own.get("sensors"):  # the observers of others are not known yet
            observer_sensors(typed(own, CellSettings), sum(count for _, count in slots))


def _check_architectures(config: Mapping[str, Any], stated: Iterable[StatedVariant]) -> None:
    """Scenario and architecture of the variants and of the comparison of tasking methods."""
    task2 = config["task2"]
    variants, compared = task2["variants"], task2["tasking_comparison"]
    places = {"task2.variants": (variants["scenario"], variants["architecture"])}
    places["task2.tasking_comparison"] = (compared["scenario"], compared["architecture"])
    for variant in stated:
        places[variant.family] = variant_place(task2, variant.name)
    for key, (scenario, architecture) in places.items():
        if scenario is None:
            continue
        _require_scenario(f"{key}.scenario", scenario, config["scenarios"])
        if not has_architecture(scenario, architecture):
            raise ConfigurationError(
                f"configuration key '{key}.architecture' = {architecture!r}: the paper has "
                f"no architecture for scenario {scenario!r}"
            )


def _require_scenario(key: str, scenario: str, scenarios: Mapping[str, Any]) -> None:
    if scenario not in scenarios:
        raise ConfigurationError(
            f"configuration key '{key}': scenario {scenario!r} is not among those of 'scenarios' "
            f"({', '.join(scenarios)})"
        )


def _check_times(place: str, settings: Mapping[str, Any], config: Mapping[str, Any]) -> None:
    """Step, interval, duration, records and shape of a cell or variant."""
    step, hours = settings["step_s"], settings["duration_hours"]
    for key, unit_s in (("duration_hours", 3600.0), ("record_minutes", 60.0)):
        if not is_multiple(unit_s * settings[key], step):
            raise ConfigurationError(
                f"configuration key '{place}{key}' = {settings[key]} is no multiple of step_s = "
                f"{step} s, from one to {MOST_STEPS:,} steps"
            )
    if not is_multiple(60.0 * config["task2"]["interval_minutes"], step):
        raise ConfigurationError(
            f"configuration key '{place}step_s' = {step} s does not divide "
            f"'task2.interval_minutes' = {config['task2']['interval_minutes']}"
        )
    _check_schedule(f"{place}tasking", settings["tasking"], step)
    if settings.get("eclipse") and settings["batch"].get("use_non_detections"):
        raise ConfigurationError(
            f"configuration key '{place}batch.use_non_detections': a target in shadow is not seen "
            "either, which the estimator would take for a faint attitude; leave out 'eclipse'"
        )
    _check_communication(place, settings)
    _check_fusion(place, settings)
    days = config["visibility"]["duration_days"]
    start = settings.get("start_day", 0)
    if hours > 24.0 * (days - start):
        raise ConfigurationError(
            f"configuration key '{place}duration_hours' = {hours} exceeds the ephemeris, which "
            f"covers 'visibility.duration_days' = {days}"
            + (f", from '{place}start_day' = {start} on" if start else "")
        )
    material = settings["material"]
    if not (
        material["diffuse_weight"] * material["diffuse_albedo"]
        or material["specular_weight"] * material["normal_reflectance"]
    ):
        raise ConfigurationError(
            f"configuration key '{place}material' = {material} reflects nothing: raise "
            "diffuse_weight and diffuse_albedo, or specular_weight and normal_reflectance"
        )
    true = true_settings(settings)
    for key, spread, of in (
        ("batch.unknowns", settings["batch"].get("unknowns", {}), settings),
        ("truth.spread", true["spread"], true),
    ):
        try:
            BodySpread(**spread).require_possible(_materials(of))
        except ConfigurationError as error:
            raise ConfigurationError(f"configuration key '{place}{key}': {error}") from None
    _check_body(f"{place}body", settings["body"])
    _check_body(f"{place}truth.body", true["body"])


def _check_schedule(place: str, tasking: Mapping[str, Any], step: float) -> None:
    """Slots of a tasking interval, and what cannot be had with them."""
    tasking = in_mode(tasking)
    minutes = tasking.get("slot_minutes")
    if minutes is not None and not is_multiple(60.0 * minutes, step):
        raise ConfigurationError(
            f"configuration key '{place}.slot_minutes' = {minutes} is no multiple of step_s = "
            f"{step} s, from one step on"
        )
    usual = {key: Tasking.model_fields[key].default for key in SCHEDULE_KEYS}
    asked = [key for key in SCHEDULE_KEYS if tasking.get(key, usual[key]) != usual[key]]
    for key, needed in (("method", "exact"), ("states", "translation")):
        if asked and tasking[key] != needed:
            raise ConfigurationError(
                f"configuration key '{place}.{key}' = {tasking[key]!r}: {', '.join(asked)} can "
                f"be had with {needed!r} alone"
            )


def _check_communication(place: str, settings: Mapping[str, Any]) -> None:
    """Delays within the run, updates that steps fit, and what cannot be had with late data."""
    links = settings.get("communication", {})
    key, delay = f"configuration key '{place}communication.", links.get("delay_minutes", 0)
    minutes, step = links.get("update_minutes"), settings["step_s"]
    if delay >= 60.0 * settings["duration_hours"]:
        raise ConfigurationError(
            f"{key}delay_minutes' = {delay} is as long as the run of duration_hours = "
            f"{settings['duration_hours']}: nothing would ever be received; shorten it"
        )
    if minutes is not None and not is_multiple(60.0 * minutes, step):
        raise ConfigurationError(
            f"{key}update_minutes' = {minutes} is no multiple of step_s = {step} s, from one step "
            "on"
        )
    late = delay > 0 or any(links.get("contact", {}).values())
    if late and links.get("credit_under_way") and settings["tasking"]["states"] != "translation":
        raise ConfigurationError(
            f"{key}credit_under_way': tasking by 'full' states cannot count on looks under way; "
            "set it to false, or 'tasking.states' to 'translation'"
        )


def _check_fusion(place: str, settings: Mapping[str, Any]) -> None:
    """What catalogues of single observers cannot have."""
    fusion = settings.get("fusion", "common")
    if fusion == "common":
        return
    for key, unfit in (
        ("tasking.states", settings["tasking"]["states"] != "translation"),
        ("batch.unknowns", any(settings["batch"].get("unknowns", {}).values())),
    ):
        if unfit:
            raise ConfigurationError(
                f"configuration key '{place}{key}': fusion = {fusion!r} hands on position and "
                "velocity, and no more than attitude and rate besides; leave one of them out"
            )
    dynamics = settings.get("dynamics", {})
    if dynamics.get("truth") == "ephemeris" and dynamics.get("filter") == "cr3bp":
        raise ConfigurationError(
            f"configuration key '{place}dynamics.filter': fusion = {fusion!r} needs a force model "
            "that all targets share; set it to 'ephemeris'"
        )


def _materials(settings: Mapping[str, Any]) -> list[Array]:
    """Materials of the body of all targets that no table tells of."""
    usual, body = Material(**settings["material"]), wanted_body(settings["body"])
    if body.materials is not None:
        found = group_materials(body.source, body.materials, usual).values()
    else:
        found = MODELS[body.shape][1].values() if body.shape in MODELS else [usual]
    return [material.as_array() for material in found]


def _check_body(place: str, body: Mapping[str, Any]) -> None:
    """Size and inertia of a body, believed or true."""
    if body["shape"] == "icosahedron" and body["radius_m"] is None:
        raise ConfigurationError(
            f"configuration key '{place}.radius_m': an icosahedron has no size of its own; "
            "give the radius of the sphere of equal area"
        )
    try:
        inertia_matrix(1.0 if body["inertia"] is None else body["inertia"])
    except ConfigurationError as error:
        raise ConfigurationError(f"configuration key '{place}.inertia': {error}") from None


def _check_comparison(task2: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
    """Epochs and budgets of the comparison of tasking methods, as its scenario is set."""
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
