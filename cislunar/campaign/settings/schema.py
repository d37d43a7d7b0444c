"""The JSON schema of the configuration, as a file and as the keys that documents explain."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from cislunar.campaign.settings.tree import Campaign
from cislunar.runtime.settings_words import inner

SCHEMA_FILE = "workflow/schemas/config.schema.json"

_STATED = ("description", "unit", "paper", "default")


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
            stated = {about: part[about] for about in _STATED if about in part}
            yield f"{place}{key}.{names}", {**each, **stated}
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
