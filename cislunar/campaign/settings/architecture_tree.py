"""Settings of the search for architectures: optimizers, designs and fronts by objective.

See `cislunar.campaign.settings.tree`.
"""

from typing import Annotated, Literal

from pydantic import Field

from cislunar.campaign.settings.fields import (
    Count,
    NotNegative,
    Positive,
    Section,
    number,
    setting,
    several,
    whole,
)

# fmt: off

Optimizer = Literal["tpe", "random", "atpe", "exact", "published"]
ARCHITECTURE_NAME = "^[A-Za-z][A-Za-z0-9-]*$"
Architecture = Annotated[str, Field(pattern=ARCHITECTURE_NAME)]
Sampler = Literal["hyperopt", "compiled"]
Objective = Literal["coverage", "target-days", "longest-gap", "mean-gap", "mean-wait",
                    "information", "attitude", "J"]
Labels = Literal["family_position", "index", "stability_rank", "categorical"]


class Certificate(Section):
    within: number(ge=0, lt=1) = setting(
        "every architecture with J within this share of the optimum is listed", default=0.01)
    nodes: whole(ge=1) = setting(
        "after so many nodes of the tree the bound reached is reported instead of a proof",
        default=1_000_000)


class Front(Section):
    fewest: whole(ge=1) | None = setting(
        "least satellite total of the front of best J; null: `architecture.slots`", default=None)
    most: whole(ge=1) | None = setting(
        "greatest satellite total of the front; null: 60, if `architecture.slots` and "
        "`architecture.max_satellites` allow it", default=None)
    restarts: whole(ge=0) = setting(
        "random starts for each total, beside the solution of the total before", default=4)


class LabelComparison(Section):
    scenario: str | None = setting("scenario on which ways of labelling are compared", default="A")
    labels: several(Labels) = setting(
        "ways compared with `architecture.labels`",
        default=["family_position", "index", "categorical"])


class Readings(Section):
    scenario: str | None = setting(
        "scenario rerun under each reading of the paper (`tables/readings_architecture.csv`)",
        default="A")


class Information(Section):
    targets: whole(ge=1, le=100_000) = setting(
        "moving targets of the objectives `information` and `attitude`, at most those of the "
        "scenario", "1", default=100)
    target_seed: whole(ge=0) = setting(
        "chooses them, where on their orbits they start, and their attitudes; other than "
        "`task2.monitored_seed`, an architecture is not chosen on the targets it is judged by",
        "1", default=1)
    windows: whole(ge=1, le=1000) = setting(
        "windows spread over `visibility.duration_days`", "1", default=10)
    window_hours: Positive = setting("length of each", "h", default=24)
    step_hours: Positive = setting(
        "time between the looks that are computed, each for all in a step", "h", default=1)
    brightness: Literal["sphere", "body"] = setting(
        "a look of `information` counts in full where the sphere is bright enough that tasking "
        "believes in, or by the share of attitudes in which the body is", default="body")
    attitudes: whole(ge=1, le=1000) = setting(
        "random attitudes of each target in each window", "1", default=1)


class Elsewhere(Section):
    scenario: str | None = setting(
        "scenario whose architectures by `information` are judged on other targets "
        "(`tables/objectives_elsewhere.csv`); null: none", default=None)
    satellites: several(Count) = setting("numbers of satellites", default=[20, 33])
    target_seeds: several(whole(ge=0)) = setting(
        "choose other sets of moving targets, as `information.target_seed` does", "1",
        default=[11, 12, 13])
    windows: whole(ge=1, le=1000) = setting("windows in which these are", "1", default=7)
    least: whole(ge=1) = setting(
        "classes of families with so many moving targets are left out of the choice in turn", "1",
        default=10)


class OwnInformation(Section):
    targets: Count | None = setting(
        "of a design, in place of `architecture.information.targets`", "1", default=None)
    windows: Count | None = setting("windows", "1", default=None)
    window_hours: Positive | None = setting("length of each", "h", default=None)
    halvings: whole(ge=1, le=5) | None = setting(
        "a sharper bound, that takes longer: linear also over the first half, quarter ... of "
        "greedy's choices, so many of them", "1", default=None)


