"""The cells of the tracking campaign: which there are, how each is set, and what is refused.

A cell is an architecture, a number of monitored targets and a tasking interval. A variant is a
cell with a few settings changed. Nothing here needs the compiled library, so that a configuration
is checked at once.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from cislunar.architecture.published import PUBLISHED
from cislunar.campaign.settings.cell_tree import (
    Batch,
    CellSettings,
    Communication,
    Detection,
    Dynamics,
    Tasking,
)
from cislunar.campaign.settings.reading import merged
from cislunar.errors import ConfigurationError
from cislunar.observation.wanted_bodies import ICOSAHEDRON, WantedBody, load_body_table
from cislunar.photometry.materials import REFLECTION_LAWS
from cislunar.photometry.spacecraft import MODELS

TRACKED_TARGETS = 202
"""Number of targets in ``orbits/tracked.nc``."""

MOST_STEPS = 10_000_000
"""More steps of a horizon or a run than this are taken for a slip of the pen."""

FEWEST_RANKED = 10
"""Architectures of the least group whose objectives are compared with tracking."""

CELL_KEYS = tuple(CellSettings.model_fields)
"""Keys of `task2` that set a cell, and that a variant may change."""


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
    def path(self) -> str:
        """Its data set, relative to the results folder."""
        suffix = f"_{self.variant}" if self.variant else ""
        return (
            f"task2/{self.scenario}/{self.architecture}/{self.estimator}/"
            f"nt{self.targets}_dt{self.interval_minutes}{suffix}.nc"
        )


def cell_settings(task2: Mapping[str, Any], variant: str = "") -> dict[str, Any]:
    """The keys `CELL_KEYS` of `task2`, as a variant changes them; it must be one there is."""
    base = {key: task2[key] for key in CELL_KEYS}
    if not variant:
        return _without_nothing(base)
    variants = task2["variants"]["cells"]
    if variant not in variants:
        raise ConfigurationError(
            f"variant {variant!r} is none of the configuration key 'task2.variants.families', "
            f"which make {', '.join(variants) or 'none'}"
        )
    return _without_nothing(merged(base, variants[variant]["change"]))


RECOMMENDED = {"detection": "learned", "slot_minutes": 20, "credited_measurements": 20}
"""What the recommended mode of `task2.tasking` sets."""


def in_mode(tasking: Mapping[str, Any]) -> dict[str, Any]:
    """The section `tasking` as its mode has it, and without the mode."""
    said = {key: value for key, value in tasking.items() if key != "mode"}
    if tasking.get("mode") != "recommended":
        return said
    usual = {key: Tasking.model_fields[key].default for key in RECOMMENDED}
    left = {key: v for key, v in RECOMMENDED.items() if said.get(key, usual[key]) == usual[key]}
    return {**said, **left}


_UNSAID = ("start_day", "histories", "record", "eclipse", "fusion", "sensors", "stations")
"""Keys that are left out of settings where they keep what is usual."""


def _without_nothing(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings that keep what is usual do not say so: the file is the same as without the key."""
    settings = {**settings, "tasking": in_mode(settings["tasking"])}
    fields = CellSettings.model_fields
    usual = {key: fields[key].default for key in _UNSAID}
    usual["dynamics"] = Dynamics().model_dump()
    usual["communication"] = Communication().model_dump()
    said = {key: value for key, value in settings.items() if value != usual.get(key, ...)}
    for section, unsaid in _SAID_IF_UNUSUAL.items():
        said[section] = {
            key: value for key, value in settings[section].items() if value != unsaid.get(key, ...)
        }
    return said


SCHEDULE_KEYS = (
    "slot_minutes",
    "observers_per_target",
    "slew_deg_s",
    "settle_s",
    "horizon_epochs",
    "bound_steps",
)
"""Keys of `task2.tasking` that say how observers are scheduled within an interval."""

_SAID_IF_UNUSUAL = {
    "sensor": {"photon_noise": None},
    "batch": {
        key: value
        for key, value in Batch().model_dump().items()
        if key in ("noise_freedom", "most_searches", "unknowns")
    },
    "body": {"materials": None, "table": None},
    "tasking": {
        "detection": "sphere",
        "learned": Detection().model_dump(),
        **{key: Tasking.model_fields[key].default for key in SCHEDULE_KEYS},
    },
    "process_noise": {"acceleration_m2_s3": 0},
}
"""Keys of sections that are left out of settings where they keep what is usual."""


