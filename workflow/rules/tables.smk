def architecture_files(pattern):
    """Every architecture of every scenario."""
    return [
        results(pattern.format(scenario=scenario, optimizer=optimizer))
        for scenario in SCENARIOS
        for optimizer in optimizers_of(scenario)
    ]


rule architecture_table:
    input:
        orbits=rules.families.output[0],
        sun=rules.ephemeris.output[0],
        targets=expand(results("targets/static_{scenario}.nc"), scenario=SCENARIOS),
        architectures=architecture_files("architecture/{scenario}/{optimizer}.nc"),
    output:
        architecture=results("tables/architecture.csv"),
        near_optimal=results("tables/near_optimal.csv"),
    log:
        log_of("tables/architecture"),
    benchmark:
        benchmark_of("tables/architecture")
    threads: workflow.cores
    params:
        scenarios=SCENARIOS,
        settings=settings("epoch_jd", "propagator", "visibility"),
    message:
        "Writing table 2 beside the paper's, with the coverage of each architecture"
    script:
        "../scripts/architecture_table.py"


rule label_comparison:
    input:
        expand(
            results("architecture/{scenario}/runs/tpe_{labels}_{run}.nc"),
            scenario=ARCHITECTURE["label_comparison"]["scenario"],
            labels=[ARCHITECTURE["labels"], *ARCHITECTURE["label_comparison"]["labels"]],
            run=RUNS,
        ),
    output:
        results("tables/label_comparison.csv"),
    log:
        log_of("tables/label_comparison"),
    message:
        "Comparing the ways to label an orbit for TPE"
    script:
        "../scripts/label_comparison.py"


rule paper_vs_ours:
    input:
        orbits=rules.families.output[0],
        points=rules.zvs_points.output[0],
        architectures=architecture_files("architecture/{scenario}/{optimizer}.nc"),
    output:
        report(
            results("tables/paper_vs_ours.csv"),
            caption="../report/paper_vs_ours.rst",
            category="Tables",
        ),
    log:
        log_of("tables/paper_vs_ours"),
    message:
        "Comparing the paper's numbers and claims with ours"
    script:
        "../scripts/paper_vs_ours.py"


rule task1:
    input:
        rules.architecture_table.output,
        rules.label_comparison.output,
        rules.paper_vs_ours.output,
        expand(results("architecture/{scenario}/front.nc"), scenario=SCENARIOS),
