"""The checked configuration, the results folder and the wildcards, which every stage uses."""

import os
import re
import shlex
import sys
from functools import cache
from pathlib import Path

from cislunar.architecture.published import PUBLISHED
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.families import sweep_points, swept_cells, with_families
from cislunar.campaign.settings.preflight import (
    check_inputs,
    check_orbits,
    check_request,
    crowded_objectives,
)
from cislunar.campaign.settings.reading import merged, typed, with_types
from cislunar.campaign.settings.scenarios import (
    in_study,
    information_of,
    longest_horizon,
    orbits_of,
    scenario_settings,
    shared_dataset,
    tracked_count,
    tracked_epoch,
)
from cislunar.campaign.settings.cell_settings import cell_files, cell_settings, replay_settings
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.cells import Cell, check_cell, estimator_names
from cislunar.campaign.settings.tracking_checks import shortened_intervals
from cislunar.runtime.worker_client import offer_worker
from cislunar.runtime.kernels import drop_stale_kernels
from cislunar.errors import CislunarError

try:
    config.update(check_campaign(with_types(config)))
    check_inputs(config)
    config.update(in_study(config))
    # with the variants; and with the variants and the scenarios of sweeps
    CAMPAIGN = with_families({**config, "sweeps": {}})
    STUDY = with_families(config)
    if workflow.is_main_process:
        check_orbits(STUDY)
        for warning in shortened_intervals(STUDY):
            print(f"warning: 'task2': {warning}", file=sys.stderr)
        if crowded := crowded_objectives(STUDY):
            # importing it takes seconds, and few studies need it
            from cislunar.campaign.architectures.objectives import check_orbit_slots

            check_orbit_slots(STUDY, crowded)
    TRACKED_COUNT = {name: tracked_count(STUDY, name) for name in STUDY["scenarios"]}
except CislunarError as error:
    # not an exception, to which Snakemake would add lines
    raise SystemExit(f"error: {error}\n(see config/README.md)") from None

if workflow.is_main_process:
    drop_stale_kernels()
offer_worker(workflow.is_main_process)


onstart:
    # Snakemake (9.27) repeats its search for jobs that the rate limit allows one second after each
    # search, and each finished job starts another such chain: after some hundred jobs it does little
    # else. Jobs on the cores of one machine need no such limit.
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None


RESULTS = config["results"].rstrip("/")
SCENARIOS = list(config["scenarios"])
ARCHITECTURE = config["architecture"]
TASK2 = CAMPAIGN["task2"]
# Without optimizers, everything that rests on the candidate orbits is omitted.
OPTIMIZERS = ARCHITECTURE["optimizers"]
# Without a scenario of the paper there is no comparison with it.
OF_THE_PAPER = bool(OPTIMIZERS) and any(scenario in PUBLISHED for scenario in SCENARIOS)
# Reduced to --cores by Snakemake, and defined for commands without --cores, such as --report.
ALL_CORES = os.cpu_count()
SEARCHES = ["tpe", "random", "atpe"]
OBSERVERS = config["observers"]
DESIGNS = ARCHITECTURE["designs"]
FRONTS = ARCHITECTURE["objective_fronts"]
RUNS = range(ARCHITECTURE["runs"])
OWN_STATIC = [name for name, entry in STUDY["scenarios"].items() if "static_targets" in entry]
SAMPLED = [name for name in STUDY["scenarios"] if name not in OWN_STATIC]


def any_of(names):
    """A pattern for wildcards: one of the given names; it matches nothing if there are none."""
    return "|".join(map(re.escape, names)) or "(?!)"


KNOWN_WILDCARDS = {
    "scenario": list(STUDY["scenarios"]),
    "architecture": [*SEARCHES, "exact", "published", *OBSERVERS, *DESIGNS],
    "estimator": estimator_names(TASK2),
    "variant": list(STUDY["task2"]["variants"]["cells"]),
    "sweep": list(config["sweeps"]),
}


