"""Sensor tasking and tracking: every cell, their statistics, and TPE against exact tasking."""

from cislunar.campaign.tracking.model_errors import model_errors
from cislunar.campaign.settings.cells import (
    FEWEST_RANKED,
    campaign_cells,
    most_alike,
    paper_cells,
    replayed_cell,
)

# Statistics and claims are computed twice: from the cells that the paper has, and from all.
EXTENTS = {"paper/": paper_cells(TASK2), "": campaign_cells(TASK2)}
CELLS = [results(cell.path) for cell in EXTENTS[""]]
SUMMARY = results("task2/summary.nc")
COMPARED = TASK2["tasking_comparison"]
REPLAYED = replayed_cell(TASK2)
CELL = "{scenario}/{architecture}/{estimator}/nt{n}_dt{minutes}"
WITH_ERRORS = [
    error for error in model_errors(TASK2) if TASK2["variants"]["cells"][error.variant]["targets"]
]
# Long tables are not in the report, which shows complete tables: they would be half of it.
# Tables that compare cells are made only if there are two kinds of cells.
COMPARING_TABLES = {}
if any(cell.variant for cell in EXTENTS[""]):
    COMPARING_TABLES["readings"] = results("tables/readings_tracking.csv")
if len(estimator_names(TASK2)) > 1:
    COMPARING_TABLES["estimators"] = results("tables/estimators.csv")


# Inputs of every cell.
TRACKED = {
    "architecture": results("architecture/{scenario}/{architecture}.nc"),
    "orbits": observer_orbits,
    "tracked": shared("orbits/tracked"),
    "sun": shared("ephemeris/sun"),
    "bodies": tracking_bodies,
    "flown": tracking_flown,
    "mesh": tracking_mesh,
}


# Long cells start first, so that no core is idle at the end: variants may use longer searches or
# more steps, and large cells take longer than small ones.
rule tracking_cell_variant:
    input:
        **TRACKED,
        realizations=kept_realizations,
    output:
        results(f"task2/{CELL}_{{variant}}.nc"),
    log:
        log_of("task2/{scenario}/{architecture}/{estimator}/nt{n}_dt{minutes}_{variant}"),
        times=benchmark_of(f"tracking_cell_variant/{CELL}_{{variant}}"),
    priority: 4
    conda:
        "../envs/cislunar.yaml"
    threads: TASK2["threads"]
    resources:
        mem_mb=2000,
    params:
        cell=lambda wildcards: list(cell_of(wildcards)),
        path=lambda wildcards: results(cell_of(wildcards).path),
        settings=tracking_settings,
        propagator=config["propagator"],
        seed=config["seed"],
    message:
        "Tracking {wildcards.n} targets, tasking every {wildcards.minutes} min, "
        "{wildcards.variant} ({wildcards.architecture}, scenario {wildcards.scenario})"
    script:
        "../scripts/tracking_cell.py"


use rule tracking_cell_variant as tracking_cell_large with:
    output:
        results(f"task2/{CELL}.nc".replace("{n}", "{n,[1-9][0-9][0-9]+}")),
    log:
        log_of("task2/{scenario}/{architecture}/{estimator}/nt{n}_dt{minutes}"),
        times=benchmark_of(f"tracking_cell_large/{CELL}"),
    priority: 3
    message:
        "Tracking {wildcards.n} targets, tasking every {wildcards.minutes} min "
        "({wildcards.architecture}, scenario {wildcards.scenario})"


use rule tracking_cell_large as tracking_cell_small with:
    output:
        results(f"task2/{CELL}.nc".replace("{n}", "{n,[1-9][0-9]?}")),
    log:
        log_of("task2/{scenario}/{architecture}/{estimator}/nt{n}_dt{minutes}"),
        times=benchmark_of(f"tracking_cell_small/{CELL}"),
    priority: 2


# With `task2.realization_jobs` each realization is a job, and the cell only collects them.
use rule tracking_cell_variant as tracking_realization with:
    input:
        **TRACKED,
    output:
        temp(touch(results(f"task2/{CELL}{{changed}}.nc.checkpoint/{{realization}}.kept"))),
    log:
        log_of(f"task2/{CELL}{{changed}}_{{realization}}"),
        times=benchmark_of(f"tracking_realization/{CELL}{{changed}}_{{realization}}"),
    priority: 5
    message:
        "Tracking {wildcards.n} targets, tasking every {wildcards.minutes} min, realization "
        "{wildcards.realization}{wildcards.changed} ({wildcards.architecture}, scenario "
        "{wildcards.scenario})"


