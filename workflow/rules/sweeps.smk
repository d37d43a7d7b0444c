"""Sweeps over a key of a scenario, each with its table and figure."""


wildcard_constraints:
    sweep=any_of(SWEEPS),


rule sweep_table:
    input:
        cells=lambda wildcards: [results(cell.path) for cell in SWEPT_CELLS[wildcards.sweep]],
        orbits=lambda wildcards: orbits_file(SWEEPS[wildcards.sweep]["architecture"]),
        architectures=lambda wildcards: [
            results(f"architecture/{name}/{SWEEPS[wildcards.sweep]['architecture']}.nc")
            for name in swept_scenarios(wildcards)
        ],
        targets=lambda wildcards: [
            results(f"targets/static_{name}.nc") for name in swept_scenarios(wildcards)
        ],
        suns=lambda wildcards: [
            sky(name, SWEEPS[wildcards.sweep]["architecture"])
            for name in swept_scenarios(wildcards)
        ],
    output:
        table_file("sweep_{sweep}", "sweep"),
    log:
        log_of("tables/sweep_{sweep}"),
        times=benchmark_of("sweep_table/{sweep}"),
    conda:
        "../envs/cislunar.yaml"
    params:
        sweep=lambda wildcards: SWEEPS[wildcards.sweep],
        points=lambda wildcards: list(map(tuple, SWEEP_POINTS[wildcards.sweep])),
        cells=lambda wildcards: list(map(tuple, SWEPT_CELLS[wildcards.sweep])),
        settings=lambda wildcards: [
            settings_in(name, "epoch_jd", "propagator", "visibility")
            for name in swept_scenarios(wildcards)
        ],
        seed=config["seed"],
    message:
        "Writing the table of the sweep {wildcards.sweep}"
    script:
        "../scripts/sweep_table.py"


use rule result as sweep_figure with:
    input:
        rules.sweep_table.output[0],
    output:
        **figure_files("sweep_{sweep}", "sweep"),
    log:
        log_of("figures/sweep_{sweep}"),
        times=benchmark_of("sweep_figure/{sweep}"),
    params:
        function="figures.search.sweep_figure",
    message:
        "Drawing the sweep {wildcards.sweep}"


# Association against known identities, over all sweeps of a study.
use rule result as association_table with:
    input:
        cells=[results(cell.path) for cells in SWEPT_CELLS.values() for cell in cells],
    output:
        table_file("association"),
    log:
        log_of("tables/association"),
        times=benchmark_of("association_table"),
    params:
        function="campaign.tracking.association_table.association_rows",
        metrics=True,
        cells=[tuple(cell) for cells in SWEPT_CELLS.values() for cell in cells],
        custody_km=TASK2["custody"]["position_km"],
    message:
        "Comparing association with known identities"


use rule sweep_figure as association_figure with:
    input:
        rules.association_table.output[0],
    output:
        **figure_files("association", "association"),
    log:
        log_of("figures/association"),
        times=benchmark_of("association_figure"),
    params:
        function="figures.tracking.association_figure",
    message:
        "Drawing association against the number of false alarms"


rule association:
    input:
        rules.association_table.output,
        rules.association_figure.output,


# Targets that maneuver, over all sweeps of a study.
use rule result as maneuver_table with:
    input:
        cells=[results(cell.path) for cells in SWEPT_CELLS.values() for cell in cells],
    output:
        table_file("maneuvers"),
    log:
        log_of("tables/maneuvers"),
        times=benchmark_of("maneuver_table"),
    params:
        function="campaign.tracking.maneuvers.table.maneuver_rows",
        cells=[tuple(cell) for cells in SWEPT_CELLS.values() for cell in cells],
        custody_km=TASK2["custody"]["position_km"],
    message:
        "Comparing detected and estimated maneuvers with the true ones"


use rule sweep_figure as maneuver_figure with:
    input:
        rules.maneuver_table.output[0],
    output:
        **figure_files("maneuvers", "maneuvers"),
    log:
        log_of("figures/maneuvers"),
        times=benchmark_of("maneuver_figure"),
    params:
        function="figures.maneuvers.maneuver_figure",
    message:
        "Drawing detection and custody of targets that maneuver"


rule maneuvers:
    input:
        rules.maneuver_table.output,
        rules.maneuver_figure.output,


rule sweeps:
    input:
        expand(rules.sweep_table.output, sweep=SWEEPS),
        expand(rules.sweep_figure.output, sweep=SWEEPS),
