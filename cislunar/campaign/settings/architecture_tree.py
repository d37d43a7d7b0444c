"""Settings of the search for architectures: optimizers, designs and fronts by objective."""

from typing import Annotated, Literal, get_args

from pydantic import Field

from cislunar.runtime import Count, NotNegative, Positive, Section, number, setting, several, whole
from cislunar.runtime.settings_words import pattern

# fmt: off

Optimizer = Literal["tpe", "random", "atpe", "exact", "published"]
ARCHITECTURE_NAME = pattern(
    "^[A-Za-z][A-Za-z0-9-]*$",
    f"one of {', '.join(get_args(Optimizer))}, or of `observers` or `architecture.designs` a name "
    "of letters, digits and hyphens, a letter first")
Architecture = Annotated[str, Field(pattern=ARCHITECTURE_NAME)]
Sampler = Literal["hyperopt", "compiled"]
Objective = Literal["coverage", "target-days", "longest-gap", "mean-gap", "mean-wait",
                    "search", "information", "attitude", "J"]
Labels = Literal["family_position", "index", "stability_rank", "categorical"]


class CertificateSettings(Section):
    within: number(ge=0, lt=1) = setting(
        "every architecture whose J is within this share of the optimum is listed", default=0.01)
    nodes: whole(ge=1) = setting(
        "maximum number of nodes of the search tree, after which the bound reached is reported in "
        "place of a proof", default=1_000_000)


class Front(Section):
    fewest: whole(ge=1) | None = setting(
        "minimum total number of satellites on the front of best J; null: `architecture.slots`",
        default=None)
    most: whole(ge=1) | None = setting(
        "maximum total number of satellites on the front; null: 60, within the limits of "
        "`architecture.slots` and `architecture.max_satellites`", default=None)
    restarts: whole(ge=0) = setting(
        "number of random starts for each total, in addition to the solution of the previous total",
        default=4)


class LabelComparison(Section):
    scenario: str | None = setting(
        "scenario in which ways of labeling are compared; null: none", default="A")
    labels: several(Labels) = setting(
        "ways of labeling that are compared with `architecture.labels`",
        default=["family_position", "index", "categorical"])


class Readings(Section):
    scenario: str | None = setting(
        "scenario that is rerun under each reading of the paper "
        "(`tables/readings_architecture.csv`); null: none", default="A")


class Information(Section):
    targets: whole(ge=1, le=100_000) = setting(
        "number of moving targets for the objectives `information` and `attitude`, at most those "
        "of the scenario", "1", default=100)
    target_seed: whole(ge=0) = setting(
        "seed that selects these targets, their initial phases and their attitudes. With a value "
        "other than `task2.monitored_seed`, the targets of the selection differ from those of the "
        "evaluation", "1", default=1)
    windows: whole(ge=1, le=1000) = setting(
        "number of windows, distributed over `visibility.duration_days`", "1", default=10)
    window_hours: Positive = setting("duration of each window", "h", default=24)
    step_hours: Positive = setting(
        "time between the observations that are computed, each of which represents all "
        "observations in a step", "h", default=1)
    brightness: Literal["sphere", "body"] = setting(
        "weight of an observation for `information`: full if the sphere that tasking assumes is "
        "bright enough (`sphere`), or the share of attitudes in which the body is (`body`)",
        default="body")
    attitudes: whole(ge=1, le=1000) = setting(
        "number of random attitudes of each target in each window", "1", default=1)


class Generalization(Section):
    scenario: str | None = setting(
        "scenario whose architectures by `information` are evaluated on other targets "
        "(`tables/objectives_generalization.csv`); null: none", default=None)
    satellites: several(Count) = setting("numbers of satellites", default=[20, 33])
    target_seeds: several(whole(ge=0)) = setting(
        "seeds that select other sets of moving targets, as `information.target_seed` does", "1",
        default=[11, 12, 13])
    windows: whole(ge=1, le=1000) = setting(
        "number of windows in which architectures are evaluated on other targets", "1", default=7)
    least: whole(ge=1) = setting(
        "each class of families with at least this number of moving targets is excluded from the "
        "selection in turn", "1", default=10)


class OwnInformation(Section):
    targets: Count | None = setting(
        "number of moving targets of a design, in place of `architecture.information.targets`",
        "1", default=None)
    windows: Count | None = setting(
        "number of windows, in place of `architecture.information.windows`", "1", default=None)
    window_hours: Positive | None = setting(
        "duration of each window, in place of `architecture.information.window_hours`", "h",
        default=None)
    halvings: whole(ge=1, le=5) | None = setting(
        "number of additional linearizations, over the first half, quarter ... of the greedy "
        "selection, for a tighter bound that takes longer", "1", default=None)