# The cell of figures/replay.html again, with its first realization alone and more records.
use rule tracking_cell_variant as replay_cell with:
    input:
        **TRACKED,
    output:
        results(f"replay/{CELL}{{changed}}.nc"),
    log:
        log_of(f"replay/{CELL}{{changed}}"),
        times=benchmark_of(f"replay_cell/{CELL}{{changed}}"),
    priority: 1
    params:
        path=lambda wildcards, output: output[0],
        settings=lambda wildcards: replay_settings(tracking_settings(wildcards)),
    message:
        "Recording a realization for the replay: {wildcards.n} targets, tasking every "
        "{wildcards.minutes} min{wildcards.changed} ({wildcards.architecture}, scenario "
        "{wildcards.scenario})"


wildcard_constraints:
    extent=any_of(EXTENTS),


# Days and variants of an architecture share the refined orbits of its satellites.
use rule result as flown_orbits with:
    input:
        architecture=results("architecture/{scenario}/{architecture}.nc"),
        orbits=observer_orbits,
        bodies=shared("ephemeris/bodies"),
    output:
        results("orbits/flown_{scenario}_{architecture}.nc"),
    log:
        log_of("orbits/flown_{scenario}_{architecture}"),
        times=benchmark_of("flown_orbits/{scenario}_{architecture}"),
    priority: 6
    params:
        function="campaign.tracking.flown_dataset",
        progress="satellites",
        settings=flown_settings,
    message:
        "Refining the orbits of the satellites ({wildcards.architecture}, scenario "
        "{wildcards.scenario})"


use rule result as tracking_summary with:
    input:
        cells=lambda wildcards: [results(cell.path) for cell in EXTENTS[wildcards.extent]],
    output:
        results("task2/{extent}summary.nc"),
    log:
        log_of("task2/{extent}summary"),
        times=benchmark_of("tracking_summary/{extent}cells"),
    params:
        function="campaign.tracking.summary_dataset",
        metrics=True,
        cells=lambda wildcards: list(map(tuple, EXTENTS[wildcards.extent])),
        settings=settings("task2"),
        seed=config["seed"],
    message:
        "Computing the statistics of every cell"


rule tracking_tables:
    input:
        SUMMARY,
    output:
        **COMPARING_TABLES,
        tracking=results("tables/tracking.csv"),
    log:
        log_of("tables/tracking"),
    conda:
        "../envs/cislunar.yaml"
    message:
        "Writing the tables of tracking"
    script:
        "../scripts/tracking_tables.py"


use rule tracking_tables as tracking_table_of_paper with:
    input:
        SUMMARY.replace("task2/", "task2/paper/"),
    output:
        tracking=results("tables/paper/tracking.csv"),
    log:
        log_of("tables/paper/tracking"),


use rule result as pooled_table with:
    input:
        SUMMARY,
    output:
        table_file("pooled"),
    log:
        log_of("tables/pooled"),
    params:
        function="campaign.tracking.pooled_rows",
        pooled=list(config["task2"]["variants"]["pooled"]),
    message:
        "Pooling the realizations of all days and sets of targets"


use rule result as objective_ranks with:
    input:
        tracking=(
            rules.pooled_table.output[0]
            if config["task2"]["variants"]["pooled"]
            else rules.tracking_tables.output.tracking
        ),
        objectives=expand(rules.objectives_table.output, scenario=JUDGED),
    output:
        table_file("objective_ranks"),
    log:
        log_of("tables/objective_ranks"),
    params:
        function="campaign.tracking.rank_rows",
    message:
        "Ranking objectives by the tracking of their architectures"


use rule result as model_error_table with:
    input:
        SUMMARY,
    output:
        table_file("model_error"),
    log:
        log_of("tables/model_error"),
    params:
        function="campaign.tracking.model_error_rows",
        settings=settings("task2"),
    message:
        "Writing the table of model errors"


