"""The check of a whole configuration: each setting, and the settings that depend on each other."""

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from cislunar.campaign.settings.architecture_tree import Design, ObjectiveFront
from cislunar.campaign.settings.cell_settings import cell_settings
from cislunar.campaign.settings.cell_tree import CellChange, CellSettings, Dynamics
from cislunar.campaign.settings.cells import variant_place
from cislunar.campaign.settings.families import (
    check_families,
    stated_variants,
    sweep_points,
    with_families,
)
from cislunar.campaign.settings.reading import checked, first_fault, merged, typed
from cislunar.campaign.settings.scenarios import (
    OPTIMIZERS,
    in_study,
    information_of,
    require_scenario,
    scenario_settings,
    tracked_count,
)
from cislunar.campaign.settings.tracking_checks import check_tracking
from cislunar.campaign.settings.tree import (
    Campaign,
    StatedSurvey,
    Surroundings,
    Visibility,
    survey_label,
)
from cislunar.errors import ConfigurationError
from cislunar.estimation.navigation.errors import ObserverErrors
from cislunar.runtime import is_multiple, shown

_TAKEN = ("front", "fronts", "runs")
"""Names of other folders beside the architectures of a scenario."""

_MOST_OF_FRONT = 60
"""Satellites, where the configuration does not state them."""

_SPECIAL = set("{}*?[]")
"""Characters that have a meaning of their own for Snakemake in a file name."""


