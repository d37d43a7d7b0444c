"""Reading a configuration: texts become typed values, and a line names the key of each fault."""

import datetime
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import ValidationError

from cislunar.campaign.settings.tree import Campaign
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.exchange.key_values import read_text
from cislunar.runtime import Section, faults, inner, schema_of, types, unreadable

Part = TypeVar("Part", bound=Section)

RENAMED = {
    "believed_factor": "assumed_factor",
    "credit_under_way": "use_pending_measurements",
    "credited_measurements": "expected_measurements",
    "elsewhere": "generalization",
    "held": "reference",
    "log_stretch": "log_axis_scale",
    "metres_per_unit": "meters_per_unit",
    "spread": "parameter_sigma",
    "stretch": "axis_scale",
    "track_gate": "pointing_uncertainty_gate",
    "unknowns": "estimated_parameters",
}
"""Former names, of version 0.1, of keys and of the value of `dynamics.unrefined`."""


class _Loader(yaml.SafeLoader):
    """Leaves dates as text."""


_Loader.add_constructor("tag:yaml.org,2002:timestamp", yaml.SafeLoader.construct_scalar)


def _parsed(text: str) -> Any:
    """What a text in YAML or JSON, which may have tabs, contains. ConfigurationError for keys that
    occur twice, of which both formats would keep one."""
    try:
        return json.loads(text, object_pairs_hook=_without_repetition)
    except json.JSONDecodeError:
        loader = _Loader(text)
    node, seen = loader.get_single_node(), set()
    left = [] if node is None else [node]
    while left:
        each = left.pop()
        if id(each) in seen or isinstance(each, yaml.ScalarNode):
            continue
        seen.add(id(each))
        if isinstance(each, yaml.MappingNode):
            earlier = set()
            for key, _ in each.value:
                if (name := str(key.value)) in earlier:
                    line = key.start_mark.line + 1
                    raise ConfigurationError(f"line {line}: {name} occurs twice; rename one")
                earlier.add(name)
            left += [value for _, value in each.value]
        else:
            left += each.value
    return None if node is None else loader.construct_document(node)


def _without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        name = next(each for each in names if names.count(each) > 1)
        raise ConfigurationError(f"{name} occurs twice; rename one")
    return found


def read_yaml(path: str | Path, what: str) -> dict[Any, Any]:
    """The mapping in a file in YAML or JSON, which is `what` for messages, such as "a study".

    An `InputFileError` names the file, and in YAML the line of a key that occurs twice.
    """
    text = read_text(path, what)
    try:
        given = _parsed(text)
    except yaml.YAMLError as error:
        raise InputFileError(f"{path}: no YAML ({' '.join(str(error).split())})") from error
    except ConfigurationError as error:
        raise InputFileError(f"{path}, {error}") from error
    if not isinstance(given, dict):
        raise InputFileError(f"{path}: {what} is a mapping; write lines of the form key: value")
    return given


def merged(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping with some entries replaced, at any depth."""
    result = dict(base)
    for key, value in change.items():
        nested = isinstance(value, Mapping) and isinstance(base.get(key), Mapping)
        result[key] = merged(base[key], value) if nested else value
    return result


def with_types(config: Mapping[str, Any], model: type[Section] = Campaign) -> dict[str, Any]:
    """Replace texts by the numbers, booleans and nulls that they denote.

    Snakemake gives nested values of ``--config 'task2={"seeds": 3}'`` as texts. Dates, which YAML
    makes of texts without quotes, become texts again. A `ConfigurationError` if an alias of YAML
    makes the configuration a part of itself.
    """
    try:
        return _typed(config, schema_of(model))
    except RecursionError:
        raise ConfigurationError(
            "a configuration key contains itself: remove the alias (*name in YAML)"
        ) from None


def _typed(value: Any, schema: Mapping[str, Any]) -> Any:
    if isinstance(value, Mapping):
        return {key: _typed(part, inner(schema, key)) for key, part in value.items()}
    if isinstance(value, list):
        return [_typed(part, inner(schema, 0)) for part in value]
    if isinstance(value, datetime.datetime) and value.tzinfo is not None:
        value = value.astimezone(datetime.UTC).replace(tzinfo=None)
    if isinstance(value, datetime.date):
        return value.isoformat()
    kinds = types(schema)
    if isinstance(value, str) and kinds and ("string" not in kinds or "number" in kinds):
        try:
            return yaml.safe_load(value)
        except (yaml.YAMLError, ValueError):
            return value  # denotes no number: refused afterwards
    return value


def typed(config: Mapping[str, Any], model: type[Part], place: str = "") -> Part:
    """The settings object of a section, with defaults.

    Unknown keys, wrong types and values out of range raise a `ConfigurationError` with a line for
    each fault; `place` is the key of the section.
    """
    lines = "\n".join(unreadable(config, place))
    if not lines:
        try:
            return model.model_validate(config)
        except ValidationError as error:
            lines = faults(error, model, place, RENAMED)
    raise ConfigurationError(lines) from None


def first_fault(error: ConfigurationError) -> str:
    """The first line of a message of `typed`."""
    return str(error).splitlines()[0]


def checked(
    config: Mapping[str, Any], model: type[Section] = Campaign, place: str = ""
) -> dict[str, Any]:
    """The same as a plain mapping, whose numbers are as they were written."""
    return typed(config, model, place).model_dump()
