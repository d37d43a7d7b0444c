"""Every setting of the campaign, stated once: type, range, unit, the paper's value, meaning.

Where the paper gives a value, the campaign has to state one (``config/config.yaml`` does); what it
leaves open has its default here. The schema for editors, the tables of ``config/README.md``, every
message and what the library is handed are made from these classes.
"""

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, WithJsonSchema, create_model

from cislunar.campaign.settings.architecture_tree import Architecture, Sampler, Search
from cislunar.campaign.settings.cell_tree import CellChange, CellSettings
from cislunar.campaign.settings.fields import (
    Count,
    Date,
    Flag,
    NotNegative,
    Number,
    Partial,
    Positive,
    Section,
    Text,
    number,
    partial,
    setting,
    several,
    whole,
)
from cislunar.campaign.settings.observing.sensor_tree import Exclusion

# fmt: off

FAMILIES = (
    *("Butterfly_N", "Butterfly_S", "Dragonfly_N", "Dragonfly_S", "Halo_L1_N", "Halo_L1_S"),
    *("Halo_L2_N", "Halo_L2_S", "Halo_L3_N", "Halo_L3_S", "Lyap_L1", "Lyap_L2", "Lyap_L3"),
)
Center = Literal["moon", "earth", "barycenter", "L1", "L2", "L3", "L4", "L5"]
SCENARIO_NAME, SWEEP_NAME = "^[A-Za-z][A-Za-z0-9.-]*$", "^[a-z][a-z0-9-]*$"
VARIANT_NAME = "^[a-z][a-z0-9.-]*$"
ScenarioName = Annotated[str, Field(pattern=SCENARIO_NAME)]
SweepName = Annotated[str, Field(pattern=SWEEP_NAME)]
VariantName = Annotated[str, Field(pattern=VARIANT_NAME)]
TargetCounts = several(whole(ge=1))
CountsByScenario = dict[str, TargetCounts]
Estimators = Annotated[several(Literal["mukf", "batch"]), Field(min_length=1)]


class Ephemeris(Section):
    kernel: Text = setting(
        "`de421` (the file of the package skyfield-data) or the path of any SPK file that has "
        "Sun, Earth and Moon", paper="SPICE", default="de421")
    step_minutes: number(gt=0, le=60) = setting(
        "spacing of the samples in `ephemeris/sun.nc`; read linearly in between", "min", default=10)


class KeepOut(Section):
    perilune_altitude_km: NotNegative = setting(
        "least altitude over the Moon (extent `keep_out`)", "km", default=100)
    perigee_altitude_km: NotNegative = setting(
        "least altitude over the Earth (extent `keep_out`)", "km", default=200)


_COUNTS = {name: (whole(ge=0, le=500), setting("")) for name in FAMILIES}
_Members = create_model("Members", __base__=Section, **_COUNTS)


class Orbits(Section):
    extent: Literal["keep_out", "catalog"] = setting(
        "`keep_out`: families end where they meet a body; `catalog`: they go as far as published "
        "catalogues list them, through the bodies", default="keep_out")
    keep_out: KeepOut = KeepOut()
    members: _Members = setting(
        "orbits of each of the 13 families; 0 leaves a family out",
        paper="about 23, 302 in all", name="FAMILY")


class Targets(Section):
    missions: Text = setting("table with the columns `mission` and `jacobi`", "path", "64 missions")
    centers: Annotated[several(Center), Field(min_length=1)] = setting(
        "centres of the angular grids", default=["moon", "earth"])
    region: Literal["moon", "earth", "bodies", "all"] = setting(
        "which part of the region within a zero-velocity surface: the component of the `moon`, of "
        "the `earth`, of both `bodies`, or `all`", default="moon")
    angular_step_deg: number(ge=0.1, le=90) = setting(
        "step in longitude and latitude", "deg", "equiangular", default=15)
    radial_points: whole(ge=1, le=10_000) = setting("points along each ray", default=8)
    radial_step_km: number(ge=1) | None = setting(
        "length of a radial step in place of `radial_points`; null = not used", "km", default=None)
    outer_radius_km: number(gt=384_400, le=10_000_000) = setting(
        "distance from the barycentre beyond which nothing is sampled", "km", default=700_000)
    seeding: Literal["k-means++", "greedy k-means++", "random"] = setting(
        "how k-means is seeded; see `cislunar/targets/clustering.py`",
        paper="k-means", default="greedy k-means++")


class Visibility(Section):
    duration_days: number(gt=0, le=36_525) = setting("horizon", "d", "30")
    step_hours: Positive = setting("spacing of the evaluation times (721 of them)", "h", "1")
    limiting_magnitude: Number = setting("a target must be brighter", "mag", "18")
    target_radius_m: Positive = setting("radius of the spherical targets", "m", "1")
    diffuse_reflection_coefficient: Positive = setting(
        "C_d of the sphere; 1 brings out the paper's J, see `docs/deviations.md`", default=1)
    exclusion_deg: Exclusion = setting("")
    eclipse: Flag = setting(
        "true: targets dim in the penumbra of Earth and Moon, and cannot be seen in the umbra",
        paper="not in the paper", default=False)
    dynamics: Literal["cr3bp", "ephemeris"] = setting(
        "where observers and bodies are while architectures are chosen: as in the `cr3bp`, or "
        "Earth, Moon and Sun where they are and observers as `task2.dynamics` has them; static "
        "targets rest in the frame of the instant, and J is the only objective (docs/dynamics.md)",
        paper="cr3bp", default="cr3bp")