wildcard_constraints:
    scenario=any_of(STUDY["scenarios"]),
    method="|".join(SEARCHES),
    observers=any_of(OBSERVERS),
    design=any_of(DESIGNS),
    front=any_of(FRONTS),
    labels="family_position|index|stability_rank|categorical",
    run=r"\d+",
    architecture="[A-Za-z][A-Za-z0-9-]*",
    estimator="|".join(estimator_names(TASK2)),
    n=r"[1-9]\d*",
    minutes=r"[1-9]\d*",
    variant="[a-z][a-z0-9.-]*",
    changed="(_[a-z][a-z0-9.-]*)?",
    realization=r"\d+",


def settings(*keys):
    """The slice of the configuration a rule depends on."""
    return {key: CAMPAIGN[key] for key in keys}


def settings_in(scenario, *keys):
    """The slice of the configuration that applies to a scenario."""
    own = scenario_settings(STUDY, scenario)
    return {key: own.get(key, config[key]) for key in keys}


def settings_of(*keys):
    """The slice of the configuration that applies to the scenario of a job."""
    return lambda wildcards: settings_in(wildcards.scenario, *keys)


def sampling_of(wildcards):
    """Settings of the sampled static targets of the scenario of a job."""
    return settings_in(wildcards.scenario, "targets")["targets"]


def results(path):
    """A path in the results folder."""
    return f"{RESULTS}/{path}"


def log_of(path):
    """The log file of a result."""
    return f"{RESULTS}/logs/{path}.log"


def benchmark_of(path):
    """The file with a job's time and memory; its path begins with the name of the rule.

    The job writes it, because Snakemake would measure the process that waits for the worker.
    """
    return f"{RESULTS}/benchmarks/{path}.tsv"


def figure_files(name, caption):
    """A figure as PNG, which is in the report, and as PDF."""
    caption = f"../report/figure_{caption}.rst"
    path = results(f"figures/{name}")
    return {"png": report(f"{path}.png", caption, category="Figures"), "pdf": f"{path}.pdf"}


def table_file(name, caption=""):
    """A table in the report; by default its caption has the name of the table."""
    caption = f"../report/{caption or name}.rst"
    return report(results(f"tables/{name}.csv"), caption, category="Tables")


def shared(name, scenario=None):
    """A data set that scenarios with the same settings share; by default that of a job's scenario."""
    if scenario is None:
        return lambda wildcards: shared(name, wildcards.scenario)
    return results(shared_dataset(STUDY, scenario, name))


def ephemeris_refined(scenario):
    """Whether the architectures of a scenario are chosen in ephemeris dynamics."""
    own = settings_in(scenario, "visibility")["visibility"]
    return own.get("dynamics") == "ephemeris"


def sky(scenario=None, architecture=""):
    """Positions of the Sun, in ephemeris dynamics also of observers; by default for a job."""
    if scenario is None:
        return lambda wildcards: sky(wildcards.scenario, wildcards.get("observers", ""))
    if not ephemeris_refined(scenario):
        return shared("ephemeris/sun", scenario)
    if architecture in OBSERVERS:
        return results(f"orbits/paths_{scenario}_{architecture}.nc")
    return shared("orbits/paths", scenario)


def path_settings(wildcards):
    """Settings on which the trajectories of observers in ephemeris dynamics depend."""
    own = settings_in(wildcards.scenario, "epoch_jd", "visibility", "task2")
    return own | {"dynamics": own.pop("task2")["dynamics"]}


def in_cr3bp(scenario, what):
    """Refuse results of the CR3BP for a scenario whose architectures are chosen in ephemeris dynamics."""
    if ephemeris_refined(scenario):
        raise SystemExit(
            f"error: scenario {scenario} has visibility.dynamics = 'ephemeris', but {what} "
            f"available only in the CR3BP; omit {scenario} there, or set visibility.dynamics to "
            "'cr3bp'"
        )


def readings_settings(*keys):
    """The configuration of the scenario that is repeated with each reading of the paper."""
    scenario = ARCHITECTURE["readings"]["scenario"]
    in_cr3bp(scenario, "architecture.readings is")
    return settings_in(scenario, *keys)


def orbits_file(architecture):
    """The file of orbits to which an architecture refers."""
    return results(orbits_of(architecture, architecture in OBSERVERS))


