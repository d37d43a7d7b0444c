rule zvs_points:
    input:
        config["targets"]["missions"],
    output:
        results("targets/zvs_points.nc"),
    log:
        log_of("targets/zvs_points"),
    benchmark:
        benchmark_of("targets/zvs_points")
    params:
        settings=settings("targets"),
    priority: 100
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
    params:
        targets=lambda w: config["scenarios"][w.scenario]["targets"],
        seeding=config["targets"]["seeding"],
        seed=config["seed"],
    priority: 50
    message:
        "Clustering the sampled points to {params.targets} targets (scenario {wildcards.scenario})"
    script:
        "../scripts/static_targets.py"
