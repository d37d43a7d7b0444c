"""Families of variants and of scenarios: their changes, and their names in the results.

A value of a setting of a cell changes the tracking by an architecture, and makes a variant of its
cells. A value of any other setting of a scenario changes the optimization of the architecture, and
makes a further scenario.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from cislunar.campaign.settings.cell_tree import CellChange
from cislunar.campaign.settings.cells import Cell, grid_cells, has_architecture
from cislunar.campaign.settings.reading import checked, first_fault, merged, with_types
from cislunar.campaign.settings.scenarios import require_scenario
from cislunar.campaign.settings.tree import Scenario
from cislunar.errors import ConfigurationError, did_you_mean, known_keys

TRACKING = "settings.task2"
"""Key, or beginning of keys, of a scenario whose sweep does not change the architecture."""

PLACE = ("scenario", "architecture", "other_architectures", "other_scenarios", "estimators")
"""Keys of a family that select the cells of its variants."""


class SweepPoint(NamedTuple):
    """A value of a sweep with the scenario and the variant of its cells."""

    value: Any
    scenario: str
    variant: str


class StatedVariant(NamedTuple):
    """A variant with the keys of its family and of its change; `entry` has its `change`, its
    `targets` and those keys of `PLACE` that the family states; of a variant that is repeated with a
    change of `task2.variants.pooled`, also its name as `repeats`."""

    family: str
    key: str
    name: str
    entry: dict[str, Any]


def _named_values(name: str, family: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Values of a family with the names of their variants or scenarios."""
    values = family["values"]
    if isinstance(values, Mapping):
        return list(values.items())
    return [(f"{name}-{_in_a_path(value)}", value) for value in values]


def _in_a_path(value: Any) -> str:
    """A value as a part of a file name."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return f"{value:.12g}".replace("-", "m").replace("+", "")
    return re.sub(r"[^a-z0-9.]+", "-", str(value).lower()).strip("-.")


def _within_cell(key: str) -> str | None:
    """Setting of a cell that a sweep's key denotes; empty for several settings, None for none."""
    return key[len(TRACKING) + 1 :] if f"{key}.".startswith(f"{TRACKING}.") else None


def nested(key: str, value: Any) -> dict[str, Any]:
    """A mapping with one entry, at a dotted key."""
    for part in reversed(key.split(".") if key else []):
        value = {part: value}
    return value


def _cell_change(key: str, value: Any) -> dict[str, Any]:
    """The change of a variant; values of the command line are still texts."""
    return with_types(nested(key, value), CellChange)


def sweep_points(config: Mapping[str, Any], name: str) -> list[SweepPoint]:
    """The values of a sweep, in the order of the configuration."""
    sweep = config["sweeps"][name]
    scenario, named = sweep["scenario"], _named_values(name, sweep)
    if _within_cell(sweep["key"]) is not None:
        return [SweepPoint(value, scenario, label) for label, value in named]
    return [SweepPoint(value, f"{scenario}-{label}", "") for label, value in named]


def stated_variants(config: Mapping[str, Any]) -> Iterator[StatedVariant]:
    """The variants of all families, each followed by its repetitions with the changes of
    `task2.variants.pooled`, the repetitions of the unchanged cell, and the variants of sweeps,
    which have cells in the sweep alone."""
    variants = config["task2"]["variants"]
    # Families of a user's file come before those that they combine: any order is allowed.
    changes: dict[str, dict[str, Any]] = {}
    for name, family in variants["families"].items():
        alone = {key: value for key, value in family.items() if key != "combine"}
        changes |= {variant: change for _, variant, change in _changes(name, alone, {})}
    for name, family in variants["families"].items():
        place = {key: family[key] for key in PLACE if key in family and key != "other_scenarios"}
        for key, variant, change in _changes(name, family, changes):
            targets, others = family.get("targets", []), family.get("other_scenarios", {})
            if variants["targets"] is not None:
                targets, others = variants["targets"], dict.fromkeys(others, variants["targets"])
            if variants["only"] is not None and variant not in variants["only"]:
                targets, others = [], {}
            entry = {**place, "targets": targets, "change": change}
            if others:
                entry["other_scenarios"] = others
            yield StatedVariant(f"task2.variants.families.{name}", key, variant, entry)
            yield from _repetitions(f"task2.variants.families.{name}", variants, variant, entry,
                                    family.get("pooled", variants["pooled"]))  # fmt: skip
    yield from _repetitions("task2.variants", variants, "", _unchanged(config), variants["pooled"])
    for name, sweep in config["sweeps"].items():
        key = _within_cell(sweep["key"]) or ""
        place = {k: sweep[k] for k in ("scenario", "architecture")}
        for point in sweep_points(config, name):
            if point.variant:
                entry = {**place, "targets": [], "change": _cell_change(key, point.value)}
                stated = f"sweeps.{name}"
                yield StatedVariant(stated, f"{stated}.values", point.variant, entry)


def _repetitions(
    family: str, variants: Mapping[str, Any], name: str, entry: Mapping[str, Any], pooled: Any
) -> Iterator[StatedVariant]:
    """A variant, or the unchanged cell without a name, with each of some changes of `pooled`."""
    for repeated in pooled:
        change = merged(entry["change"], variants["pooled"][repeated])
        called = f"{name}-{repeated}" if name else repeated
        whole = {**entry, "change": change, "repeats": name}
        yield StatedVariant(family, f"task2.variants.pooled.{repeated}", called, whole)


