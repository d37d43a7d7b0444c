"""The scenarios of a study: their settings, and the files that they share.

A scenario is a set of targets with its settings. Its entry in the configuration key `scenarios` may
change any key of `SECTIONS` of the campaign, and name tables of its own targets. No function here
needs compiled kernels, so that a configuration is checked at once.
"""

from collections.abc import Callable, Collection, Mapping
from typing import Any, get_args

from cislunar.campaign.settings.architecture_tree import Optimizer
from cislunar.campaign.settings.cells import TRACKED_TARGETS
from cislunar.campaign.settings.reading import merged
from cislunar.campaign.settings.tree import Surroundings
from cislunar.errors import ConfigurationError
from cislunar.exchange.inertial import epoch_at
from cislunar.targets.tables import TargetStates, is_message, load_target_states

SECTIONS = tuple(Surroundings.model_fields)
"""Keys of the configuration that a scenario may change; of `task2`, the settings of a cell."""

COMPARISONS = (
    ("architecture", "label_comparison"),
    ("architecture", "readings"),
    ("architecture", "generalization"),
    ("task2", "tasking_comparison"),
)
"""Parts of the configuration that depend on one scenario, and are left out without it."""


def in_study(config: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration without the scenarios that are null, and without references to them.

    Comparisons that depend on such a scenario have null in its place.
    """
    absent = {None, *(name for name, entry in config["scenarios"].items() if entry is None)}

    def kept(counts: Mapping[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in counts.items() if name not in absent}

    result = merged(config, {})
    result["scenarios"] = kept(config["scenarios"])
    task2 = result["task2"] = dict(config["task2"])
    task2["target_counts"] = kept(task2["target_counts"])
    intervals, others = task2["intervals"], task2["other_architectures"].items()
    task2["intervals"] = intervals | {"target_counts": kept(intervals["target_counts"])}
    task2["other_architectures"] = {name: kept(counts) for name, counts in others}
    usual = task2["variants"]["scenario"]
    families = task2["variants"]["families"].items()
    task2["variants"] = task2["variants"] | {
        "scenario": None if usual in absent else usual,
        "families": {n: f for n, f in families if f.get("scenario", usual) not in absent},
    }
    for section, key in COMPARISONS:
        if result[section][key]["scenario"] in absent:
            result[section] = result[section] | {key: result[section][key] | {"scenario": None}}
    search = result["architecture"]
    result["architecture"] = search | {
        key: {name: _left(objective, absent) for name, objective in search[key].items()}
        for key in ("designs", "objective_fronts")
    }
    result["sweeps"] = {
        name: sweep for name, sweep in config["sweeps"].items() if sweep["scenario"] not in absent
    }
    return result


def _left(objective: Mapping[str, Any], absent: Collection[str | None]) -> dict[str, Any]:
    """A design or a front without the scenarios that are null."""
    named = objective.get("scenarios")
    kept = {} if named is None else {"scenarios": [s for s in named if s not in absent]}
    return {**objective, **kept}


def information_of(objective: Mapping[str, Any], architecture: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of the information for a design or a front: `architecture.information`, with the
    changes of a design."""
    own = objective.get("information", {})
    return architecture["information"] | {k: v for k, v in own.items() if v is not None}


PHOTOMETRY = {"printed": ("4pi", 0.5), "physical": ("1/r^2", None)}
"""Irradiance and C_d of tasking's sphere in scenarios that do not state them; None: C_d of the
sphere as bright as the body's material."""


def scenario_settings(config: Mapping[str, Any], scenario: str) -> dict[str, Any]:
    """The keys `SECTIONS` of the configuration with the changes of a scenario."""
    entry = config["scenarios"][scenario]
    own = merged({key: config[key] for key in SECTIONS}, entry.get("settings", {}))
    task2 = own["task2"]
    irradiance, coefficient = PHOTOMETRY[entry.get("photometry", "physical")]
    for section, key, usual in (
        ("photometry", "irradiance", irradiance),
        ("tasking", "diffuse_reflection_coefficient", coefficient),
    ):
        if task2[section][key] is None:
            task2 = task2 | {section: task2[section] | {key: usual}}
    return own | {"task2": task2}


OPTIMIZERS = get_args(Optimizer)
"""Architectures that every campaign can have."""


def require_scenario(key: str, scenario: str, config: Mapping[str, Any]) -> None:
    """Refuse a scenario that the configuration does not have."""
    if scenario not in config["scenarios"]:
        raise ConfigurationError(
            f"configuration key '{key}' = {scenario!r} is none of {', '.join(config['scenarios'])}"
        )


def orbits_of(architecture: str, own: bool) -> str:
    """Data set of the orbits of an architecture; `own`: its observers come from a table."""
    return f"orbits/observers_{architecture}.nc" if own else "orbits/families.nc"


def longest_horizon(config: Mapping[str, Any]) -> float:
    """Days of the longest horizon of a scenario."""
    return max(
        scenario_settings(config, name)["visibility"]["duration_days"]
        for name in config["scenarios"]
    )


def tracked_count(config: Mapping[str, Any], scenario: str) -> int:
    """Number of moving targets of a scenario; its table may be missing or faulty."""
    table = config["scenarios"][scenario].get("tracked")
    return TRACKED_TARGETS if table is None else len(_tracked(config, scenario, table))


def tracked_names(config: Mapping[str, Any], scenario: str) -> set[str]:
    """Names of the moving targets of a scenario: their numbers, and names in its table."""
    table = config["scenarios"][scenario].get("tracked")
    numbers = {str(number) for number in range(tracked_count(config, scenario))}
    return numbers | set(() if table is None else _tracked(config, scenario, table).name)


def _tracked(config: Mapping[str, Any], scenario: str, table: str) -> TargetStates:
    decides = tracked_epoch(scenario_settings(config, scenario), table)
    return load_target_states(table, decides and epoch_at(*decides))


def tracked_epoch(settings: Mapping[str, Any], table: str | None) -> tuple[float, str] | None:
    """Epoch and kernel for reading a file of moving targets; None for a table of states."""
    if table is None or not is_message(table):
        return None
    return settings["epoch_jd"], settings["ephemeris"]["kernel"]


def _span(settings: Mapping[str, Any]) -> tuple:
    """Settings of the time that an ephemeris covers."""
    return settings["epoch_jd"], settings["ephemeris"], settings["visibility"]["duration_days"]


SHARED: dict[str, Callable[[Mapping[str, Any], Mapping[str, Any]], Any]] = {
    "ephemeris/sun": lambda settings, _: _span(settings),
    "ephemeris/bodies": lambda settings, _: _span(settings),
    "orbits/paths": lambda settings, _: (
        *_span(settings), settings["visibility"]["step_hours"], settings["task2"]["dynamics"]
    ),
    "targets/zvs_points": lambda settings, _: settings["targets"] | {"seeding": None},
    "orbits/tracked": lambda settings, entry: (
        entry.get("tracked"), tracked_epoch(settings, entry.get("tracked"))
    ),
}  # fmt: skip
"""Data sets that scenarios share if this part of their settings and entries is the same."""


def shared_dataset(config: Mapping[str, Any], scenario: str, name: str) -> str:
    """Path in the results folder of a data set (key of `SHARED`) shared under the same settings.

    ``{name}.nc`` where the scenario agrees with the campaign as a whole, else
    ``{name}_{scenario}.nc`` with the first scenario it agrees with.
    """
    decides = SHARED[name]

    def of(other: str) -> Any:
        return decides(scenario_settings(config, other), config["scenarios"][other])

    own = of(scenario)
    if own == decides(config, {}):
        return f"{name}.nc"
    first = next(other for other in config["scenarios"] if of(other) == own)
    return f"{name}_{first}.nc"
