"""The tables of settings in ``config/README.md``, from the settings' own classes.

From the folder of the repository::

    python -m cislunar.campaign.documents.settings_tables

makes them anew, and ``workflow/schemas/config.schema.json``, which editors take.
"""

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from cislunar.campaign.documents.markdown import fill_blocks, markdown_table
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.schema import (
    SCHEMA_FILE,
    allowed,
    schema_of,
    schema_text,
    stated_keys,
)
from cislunar.campaign.settings.tree import Campaign

_DASH = "\N{EN DASH}"
_SECTIONS = ("ephemeris", "orbits", "targets", "visibility", "scenarios", "observers")
_SECTIONS += ("sweeps", "architecture")


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
        return _DASH
    value = part["default"]
    return f"`{value if isinstance(value, str) else json.dumps(value)}`"


def settings_table(section: str) -> str:
    """The keys of a section with unit, values allowed, default and meaning, in Markdown."""
    rows = [
        (f"`{key}`", part["unit"] or _DASH, allowed(part), _default(part),
         part["paper"] or _DASH, part["description"])
        for key, part in stated_keys(schema_of(Campaign))
        if _section(key) == section
    ]  # fmt: skip
    return markdown_table(["key", "unit", "value", "default", "paper", "meaning"], rows)


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
