"""The cells of the tracking campaign, and the cells that are refused.

A cell is one combination of scenario, architecture, estimator, number of targets and tasking
interval, run for all realizations. A variant is a cell with changed settings.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from cislunar.architecture.published import PUBLISHED
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.errors import ConfigurationError
from cislunar.runtime.settings_fields import is_multiple

TRACKED_TARGETS = 202
"""Number of targets in ``orbits/tracked.nc``."""

PAPER_ARCHITECTURES = ("published", "tpe")
"""Architectures that the paper tracks with: those it states, and those of its search."""

PAPER_FILTER = "mukf"
"""The paper's estimator."""

FIRST = "first"
"""Value of `task2.replay`: the first cell of the campaign."""

FEWEST_RANKED = 10
"""Smallest number of architectures whose objectives are compared with tracking."""


class Cell(NamedTuple):
    """A cell of the campaign: n_T `targets`, tasked every T_ST `interval_minutes`.

    `variant` is the name of the changed settings; empty for those of the configuration.
    """

    scenario: str
    architecture: str
    estimator: str
    targets: int
    interval_minutes: int
    variant: str = ""

    @property
    def name(self) -> str:
        """Its name, such as ``A/published/mukf/nt20_dt60``."""
        suffix = f"_{self.variant}" if self.variant else ""
        return (
            f"{self.scenario}/{self.architecture}/{self.estimator}/"
            f"nt{self.targets}_dt{self.interval_minutes}{suffix}"
        )

    @property
    def path(self) -> str:
        """Its data set, relative to the results folder."""
        return f"task2/{self.name}.nc"


def has_architecture(scenario: str, architecture: str) -> bool:
    """Whether a scenario has the architecture; the paper publishes those of its own scenarios."""
    return architecture != "published" or scenario in PUBLISHED


def grid_cells(task2: Mapping[str, Any]) -> list[Cell]:
    """The cells of `task2` by number of targets, interval and architecture, each once."""
    usual, intervals = task2["interval_minutes"], task2["intervals"]
    found: list[Cell] = []
    for estimator in task2["estimators"]:
        for architecture in task2["architectures"]:
            found += _cells(task2["target_counts"], [usual], architecture, estimator)
            found += _cells(
                intervals["target_counts"], intervals["minutes"], architecture, estimator
            )
        for architecture, counts in task2["other_architectures"].items():
            found += _cells(counts, [usual], architecture, estimator)
    return list(dict.fromkeys(found))


def _cells(counts, minutes, architecture: str, estimator: str) -> Iterator[Cell]:
    for scenario, targets in counts.items():
        if not has_architecture(scenario, architecture):
            continue
        for interval in minutes:
            for n in targets:
                yield Cell(scenario, architecture, estimator, int(n), int(interval))


def variant_place(task2: Mapping[str, Any], name: str) -> tuple[str, str]:
    """Scenario and architecture of a variant: its own, or those of all variants."""
    variants = task2["variants"]
    own = variants["cells"][name]
    return (
        own.get("scenario", variants["scenario"]),
        own.get("architecture", variants["architecture"]),
    )


def variant_cells(task2: Mapping[str, Any]) -> list[Cell]:
    """The cells with changed settings, with the first estimator if the variant names none."""
    return [
        Cell(scenario, architecture, estimator, int(n), task2["interval_minutes"], name)
        for name, variant in task2["variants"]["cells"].items()
        for scenario, first, counts in _places(task2, name)
        for architecture in dict.fromkeys([first, *variant.get("other_architectures", ())])
        if has_architecture(scenario, architecture)
        for estimator in variant.get("estimators", task2["estimators"][:1])
        for n in counts
    ]


def unpooled_variant(variant: str, pooled: Iterable[str]) -> tuple[str, str]:
    """A variant without the suffix of a pooled variant, and the pooled variant."""
    for name in pooled:
        if variant == name or variant.endswith(f"-{name}"):
            return variant.removesuffix(name).removesuffix("-"), name
    return variant, ""


