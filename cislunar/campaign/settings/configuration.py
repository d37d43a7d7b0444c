"""Checking a campaign's configuration against its schema."""

import difflib
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from cislunar.campaign.settings.cells import cell_settings, variant_place, variant_schema
from cislunar.campaign.settings.scenarios import in_study, scenario_settings, settings_schema
from cislunar.campaign.settings.sweeps import check_sweeps, variant_key, with_sweeps
from cislunar.campaign.settings.tracking_checks import check_tracking
from cislunar.errors import ConfigurationError, InputFileError

_LONGEST_TEXT = 1000
_LONGEST_VALUE = 80
_SPECIAL = set("{}*?[]")
"""Characters that Snakemake does not take as they stand in a file name."""


def load_schema(path: str | Path) -> dict[str, Any]:
    """Read the JSON schema of the configuration, written in YAML.

    Parameters
    ----------
    path : str or Path
        The schema file.

    Returns
    -------
    dict
        What a scenario may set for itself follows from the sections of the whole.

    Raises
    ------
    InputFileError
        If the file is missing.
    """
    path = Path(path)
    if not path.is_file():
        raise InputFileError(f"configuration schema {path}: no such file")
    schema = yaml.safe_load(path.read_text(encoding="utf-8"))
    entry = schema["properties"]["scenarios"]["additionalProperties"]
    entry["properties"]["settings"] = settings_schema(schema)
    return schema


def with_types(value: Any, schema: Mapping[str, Any]) -> Any:
    """Give values the type the schema wants.

    Snakemake hands over nested values of ``--config 'task2={"seeds": 3}'`` as strings.

    Parameters
    ----------
    value : object
        The configuration, or a part of it.
    schema : mapping
        Its JSON schema.

    Returns
    -------
    object
        The same with numbers, booleans and nulls in place of the strings that stand for them, and
        integers in place of floats without fraction.

    Raises
    ------
    ConfigurationError
        If an alias of YAML makes the configuration a part of itself.
    """
    try:
        return _typed(value, schema)
    except RecursionError:
        raise ConfigurationError(
            "a configuration key holds itself: remove the alias (*name in YAML)"
        ) from None


def _typed(value: Any, schema: Mapping[str, Any]) -> Any:
    if isinstance(value, Mapping):
        known, other = schema.get("properties", {}), schema.get("additionalProperties")
        other = other if isinstance(other, Mapping) else {}
        return {key: _typed(part, known.get(key, other)) for key, part in value.items()}
    if isinstance(value, list):
        return [_typed(part, schema.get("items", {})) for part in value]
    wanted = schema.get("type", "string")
    wanted = [wanted] if isinstance(wanted, str) else wanted
    if isinstance(value, str) and "string" not in wanted:
        try:
            value = yaml.safe_load(value)
        except (yaml.YAMLError, ValueError):
            return value  # stands for nothing: left for the schema to refuse
    # 3.0 counts as an integer in JSON, but not as a number of things in Python.
    if "integer" in wanted and isinstance(value, float) and value.is_integer():
        return int(value)
    return value


def check_configuration(config: Mapping[str, Any], schema: Mapping[str, Any]) -> None:
    """Refuse unknown keys, wrong types and impossible values.

    Parameters
    ----------
    config : mapping
        The configuration, all files merged.
    schema : mapping
        JSON schema (draft 2020-12).

    Raises
    ------
    ConfigurationError
        With a line for each fault that names the key.
    """
    from jsonschema import Draft202012Validator

    # What JSON has no notion of, the schema would let pass.
    lines = list(_beyond_json(config))
    if not lines:
        faults = sorted(
            Draft202012Validator(schema).iter_errors(config),
            key=lambda fault: list(map(str, fault.path)),
        )
        lines = [line for fault in faults for line in _describe(fault)]
    if lines:
        raise ConfigurationError("\n".join(lines))


def _beyond_json(value: Any, place: str = "") -> Iterator[str]:
    """A line for each number that is not finite, and each text of which no name can be made."""
    if isinstance(value, float) and not math.isfinite(value):
        yield f"configuration key {place!r} = {value}: must be a finite number"
    elif isinstance(value, str) and not (value.isprintable() and len(value) <= _LONGEST_TEXT):
        yield (
            f"configuration key {place!r} = {_shown(value)}: must be a line of at most "
            f"{_LONGEST_TEXT} printable characters"
        )
    elif isinstance(value, Mapping):
        for key, part in value.items():
            if isinstance(key, str) and key.isprintable():
                yield from _beyond_json(part, _join(place, key))
            else:
                yield f"unknown configuration key {_shown(key)} in {place or 'the configuration'!r}"
    elif isinstance(value, list):
        for number, part in enumerate(value):
            yield from _beyond_json(part, _join(place, number))