class _ObjectiveSection(Section):
    omitted = ("max_station_keeping_m_s",)

    objective: Objective = setting(
        "objective of the selection, see `docs/objectives.md`: `coverage` of target-hours or of "
        "`target-days`; `longest-gap`, `mean-gap` or `mean-wait`; `search` for undetected objects; "
        "`information` about the orbits of moving targets or about their `attitude`; `J`, in slots "
        "alone")
    phases: whole(ge=1, le=1000) | None = setting(
        "number of phases of each orbit, at most one satellite per phase; null: the paper's slots, "
        "`slots` orbits of up to `max_satellites` (not for `information` and `attitude`)",
        default=10)
    fold: whole(ge=1, le=8) = setting(
        "number of satellites that have to observe a target for `coverage`, `target-days` and "
        "`search`; three confirm an orbit of a survey",
        default=1)
    max_stability_index: number(ge=1) | None = setting(
        "maximum stability index of the candidate orbits; null: no limit", "1", default=2)
    max_station_keeping_m_s: NotNegative | None = setting(
        "maximum station-keeping velocity of the candidate orbits in a year, by "
        "`cislunar/orbits/station_keeping.py`; null: no limit", "m/s", default=None)


class Design(_ObjectiveSection):
    omitted = ("max_station_keeping_m_s", "scenarios")

    objective: Objective | None = setting(
        "objective, as for `objective_fronts`; left out with the method `chance`", default=None)
    satellites: Count = setting("number of satellites")
    method: Literal["certified", "tpe", "random", "chance"] = setting(
        "`certified`: search and bound; `tpe` and `random`: the paper's searches over orbit slots, "
        "with `labels`, `early_stop` and `sampler`; `chance`: random orbit slots",
        default="certified")
    evaluations: Count | None = setting(
        "maximum number of evaluations of `tpe` and `random`; null: `max_evaluations`",
        default=None)
    information: OwnInformation = OwnInformation()
    sampler: Sampler | None = setting(
        "sampler of `tpe`; null: `architecture.sampler`", default=None)
    scenarios: several(str) | None = setting(
        "scenarios in which the design is evaluated by every objective; null: all", default=None)
    copies: whole(ge=1, le=1000) = setting(
        "number of designs with different random numbers, `{design}-1`, `{design}-2` ..., all of "
        "which `{design}` denotes in lists of `other_architectures`", "1", default=1)


class ObjectiveFront(_ObjectiveSection):
    scenarios: several(str) = setting("scenarios for which the front is computed")
    satellites: Annotated[several(Count), Field(min_length=1)] = setting(
        "numbers of satellites", default=list(range(5, 61, 5)))


class Search(Section):
    optimizers: several(Optimizer) = setting(
        "optimizers of the architectures; `atpe` needs the package lightgbm. `[]`: none, and only "
        "the architectures that `task2`, `sweeps`, `designs` and `objective_fronts` name are made, "
        "such as those of `observers`", paper="tpe, random")
    slots: whole(ge=1, le=1000) = setting(
        "number of distinct orbits of an architecture", paper="10")
    max_satellites: whole(ge=1, le=90) = setting(
        "maximum number of satellites on an orbit", paper="10")
    max_evaluations: Count = setting("maximum number of evaluations of a search", paper="10,000")
    early_stop: Count = setting(
        "number of evaluations without improvement after which a search ends", paper="500")
    labels: Labels = setting(
        "way of labeling the orbits for Hyperopt; see `docs/deviations.md`",
        default="stability_rank")
    sampler: Sampler = setting(
        "sampler of `tpe`: Hyperopt, or the compiled sampler of the same algorithm "
        "(`cislunar/parzen.py`)", paper="Hyperopt", default="compiled")
    runs: whole(ge=1, le=1000) = setting(
        "number of searches with different random numbers; the best becomes the architecture, and "
        "all enter the statistics", paper="1", default=20)
    restarts: whole(ge=1, le=1_000_000) = setting(
        "number of starts of the coordinate search (`exact`, `published`)", default=10)
    certificate: CertificateSettings = CertificateSettings()
    front: Front = Front()
    information: Information = Information()
    designs: dict[Architecture, Design] = setting("", default={}, name="{design}")
    objective_fronts: dict[Architecture, ObjectiveFront] = setting("", default={}, name="{front}")
    generalization: Generalization = Generalization()
    label_comparison: LabelComparison = LabelComparison()
    readings: Readings = Readings()