def _unchanged(config: Mapping[str, Any]) -> dict[str, Any]:
    """The entry of the unchanged cells at the place of the first of them; `campaign_cells` knows
    all their places."""
    for cell in grid_cells(config["task2"]):
        place = {"scenario": cell.scenario, "architecture": cell.architecture}
        return {**place, "targets": [], "change": {}}
    return {"targets": [], "change": {}}


def _changes(
    name: str, family: Mapping[str, Any], others: Mapping[str, dict[str, Any]]
) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Configuration key, name and change of each variant of a family."""
    place = f"task2.variants.families.{name}"
    for variant, value in _named_values(name, family) if "values" in family else ():
        yield f"{place}.values", variant, _cell_change(family.get("key", ""), value)
    for variant, change in family.get("changes", {}).items():
        yield f"{place}.changes.{variant}", variant, change
    for other, names in family.get("combine", {}).items():
        for one in names:
            missing = [each for each in (one, other) if each not in others]
            if missing:
                raise ConfigurationError(
                    f"configuration key '{place}.combine.{other}': {missing[0]!r} is no variant "
                    "with a change of its own"
                )
            yield f"{place}.combine", f"{one}-{other}", merged(others[one], others[other])


def with_families(config: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration with the scenarios and variants of its families and sweeps.

    `task2.variants` has `scenario`, `architecture`, `pooled` and, in place of the families,
    `cells`: the entry of each variant by its name, first the variants in `only`, in its order.
    """
    scenarios, task2 = dict(config["scenarios"]), config["task2"]
    for name, sweep in config["sweeps"].items():
        for point in sweep_points(config, name):
            if not point.variant:
                change = nested(sweep["key"], point.value)
                entry = merged(scenarios[sweep["scenario"]], change)
                try:
                    # also makes Julian dates of dates
                    entry = checked(entry, Scenario, f"scenarios.{point.scenario}")
                except ConfigurationError as error:
                    fault = f"configuration key 'sweeps.{name}': {first_fault(error)}"
                    raise ConfigurationError(fault) from None
                scenarios[point.scenario] = entry
    variants = {key: task2["variants"][key] for key in ("scenario", "architecture", "pooled")}
    cells = {variant.name: variant.entry for variant in stated_variants(config)}
    first = [name for name in task2["variants"]["only"] or () if name in cells]
    variants["cells"] = {name: cells[name] for name in dict.fromkeys([*first, *cells])}
    task2 = {**task2, "variants": variants}
    return {**config, "scenarios": scenarios, "task2": task2}


def swept_cells(config: Mapping[str, Any], name: str) -> list[Cell]:
    """The cells of a sweep by estimator, number of targets and value."""
    sweep, task2 = config["sweeps"][name], config["task2"]
    architecture, minutes = sweep["architecture"], int(task2["interval_minutes"])
    return [
        Cell(point.scenario, architecture, estimator, int(n), minutes, point.variant)
        for estimator in sweep.get("estimators", task2["estimators"])
        for n in sweep.get("targets", ())
        for point in sweep_points(config, name)
    ]


def check_families(config: Mapping[str, Any], left: Mapping[str, Any]) -> None:
    """Refuse families without values and names that occur twice; values are checked afterwards.
    `left` is the configuration without the scenarios that are null."""
    variants = config["task2"]["variants"]
    for name, family in variants["families"].items():
        ways = [way for way in ("values", "changes", "combine") if way in family]
        several = ways[:2] == ["values", "changes"]
        if not ways or several or ("key" in family) != ("values" in family):
            raise ConfigurationError(
                f"configuration key 'task2.variants.families.{name}': give either key and values "
                "or changes, or combine, in addition to them or alone"
            )
        for other in family.get("pooled", ()):
            if other not in variants["pooled"]:
                raise ConfigurationError(
                    f"configuration key 'task2.variants.families.{name}.pooled': {other!r} is none "
                    f"of task2.variants.pooled ({', '.join(variants['pooled']) or 'empty'})"
                )
    taken = set(config["scenarios"])
    for variant in stated_variants(config | {"sweeps": {}}):
        if variant.name in taken:
            raise ConfigurationError(
                f"configuration key '{variant.key}': there is another variant or scenario "
                f"{variant.name!r}; rename one of them"
            )
        taken.add(variant.name)
    for name in variants["only"] or ():
        if name not in taken:
            raise ConfigurationError(
                f"configuration key 'task2.variants.only': {name!r} is none of the variants; "
                + (did_you_mean(name, taken) or known_keys(sorted(taken)))
            )
    for name in left["sweeps"]:
        _check_sweep(left, name, taken)


def _check_sweep(config: Mapping[str, Any], name: str, taken: set[str]) -> None:
    """Refuse a sweep with an unfit scenario or architecture, no targets, or a taken name."""
    place, sweep = f"configuration key 'sweeps.{name}", config["sweeps"][name]
    scenario, key, architecture = sweep["scenario"], sweep["key"], sweep["architecture"]
    require_scenario(f"sweeps.{name}.scenario", scenario, config)
    if not sweep.get("targets") and _within_cell(key) is not None:
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
