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
        report(
            results("tables/sweep_{sweep}.csv"),
            caption="../report/sweep.rst",
            category="Tables",
        ),
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


rule sweep_figure:
    input:
        rules.sweep_table.output[0],
    output:
        png=report(
            results("figures/sweep_{sweep}.png"),
            caption="../report/figure_sweep.rst",
            category="Figures",
        ),
        pdf=results("figures/sweep_{sweep}.pdf"),
    log:
        log_of("figures/sweep_{sweep}"),
        times=benchmark_of("sweep_figure/{sweep}"),
    conda:
        "../envs/cislunar.yaml"
    params:
        figure="search.sweep_figure",
    message:
        "Drawing the sweep {wildcards.sweep}"
    script:
        "../scripts/figure.py"


# Association against known identities, over all sweeps of a study.
rule association_table:
    input:
        cells=[results(cell.path) for cells in SWEPT_CELLS.values() for cell in cells],
    output:
        report(
            results("tables/association.csv"),
            caption="../report/association.rst",
            category="Tables",
        ),
    log:
        log_of("tables/association"),
        times=benchmark_of("association_table"),
    conda:
        "../envs/cislunar.yaml"
    params:
        cells=[tuple(cell) for cells in SWEPT_CELLS.values() for cell in cells],
        custody_km=TASK2["custody"]["position_km"],
    message:
        "Comparing association with known identities"
    script:
        "../scripts/association_table.py"


rule association_figure:
    input:
        rules.association_table.output[0],
    output:
        png=report(
            results("figures/association.png"),
            caption="../report/figure_association.rst",
            category="Figures",
        ),
        pdf=results("figures/association.pdf"),
    log:
        log_of("figures/association"),
        times=benchmark_of("association_figure"),
    conda:
        "../envs/cislunar.yaml"
    params:
        figure="tracking.association_figure",
    message:
        "Drawing association against the number of false alarms"
    script:
        "../scripts/figure.py"


rule association:
    input:
        rules.association_table.output,
        rules.association_figure.output,


# Targets that maneuver, over all sweeps of a study.
rule maneuver_table:
    input:
        cells=[results(cell.path) for cells in SWEPT_CELLS.values() for cell in cells],
    output:
        report(
            results("tables/maneuvers.csv"),
            caption="../report/maneuvers.rst",
            category="Tables",
        ),
    log:
        log_of("tables/maneuvers"),
        times=benchmark_of("maneuver_table"),
    conda:
        "../envs/cislunar.yaml"
    params:
        cells=[tuple(cell) for cells in SWEPT_CELLS.values() for cell in cells],
        custody_km=TASK2["custody"]["position_km"],
    message:
        "Comparing detected and estimated maneuvers with the true ones"
    script:
        "../scripts/maneuver_table.py"


rule maneuver_figure:
    input:
        rules.maneuver_table.output[0],
    output:
        png=report(
            results("figures/maneuvers.png"),
            caption="../report/figure_maneuvers.rst",
            category="Figures",
        ),
        pdf=results("figures/maneuvers.pdf"),
    log:
        log_of("figures/maneuvers"),
        times=benchmark_of("maneuver_figure"),
    conda:
        "../envs/cislunar.yaml"
    params:
        figure="maneuvers.maneuver_figure",
    message:
        "Drawing detection and custody of targets that maneuver"
    script:
        "../scripts/figure.py"


rule maneuvers:
    input:
        rules.maneuver_table.output,
        rules.maneuver_figure.output,


rule sweeps:
    input:
        expand(rules.sweep_table.output, sweep=SWEEPS),
        expand(rules.sweep_figure.output, sweep=SWEEPS),
