"""The tables of settings in ``config/README.md``, from the settings' own classes.

From the folder of the repository::

    python -m workflow.documents.settings_tables

generates them and ``workflow/schemas/config.schema.json``, which editors use.
"""

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from cislunar.campaign.settings import SCHEMA_FILE, Campaign, CellSettings, schema_text, stated_keys
from cislunar.runtime.settings_words import allowed, schema_of

from .markdown import DASH, fill_blocks, markdown_table

_SECTIONS = ("ephemeris", "orbits", "targets", "visibility", "scenarios", "observers")
_SECTIONS += ("sweeps", "surveys", "architecture")


def _section(key: str) -> str:
    """Name of the table that holds a key."""
    first, *inside = key.split(".")
    if first in _SECTIONS:
        return first
    if not inside:
        return "campaign"
    if inside[0] in CellSettings.model_fields:
        return "cell"
    return "variants" if inside[0] == "variants" else "tracking"


def _default(part: Mapping[str, Any]) -> str:
    if "default" not in part:
        return DASH
    value = part["default"]
    return f"`{value if isinstance(value, str) else json.dumps(value)}`"


def settings_table(section: str) -> str:
    """The keys of a section with unit, allowed values, default and meaning, in Markdown."""
    rows = [
        (f"`{key}`", part["unit"] or DASH, allowed(part), _default(part),
         part["paper"] or DASH, part["description"])
        for key, part in stated_keys(schema_of(Campaign))
        if _section(key) == section
    ]  # fmt: skip
    return markdown_table(["Key", "Unit", "Allowed values", "Default", "Paper", "Meaning"], rows)


SETTINGS_BLOCKS: Mapping[str, Callable[[], str]] = {
    f"settings-{section}": partial(settings_table, section)
    for section in ("campaign", *_SECTIONS, "cell", "tracking", "variants")
}
"""What makes each table, by the name in its opening line."""


if __name__ == "__main__":
    readme = Path("config/README.md")
    text = fill_blocks(readme.read_text(encoding="utf-8"), SETTINGS_BLOCKS, str(readme))
    readme.write_text(text, encoding="utf-8")
    Path(SCHEMA_FILE).write_text(schema_text(), encoding="utf-8")
    print(f"made {SCHEMA_FILE} and the tables of {readme}")
