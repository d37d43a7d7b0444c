"""Settings in words: the JSON schema of a settings class, and a message for each faulty value."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from pydantic import BaseModel, ValidationError

from cislunar.errors import did_you_mean, known_keys

_LIMITS = (
    ("minimum", "at least"),
    ("exclusiveMinimum", "above"),
    ("maximum", "at most"),
    ("exclusiveMaximum", "below"),
)
_KINDS = {
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "string": "a text",
    "object": "a mapping",
}
_PATTERNS: dict[str, str] = {}

_LONGEST_TEXT = 1000
_LONGEST_VALUE = 80


def pattern(expression: str, words: str) -> str:
    """A regular expression of texts, described in words in messages and documents."""
    _PATTERNS[expression] = words
    return expression


@cache
def schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """JSON schema of a section without references, and with null as one of the types."""
    whole = model.model_json_schema()
    return _inlined(whole, whole.get("$defs", {}))


def _inlined(node: Any, parts: Mapping[str, Any]) -> Any:
    if isinstance(node, list):
        return [_inlined(each, parts) for each in node]
    if not isinstance(node, dict):
        return node
    own = {key: value for key, value in node.items() if key not in ("$ref", "$defs", "anyOf")}
    own = {key: _inlined(value, parts) for key, value in own.items()}
    if "$ref" in node:
        return _inlined(parts[node["$ref"].rpartition("/")[2]], parts) | own
    if "anyOf" in node:  # a type, or null
        usual = _inlined(node["anyOf"][0], parts)
        return usual | own | {"type": [usual["type"], "null"]}
    return own


def inner(schema: Mapping[str, Any], key: Any) -> Mapping[str, Any]:
    """Schema of an entry of a mapping or of a list; empty if there is none."""
    if isinstance(key, int):
        return schema.get("items", {})
    named = schema.get("properties", {}).get(key)
    others = [*schema.get("patternProperties", {}).values(), schema.get("additionalProperties")]
    return named or (others[0] if isinstance(others[0], Mapping) else {})


def types(schema: Mapping[str, Any]) -> Sequence[str]:
    """JSON types a schema allows."""
    found = schema.get("type", ())
    return [found] if isinstance(found, str) else found


def allowed(schema: Mapping[str, Any]) -> str:
    """Values that a schema allows, in words."""
    kinds = types(schema)
    if "enum" in schema:
        text = f"one of {', '.join(schema['enum'])}"
    elif "array" in kinds and "items" in schema:
        least, most = schema.get("minItems", 0), schema.get("maxItems")
        count = f"{most} of:" if least == most else "one or more of:" if least else "values, each"
        text = f"a list of {count} {allowed(schema['items'])}"
    elif "pattern" in schema:
        return _in_words(schema["pattern"])
    else:
        limits = " and ".join(f"{words} {schema[key]:,}" for key, words in _LIMITS if key in schema)
        named = [_KINDS.get(kind, "a list") for kind in kinds if kind != "null"]
        text = f"{named[0]}{' ' * bool(limits)}{' or '.join([limits, *named[1:]])}"
    return f"{text}, or null" if "null" in kinds else text


def _in_words(expression: str) -> str:
    return _PATTERNS.get(expression, f"a text like {expression}")


def shown(value: Any) -> str:
    """A value as it stands in a message: on one line, and not too long."""
    text = " ".join(line.strip() for line in repr(value).splitlines())
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}..."


def _join(*keys: Any) -> str:
    return ".".join(str(key) for key in keys if key != "")


def unreadable(value: Any, *path: Any) -> Iterator[str]:
    """A line for each number that is not finite, and each text that can be no part of a name, in
    the value of the configuration at a path of keys."""
    if isinstance(value, str):
        if not (value.isprintable() and len(value) <= _LONGEST_TEXT):
            yield (
                f"configuration key {_join(*path)!r} = {shown(value)}: must be a line of at most "
                f"{_LONGEST_TEXT} printable characters"
            )
    elif isinstance(value, float):
        if not math.isfinite(value):
            yield f"configuration key {_join(*path)!r} = {value}: must be a finite number"
    elif isinstance(value, Mapping):
        for key, part in value.items():
            if isinstance(key, str) and key.isprintable():
                yield from unreadable(part, *path, key)
            else:
                place = _join(*path) or "the configuration"
                yield f"unknown configuration key {shown(key)} in {place!r}"
    elif isinstance(value, list):
        for number, part in enumerate(value):
            yield from unreadable(part, *path, number)


def faults(
    error: ValidationError,
    model: type[BaseModel],
    place: str = "",
    renamed: Mapping[str, str] | None = None,
) -> str:
    """One line for each fault of a section of the configuration: the key, the value, and what is
    allowed. `place` is the key of the section, `renamed` has former names of keys and of values,
    and their present names."""
    found = (_described(fault, model, place, renamed or {}) for fault in error.errors())
    return "\n".join(found)


def faults_of_arguments(error: ValidationError, model: type[BaseModel]) -> str:
    """The same in one line for a settings object made in Python, whose keys are arguments."""
    lines = []
    for fault in error.errors():
        path, reason, _ = _reason(fault, model)
        names_itself = fault["type"] == "value_error" and not path
        value = "" if fault["type"] == "missing" else f" = {fault['input']!r}"
        lines.append(reason if names_itself else f"{_join(*path)}{value} {reason}")
    return "; ".join(lines)


def _reason(
    fault: Mapping[str, Any], model: type[BaseModel]
) -> tuple[tuple[Any, ...], str, Mapping[str, Any]]:
    """Path of a faulty value, why it is refused, and its schema."""
    path, kind = fault["loc"], fault["type"]
    schema: Mapping[str, Any] = schema_of(model)
    for key in path:
        schema = inner(schema, key)
    if kind == "missing":
        return path, "is missing", schema
    if kind in ("model_type", "dict_type"):
        return path, f"must be {_KINDS['object']}", schema
    if kind == "value_error":
        return path, str(fault["ctx"]["error"]), schema
    if kind == "extra_forbidden":
        return path, "is no such setting", schema
    return path, f"must be {allowed(schema)}", schema


def _described(
    fault: Mapping[str, Any], model: type[BaseModel], above: str, renamed: Mapping[str, str]
) -> str:
    """A fault of the configuration in a line."""
    path, value, kind = fault["loc"], fault["input"], fault["type"]
    place = _join(above, *path)
    if kind == "extra_forbidden":
        schema: Mapping[str, Any] = schema_of(model)
        for key in path[:-1]:
            schema = inner(schema, key)
        known = list(schema["properties"])
        if renamed.get(path[-1]) in known:
            remedy = f"it is now called {renamed[path[-1]]!r}"
        else:
            remedy = did_you_mean(path[-1], known) or known_keys(known)
        return f"unknown configuration key {shown(place)}: {remedy}"
    if path and path[-1] == "[key]":
        expected = fault["ctx"].get("pattern")
        name = _in_words(expected) if expected else fault["ctx"].get("expected")
        place = _join(above, *path[:-2])
        return f"configuration key {place!r}: name {shown(value)} is not allowed: must be {name}"
    _, reason, schema = _reason(fault, model)
    if kind == "missing":
        return f"configuration key {place!r} is missing"
    if kind == "value_error" and "properties" in schema:
        return f"configuration key {shown(place)}: {reason}"
    if isinstance(value, str) and renamed.get(value) in schema.get("enum", ()):
        reason = f"this value is now called {renamed[value]!r}"
    return f"configuration key {shown(place)} = {shown(value)}: {reason}"