rule tasking_comparison_cell:
    input:
        architecture=results("architecture/{scenario}/{architecture}.nc"),
        orbits=observer_orbits,
        tracked=shared("orbits/tracked"),
        sun=shared("ephemeris/sun"),
        bodies=lambda wildcards: bodies_for(wildcards.scenario, comparison_settings(wildcards)),
        mesh=lambda wildcards: cell_files(comparison_settings(wildcards)),
    output:
        results("task2/tasking/{scenario}_{architecture}_nt{n}.nc"),
    log:
        log_of("task2/tasking/{scenario}_{architecture}_nt{n}"),
        times=benchmark_of("tasking_comparison_cell/{scenario}_{architecture}_nt{n}"),
    priority: 6
    conda:
        "../envs/cislunar.yaml"
    params:
        settings=comparison_settings,
        comparison=COMPARED,
        interval_minutes=TASK2["interval_minutes"],
        estimator=TASK2["estimators"][0],
        propagator=config["propagator"],
        seed=config["seed"],
    message:
        "Comparing tasking methods on {wildcards.n} targets "
        "({wildcards.architecture}, scenario {wildcards.scenario})"
    script:
        "../scripts/tasking_comparison_cell.py"


use rule result as tasking_comparison with:
    input:
        compared=expand(
            results("task2/tasking/{scenario}_{architecture}_nt{n}.nc"),
            scenario=COMPARED["scenario"],
            architecture=COMPARED["architecture"],
            n=COMPARED["targets"],
        ),
    output:
        results("task2/tasking_comparison.nc"),
    log:
        log_of("task2/tasking_comparison"),
    params:
        function="campaign.tracking.concatenate_comparisons",
    message:
        "Gathering the comparison of tasking methods"


rule tracking_claims:
    input:
        summary=rules.tracking_summary.output[0],
        comparison=rules.tasking_comparison.output[0] if COMPARED["scenario"] else [],
    output:
        results("tables/{extent}claims_tracking.csv"),
    log:
        log_of("tables/{extent}claims_tracking"),
    conda:
        "../envs/cislunar.yaml"
    message:
        "Comparing the claims on tasking and tracking with the paper"
    script:
        "../scripts/tracking_claims.py"


rule paper_vs_ours:
    input:
        rules.architecture_claims.output,
        rules.tracking_claims.output[0] if CELLS else [],
    output:
        table_file("{extent}paper_vs_ours", "paper_vs_ours"),
    log:
        log_of("tables/{extent}paper_vs_ours"),
    conda:
        "../envs/cislunar.yaml"
    message:
        "Collecting the comparisons with the paper"
    script:
        "../scripts/paper_vs_ours.py"


use rule result as photometry_table with:
    output:
        table_file("photometry"),
    log:
        log_of("tables/photometry"),
    params:
        function="campaign.readings.photometry_table",
        material=TASK2["material"],
        limiting_magnitude=TASK2["sensor"]["limiting_magnitude"],
        seed=config["seed"],
    message:
        "Computing the effects of the readings of the photometric equations"


rule results_page:
    input:
        paper_vs_ours=rules.paper_vs_ours.output[0],
        architecture=rules.architecture_table.output.architecture,
        tracking=results("tables/{extent}tracking.csv"),
        datasets=[rules.families.output[0], rules.tracking_summary.output[0]],
    output:
        page=results("tables/{extent}results.md"),
        verdicts=results("tables/{extent}images/verdicts.svg"),
    log:
        log_of("tables/{extent}results_page"),
    conda:
        "../envs/cislunar.yaml"
    params:
        config={key: value for key, value in config.items() if value or key != "observers"},
    message:
        "Writing the page of results"
    script:
        "../scripts/results_page.py"


rule task2:
    input:
        CELLS,
        rules.tracking_tables.output if CELLS else [],
        rules.objective_ranks.output if JUDGED and most_alike(TASK2) >= FEWEST_RANKED else [],
        rules.pooled_table.output if config["task2"]["variants"]["pooled"] else [],
        rules.model_error_table.output if WITH_ERRORS else [],
        rules.tasking_comparison.output if COMPARED["scenario"] else [],
        expand(rules.tracking_claims.output, extent="" if CELLS and OF_THE_PAPER else []),
        rules.photometry_table.output,
