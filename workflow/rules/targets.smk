rule zvs_points:
    input:
        config["targets"]["missions"],
    output:
        results("targets/zvs_points.nc"),
    log:
        log_of("targets/zvs_points"),
    benchmark:
        benchmark_of("targets/zvs_points")
    priority: 100
    conda:
        "../envs/cislunar.yaml"
    params:
        settings=settings("targets"),
    message:
        "Sampling the zero-velocity surfaces of the missions in {input}"
    script:
        "../scripts/zvs_points.py"


rule static_targets:
    input:
        rules.zvs_points.output,
    output:
        results("targets/static_{scenario}.nc"),
    log:
        log_of("targets/static_{scenario}"),
    benchmark:
        benchmark_of("targets/static_{scenario}")
    priority: 50
    conda:
        "../envs/cislunar.yaml"
    params:
        targets=lambda w: config["scenarios"][w.scenario]["targets"],
        seeding=config["targets"]["seeding"],
        seed=config["seed"],
    message:
        "Clustering the sampled points to {params.targets} targets (scenario {wildcards.scenario})"
    script:
        "../scripts/static_targets.py"
