"""Checks of the files and packages of a campaign before any job starts.

Snakemake removes the files of a job before the job runs, so a job that fails also destroys the
result of an earlier one. Faults that can be detected beforehand are detected here.
"""

import importlib.util
import json
import os
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from cislunar.architecture.published import PUBLISHED
from cislunar.campaign.settings.cell_settings import cell_settings, true_settings
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.cells import variant_place
from cislunar.campaign.settings.families import stated_variants, with_families
from cislunar.campaign.settings.reading import typed
from cislunar.campaign.settings.scenarios import (
    in_study,
    longest_horizon,
    orbits_of,
    scenario_settings,
    shared_dataset,
    tracked_count,
    tracked_names,
)
from cislunar.constants import SECONDS_PER_DAY
from cislunar.ephemeris import check_coverage, tdb_after, tdb_seconds
from cislunar.errors import CislunarError, ConfigurationError, InputFileError, placed
from cislunar.estimation.navigation.table import load_observer_errors
from cislunar.observation.body_spec import BodySpec, load_body_table
from cislunar.photometry.materials import REFLECTION_LAWS, Material
from cislunar.photometry.reflection.tables import load_reflectance_table
from cislunar.runtime.settings_fields import MOST_STEPS
from cislunar.targets import load_maneuvers, load_missions
from cislunar.targets.tables import (
    check_closed_targets,
    is_message,
    load_target_positions,
    load_target_states,
)

_FEW = 60
"""Satellites of a design for which orbit slots are not counted beforehand."""


def check_inputs(config: Mapping[str, Any]) -> None:
    """Refuse a checked configuration whose files, packages or optimizers cannot be used.

    An `InputFileError` if a kernel, mesh or table is missing or faulty, or a kernel does not cover
    the horizon. A `ConfigurationError` if the horizon is no whole number of steps, a scenario has
    more targets than sampled points, or an optimizer cannot run.
    """
    study = in_study(config)
    config = with_families(study)
    _check_horizon("visibility", config["visibility"])
    load_missions(config["targets"]["missions"])
    for scenario in config["scenarios"]:
        settings = scenario_settings(config, scenario)
        _check_horizon(f"scenarios.{scenario}.settings.visibility", settings["visibility"])
        _check_static_targets(config, scenario, settings["targets"])
    for name, survey in config["surveys"].items():
        if survey["prior_table"] is not None:
            with placed(f"configuration key 'surveys.{name}.prior_table'"):
                load_target_states(survey["prior_table"])
    _check_ephemerides(config)
    _check_bodies(study, config)
    architecture = config["architecture"]
    if "atpe" in architecture["optimizers"] and importlib.util.find_spec("lightgbm") is None:
        raise ConfigurationError(
            "configuration key 'architecture.optimizers': 'atpe' needs the package lightgbm: "
            "pip install lightgbm, or leave it out"
        )
    if "published" in architecture["optimizers"]:
        for scenario in config["scenarios"]:
            _check_published(scenario, config["orbits"]["members"], architecture["max_satellites"])


def check_orbits(config: Mapping[str, Any]) -> None:
    """Check the tables of observers and moving targets of a study with its families.

    An `InputFileError` if a table is missing or faulty, an orbit cannot be propagated, or an orbit
    with a period is not closed. A table that is older than its data set is not checked again.
    """
    # the library of orbits takes a second to import, and is needed for a table alone
    results = Path(config["results"])
    for name, table in config["observers"].items():
        if not _made_since(table, results / orbits_of(name, own=True)):
            from cislunar.orbits.observers import load_observers, observer_orbits

            observer_orbits(load_observers(table), longest_horizon(config))
    for scenario, entry in config["scenarios"].items():
        table = entry.get("tracked")
        if table is None or is_message(table):
            continue
        if not _made_since(table, results / shared_dataset(config, scenario, "orbits/tracked")):
            check_closed_targets(table, load_target_states(table))


def crowded_objectives(config: Mapping[str, Any]) -> dict[str, int]:
    """Keys of designs and fronts whose limits on orbits may leave too few orbit slots.

    The values are the required numbers of orbit slots. The remaining orbits are known only from the
    library, which takes seconds to compute: designs of at most 60 satellites, on at most a fifth of
    all orbit slots, are assumed to fit.
    """
    search, members = config["architecture"], sum(config["orbits"]["members"].values())
    found = {}
    for kind in ("designs", "objective_fronts"):
        for name, objective in search[kind].items():
            capped = (
                objective["max_stability_index"]
                or objective.get("max_station_keeping_m_s") is not None
            )
            if not capped or objective.get("scenarios") == []:
                continue
            slots = members * (objective["phases"] or 1)
            required = objective["satellites"] if objective["phases"] else search["slots"]
            most = max(required) if isinstance(required, list) else required
            if most > min(_FEW, slots / 5.0):
                found[f"{kind}.{name}"] = most
    return found