def _values(value: Any) -> Any:
    """Values of a family: a list of different ones, or their variants' names with them."""
    simple = isinstance(value, list) and all(isinstance(v, int | float | str) for v in value)
    if not value or not (simple or isinstance(value, dict)):
        raise ValueError("must be a list of numbers, texts or true and false, or name: value")
    if simple and len(set(value)) < len(value):
        raise ValueError("holds a value twice")
    for name in () if simple else value:
        if not re.match(VARIANT_NAME, name):
            raise ValueError(f"{name!r} is no name of a variant, like {VARIANT_NAME}")
    return value


Values = Annotated[Any, AfterValidator(_values), WithJsonSchema({"type": ["array", "object"]})]


def _optional(meaning: str, unit: str = "") -> Any:
    """A key that may be left out."""
    return setting(meaning, unit, default=None)


class Family(Partial):
    """One key with values, each of which makes a variant or a scenario."""

    scenario: str = _optional("scenario that is varied; left out: that of all variants")
    architecture: Architecture = _optional("whose observers track; left out: those of all variants")
    targets: TargetCounts = _optional("numbers of targets that are tracked", "1")
    estimators: Estimators = _optional("estimators; left out: the first of `task2.estimators`")
    key: Text = _optional("dotted key of a cell that takes `values`, such as `truth.body.inertia`")
    values: Values = _optional("its values by the names of the variants")


class VariantFamily(Family):
    """A family that may also be stated as named changes, or as combinations of variants."""

    other_architectures: several(Architecture) = _optional(
        "further architectures whose observers track too")
    other_scenarios: dict[ScenarioName, TargetCounts] = setting(
        "further scenarios in which the same observers track, with numbers of targets", "1",
        default=None, name="{scenario}")
    changes: dict[VariantName, CellChange] = setting(
        "in place of `key` and `values`: settings that differ, in the form of the keys above, by "
        "the names of the variants", default=None, name="")
    combine: dict[VariantName, several(VariantName)] = setting(
        "in place of both or beside them: variants that another one is added to; each is called "
        "`{one of them}-{variant}`", default=None, name="")


class Sweep(Family):
    """A family whose values are compared in a table and a figure of their own."""

    scenario: str = setting("scenario that is varied")
    architecture: Architecture = setting("architecture that is compared")
    targets: TargetCounts = _optional(
        "numbers of moving targets that are tracked; empty or left out for a sweep of "
        "architectures alone", "1")
    estimators: Estimators = _optional("estimators; left out: `task2.estimators`")
    key: Text = setting(
        "dotted key within `scenarios.NAME`, such as `settings.visibility.limiting_magnitude`, "
        "`settings.task2.sensor.magnitude_noise`, `targets`, `tracked`; `settings.task2` for "
        "values that set several keys of a cell")
    values: Values = setting(
        "its values. Of `settings.task2`, each is a variant of the scenario's cells "
        "(`_{sweep}-{value}.nc`); else a scenario of its own (`{scenario}-{sweep}-{value}`), with "
        "its own architecture")
    label: Annotated[str, Field(min_length=1, max_length=80)] = _optional(
        "what the values are, with their unit, below the figure; the key if left out")


class Variants(Section):
    scenario: str | None = setting(
        "where settings are changed, unless a family says otherwise; null: nowhere", default=None)
    architecture: Architecture = setting("whose observers track there", default="published")
    only: several(VariantName) | None = setting(
        "variants that have cells; null: all. Any cell can be had with any variant by its name, "
        "`nt50_dt60_{variant}.nc`", default=None)
    targets: TargetCounts | None = setting(
        "their numbers of targets in place of the families' own; null: those", "1", default=None)
    pooled: several(VariantName) = setting(
        "variants that only set another day, or other targets: their realizations, and those of "
        "each `{variant}-{one of them}`, count as further ones of what they change, in "
        "`tables/pooled.csv` and `figures/pooled.png`", default=[])
    families: dict[VariantName, VariantFamily] = setting("", default={}, name="{family}")


class Intervals(Section):
    minutes: several(Count) = setting(
        "tasking intervals of the second sweep", "min", "30, 60, 120, 180, 240")
    target_counts: CountsByScenario = setting(
        "numbers of targets of the second sweep", "1", "A 20 and 50, B 33", name="{scenario}")


