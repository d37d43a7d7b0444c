"""The JSON schema of the configuration, and what it says in words."""

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, get_args

from cislunar.campaign.settings.architecture_tree import ARCHITECTURE_NAME, Optimizer
from cislunar.campaign.settings.cell_tree import SHAPE, TABLE
from cislunar.campaign.settings.fields import Section
from cislunar.campaign.settings.tree import (
    SCENARIO_NAME,
    SWEEP_NAME,
    VARIANT_NAME,
    Campaign,
)
from cislunar.observation.wanted_bodies import ICOSAHEDRON
from cislunar.photometry.spacecraft import MODELS

SCHEMA_FILE = "workflow/schemas/config.schema.json"

_LIMITS = (
    ("minimum", "at least"),
    ("exclusiveMinimum", "above"),
    ("maximum", "at most"),
    ("exclusiveMaximum", "below"),
)
_TOLD = ("description", "unit", "paper", "default")
_PATTERNS = {
    ARCHITECTURE_NAME: f"one of {', '.join(get_args(Optimizer))}, or of `observers` or "
    "`architecture.designs` a name of letters, digits and hyphens, a letter first",
    SHAPE: f"one of {', '.join((ICOSAHEDRON, *MODELS))}, or a file ending in .obj or .stl",
    TABLE: "a file ending in .csv",
    SCENARIO_NAME: "a name of letters, digits, dots and hyphens, a letter first",
    SWEEP_NAME: "a name of small letters, digits and hyphens, a letter first",
    VARIANT_NAME: "a name of small letters, digits, dots and hyphens, a letter first",
}
_KINDS = {
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "string": "a text",
    "object": "a mapping",
}


@cache
def schema_of(model: type[Section]) -> dict[str, Any]:
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
    """What a schema allows, in words."""
    kinds = types(schema)
    if "enum" in schema:
        text = f"one of {', '.join(schema['enum'])}"
    elif "array" in kinds and "items" in schema:
        least, most = schema.get("minItems", 0), schema.get("maxItems")
        count = f"{most} of: " if least == most else "one or more of: " if least else ""
        text = f"a list of {count}{allowed(schema['items'])}"
    else:
        limits = [f"{words} {schema[key]:,}" for key, words in _LIMITS if key in schema]
        if "pattern" in schema:
            return in_words(schema["pattern"])
        named = [_KINDS.get(kind, "a list") for kind in kinds if kind != "null"]
        text = f"{' or '.join(named)}{' ' * bool(limits)}{' and '.join(limits)}"
    return f"{text}, or null" if "null" in kinds else text


def in_words(pattern: str) -> str:
    """What a regular expression of a setting asks for."""
    return _PATTERNS.get(pattern, f"a text like {pattern}")


def stated_keys(
    schema: Mapping[str, Any], place: str = ""
) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Every key that a document explains, in capitals or braces where any name may stand."""
    for key, part in schema["properties"].items():
        names = part.get("name", "NAME")  # none: what is inside is explained elsewhere
        each = inner(part, names)
        if "properties" in part and not part.get("description"):
            yield from stated_keys(part, f"{place}{key}.")
        elif "properties" in each:
            if part.get("description"):
                yield f"{place}{key}{'.' * bool(names)}{names}", part
            if names == "NAME" or not part.get("description"):
                yield from stated_keys(each, f"{place}{key}.{names}.")
        elif names and (each or part.get("name")):
            each = each or next(iter(part.get("properties", {}).values()), {})
            told = {about: part[about] for about in _TOLD if about in part}
            yield f"{place}{key}.{names}", {**each, **told}
        else:
            yield f"{place}{key}", part


def schema_text() -> str:
    """The schema file: a line for each section."""
    whole = Campaign.model_json_schema()
    parts = whole.pop("$defs")
    for part in [whole, *parts.values()]:
        for each in [part, *part.get("properties", {}).values()]:
            each.pop("title", None)
    whole["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    lines = [f'"{name}": {json.dumps(part)}' for name, part in parts.items()]
    return json.dumps(whole)[:-1] + ', "$defs": {\n' + ",\n".join(lines) + "\n}}\n"