def true_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """`material`, `body`, `sensor` and the keys of `truth` alone, as they truly are."""
    believed = {key: settings[key] for key in ("material", "body", "sensor")}
    usual = {
        "reflection": REFLECTION_LAWS[0],
        "angular_acceleration_deg_h2": [0, 0, 0],
        "spread": {},
    }
    return merged({**believed, **usual}, settings["truth"])


def has_architecture(scenario: str, architecture: str) -> bool:
    """The paper publishes architectures for its own scenarios alone."""
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
    """Scenario and architecture of a variant: its own, else those of all variants."""
    variants = task2["variants"]
    own = variants["cells"][name]
    return (
        own.get("scenario", variants["scenario"]),
        own.get("architecture", variants["architecture"]),
    )


def variant_cells(task2: Mapping[str, Any]) -> list[Cell]:
    """The cells with changed settings; by the first estimator where none is named."""
    return [
        Cell(scenario, architecture, estimator, int(n), task2["interval_minutes"], name)
        for name, variant in task2["variants"]["cells"].items()
        for scenario, first, counts in _places(task2, name)
        for architecture in dict.fromkeys([first, *variant.get("other_architectures", ())])
        if has_architecture(scenario, architecture)
        for estimator in variant.get("estimators", task2["estimators"][:1])
        for n in counts
    ]


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
    """All cells of `task2`: sweeps, variants, and what these are compared with, each once."""
    changed = variant_cells(task2)
    plain = [cell._replace(variant="") for cell in changed]
    return list(dict.fromkeys([*grid_cells(task2), *plain, *changed]))


def most_alike(task2: Mapping[str, Any]) -> int:
    """The largest number of cells of `task2` that differ in their architecture alone."""
    alike = Counter(cell._replace(architecture="") for cell in campaign_cells(task2))
    return max(alike.values(), default=0)


def is_multiple(value: float, step: float) -> bool:
    """Whether a time is a whole number of steps, one at least."""
    ratio = value / step
    return (
        ratio <= MOST_STEPS
        and math.isclose(ratio, round(ratio), rel_tol=0.0, abs_tol=1e-9)
        and round(ratio) >= 1
    )


def check_cell(cell: Cell, settings: Mapping[str, Any], available: int = TRACKED_TARGETS) -> None:
    """Refuse more targets than are available, an interval that is no multiple of the step, and
    noise that the estimator cannot take."""
    targets, interval_minutes = cell.targets, cell.interval_minutes
    if not 1 <= targets <= available:
        raise ConfigurationError(
            f"n_T = {targets} (nt{targets} in the file name): there are {available} targets; "
            f"choose 1 .. {available}"
        )
    step = settings["step_s"]
    if not is_multiple(60.0 * interval_minutes, step):
        raise ConfigurationError(
            f"tasking interval of {interval_minutes} min (dt{interval_minutes} in the file name) "
            f"is no multiple of 'task2.step_s' = {step} s: choose another interval or step"
        )
    noise = settings.get("process_noise", {})
    for key in ("attitude_deg", "angular_velocity_deg_h"):
        if cell.estimator == "batch" and noise.get(key, 0.0) > 0.0:
            variant = f" of the variant {cell.variant!r}" if cell.variant else ""
            raise ConfigurationError(
                f"configuration key 'task2.process_noise.{key}' = {noise[key]}{variant}: the batch "
                "estimator takes the rotation as free of noise; set it to 0, or window_hours and "
                "memory_hours of 'task2.batch' in its place"
            )


def wanted_body(body: Mapping[str, Any], source: str = "task2.body") -> WantedBody:
    """What a section `body` asks for, but for its table; `source` is its key, for messages."""
    return WantedBody(
        body["shape"],
        body["radius_m"],
        body["metres_per_unit"],
        tuple(body["stretch"]),
        body.get("materials"),
        None if body.get("inertia") is None else tuple(body["inertia"]),
        source,
    )


def body_files(settings: Mapping[str, Any]) -> list[str]:
    """Meshes and tables of bodies a cell depends on, believed and true, each once."""
    found: list[str] = []
    for body in (settings["body"], true_settings(settings)["body"]):
        shapes, table = [body["shape"]], body.get("table")
        if table is not None:
            found.append(table)
            shapes += [each.shape for each in load_body_table(table).values()]
        found += [shape for shape in shapes if shape != ICOSAHEDRON and shape not in MODELS]
    return list(dict.fromkeys(found))
