"""Reading a configuration: texts to the types wanted, every fault in a line that names the key."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

import yaml
from pydantic import ValidationError

from cislunar.campaign.settings.fields import Section
from cislunar.campaign.settings.schema import allowed, in_words, inner, schema_of, types
from cislunar.campaign.settings.tree import Campaign
from cislunar.errors import ConfigurationError, did_you_mean

Part = TypeVar("Part", bound=Section)

_LONGEST_TEXT = 1000
_LONGEST_VALUE = 80


def merged(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping with some entries replaced, at any depth."""
    result = dict(base)
    for key, value in change.items():
        nested = isinstance(value, Mapping) and isinstance(base.get(key), Mapping)
        result[key] = merged(base[key], value) if nested else value
    return result


def with_types(config: Mapping[str, Any], model: type[Section] = Campaign) -> dict[str, Any]:
    """Put numbers, booleans and nulls in place of the strings that stand for them.

    Snakemake hands over nested values of ``--config 'task2={"seeds": 3}'`` as strings. A
    `ConfigurationError` if an alias of YAML makes the configuration a part of itself.
    """
    try:
        return _typed(config, schema_of(model))
    except RecursionError:
        raise ConfigurationError(
            "a configuration key holds itself: remove the alias (*name in YAML)"
        ) from None


def _typed(value: Any, schema: Mapping[str, Any]) -> Any:
    if isinstance(value, Mapping):
        return {key: _typed(part, inner(schema, key)) for key, part in value.items()}
    if isinstance(value, list):
        return [_typed(part, inner(schema, 0)) for part in value]
    kinds = types(schema)
    if isinstance(value, str) and kinds and ("string" not in kinds or "number" in kinds):
        try:
            return yaml.safe_load(value)
        except (yaml.YAMLError, ValueError):
            return value  # stands for nothing: left to be refused
    return value


def typed(config: Mapping[str, Any], model: type[Part], place: str = "") -> Part:
    """Refuse unknown keys, wrong types and values out of range; fill in defaults.

    `place` is the key of the part, for the `ConfigurationError`, which has a line for each fault.
    """
    # What JSON has no notion of, or no name can be made of.
    lines = list(_beyond_json(config, place))
    if not lines:
        try:
            return model.model_validate(config)
        except ValidationError as error:
            lines = [_described(fault, model, place) for fault in error.errors()]
    raise ConfigurationError("\n".join(lines)) from None


def checked(
    config: Mapping[str, Any], model: type[Section] = Campaign, place: str = ""
) -> dict[str, Any]:
    """The same as `typed` as a plain mapping, whose values are as they were written."""
    return typed(config, model, place).model_dump()


def _beyond_json(value: Any, place: str = "") -> Iterator[str]:
    """A line for each number that is not finite, and each text of which no name can be made."""
    if isinstance(value, float) and not math.isfinite(value):
        yield f"configuration key {place!r} = {value}: must be a finite number"
    elif isinstance(value, str) and not (value.isprintable() and len(value) <= _LONGEST_TEXT):
        yield (
            f"configuration key {place!r} = {shown(value)}: must be a line of at most "
            f"{_LONGEST_TEXT} printable characters"
        )
    elif isinstance(value, Mapping):
        for key, part in value.items():
            if isinstance(key, str) and key.isprintable():
                yield from _beyond_json(part, _join(place, key))
            else:
                yield f"unknown configuration key {shown(key)} in {place or 'the configuration'!r}"
    elif isinstance(value, list):
        for number, part in enumerate(value):
            yield from _beyond_json(part, _join(place, number))


def shown(value: Any) -> str:
    """A value as it stands in a message: on one line, and not too long."""
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}..."


def _join(place: str, *keys: Any) -> str:
    return ".".join(str(key) for key in (place, *keys) if key != "")


def _described(fault: Mapping[str, Any], model: type[Section], above: str) -> str:
    """A fault in a line: the key, what was given, and what is allowed."""
    path, value, kind = fault["loc"], fault["input"], fault["type"]
    schema = schema_of(model)
    for key in path[:-1]:
        schema = inner(schema, key)
    place = _join(above, *path)
    if kind == "extra_forbidden":
        known = list(schema["properties"])
        mend = did_you_mean(path[-1], known) or f"known keys: {', '.join(known)}"
        return f"unknown configuration key {shown(place)}: {mend}"
    if kind == "missing":
        return f"configuration key {place!r} is missing"
    if path and path[-1] == "[key]":
        pattern = fault["ctx"].get("pattern")
        name = in_words(pattern) if pattern else fault["ctx"].get("expected")
        place = _join(above, *path[:-2])
        return f"configuration key {place!r}: name {shown(value)} is not allowed: must be {name}"
    schema = inner(schema, path[-1]) if path else schema
    if kind in ("model_type", "dict_type"):
        reason = f"{shown(value)} is not of type 'object'"
    elif kind == "value_error":
        reason = str(fault["ctx"]["error"])
        if "properties" in schema:
            return f"configuration key {shown(place)}: {reason}"
    else:
        reason = f"must be {allowed(schema)}"
    return f"configuration key {shown(place)} = {shown(value)}: {reason}"