class TaskingComparison(Section):
    scenario: str | None = setting("cells on which the tasking methods are compared; null: none")
    architecture: Architecture = setting("whose observers")
    targets: TargetCounts = setting("numbers of targets", "1")
    epochs: Annotated[several(whole(ge=0)), Field(min_length=1)] = setting(
        "tasking epochs compared, counted from 0", "1")
    runs: Count = setting("searches of each kind at each epoch", "1")
    evaluations: Annotated[several(Count), Field(min_length=1)] = setting(
        "budgets, each a search of its own with its own clock", "1", "5000")
    tpe_evaluations: Count = setting(
        "largest budget of TPE, whose time grows faster than its evaluations", "1", "5000")
    sampler: Sampler = setting(
        "who draws for TPE, as `architecture.sampler`", paper="Hyperopt", default="compiled")
    early_stop: Count = setting(
        "evaluations without progress after which a search ends", "1", "700")


class Task2(CellSettings):
    architectures: several(Architecture) = setting(
        "architectures of both sweeps", paper="the TPE result")
    estimators: Estimators = setting(
        "estimators; `mukf` is the paper's error-state multiplicative UKF", paper="mukf")
    interval_minutes: Count = setting(
        "tasking interval of the sweep over the number of targets, a multiple of the step",
        "min", "60")
    target_counts: CountsByScenario = setting(
        "numbers of monitored targets, at most 202 (or the rows of the scenario's own table)",
        "1", "A 20 .. 202, B 33 .. 202, C 43 .. 202", name="{scenario}")
    intervals: Intervals = setting("")
    other_architectures: dict[Architecture, CountsByScenario] = setting(
        "numbers of targets tracked by a further architecture, to set beside the others",
        "1", default={}, name="{architecture}.{scenario}")
    variants: Variants = Variants()
    realization_jobs: bool = setting(
        "each realization of a cell is a job of its own: for large cells, where there are more "
        "cores than cells", default=False)
    threads: whole(ge=1, le=1024) = setting(
        "cores of the job of a cell, which share its targets: for cells of thousands, where there "
        "are more cores than jobs", "1", default=1)
    tasking_comparison: TaskingComparison = setting("")


class Surroundings(Section):
    """What a scenario may set for itself."""

    epoch_jd: Date = setting(
        "initial epoch, UTC: a Julian date, or ISO 8601 like 2024-10-01T00:00:00 (kept as the "
        "Julian date)", "JD", "2460584.5 (2024-10-01)")
    ephemeris: Ephemeris = Ephemeris()
    targets: Targets = setting("")
    visibility: Visibility = setting("")
    task2: CellSettings = setting("")


class Scenario(Partial):
    targets: whole(ge=1, le=10_000_000) = setting(
        "clusters (static targets) of the scenario; the paper has A, B and C",
        paper="100, 2 000, 10 000", default=None)
    static_targets: Text = setting(
        "in place of `targets`: table of static targets (columns `id`, `x`, `y`, `z` or `x_km`, "
        "`y_km`, `z_km`; see `cislunar/targets/tables.py`)", "path", default=None)
    tracked: Text = setting(
        "moving targets in place of the 202 orbits: a CCSDS OEM (`*.oem`), rows of JPL's catalogue "
        "of periodic orbits, or a table: `id`, position as above, velocity "
        "`vx`, `vy`, `vz` or `vx_km_s`, `vy_km_s`, `vz_km_s`, at the epoch in the rotating frame; "
        "optional `period` or `period_days`, and `family`", "path", default=None)
    photometry: Literal["printed", "physical"] = _optional(
        "how bright targets are where `task2` does not say. `printed`: as the paper prints it, "
        "irradiance `4pi`, while tasking judges by a sphere of C_d = 0.5; `physical`, also where "
        "left out: irradiance `1/r^2`, and tasking judges by the sphere that returns as much light "
        "as the body's material")
    settings: partial(Surroundings) = _optional(
        "what the scenario sets otherwise: any of `epoch_jd`, `ephemeris`, `targets`, "
        "`visibility` and, of `task2`, the keys that set a cell, in the form they have here")


class Campaign(Surroundings):
    """The configuration of a campaign."""

    results: Text = setting(
        "folder of every result; another folder is another campaign", "path", default="results")
    seed: whole(ge=0) = setting("seed of all random numbers (each job derives its own stream)")
    propagator: Literal["dopri5", "dop853"] = setting(
        "how observers are propagated: `dopri5` (5(4) at 1e-10) or `dop853` (at 1e-13)",
        paper="dopri5")
    orbits: Orbits = setting("")
    observers: dict[Architecture, Text] = setting(
        "architecture of one's own: table of observers, each with `id` and either its state at the "
        "epoch (columns as of `scenarios.NAME.tracked`, optional `period_days`) or `family` and "
        "one of `jacobi`, `period_days`; optional `phase`, a share of the period; see "
        "`cislunar/orbits/observers.py`", "path", default={})
    scenarios: Annotated[dict[ScenarioName, Scenario | None], Field(min_length=1)] = setting(
        "static targets and all that is done with them; null leaves the scenario out, with all "
        "that refers to it", paper="A, B, C")
    sweeps: dict[SweepName, Sweep] = setting("", default={})
    architecture: Search = setting("")
    task2: Task2 = setting("")
