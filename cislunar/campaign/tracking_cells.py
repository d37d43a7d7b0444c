"""The cells of the tracking campaign: which there are, how each is set, and what is refused.

A cell is an architecture, a number of monitored targets and a tasking interval. A variant is a
cell with a few settings changed. Nothing here needs the compiled library, so that a configuration
is checked at once.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from cislunar.architecture.published import PUBLISHED
from cislunar.attitude.inertia import inertia_matrix
from cislunar.errors import ConfigurationError
from cislunar.estimation.batch_settings import BatchSettings

TRACKED_TARGETS = 202
"""Number of targets in ``orbits/tracked.nc``."""

CELL_KEYS = (
    "seeds",
    "monitored_seed",
    "duration_hours",
    "step_s",
    "record_minutes",
    "tasking",
    "sensor",
    "initial_sigma",
    "process_noise",
    "batch",
    "body",
    "material",
    "photometry",
    "truth",
)
"""Keys of `task2` that set a cell, and that a variant may change."""


class Cell(NamedTuple):
    """A cell of the campaign.

    Attributes
    ----------
    scenario, architecture, estimator : str
        Whose observers track, and with what.
    targets : int
        Number of monitored targets, n_T.
    interval_minutes : int
        Time between tasking epochs, T_ST.
    variant : str
        Name of the changed settings; empty for those of the configuration.
    """

    scenario: str
    architecture: str
    estimator: str
    targets: int
    interval_minutes: int
    variant: str = ""

    @property
    def path(self) -> str:
        """Its data set, relative to the results folder."""
        suffix = f"_{self.variant}" if self.variant else ""
        return (
            f"task2/{self.scenario}/{self.architecture}/{self.estimator}/"
            f"nt{self.targets}_dt{self.interval_minutes}{suffix}.nc"
        )


def merged(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping with some entries replaced, at any depth.

    Parameters
    ----------
    base, change : mapping
        What there is, and what is to be different.

    Returns
    -------
    dict
    """
    result = dict(base)
    for key, value in change.items():
        nested = isinstance(value, Mapping) and isinstance(base.get(key), Mapping)
        result[key] = merged(base[key], value) if nested else value
    return result


def cell_settings(task2: Mapping[str, Any], variant: str = "") -> dict[str, Any]:
    """Settings of a cell.

    Parameters
    ----------
    task2 : mapping
        Configuration key `task2`.
    variant : str
        Name of a variant, or empty.

    Returns
    -------
    dict
        The keys `CELL_KEYS`.

    Raises
    ------
    ConfigurationError
        If the configuration has no such variant.
    """
    base = {key: task2[key] for key in CELL_KEYS}
    if not variant:
        return base
    variants = task2["variants"]["cells"]
    if variant not in variants:
        raise ConfigurationError(
            f"variant {variant!r} is not in the configuration key 'task2.variants.cells', which "
            f"has {', '.join(variants) or 'none'}"
        )
    return merged(base, variants[variant]["change"])


