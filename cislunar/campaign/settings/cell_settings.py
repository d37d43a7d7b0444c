"""Settings of a cell: of the configuration, of a variant, of the mode of tasking, and true ones."""

from collections.abc import Mapping
from typing import Any

from cislunar.campaign.settings.cell_tree import CellSettings, Tasking
from cislunar.campaign.settings.reading import merged, typed
from cislunar.errors import ConfigurationError
from cislunar.observation.body_spec import ICOSAHEDRON, load_body_table
from cislunar.photometry import MODELS, REFLECTION_LAWS

REPLAY_MINUTES = 5.0
"""Time between the recorded states of a replay, at least a step."""

RECOMMENDED = {"detection": "learned", "slot_minutes": 20, "expected_measurements": 20}
"""Settings of the recommended mode of `task2.tasking`."""


def cell_settings(task2: Mapping[str, Any], variant: str = "") -> dict[str, Any]:
    """The settings of a cell of checked `task2`, as jobs get them and results keep them, with those
    of a variant; keys that are omitted while they have their defaults are left out.

    Raises
    ------
    ConfigurationError
        If there is no such variant.
    """
    found = {key: task2[key] for key in CellSettings.model_fields}
    if variant:
        variants = task2["variants"]["cells"]
        if variant not in variants:
            raise ConfigurationError(
                f"variant {variant!r} is none of the configuration key 'task2.variants.families', "
                f"which make {', '.join(variants) or 'none'}"
            )
        found = merged(found, variants[variant]["change"])
    return CellSettings.kept({**found, "tasking": in_mode(found["tasking"])})


def in_mode(tasking: Mapping[str, Any]) -> dict[str, Any]:
    """The section `tasking` with the settings of its mode, and without the mode."""
    stated = {key: value for key, value in tasking.items() if key != "mode"}
    if tasking.get("mode") != "recommended":
        return stated
    usual = {key: Tasking.model_fields[key].default for key in RECOMMENDED}
    return stated | {
        key: value
        for key, value in RECOMMENDED.items()
        if stated.get(key, usual[key]) == usual[key]
    }


def replay_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a cell with the first realization alone and the records of a replay, which
    change no result."""
    step_s = settings["step_s"]
    steps = max(1, round(60.0 * REPLAY_MINUTES / step_s))
    return {
        **settings,
        "seeds": 1,
        "record": ["truth", "estimates", "covariance", "measurements", "pointing"],
        "histories": ["errors"],
        "record_minutes": min(settings["record_minutes"], steps * step_s / 60.0),
    }


def true_settings(settings: CellSettings) -> CellSettings:
    """The settings with material, body and sensor as `truth` states them."""
    changed = settings.truth.model_dump(include={"material", "body", "sensor"})
    return typed(merged(settings.model_dump(), changed), CellSettings)


def cell_files(settings: Mapping[str, Any]) -> list[str]:
    """Meshes and tables that a cell depends on, each once: of bodies and of a reflection law,
    assumed and true, of the errors of observers, and of maneuvers."""
    assumed = typed(settings, CellSettings)
    tables = assumed.observer_errors.table, assumed.truth.maneuvers.table
    found: list[str] = [each for each in tables if each is not None]
    for body in (assumed.body, true_settings(assumed).body):
        shapes = [body.shape]
        if body.table is not None:
            found.append(body.table)
            shapes += [each.shape for each in load_body_table(body.table).values()]
        found += [shape for shape in shapes if shape != ICOSAHEDRON and shape not in MODELS]
    if assumed.truth.reflection not in REFLECTION_LAWS:
        found.append(assumed.truth.reflection)
    return list(dict.fromkeys(found))