def _made_since(table: str, made: Path) -> bool:
    """Whether a data set is newer than its table."""
    try:
        return made.stat().st_mtime > Path(table).stat().st_mtime
    except OSError:
        return False


def _check_horizon(key: str, visibility: Mapping[str, Any]) -> None:
    steps = visibility["duration_days"] * 24.0 / visibility["step_hours"]
    if steps > MOST_STEPS or abs(steps - round(steps)) > 1e-9:
        raise ConfigurationError(
            f"configuration key '{key}.duration_days' = {visibility['duration_days']} is not "
            f"a whole number of steps of visibility.step_hours = {visibility['step_hours']}, at "
            f"most {MOST_STEPS:,}"
        )


def _check_static_targets(
    config: Mapping[str, Any], scenario: str, sampling: Mapping[str, Any]
) -> None:
    """Refuse a faulty table of a scenario's static targets or missions."""
    entry = config["scenarios"][scenario]
    if "static_targets" in entry:
        load_target_positions(entry["static_targets"])
        return
    if sampling["missions"] != config["targets"]["missions"]:
        load_missions(sampling["missions"])
    points = Path(config["results"]) / shared_dataset(config, scenario, "targets/zvs_points")
    check_target_count(points, scenario, entry["targets"], sampling)


def _check_ephemerides(config: Mapping[str, Any]) -> None:
    """Refuse ephemeris kernels that are missing or do not cover the horizon."""
    distinct = {}
    for each in [config, *(scenario_settings(config, name) for name in config["scenarios"])]:
        span = each["epoch_jd"], each["visibility"]["duration_days"]
        distinct[*span, each["ephemeris"]["step_minutes"], each["ephemeris"]["kernel"]] = None
    for epoch_jd, days, minutes, kernel in distinct:
        if days * 1440.0 / minutes > MOST_STEPS:
            raise ConfigurationError(
                f"configuration key 'ephemeris.step_minutes' = {minutes}: {days} days would take "
                f"more than {MOST_STEPS:,} samples; make it longer"
            )
        check_coverage(epoch_jd, days, minutes, kernel)


def _check_bodies(study: Mapping[str, Any], config: Mapping[str, Any]) -> None:
    """Refuse faulty bodies and tables, of bodies, assumed or true, of the errors of observers and
    of maneuvers, of cells and variants."""
    task2 = config["task2"]
    scenarios = {"task2.": task2["variants"]["scenario"]}
    cells = {"task2.": cell_settings(task2)}
    for name in config["scenarios"]:
        place = f"scenarios.{name}.settings.task2."
        scenarios[place] = name
        cells[place] = cell_settings(scenario_settings(config, name)["task2"])
    for variant in stated_variants(study):
        place = f"{variant.key}: "
        scenarios[place] = name = variant_place(task2, variant.name)[0]
        own = scenario_settings(config, name)["task2"] if name in config["scenarios"] else task2
        cells[place] = cell_settings(own, variant.name)
    seen = set()
    for place, settings in cells.items():
        cell = typed(settings, CellSettings)
        reflection = cell.truth.reflection
        if reflection not in REFLECTION_LAWS and reflection not in seen:
            with placed(f"configuration key '{place}truth.reflection'", InputFileError):
                load_reflectance_table(reflection)
            seen.add(reflection)
        for key, of in (("body", cell), ("truth.body", true_settings(cell))):
            body, usual, table = of.body, of.material, of.body.table
            bare = body.model_copy(update={"materials": None})
            for aspect, each in (("shape", bare), ("materials", body)):
                if (each, usual) not in seen:
                    _check_body(each.named(f"configuration key '{place}{key}.{aspect}'"), usual)
                    seen.add((each, usual))
            known = table, scenarios[place], usual
            if table is not None and known not in seen:
                _check_table(table, f"{place}{key}.table", config, scenarios[place], usual)
                seen.add(known)
        errors = cell.observer_errors.table
        if errors is not None and errors not in seen:
            load_observer_errors(errors)
            seen.add(errors)
        _check_maneuvers(cell, f"{place}truth.maneuvers", config, scenarios[place])