def true_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of the targets and sensors as they truly are.

    Parameters
    ----------
    settings : mapping
        Settings of a cell: what the estimators believe, and in `truth` what is otherwise.

    Returns
    -------
    dict
        The keys `material`, `body`, `sensor`, and `angular_acceleration_deg_h2` of three numbers.
    """
    believed = {key: settings[key] for key in ("material", "body", "sensor")}
    return merged({**believed, "angular_acceleration_deg_h2": [0, 0, 0]}, settings["truth"])


def _has_architecture(scenario: str, architecture: str) -> bool:
    """The paper publishes architectures for its own scenarios alone."""
    return architecture != "published" or scenario in PUBLISHED


def sweep_cells(task2: Mapping[str, Any]) -> list[Cell]:
    """The cells of both sweeps, without variants, each once.

    Parameters
    ----------
    task2 : mapping
        Configuration key `task2`.

    Returns
    -------
    list of Cell
        Number of targets first, then tasking interval, then the other architectures.
    """
    usual, intervals = task2["interval_minutes"], task2["intervals"]
    found: dict[Cell, None] = {}
    for estimator in task2["estimators"]:
        for architecture in task2["architectures"]:
            sweeps = [(task2["target_counts"], [usual])]
            sweeps.append((intervals["target_counts"], intervals["minutes"]))
            for counts, minutes in sweeps:
                for cell in _cells(counts, minutes, architecture, estimator):
                    found[cell] = None
        for architecture, counts in task2["other_architectures"].items():
            for cell in _cells(counts, [usual], architecture, estimator):
                found[cell] = None
    return list(found)


def _cells(counts, minutes, architecture: str, estimator: str) -> Iterator[Cell]:
    for scenario, targets in counts.items():
        if not _has_architecture(scenario, architecture):
            continue
        for interval in minutes:
            for n in targets:
                yield Cell(scenario, architecture, estimator, int(n), int(interval))


def variant_cells(task2: Mapping[str, Any]) -> list[Cell]:
    """The cells with changed settings.

    Parameters
    ----------
    task2 : mapping
        Configuration key `task2`.

    Returns
    -------
    list of Cell
        With the estimators of the variant, or the first of the configuration if it names none.
    """
    variants = task2["variants"]
    return [
        Cell(
            variants["scenario"],
            variants["architecture"],
            estimator,
            int(n),
            task2["interval_minutes"],
            name,
        )
        for name, variant in variants["cells"].items()
        for estimator in variant.get("estimators", task2["estimators"][:1])
        for n in variant["targets"]
    ]


def estimator_names(task2: Mapping[str, Any]) -> list[str]:
    """Estimators of the sweeps and the variants, each once.

    Parameters
    ----------
    task2 : mapping
        Configuration key `task2`.

    Returns
    -------
    list of str
    """
    variants = task2["variants"]["cells"].values()
    named = [name for variant in variants for name in variant.get("estimators", ())]
    return list(dict.fromkeys([*task2["estimators"], *named]))


def campaign_cells(task2: Mapping[str, Any]) -> list[Cell]:
    """All cells: sweeps, variants, and what the variants are compared with, each once.

    Parameters
    ----------
    task2 : mapping
        Configuration key `task2`.

    Returns
    -------
    list of Cell
    """
    changed = variant_cells(task2)
    plain = [cell._replace(variant="") for cell in changed]
    return list(dict.fromkeys([*sweep_cells(task2), *plain, *changed]))


def _is_multiple(value: float, step: float) -> bool:
    ratio = value / step
    return math.isclose(ratio, round(ratio), rel_tol=0.0, abs_tol=1e-9) and round(ratio) >= 1


def check_cell(targets: int, interval_minutes: int, settings: Mapping[str, Any]) -> None:
    """Refuse a cell that cannot be run.

    Parameters
    ----------
    targets, interval_minutes : int
        Number of targets and tasking interval, as in its file name.
    settings : mapping
        Of `cell_settings`.

    Raises
    ------
    ConfigurationError
        If there are not so many targets, or the interval is no multiple of the step.
    """
    if not 1 <= targets <= TRACKED_TARGETS:
        raise ConfigurationError(
            f"n_T = {targets} (nt{targets} in the file name): there are {TRACKED_TARGETS} targets; "
            f"choose 1 .. {TRACKED_TARGETS}"
        )
    step = settings["step_s"]
    if not _is_multiple(60.0 * interval_minutes, step):
        raise ConfigurationError(
            f"tasking interval of {interval_minutes} min (dt{interval_minutes} in the file name) "
            f"is no multiple of 'task2.step_s' = {step} s: choose another interval or step"
        )


def check_tracking(config: Mapping[str, Any]) -> None:
    """Check what ties the keys of `task2` to each other and to the rest.

    The variants' own settings are checked like those of the configuration.

    Parameters
    ----------
    config : mapping
        The configuration, valid by its schema.

    Raises
    ------
    ConfigurationError
        With a message that names the key.
    """
    task2, scenarios = config["task2"], config["scenarios"]
    by_scenario = {
        "target_counts": task2["target_counts"],
        "intervals.target_counts": task2["intervals"]["target_counts"],
    }
    for name, counts in task2["other_architectures"].items():
        by_scenario[f"other_architectures.{name}"] = counts
    for key, counts in by_scenario.items():
        for scenario in counts:
            _require_scenario(f"task2.{key}.{scenario}", scenario, scenarios)
    for key in ("variants", "tasking_comparison"):
        scenario, architecture = task2[key]["scenario"], task2[key]["architecture"]
        _require_scenario(f"task2.{key}.scenario", scenario, scenarios)
        if not _has_architecture(scenario, architecture):
            raise ConfigurationError(
                f"configuration key 'task2.{key}.architecture' = {architecture!r}: the paper has "
                f"no architecture for scenario {scenario!r}"
            )
    for name in ("", *task2["variants"]["cells"]):
        place = f"task2.variants.cells.{name}.change: " if name else "task2."
        _check_times(place, cell_settings(task2, name), config)
    minutes = {
        "interval_minutes": [task2["interval_minutes"]],
        "intervals.minutes": task2["intervals"]["minutes"],
    }
    for key, values in minutes.items():
        for value in values:
            if not _is_multiple(60.0 * value, task2["step_s"]):
                raise ConfigurationError(
                    f"configuration key 'task2.{key}': {value} min is no multiple of "
                    f"'task2.step_s' = {task2['step_s']} s"
                )
    _check_comparison(task2)


def _require_scenario(key: str, scenario: str, scenarios: Mapping[str, Any]) -> None:
    if scenario not in scenarios:
        raise ConfigurationError(
            f"configuration key '{key}': scenario {scenario!r} is not among those of 'scenarios' "
            f"({', '.join(scenarios)})"
        )


def _check_times(place: str, settings: Mapping[str, Any], config: Mapping[str, Any]) -> None:
    """Step, interval, duration, records and shape of a cell or variant."""
    step, hours = settings["step_s"], settings["duration_hours"]
    seconds = {
        "duration_hours": 3600.0 * hours,
        "record_minutes": 60.0 * settings["record_minutes"],
    }
    for key, value in seconds.items():
        if not _is_multiple(value, step):
            raise ConfigurationError(
                f"configuration key '{place}{key}' = {settings[key]} is no multiple of step_s = "
                f"{step} s"
            )
    if not _is_multiple(60.0 * config["task2"]["interval_minutes"], step):
        raise ConfigurationError(
            f"configuration key '{place}step_s' = {step} s does not divide "
            f"'task2.interval_minutes' = {config['task2']['interval_minutes']}"
        )
    days = config["visibility"]["duration_days"]
    if hours > 24.0 * days:
        raise ConfigurationError(
            f"configuration key '{place}duration_hours' = {hours} exceeds the ephemeris, which "
            f"covers 'visibility.duration_days' = {days}"
        )
    try:
        BatchSettings(**settings["batch"])
    except ConfigurationError as error:
        raise ConfigurationError(f"configuration key '{place}batch': {error}") from None
    _check_body(f"{place}body", settings["body"])
    _check_body(f"{place}truth.body", true_settings(settings)["body"])


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


def _check_comparison(task2: Mapping[str, Any]) -> None:
    compared = task2["tasking_comparison"]
    if not compared["targets"]:
        raise ConfigurationError(
            "configuration key 'task2.tasking_comparison.targets' is empty: give at least one "
            "number of targets"
        )
    n_epochs = math.ceil(60.0 * task2["duration_hours"] / task2["interval_minutes"] - 1e-9)
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


def variant_schema(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Schema of the settings of a cell, from that of the configuration.

    Parameters
    ----------
    schema : mapping
        JSON schema of the configuration.

    Returns
    -------
    dict
    """
    known = schema["properties"]["task2"]["properties"]
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": {key: known[key] for key in CELL_KEYS},
    }


def mesh_file(settings: Mapping[str, Any]) -> list[str]:
    """Mesh files a cell depends on.

    Parameters
    ----------
    settings : mapping
        Settings of the cell.

    Returns
    -------
    list of str
        Paths of the shape believed and of the true one, each once; none for an icosahedron.
    """
    shapes = dict.fromkeys([settings["body"]["shape"], true_settings(settings)["body"]["shape"]])
    return [shape for shape in shapes if shape != "icosahedron"]
