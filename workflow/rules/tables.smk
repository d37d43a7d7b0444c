# Scenarios with architectures by objectives other than J.
JUDGED = [scenario for scenario in SCENARIOS if designs_of(scenario) or fronts_of(scenario)]
READ = ARCHITECTURE["readings"]["scenario"]
GENERALIZATION = ARCHITECTURE["generalization"]["scenario"]
LABELLED = ARCHITECTURE["label_comparison"]["scenario"]


rule architecture_table:
    input:
        orbits=rules.families.output[0],
        suns=[sky(scenario) for scenario in SCENARIOS],
        targets=expand(results("targets/static_{scenario}.nc"), scenario=SCENARIOS),
        architectures=ARCHITECTURE_FILES,
    output:
        architecture=table_file("architecture"),
        near_optimal=table_file("near_optimal"),
    log:
        log_of("tables/architecture"),
        times=benchmark_of("architecture_table"),
    conda:
        "../envs/cislunar.yaml"
    threads: ALL_CORES
    params:
        settings={
            scenario: settings_in(scenario, "epoch_jd", "propagator", "visibility")
            for scenario in SCENARIOS
        },
    message:
        "Writing table 2 with the coverage of each architecture"
    script:
        "../scripts/architecture_table.py"


rule observers_table:
    input:
        orbits=expand(rules.own_observers.output, observers=OBSERVERS),
        suns=[sky(scenario, name) for scenario in SCENARIOS for name in OBSERVERS],
        targets=expand(results("targets/static_{scenario}.nc"), scenario=SCENARIOS),
        architectures=expand(rules.own_architecture.output, scenario=SCENARIOS, observers=OBSERVERS),
    output:
        table_file("observers"),
    log:
        log_of("tables/observers"),
        times=benchmark_of("observers_table"),
    conda:
        "../envs/cislunar.yaml"
    threads: ALL_CORES
    params:
        observers=list(OBSERVERS),
        settings={
            scenario: settings_in(scenario, "epoch_jd", "propagator", "visibility")
            for scenario in SCENARIOS
        },
    message:
        "Writing the table of your own observers"
    script:
        "../scripts/observers_table.py"


rule objectives_table:
    input:
        orbits=rules.families.output[0],
        targets=rules.static_targets.output[0],
        tracked=shared("orbits/tracked"),
        sun=shared("ephemeris/sun"),
        mesh=objective_mesh,
        fronts=lambda wildcards: fronts_of(wildcards.scenario),
        architectures=lambda wildcards: [
            results(f"architecture/{wildcards.scenario}/{name}.nc")
            for name in judged_architectures(wildcards.scenario)
        ],
        own_orbits=lambda wildcards: list(
            map(orbits_file, judged_architectures(wildcards.scenario))
        ),
    output:
        table_file("objectives_{scenario}", "objectives"),
    log:
        log_of("tables/objectives_{scenario}"),
        times=benchmark_of("objectives_table/{scenario}"),
    conda:
        "../envs/cislunar.yaml"
    threads: ALL_CORES
    params:
        settings=objective_settings,
        seed=config["seed"],
    message:
        "Evaluating every architecture by every objective (scenario {wildcards.scenario})"
    script:
        "../scripts/objectives_table.py"


use rule result as generalization_table with:
    input:
        objective_mesh,
        orbits=rules.families.output[0],
        targets=rules.static_targets.output[0],
        tracked=shared("orbits/tracked"),
        sun=shared("ephemeris/sun"),
    output:
        table_file("objectives_generalization_{scenario}", "objectives_generalization"),
    log:
        log_of("tables/objectives_generalization_{scenario}"),
        times=benchmark_of("generalization_table/{scenario}"),
    resources:
        mem_mb=2000,
    params:
        function="campaign.architectures.generalization_rows",
        inputs="campaign.architectures.ArchitectureInputs",
        progress="sets and classes of targets",
        settings=lambda wildcards: {
            **objective_settings(wildcards),
            "generalization": ARCHITECTURE["generalization"],
        },
        seed=config["seed"],
    message:
        "Evaluating the generalization of architectures to other targets (scenario {wildcards.scenario})"


use rule result as label_comparison with:
    input:
        runs=expand(
            results("architecture/{scenario}/runs/tpe_{labels}_{run}.nc"),
            scenario=LABELLED,
            labels=[ARCHITECTURE["labels"], *ARCHITECTURE["label_comparison"]["labels"]],
            run=RUNS,
        ),
    output:
        table_file("label_comparison"),
    log:
        log_of("tables/label_comparison"),
    params:
        function="campaign.architectures.label_rows",
        scenario=LABELLED,
    message:
        "Comparing the labels of orbits for TPE"


use rule result as readings with:
    input:
        lambda wildcards: settings_in(READ, "targets")["targets"]["missions"],
        orbits=rules.families.output[0],
        sun=lambda wildcards: shared("ephemeris/sun", READ),
    output:
        table_file("readings_architecture"),
    log:
        log_of("tables/readings_architecture"),
        times=benchmark_of("readings"),
    threads: ALL_CORES
    params:
        function="campaign.readings.readings_table",
        progress="readings",
        scenario=READ,
        config=lambda wildcards: readings_settings(
            "seed",
            "epoch_jd",
            "propagator",
            "orbits",
            "targets",
            "visibility",
            "scenarios",
            "architecture",
        ),
    message:
        "Repeating scenario {params.scenario} with each reading of the paper"


rule architecture_claims:
    input:
        orbits=rules.families.output[0],
        points=rules.zvs_points.output[0],
        architectures=ARCHITECTURE_FILES,
    output:
        results("tables/claims_architecture.csv"),
    log:
        log_of("tables/claims_architecture"),
    conda:
        "../envs/cislunar.yaml"
    message:
        "Comparing the numbers and claims on architectures with the paper"
    script:
        "../scripts/architecture_claims.py"


rule task1:
    input:
        rules.architecture_table.output if OPTIMIZERS else [],
        rules.observers_table.output if OBSERVERS else [],
        expand(results("tables/objectives_{scenario}.csv"), scenario=JUDGED),
        expand(rules.generalization_table.output, scenario=GENERALIZATION or []),
        rules.label_comparison.output if OPTIMIZERS and LABELLED else [],
        rules.readings.output if OPTIMIZERS and READ else [],
        rules.architecture_claims.output if OF_THE_PAPER else [],
        rules.refined_orbits_table.output if TASK2["dynamics"]["truth"] == "ephemeris" else [],
        expand(rules.front.output, scenario=SCENARIOS if OPTIMIZERS else []),