def observer_orbits(wildcards):
    """The file of orbits to which the architecture of a job refers."""
    return orbits_file(wildcards.architecture)


def optimizers_of(scenario):
    """The optimizers of a scenario; the paper publishes architectures only for its own scenarios."""
    return [o for o in OPTIMIZERS if o != "published" or scenario in PUBLISHED]


ARCHITECTURES = [(scenario, name) for scenario in SCENARIOS for name in optimizers_of(scenario)]
ARCHITECTURE_FILES = [results(f"architecture/{place}/{name}.nc") for place, name in ARCHITECTURES]
"""Every architecture of every scenario."""


def cell_of(wildcards):
    """The cell of a job, or of one of its realizations."""
    return Cell(
        wildcards.scenario,
        wildcards.architecture,
        wildcards.estimator,
        int(wildcards.n),
        int(wildcards.minutes),
        wildcards.get("variant", wildcards.get("changed", "")[1:]),
    )


@cache
def settings_of_cell(cell):
    """Settings of a cell, which several jobs need and each asks for several times."""
    try:
        chosen = cell_settings(settings_in(cell.scenario, "task2")["task2"], cell.variant)
        check_cell(cell, typed(chosen, CellSettings), TRACKED_COUNT[cell.scenario])
    except CislunarError as error:
        raise SystemExit(f"error: {error}") from None
    return chosen


def tracking_settings(wildcards):
    """Settings of a cell, refused before anything runs if the cell is impossible."""
    return settings_of_cell(cell_of(wildcards))


def kept_realizations(wildcards):
    """Outputs of the realizations of a cell, where each realization is a job of its own."""
    if not TASK2["realization_jobs"]:
        return []
    count = tracking_settings(wildcards)["seeds"]
    return [results(f"{cell_of(wildcards).path}.checkpoint/{k}.kept") for k in range(count)]


@cache
def mesh_of_cell(cell):
    """Mesh files of the targets of a cell, which are read from its tables."""
    return cell_files(settings_of_cell(cell))


def tracking_mesh(wildcards):
    """Mesh files of the targets, if they have any."""
    return mesh_of_cell(cell_of(wildcards))


def tracking_bodies(wildcards):
    """Ephemerides of the bodies, for ephemeris dynamics or ground stations."""
    return bodies_for(wildcards.scenario, tracking_settings(wildcards))


def bodies_for(scenario, chosen):
    """Ephemerides of the bodies, if the settings of a cell require them."""
    among = chosen.get("dynamics", {}).get("truth") == "ephemeris"
    return shared("ephemeris/bodies", scenario) if among or chosen.get("stations") else []


def flown_settings(wildcards):
    """Settings on which the refined orbits of an architecture's satellites depend."""
    own = settings_in(wildcards.scenario, "epoch_jd", "visibility", "task2")
    dynamics = own["task2"]["dynamics"]
    dynamics = {**dynamics, "filter": "cr3bp", "srp": {**dynamics["srp"], "assumed_factor": 1}}
    return {key: own[key] for key in ("epoch_jd", "visibility")} | {"dynamics": dynamics}


def tracking_flown(wildcards):
    """Refined orbits of the observers of a cell, if it has the true dynamics of its scenario."""
    own = tracking_settings(wildcards).get("dynamics", {})
    usual = flown_settings(wildcards)["dynamics"]
    if not own or (own["truth"], own["observers"]) != ("ephemeris", "refined"):
        return []
    same = {**own, "filter": "cr3bp", "srp": {**own["srp"], "assumed_factor": 1}} == usual
    return results(f"orbits/flown_{wildcards.scenario}_{wildcards.architecture}.nc") if same else []


def comparison_settings(wildcards):
    """Settings of the cells in which tasking methods are compared."""
    return cell_settings(settings_in(wildcards.scenario, "task2")["task2"])


