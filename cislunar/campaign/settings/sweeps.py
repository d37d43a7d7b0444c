"""Sweeps over a key of a scenario: the values, and what each is called in the results.

A value of a key of `settings.task2` changes how the scenario's architecture tracks, and is a
variant of its cells. A value of any other key changes what the architecture is optimized for, and
is a scenario of its own beside the one it is taken from.
"""

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from cislunar.campaign.settings.cells import Cell, has_architecture, merged
from cislunar.errors import ConfigurationError

TRACKING_KEYS = "settings.task2."
"""Beginning of the keys that leave the architecture as it is."""


class SweepPoint(NamedTuple):
    """A value of a sweep.

    Attributes
    ----------
    value : object
        The value.
    scenario, variant : str
        Where its results are: scenario and variant of its cells.
    """

    value: Any
    scenario: str
    variant: str


def sweep_points(config: Mapping[str, Any], name: str) -> list[SweepPoint]:
    """The values of a sweep.

    Parameters
    ----------
    config : mapping
        The configuration.
    name : str
        Name of the sweep.

    Returns
    -------
    list of SweepPoint
        In the order of the configuration.
    """
    sweep = config["sweeps"][name]
    points = []
    for value in sweep["values"]:
        label = f"{name}-{_in_a_path(value)}"
        if sweep["key"].startswith(TRACKING_KEYS):
            points.append(SweepPoint(value, sweep["scenario"], label))
        else:
            points.append(SweepPoint(value, f"{sweep['scenario']}-{label}", ""))
    return points


def _in_a_path(value: Any) -> str:
    """A value as a part of a file name."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return f"{value:.12g}".replace("-", "m").replace("+", "")
    return re.sub(r"[^a-z0-9.]+", "-", str(value).lower()).strip("-.")


def _nested(key: str, value: Any) -> dict[str, Any]:
    """A mapping with one entry, at a dotted key."""
    for part in reversed(key.split(".")):
        value = {part: value}
    return value


def with_sweeps(config: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration with the scenarios and variants the sweeps add.

    Parameters
    ----------
    config : mapping
        The configuration.

    Returns
    -------
    dict
        The variants have no cells but those of their sweep.
    """
    scenarios = dict(config["scenarios"])
    cells = dict(config["task2"]["variants"]["cells"])
    for name, sweep in config["sweeps"].items():
        for point in sweep_points(config, name):
            change = _nested(sweep["key"], point.value)
            if point.variant:
                cells[point.variant] = {
                    "scenario": point.scenario,
                    "architecture": sweep["architecture"],
                    "targets": [],
                    "change": change["settings"]["task2"],
                }
            else:
                scenarios[point.scenario] = merged(scenarios[sweep["scenario"]], change)
    variants = config["task2"]["variants"] | {"cells": cells}
    return dict(config) | {
        "scenarios": scenarios,
        "task2": config["task2"] | {"variants": variants},
    }


def variant_key(config: Mapping[str, Any], variant: str) -> str:
    """The configuration key a variant comes from, or that of a sweep that varies no known key.

    Parameters
    ----------
    config : mapping
        The configuration.
    variant : str
        Name of a variant of `with_sweeps`.

    Returns
    -------
    str
        Of its change, or of the values or the key of its sweep.
    """
    for name, sweep in config["sweeps"].items():
        if any(point.variant == variant for point in sweep_points(config, name)):
            known = _is_known(config["task2"], sweep["key"].removeprefix(TRACKING_KEYS))
            return f"sweeps.{name}.{'values' if known else 'key'}"
    return f"task2.variants.cells.{variant}.change"


def _is_known(settings: Any, key: str) -> bool:
    """Whether there is an entry at a dotted key."""
    for part in key.split("."):
        if not isinstance(settings, Mapping) or part not in settings:
            return False
        settings = settings[part]
    return True


def swept_cells(config: Mapping[str, Any], name: str) -> list[Cell]:
    """The cells of a sweep.

    Parameters
    ----------
    config : mapping
        The configuration.
    name : str
        Name of the sweep.

    Returns
    -------
    list of Cell
        By estimator and number of targets, then in the order of the values.
    """
    sweep, task2 = config["sweeps"][name], config["task2"]
    return [
        Cell(
            point.scenario,
            sweep["architecture"],
            estimator,
            int(n),
            int(task2["interval_minutes"]),
            point.variant,
        )
        for estimator in task2["estimators"]
        for n in sweep.get("targets", ())
        for point in sweep_points(config, name)
    ]


def check_sweeps(config: Mapping[str, Any]) -> None:
    """Refuse sweeps that cannot be run; their values are checked like settings afterwards.

    Parameters
    ----------
    config : mapping
        The configuration, valid by its schema.

    Raises
    ------
    ConfigurationError
        With a message that names the key.
    """
    taken = {*config["scenarios"], *config["task2"]["variants"]["cells"]}
    for name, sweep in config["sweeps"].items():
        place = f"configuration key 'sweeps.{name}"
        scenario, key, architecture = sweep["scenario"], sweep["key"], sweep["architecture"]
        if scenario not in config["scenarios"]:
            raise ConfigurationError(
                f"{place}.scenario' = {scenario!r} is none of the scenarios "
                f"{', '.join(config['scenarios'])}"
            )
        if not sweep.get("targets") and key.startswith(TRACKING_KEYS):
            raise ConfigurationError(
                f"{place}.targets' is empty: {key} changes the tracking alone; give at least one "
                "number of targets"
            )
        for point in sweep_points(config, name):
            if not has_architecture(point.scenario, architecture):
                raise ConfigurationError(
                    f"{place}.architecture' = {architecture!r}: the paper has no architecture for "
                    f"{scenario} with another {key}; choose an optimizer"
                )
            label = point.variant or point.scenario
            if label in taken:
                raise ConfigurationError(
                    f"{place}.values': {point.value!r} would be called {label!r}, as another "
                    "value, scenario or variant is; rename the sweep or change the value"
                )
            taken.add(label)