class _Goal(Section):
    objective: Objective = setting(
        "what architectures are chosen for, see `docs/objectives.md`: `coverage` of target-hours, "
        "or of `target-days`; `longest-gap`, `mean-gap` or `mean-wait`; `information` about the "
        "orbits of moving targets, or about their `attitude`; `J`, in slots alone")
    phases: whole(ge=1, le=1000) | None = setting(
        "satellites stand each at one of so many phases of an orbit; null: in the paper's slots, "
        "`slots` orbits of up to `max_satellites` (not for `information` and `attitude`)",
        default=10)
    fold: whole(ge=1, le=8) = setting(
        "satellites that have to see a target for `coverage` and `target-days`", default=1)
    max_stability_index: number(ge=1) | None = setting(
        "orbits of a larger stability index are left out; null: none is", "1", default=2)
    max_station_keeping_m_s: NotNegative | None = setting(
        "and orbits that take more velocity a year, by `cislunar/orbits/station_keeping.py`; null: "
        "none", "m/s", default=None)


class Design(_Goal):
    objective: Objective | None = setting(
        "as of `objective_fronts`; left out with the method `chance`", default=None)
    satellites: Count = setting("number of satellites")
    method: Literal["certified", "tpe", "random", "chance"] = setting(
        "`certified`: search and bound; `tpe` and `random`: the paper's searches, at `phases` of "
        "their own, by `labels`, `early_stop` and `sampler`; `chance`: places drawn by chance",
        default="certified")
    evaluations: Count | None = setting(
        "evaluations of `tpe` and `random`; null: `max_evaluations`", default=None)
    information: OwnInformation = OwnInformation()
    sampler: Sampler | None = setting(
        "who draws for `tpe`; null: `architecture.sampler`", default=None)
    scenarios: several(str) | None = setting(
        "scenarios in which it is judged by every objective; null: all", default=None)
    copies: whole(ge=1, le=1000) = setting(
        "designs by random numbers of their own: `{design}-1`, `{design}-2` ..., for all of which "
        "`{design}` stands in lists of `other_architectures`", "1", default=1)


class ObjectiveFront(_Goal):
    scenarios: several(str) = setting("scenarios it is made for")
    satellites: Annotated[several(Count), Field(min_length=1)] = setting(
        "numbers of satellites", default=list(range(5, 61, 5)))


class Search(Section):
    optimizers: several(Optimizer) = setting(
        "how architectures are found; `atpe` needs the package lightgbm. `[]`: none is, and only "
        "what `task2`, `sweeps`, `designs` and `objective_fronts` name is made, such as "
        "`observers`",
        paper="tpe, random")
    slots: whole(ge=1, le=1000) = setting("distinct orbits of an architecture", paper="10")
    max_satellites: whole(ge=1, le=90) = setting("most satellites on one orbit", paper="10")
    max_evaluations: Count = setting("evaluations of a search", paper="10 000")
    early_stop: Count = setting("evaluations without improvement that end a search", paper="500")
    labels: Labels = setting(
        "how an orbit is labelled for Hyperopt; see `docs/deviations.md`", default="stability_rank")
    sampler: Sampler = setting(
        "who draws for `tpe`: Hyperopt, or the compiled sampler of the same algorithm "
        "(`cislunar/parzen.py`)", paper="Hyperopt", default="compiled")
    runs: whole(ge=1, le=1000) = setting(
        "searches with different random numbers; the best becomes the architecture, all make the "
        "spread", paper="1", default=20)
    restarts: whole(ge=1, le=1_000_000) = setting(
        "starts of the coordinate search (`exact`, `published`)", default=10)
    certificate: Certificate = Certificate()
    front: Front = Front()
    information: Information = Information()
    designs: dict[Architecture, Design] = setting("", default={}, name="{design}")
    objective_fronts: dict[Architecture, ObjectiveFront] = setting("", default={}, name="{front}")
    elsewhere: Elsewhere = Elsewhere()
    label_comparison: LabelComparison = LabelComparison()
    readings: Readings = Readings()
