rule zvs_points:
    input:
        config["targets"]["missions"],
    output:
        results("targets/zvs_points.nc"),
    log:
        log_of("targets/zvs_points"),
        times=benchmark_of("zvs_points"),
    priority: 100
    conda:
        "../envs/cislunar.yaml"
    params:
        settings=settings("targets"),
    message:
        "Sampling the zero-velocity surfaces of the missions in {input}"
    script:
        "../scripts/zvs_points.py"


use rule zvs_points as zvs_points_of_scenario with:
    input:
        lambda wildcards: settings_in(wildcards.scenario, "targets")["targets"]["missions"],
    output:
        results("targets/zvs_points_{scenario}.nc"),
    log:
        log_of("targets/zvs_points_{scenario}"),
        times=benchmark_of("zvs_points_of_scenario/{scenario}"),
    params:
        settings=settings_of("targets"),


rule static_targets:
    input:
        shared("targets/zvs_points"),
    output:
        results("targets/static_{scenario}.nc"),
    log:
        log_of("targets/static_{scenario}"),
        times=benchmark_of("static_targets/{scenario}"),
    wildcard_constraints:
        scenario=any_of(SAMPLED),
    priority: 50
    conda:
        "../envs/cislunar.yaml"
    params:
        targets=lambda wildcards: STUDY["scenarios"][wildcards.scenario]["targets"],
        seeding=lambda wildcards: settings_in(wildcards.scenario, "targets")["targets"]["seeding"],
        seed=config["seed"],
    message:
        "Clustering the sampled points into {params.targets} targets (scenario {wildcards.scenario})"
    script:
        "../scripts/static_targets.py"


rule own_static_targets:
    input:
        lambda wildcards: STUDY["scenarios"][wildcards.scenario]["static_targets"],
    output:
        results("targets/static_{scenario}.nc"),
    log:
        log_of("targets/static_{scenario}"),
        times=benchmark_of("own_static_targets/{scenario}"),
    wildcard_constraints:
        scenario=any_of(OWN_STATIC),
    conda:
        "../envs/cislunar.yaml"
    message:
        "Reading the static targets in {input} (scenario {wildcards.scenario})"
    script:
        "../scripts/own_static_targets.py"