def _places(task2: Mapping[str, Any], name: str) -> Iterator[tuple[str, str, list[int]]]:
    """Scenarios, architecture and numbers of targets of a variant."""
    entry = task2["variants"]["cells"][name]
    scenario, architecture = variant_place(task2, name)
    yield scenario, architecture, entry["targets"]
    for other, counts in entry.get("other_scenarios", {}).items():
        yield other, architecture, counts


def estimator_names(task2: Mapping[str, Any]) -> list[str]:
    """Estimators of the sweeps and the variants, each once."""
    variants = task2["variants"]["cells"].values()
    named = [name for variant in variants for name in variant.get("estimators", ())]
    return list(dict.fromkeys([*task2["estimators"], *named]))


def campaign_cells(task2: Mapping[str, Any]) -> list[Cell]:
    """All cells of `task2`, each once: sweeps, variants, and their unchanged cells, which are
    repeated with each change of `task2.variants.pooled`."""
    changed = variant_cells(task2)
    plain = dict.fromkeys([*grid_cells(task2), *(cell._replace(variant="") for cell in changed)])
    pooled = task2["variants"].get("pooled", ())
    repeated = [cell._replace(variant=name) for cell in plain for name in pooled]
    return list(dict.fromkeys([*plain, *changed, *repeated]))


def replayed_cell(task2: Mapping[str, Any]) -> Cell | None:
    """The cell of `task2.replay`, None for none; a `ConfigurationError` if the campaign lacks
    it."""
    wanted, every = task2["replay"], campaign_cells(task2)
    if wanted is None or (wanted == FIRST and not every):
        return None
    for cell in every:
        if wanted in (FIRST, cell.name):
            return cell
    such_as = f", such as {every[0].name}" if every else ""
    raise ConfigurationError(
        f"configuration key 'task2.replay' = {wanted!r} is no cell of the campaign{such_as}: give "
        f"the name of a cell, {FIRST} or null"
    )


def paper_cells(task2: Mapping[str, Any]) -> list[Cell]:
    """The cells of `campaign_cells` that the paper has: its filter on its architectures, with
    unchanged settings."""
    return [
        cell
        for cell in campaign_cells(task2)
        if cell.estimator == PAPER_FILTER
        and cell.architecture in PAPER_ARCHITECTURES
        and not cell.variant
    ]


def most_alike(task2: Mapping[str, Any]) -> int:
    """The largest number of cells of `task2` that differ only in their architecture."""
    alike = Counter(cell._replace(architecture="") for cell in campaign_cells(task2))
    return max(alike.values(), default=0)


def check_cell(cell: Cell, settings: CellSettings, available: int = TRACKED_TARGETS) -> None:
    """Refuse more targets than are available, an interval that is no multiple of the step, and
    process noise that the estimator cannot represent.

    Raises
    ------
    ConfigurationError
        If the cell asks for one of these.
    """
    targets, interval_minutes = cell.targets, cell.interval_minutes
    if not 1 <= targets <= available:
        raise ConfigurationError(
            f"n_T = {targets} (nt{targets} in the file name): there are {available} targets; "
            f"choose 1 .. {available}"
        )
    if not is_multiple(60.0 * interval_minutes, settings.step_s):
        raise ConfigurationError(
            f"tasking interval of {interval_minutes} min (dt{interval_minutes} in the file name) "
            f"is no multiple of 'task2.step_s' = {settings.step_s} s: choose another interval or "
            "step"
        )
    for key in ("attitude_deg", "angular_velocity_deg_h"):
        noise = getattr(settings.process_noise, key)
        if cell.estimator == "batch" and noise > 0.0:
            variant = f" of the variant {cell.variant!r}" if cell.variant else ""
            raise ConfigurationError(
                f"configuration key 'task2.process_noise.{key}' = {noise}{variant}: the batch "
                "estimator takes the rotation as free of noise; set it to 0, or window_hours and "
                "memory_hours of 'task2.batch' in its place"
            )