def check_campaign(config: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration of a campaign with all defaults, checked.

    Each key is checked by itself, then the keys that depend on each other. Raises
    `ConfigurationError` with a line for each impossible value, which names the key, and
    `InputFileError` if a scenario's table of moving targets is missing or faulty.
    """
    config = _with_front(checked(config, Campaign))
    study = in_study(config)
    _check_architectures(config)
    _check_scenarios(study)
    _check_optimization(study)
    _check_objectives(study)
    _check_surveys(study)
    check_families(config, study)
    whole = with_families(study)
    _check_values(study, whole)
    for name in study["scenarios"]:
        checked(_own(whole, name), Surroundings, f"scenarios.{name}.settings")
    check_tracking(study, whole)
    _check_writable(Path(study["results"]))
    return _with_copies(config)


def _with_copies(config: dict[str, Any]) -> dict[str, Any]:
    """The configuration with a design for every copy, and without omitted keys."""
    search, task2 = config["architecture"], config["task2"]
    designs = {one: {k: v for k, v in Design.kept(each).items() if k != "copies"}
               for name, each in search["designs"].items()
               for one in _copies(search["designs"], name)}  # fmt: skip
    fronts = {name: ObjectiveFront.kept(each) for name, each in search["objective_fronts"].items()}
    tracked = {one: counts for name, counts in task2["other_architectures"].items()
               for one in _copies(search["designs"], name)}  # fmt: skip
    families = dict(task2["variants"]["families"])
    for name, family in families.items():
        further = family.get("other_architectures", ())
        if further:
            every = [one for each in further for one in _copies(search["designs"], each)]
            families[name] = family | {"other_architectures": every}
    variants = task2["variants"] | {"families": families}
    return config | {
        "visibility": Visibility.kept(config["visibility"]),
        "architecture": search | {"designs": designs, "objective_fronts": fronts},
        "task2": task2 | {"other_architectures": tracked, "variants": variants},
    }


def _copies(designs: Mapping[str, Mapping[str, Any]], name: str) -> list[str]:
    """Names of the copies of an architecture."""
    count = designs[name]["copies"] if name in designs else 1
    return [name] if count == 1 else [f"{name}-{number}" for number in range(1, count + 1)]


def _with_front(config: dict[str, Any]) -> dict[str, Any]:
    """The configuration with the default totals of the front, within the limits of slots."""
    chosen = config["architecture"]
    fewest, most = chosen["slots"], chosen["slots"] * chosen["max_satellites"]
    usual = {"fewest": fewest, "most": max(fewest, min(most, _MOST_OF_FRONT))}
    given = {key: value for key, value in chosen["front"].items() if value is not None}
    return config | {"architecture": chosen | {"front": chosen["front"] | usual | given}}


def _own(whole: Mapping[str, Any], scenario: str) -> dict[str, Any]:
    """Settings of a scenario, without the keys of `task2` that set no cell."""
    own = scenario_settings(whole, scenario) if scenario in whole["scenarios"] else whole
    own = {key: own[key] for key in Surroundings.model_fields}
    return own | {"task2": {key: own["task2"][key] for key in CellSettings.model_fields}}


def _check_values(study: Mapping[str, Any], whole: Mapping[str, Any]) -> None:
    """Check the values of families and sweeps like the settings that they change."""
    for _, key, name, entry in stated_variants(study):
        own = _own(whole, variant_place(whole["task2"], name)[0])["task2"]
        try:
            checked(entry["change"], CellChange)
            checked(cell_settings(whole["task2"] | own, name), CellSettings)
        except ConfigurationError as error:
            if str(error).startswith("unknown") and key.endswith(".values"):
                key = key.removesuffix("values") + "key"
            raise ConfigurationError(f"configuration key '{key}': {first_fault(error)}") from None
    for name, point in [(n, p) for n in study["sweeps"] for p in sweep_points(study, n)]:
        try:
            if not point.variant:
                place = f"scenarios.{point.scenario}.settings"
                checked(_own(whole, point.scenario), Surroundings, place)
                _check_scenarios(whole)
        except ConfigurationError as error:
            fault = f"configuration key 'sweeps.{name}': {first_fault(error)}"
            raise ConfigurationError(fault) from None


def _check_scenarios(config: Mapping[str, Any]) -> None:
    """Refuse a study without scenarios, and scenarios without targets."""
    if not config["scenarios"]:
        raise ConfigurationError(
            "configuration key 'scenarios': every scenario is null; give at least one"
        )
    for name, entry in config["scenarios"].items():
        if ("targets" in entry) == ("static_targets" in entry):
            raise ConfigurationError(
                f"configuration key 'scenarios.{name}': give either targets, a number of static "
                "targets to sample, or static_targets, a table of them"
            )
    rerun = config["architecture"]["readings"]["scenario"]
    if "static_targets" in config["scenarios"].get(rerun, {}):
        raise ConfigurationError(
            f"configuration key 'architecture.readings.scenario' = {rerun!r}: its static targets "
            "are from a table, so that no reading changes them; choose another or null"
        )


def _check_optimization(config: Mapping[str, Any]) -> None:
    """Refuse settings of `architecture` that do not fit each other or the library of orbits."""
    architecture = config["architecture"]
    library = sum(config["orbits"]["members"].values())
    if architecture["slots"] > library:
        raise ConfigurationError(
            f"configuration key 'architecture.slots' = {architecture['slots']} exceeds the "
            f"{library} orbits of the library: lower it or raise orbits.members"
        )
    for key in ("label_comparison", "readings", "generalization"):
        if (scenario := architecture[key]["scenario"]) is not None:
            require_scenario(f"architecture.{key}.scenario", scenario, config)
    front = architecture["front"]
    fewest, most = architecture["slots"], architecture["slots"] * architecture["max_satellites"]
    if not fewest <= front["fewest"] <= front["most"] <= most:
        raise ConfigurationError(
            f"configuration key 'architecture.front': fewest = {front['fewest']} and most = "
            f"{front['most']} must rise within {fewest} .. {most} (slots, slots x max_satellites)"
        )


def _check_objectives(config: Mapping[str, Any]) -> None:
    """Refuse designs and fronts that do not fit the orbit slots, scenarios and windows."""
    search = config["architecture"]
    objectives = {f"{kind}.{name}": each for kind in ("designs", "objective_fronts")
                  for name, each in search[kind].items()}  # fmt: skip
    members = sum(config["orbits"]["members"].values())
    for key, objective in objectives.items():
        place = f"configuration key 'architecture.{key}"
        kind, phases = objective["objective"], objective["phases"]
        method, fold = objective.get("method"), objective["fold"]
        by_information = kind in ("information", "attitude")
        lacking = "has none; leave it out" if method == "chance" else "needs one"
        for wrong, setting, fault in (
            ((kind is None) != (method == "chance"), "objective':",
             f"a design with method {method} {lacking}"),
            (kind == "J" and phases is not None, f"phases' = {phases}:",
             "J is defined for satellites in slots; set phases to null"),
            (method == "certified" and objective.get("copies", 1) > 1,
             f"copies' = {objective.get('copies')}:", "all would be the same; leave it out"),
            (by_information and phases is None, "phases' = null:",
             f"{kind} is defined for satellites at phases of their own; give their number"),
            (method in ("tpe", "random") and phases is None, "phases' = null:",
             f"{method} does not keep to a number of satellites in slots; give a number of phases"),
            (fold > 1 and kind not in ("coverage", "target-days", "search"), f"fold' = {fold}:",
             f"{kind} has none; leave it out"),
        ):  # fmt: skip
            if wrong:
                raise ConfigurationError(f"{place}.{setting} {fault}")
        fewest, most = 1, members * (phases or 1)
        if phases is None:
            fewest, most = search["slots"], search["slots"] * search["max_satellites"]
        numbers = objective["satellites"]
        for number in numbers if isinstance(numbers, list) else [numbers]:
            if not fewest <= number <= most:
                raise ConfigurationError(
                    f"{place}.satellites': {number} must lie in {fewest} .. {most}, which the "
                    "orbit slots hold"
                )
        scenarios = objective.get("scenarios")
        for scenario in () if scenarios is None else scenarios:
            require_scenario(f"architecture.{key}.scenarios", scenario, config)
        if by_information:
            evaluated = config["scenarios"] if scenarios is None else scenarios
            _check_windows(config, evaluated, information_of(objective, config["architecture"]))


def _check_surveys(config: Mapping[str, Any]) -> None:
    """Refuse surveys with the label of another, of unknown scenarios, of more targets than there
    are, and beyond the horizon."""
    labels: dict[str, str] = {}
    for name, survey in config["surveys"].items():
        key = f"configuration key 'surveys.{name}"
        label = survey_label(name, survey["label"])
        if labels.setdefault(label, name) != name:
            raise ConfigurationError(
                f"{key}.label' = {label!r} is also that of 'surveys.{labels[label]}'; give each "
                "survey a label of its own"
            )
        scenario = survey["scenario"]
        require_scenario(f"surveys.{name}.scenario", scenario, config)
        try:
            shares = typed(survey, StatedSurvey).prior.shares
        except ConfigurationError as error:
            raise ConfigurationError(f"{key}.prior': {first_fault(error)}") from None
        if shares["table"] > 0.0 and survey["prior_table"] is None:
            raise ConfigurationError(
                f"{key}.prior.table' needs a table of states; give it as 'surveys.{name}."
                "prior_table'"
            )
        available = tracked_count(config, scenario)
        named = config["scenarios"][scenario].get("tracked") is not None
        if named and survey["targets"] > available:
            raise ConfigurationError(
                f"{key}.targets' = {survey['targets']} exceeds the {available} moving targets of "
                f"'scenarios.{scenario}.tracked'"
            )
        share, objects = survey["outside_families"], survey["targets"]
        if share > 0.0 and round(share * objects) == 0:
            raise ConfigurationError(
                f"{key}.outside_families' = {share} replaces none of {objects} objects; give 0, or "
                f"at least {1.0 / objects:.2g}"
            )
        _check_survey_truth(config, name, survey)
        minutes, step = survey["search"]["block_minutes"], survey["step_s"]
        if not is_multiple(60.0 * minutes, step):
            raise ConfigurationError(
                f"{key}.search.block_minutes' = {minutes} must be a multiple of step_s = {step} s"
            )
        days = scenario_settings(config, scenario)["visibility"]["duration_days"]
        if survey["start_days"] + survey["duration_days"] > days:
            raise ConfigurationError(
                f"{key}.start_days' = {survey['start_days']} and duration_days = "
                f"{survey['duration_days']} exceed the ephemeris, which covers "
                f"'visibility.duration_days' = {days}"
            )


def _check_survey_truth(config: Mapping[str, Any], name: str, survey: Mapping[str, Any]) -> None:
    """Refuse a truth that a survey cannot simulate, or its catalog cannot treat."""
    key, objects = f"configuration key 'surveys.{name}", survey["targets"]
    if survey["entering"] + survey["deployed"] > objects:
        raise ConfigurationError(
            f"{key}.entering' = {survey['entering']} and deployed = {survey['deployed']} exceed "
            f"the {objects} objects; lower them"
        )
    own = merged(scenario_settings(config, survey["scenario"])["task2"], survey["cell"])
    errors = typed(own.get("observer_errors", {}), ObserverErrors)
    dynamics = typed(own.get("dynamics", {}), Dynamics)
    if errors.treatment != "none" and (errors.assumed.walk().any() or errors.assumed.clock_s):
        raise ConfigurationError(
            f"{key}.cell.observer_errors.treatment' = {errors.treatment!r}: a survey treats "
            "constant errors of position and pointing alone; set those of the prior that walk, and "
            "clock_s, to 0"
        )
    if not survey["ephemeris"] and dynamics.truth != dynamics.filter:
        raise ConfigurationError(
            f"{key}.cell.dynamics': truth = {dynamics.truth!r} and filter = {dynamics.filter!r} "
            "differ; a survey needs the same dynamics, set 'ephemeris' to true"
        )


def _check_windows(
    config: Mapping[str, Any], scenarios: Iterable[str], information: Mapping[str, Any]
) -> None:
    """Refuse windows beyond the horizon, and more moving targets than a scenario has."""
    hours, step = information["window_hours"], information["step_hours"]
    if not is_multiple(hours, step):
        raise ConfigurationError(
            f"configuration key 'architecture.information.step_hours' = {step} does not divide "
            f"window_hours = {hours}"
        )
    for scenario in scenarios:
        days = scenario_settings(config, scenario)["visibility"]["duration_days"]
        if hours > 24.0 * days:
            raise ConfigurationError(
                f"configuration key 'architecture.information.window_hours' = {hours} exceeds the "
                f"horizon of scenario {scenario}, visibility.duration_days = {days}"
            )
        available = tracked_count(config, scenario)
        if information["targets"] > available:
            raise ConfigurationError(
                f"configuration key 'architecture.information.targets' = {information['targets']}: "
                f"scenario {scenario} has {available} moving targets; lower it"
            )


def _named_architectures(config: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Keys that name an architecture, with the name."""
    task2 = config["task2"]
    for number, name in enumerate(task2["architectures"]):
        yield f"task2.architectures.{number}", name
    for name in task2["other_architectures"]:
        yield "task2.other_architectures", name
    single = {f"task2.{key}": task2[key] for key in ("variants", "tasking_comparison")}
    for name, family in task2["variants"]["families"].items():
        single[f"task2.variants.families.{name}"] = family
        for other in family.get("other_architectures", ()):
            yield f"task2.variants.families.{name}.other_architectures", other
    for section in ("sweeps", "surveys"):
        single |= {f"{section}.{name}": each for name, each in config[section].items()}
    for key, entry in single.items():
        if "architecture" in entry:
            yield f"{key}.architecture", entry["architecture"]


def _check_architectures(config: Mapping[str, Any]) -> None:
    """Refuse architectures that are not defined, and two of one name."""
    designs = config["architecture"]["designs"]
    taken = [*OPTIMIZERS, *_TAKEN]
    for key, names in (("observers", config["observers"]), ("architecture.designs", designs)):
        for name in names:
            if name in taken:
                raise ConfigurationError(
                    f"configuration key '{key}': name {name!r} is taken; choose another"
                )
        taken += names
    copies = [one for name in designs for one in _copies(designs, name)]
    if len(set(copies)) < len(copies):
        twice = next(name for name in copies if copies.count(name) > 1)
        raise ConfigurationError(
            f"configuration key 'architecture.designs': {twice!r} is a design and a copy of "
            "another; choose another name"
        )
    known = (*OPTIMIZERS, *config["observers"], *copies)
    for key, name in _named_architectures(config):
        if name not in known and not (key.endswith("other_architectures") and name in designs):
            raise ConfigurationError(
                f"configuration key '{key}' = {name!r}: must be one of {', '.join(known)}, or "
                "a name given a table in 'observers' or an objective in 'architecture.designs'"
            )


def _check_writable(results: Path) -> None:
    """Refuse a results folder that cannot be created or written to."""
    if set(str(results)) & _SPECIAL:
        raise ConfigurationError(
            f"configuration key 'results' = {shown(str(results))}: choose a path without any of "
            f"{' '.join(sorted(_SPECIAL))}, which have a meaning of their own for Snakemake"
        )
    existing = results
    try:
        while not existing.exists() and existing != existing.parent:
            existing = existing.parent
        usable = existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)
    except OSError as error:
        fault = f"configuration key 'results' = {shown(str(results))}: {error.strerror}"
        raise ConfigurationError(fault) from error
    if not usable:
        raise ConfigurationError(
            f"configuration key 'results' = {str(results)!r}: {existing} is not a folder that can "
            "be written to"
        )