def _check_maneuvers(
    cell: CellSettings, key: str, config: Mapping[str, Any], scenario: str
) -> None:
    """Refuse maneuvers outside of the run, a faulty table of maneuvers, and targets that the
    scenario does not have."""
    for number, kind in enumerate(cell.truth.maneuvers.drawn or ()):
        with placed(f"configuration key '{key}.drawn', entry {number}", ConfigurationError):
            kind.window(cell.duration_hours)
    path = cell.truth.maneuvers.table
    if path is None:
        return
    own = scenario_settings(config, scenario) if scenario in config["scenarios"] else config
    start = tdb_after(tdb_seconds(own["epoch_jd"]), SECONDS_PER_DAY * cell.start_day)
    table = load_maneuvers(path, cell.duration_hours, float(start))
    if scenario in config["scenarios"]:
        table.require_known(tracked_names(config, scenario), f"scenario {scenario}")


def _check_body(body: BodySpec, usual: Material) -> None:
    """Refuse an impossible body; its source is the key."""
    try:
        body.check(usual)
    except CislunarError as error:
        raise ConfigurationError(str(error)) from None


def _check_table(
    table: str, key: str, config: Mapping[str, Any], scenario: str, usual: Material
) -> None:
    """Refuse a faulty table of bodies, and targets that the scenario does not have."""
    for target, body in load_body_table(table).items():
        body.check(usual)
        if scenario in config["scenarios"] and target not in tracked_names(config, scenario):
            raise ConfigurationError(
                f"{body.source}: is none of scenario {scenario}, whose targets "
                f"are numbered from 0 to {tracked_count(config, scenario) - 1} (configuration key "
                f"'{key}')"
            )


def _check_published(scenario: str, members: Mapping[str, int], max_satellites: int) -> None:
    """Refuse a library that cannot hold the published architecture."""
    slots = PUBLISHED.get(scenario, ())
    for family, required in Counter(family for family, _ in slots).items():
        if members.get(family, 0) < required:
            raise ConfigurationError(
                f"configuration key 'orbits.members.{family}' = {members.get(family, 0)}: the "
                f"published architecture of scenario {scenario} needs {required}; raise it or take "
                "'published' out of architecture.optimizers"
            )
    most = max((count for _, count in slots), default=1)
    if most > max_satellites:
        raise ConfigurationError(
            f"configuration key 'architecture.max_satellites' = {max_satellites}: the published "
            f"architecture of scenario {scenario} has {most} on one orbit; raise it or take "
            "'published' out of architecture.optimizers"
        )


def check_target_count(
    points: str | Path, scenario: str, count: int, targets: Mapping[str, Any]
) -> None:
    """Refuse more static targets than sampled points; points that will be sampled again, after a
    change of settings or mission table, are left to the clustering."""
    points, missions = Path(points), Path(targets["missions"])
    if not points.is_file() or os.path.getmtime(missions) > os.path.getmtime(points):
        return
    from netCDF4 import Dataset

    try:
        with Dataset(points) as dataset:
            made_with = json.loads(dataset.getncattr("settings"))["targets"]
            distinct = int(dataset.getncattr("distinct_points"))
    except (OSError, AttributeError, KeyError, ValueError):
        return  # damaged, or another file: the job that reads it reports it
    if {**made_with, "seeding": None} == {**targets, "seeding": None} and count > distinct:
        raise ConfigurationError(
            f"configuration key 'scenarios.{scenario}.targets' = {count}: only {distinct} distinct "
            f"points are in {points}; lower it or sample more finely (targets.angular_step_deg, "
            "targets.radial_points)"
        )


def check_request(
    target: str, outputs: Iterable[str], known: Mapping[str, Collection[str]], made: bool
) -> None:
    """Refuse a requested file that no rule makes.

    `outputs` are the file names of the rules, with wildcards in braces, `known` the values of the
    wildcards in this configuration; `made` is whether a rule makes the file.

    Raises
    ------
    ConfigurationError
        If no rule makes the file; the message says what to correct.
    """
    wrong = []
    for output in outputs:
        pattern = re.sub(r"\\\{(\w+)(?:,[^}]*)?\\\}", r"(?P<\1>[^/]*)", re.escape(output))
        found = re.fullmatch(pattern, target)
        if found:
            named = found.groupdict().items()
            wrong.append([(key, own) for key, own in named if own not in known.get(key, [own])])
    if wrong and all(wrong):  # the names of two rules may look alike
        key, value = wrong[0][0]
        raise ConfigurationError(
            f"{target}: {key} {value!r} is none of this configuration, which has "
            f"{', '.join(known[key])}; correct the file name, or add the --configfile it "
            "belongs to"
        )
    if not made:
        raise ConfigurationError(
            f"{target}: nothing makes a file of this name; correct it, or add the --configfile it "
            "belongs to (`--dry-run` without a name lists what is made)"
        )
