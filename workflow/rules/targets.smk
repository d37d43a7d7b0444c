use rule result as zvs_points with:
    input:
        missions_path=config["targets"]["missions"],
    output:
        results("targets/zvs_points.nc"),
    log:
        log_of("targets/zvs_points"),
        times=benchmark_of("zvs_points"),
    priority: 100
    params:
        function="campaign.data.zvs_points_dataset",
        settings=settings("targets"),
    message:
        "Sampling the zero-velocity surfaces of the missions in {input}"


use rule zvs_points as zvs_points_of_scenario with:
    input:
        missions_path=lambda wildcards: sampling_of(wildcards)["missions"],
    output:
        results("targets/zvs_points_{scenario}.nc"),
    log:
        log_of("targets/zvs_points_{scenario}"),
        times=benchmark_of("zvs_points_of_scenario/{scenario}"),
    params:
        settings=settings_of("targets"),


use rule result as static_targets with:
    input:
        points=shared("targets/zvs_points"),
    output:
        results("targets/static_{scenario}.nc"),
    log:
        log_of("targets/static_{scenario}"),
        times=benchmark_of("static_targets/{scenario}"),
    wildcard_constraints:
        scenario=any_of(SAMPLED),
    priority: 50
    params:
        function="campaign.data.static_targets_dataset",
        targets=lambda wildcards: STUDY["scenarios"][wildcards.scenario]["targets"],
        seeding=lambda wildcards: sampling_of(wildcards)["seeding"],
        seed=config["seed"],
    message:
        "Clustering the sampled points into {params.targets} targets (scenario {wildcards.scenario})"


use rule result as own_static_targets with:
    input:
        path=lambda wildcards: STUDY["scenarios"][wildcards.scenario]["static_targets"],
    output:
        results("targets/static_{scenario}.nc"),
    log:
        log_of("targets/static_{scenario}"),
        times=benchmark_of("own_static_targets/{scenario}"),
    wildcard_constraints:
        scenario=any_of(OWN_STATIC),
    params:
        function="campaign.data.own_static_dataset",
    message:
        "Reading the static targets in {input} (scenario {wildcards.scenario})"
