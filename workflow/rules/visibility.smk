use rule result as observer_paths with:
    input:
        orbits=rules.families.output[0],
        bodies=rules.bodies.output[0],
    output:
        results("orbits/paths.nc"),
    log:
        log_of("orbits/paths"),
        times=benchmark_of("observer_paths"),
    priority: 90
    params:
        function="campaign.data.paths_dataset",
        progress="orbits",
        settings=settings("epoch_jd", "visibility") | {"dynamics": TASK2["dynamics"]},
        max_satellites=ARCHITECTURE["max_satellites"],
    message:
        "Propagating the candidate observers with Earth, Moon and Sun from the ephemeris"


use rule observer_paths as observer_paths_of_scenario with:
    input:
        orbits=rules.families.output[0],
        bodies=shared("ephemeris/bodies"),
    output:
        results("orbits/paths_{scenario}.nc"),
    log:
        log_of("orbits/paths_{scenario}"),
        times=benchmark_of("observer_paths_of_scenario/{scenario}"),
    params:
        settings=path_settings,


use rule observer_paths_of_scenario as own_observer_paths with:
    input:
        orbits=rules.own_observers.output[0],
        bodies=shared("ephemeris/bodies"),
    output:
        results("orbits/paths_{scenario}_{observers}.nc"),
    log:
        log_of("orbits/paths_{scenario}_{observers}"),
        times=benchmark_of("own_observer_paths/{scenario}_{observers}"),
    params:
        max_satellites=1,
    message:
        "Propagating the observers {wildcards.observers} with the ephemeris"


use rule result as visibility with:
    input:
        orbits=rules.families.output[0],
        targets=rules.static_targets.output[0],
        sun=sky(),
    output:
        results("visibility/{scenario}.nc"),
    log:
        log_of("visibility/{scenario}"),
        times=benchmark_of("visibility/{scenario}"),
    priority: 50
    threads: ALL_CORES
    params:
        function="campaign.architectures.visibility_dataset",
        progress="orbits",
        settings=settings_of("epoch_jd", "propagator", "visibility"),
        max_satellites=ARCHITECTURE["max_satellites"],
    message:
        "Counting observations for every orbit and number of satellites (scenario {wildcards.scenario})"


use rule visibility as observer_visibility with:
    input:
        orbits=rules.own_observers.output[0],
        targets=rules.static_targets.output[0],
        sun=sky(),
    output:
        results("visibility/{scenario}_{observers}.nc"),
    log:
        log_of("visibility/{scenario}_{observers}"),
        times=benchmark_of("observer_visibility/{scenario}_{observers}"),
    threads: 1
    params:
        max_satellites=1,
    message:
        "Counting observations of the observers {wildcards.observers} (scenario {wildcards.scenario})"