def objective_settings(wildcards, entry=None):
    """Settings on which an architecture by an objective depends; `entry` is a design or a front."""
    in_cr3bp(wildcards.scenario, "architecture.designs, objective_fronts and generalization are")
    own = settings_in(wildcards.scenario, "epoch_jd", "propagator", "visibility")
    own |= {key: ARCHITECTURE[key] for key in ("slots", "max_satellites")}
    if entry is None or entry["objective"] in ("information", "attitude"):
        information = information_of(entry or {}, ARCHITECTURE)
        own |= {"information": information, "cell": comparison_settings(wildcards)}
    if entry is not None and entry.get("method") in ("tpe", "random"):
        search = ("labels", "early_stop", "max_evaluations", "sampler")
        own |= {key: ARCHITECTURE[key] for key in search}
    return own


def objective_mesh(wildcards, entry=None):
    """Mesh files of the moving targets, if their brightness matters and they have any."""
    if entry is not None and entry["objective"] not in ("information", "attitude"):
        return []
    return cell_files(comparison_settings(wildcards))


def fronts_of(scenario):
    """The fronts by objective of a scenario."""
    return [
        results(f"architecture/{scenario}/fronts/{name}.nc")
        for name, front in FRONTS.items()
        if scenario in front["scenarios"]
    ]


def designs_of(scenario):
    """The designs of a scenario."""
    return [name for name, each in DESIGNS.items() if scenario in each.get("scenarios", [scenario])]


def judged_architectures(scenario):
    """Every architecture of a scenario that is evaluated by all objectives."""
    return [*optimizers_of(scenario), *designs_of(scenario), *OBSERVERS]


# Texts that Snakemake and its jobs write on Ctrl-C, but not when a job fails.
INTERRUPTED = ("on user request", "SIGINT", "exit status 130", "SIGTERM", "exit status 143")


onerror:
    said = "".join(Path(each).read_text(errors="replace") for each in log)
    if any(words in said for words in INTERRUPTED):
        print(
            f"\nInterrupted. What had finished is kept in {RESULTS}; unfinished results are not. The "
            "messages above come from the jobs that were stopped. To go on from there:\n"
            f"  {shlex.join(['snakemake', *sys.argv[1:]])}"
        )
    else:
        print(
            "\nNot every job has finished. Finished results are kept. Correct what the messages above "
            f"name (each job has a log in {RESULTS}/logs), then run the same command again: it makes "
            "the remaining results."
        )


SWEEPS = config["sweeps"]
SWEPT_CELLS = {sweep: swept_cells(config, sweep) for sweep in SWEEPS}
SWEEP_POINTS = {sweep: sweep_points(config, sweep) for sweep in SWEEPS}


def swept_scenarios(wildcards):
    """The scenarios that a sweep adds, one for each value; none if it changes only the tracking."""
    return [point.scenario for point in SWEEP_POINTS[wildcards.sweep] if not point.variant]


SURVEYS = {name: dict(survey) for name, survey in STUDY["surveys"].items()}


def survey_of(wildcards):
    """The survey of a job, by its name."""
    return SURVEYS[wildcards.survey]


def survey_settings(wildcards):
    """The survey of a job without its label, which does not change the realizations."""
    return {key: value for key, value in survey_of(wildcards).items() if key != "label"}


def survey_cell(wildcards):
    """Settings of the cells of a survey's scenario, with the changes of the survey."""
    chosen = settings_in(survey_of(wildcards)["scenario"], "task2")["task2"]
    return merged(cell_settings(chosen), survey_of(wildcards)["cell"])


def survey_ephemeris(wildcards):
    """Whether a survey is in ephemeris dynamics."""
    truth = survey_cell(wildcards).get("dynamics", {}).get("truth")
    return survey_of(wildcards)["ephemeris"] or truth == "ephemeris"


def survey_file(pattern):
    """An input of a survey, by its scenario and architecture."""
    return lambda wildcards: results(pattern.format(**survey_of(wildcards)))


@cache
def inputs_of_study(name):
    """A study and the files it names; a fault is refused before a job removes earlier results."""
    from cislunar.study.settings import study_files

    path = f"config/studies/{name}.yaml"
    try:
        if workflow.is_main_process:
            # importing it takes seconds, and only a requested study needs it
            from cislunar.study.study_file import read_study

            read_study(path)
        return study_files(path)
    except CislunarError as error:
        raise SystemExit(f"error: {error}") from None