def _shown(value: Any) -> str:
    """A value as it stands in a message: on one line, and not too long."""
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}..."


def _describe(fault) -> list[str]:
    """One line for each key at fault."""
    place = ".".join(str(part) for part in fault.absolute_path)
    if fault.validator == "additionalProperties" and isinstance(fault.instance, Mapping):
        known = list(fault.schema.get("properties", {}))
        unknown = [key for key in fault.instance if key not in known]
        lines = []
        for key in unknown:
            close = difflib.get_close_matches(str(key), known, n=1)
            mend = f"did you mean {close[0]!r}?" if close else f"known keys: {', '.join(known)}"
            lines.append(f"unknown configuration key {_shown(_join(place, key))}: {mend}")
        return lines
    if fault.validator == "required":
        missing = [key for key in fault.validator_value if key not in fault.instance]
        return [f"configuration key {_join(place, key)!r} is missing" for key in missing]
    if fault.validator == "propertyNames":
        name, reason = _shown(fault.instance), _reason(fault)
        return [f"configuration key {place!r}: name {name} is not allowed: {reason}"]
    reason = "; or ".join(sorted({_reason(part) for part in fault.context})) or _reason(fault)
    return [f"configuration key {_shown(place)} = {_shown(fault.instance)}: {reason}"]


def _reason(fault) -> str:
    """The validator's message, in which the value may be long."""
    return fault.message.replace(repr(fault.instance), _shown(fault.instance))


def _join(place: str, key: Any) -> str:
    return f"{place}.{key}" if place else str(key)


def check_campaign(config: Mapping[str, Any], schema: Mapping[str, Any]) -> None:
    """Check a campaign's configuration: the schema, then what ties keys together.

    Parameters
    ----------
    config : mapping
        The configuration, all files merged.
    schema : mapping
        JSON schema (draft 2020-12).

    Raises
    ------
    ConfigurationError
        With a line for each fault that names the key.
    """
    check_configuration(config, schema)
    config = in_study(config)
    _check_scenarios(config)
    _check_optimization(config)
    check_sweeps(config)
    for name, sweep in config["sweeps"].items():
        try:
            check_configuration(with_sweeps(config | {"sweeps": {name: sweep}}), schema)
        except ConfigurationError as error:
            # All values have the same fault, or the first of the faulty ones will do.
            first = str(error).splitlines()[0]
            raise ConfigurationError(f"configuration key 'sweeps.{name}': {first}") from None
    config = with_sweeps(config)
    task2 = config["task2"]
    for name in task2["variants"]["cells"]:
        scenario, _ = variant_place(task2, name)
        own = scenario_settings(config, scenario) if scenario in config["scenarios"] else config
        try:
            check_configuration(cell_settings(own["task2"], name), variant_schema(schema))
        except ConfigurationError as error:
            raise ConfigurationError(
                f"configuration key '{variant_key(config, name)}': {error}"
            ) from None
    check_tracking(config)
    _check_writable(Path(config["results"]))


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
    """What ties the keys of `architecture` to each other and to the library."""
    architecture = config["architecture"]
    library = sum(config["orbits"]["members"].values())
    if architecture["slots"] > library:
        raise ConfigurationError(
            f"configuration key 'architecture.slots' = {architecture['slots']} exceeds the "
            f"{library} orbits of the library: lower it or raise orbits.members"
        )
    for key in ("label_comparison", "readings"):
        scenario = architecture[key]["scenario"]
        if scenario is not None and scenario not in config["scenarios"]:
            raise ConfigurationError(
                f"configuration key 'architecture.{key}.scenario' = {scenario!r} is none of the "
                f"scenarios {', '.join(config['scenarios'])}"
            )
    front = architecture["front"]
    fewest, most = architecture["slots"], architecture["slots"] * architecture["max_satellites"]
    if not fewest <= front["fewest"] <= front["most"] <= most:
        raise ConfigurationError(
            f"configuration key 'architecture.front': fewest = {front['fewest']} and most = "
            f"{front['most']} must rise within {fewest} .. {most} (slots, slots x max_satellites)"
        )


def _check_writable(results: Path) -> None:
    """Refuse a results folder that cannot be made or written to."""
    if set(str(results)) & _SPECIAL:
        raise ConfigurationError(
            f"configuration key 'results' = {_shown(str(results))}: choose a path without any of "
            f"{' '.join(sorted(_SPECIAL))}, which Snakemake does not take as they stand"
        )
    existing = results
    try:
        while not existing.exists() and existing != existing.parent:
            existing = existing.parent
        usable = existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)
    except OSError as error:
        raise ConfigurationError(
            f"configuration key 'results' = {_shown(str(results))}: {error.strerror}"
        ) from error
    if not usable:
        raise ConfigurationError(
            f"configuration key 'results' = {str(results)!r}: {existing} is not a folder that can "
            "be written to"
        )
