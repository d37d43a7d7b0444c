rule visibility:
    input:
        orbits=rules.families.output[0],
        targets=rules.static_targets.output[0],
        sun=shared("ephemeris/sun"),
    output:
        results("visibility/{scenario}.nc"),
    log:
        log_of("visibility/{scenario}"),
        times=benchmark_of("visibility/{scenario}"),
    priority: 50
    conda:
        "../envs/cislunar.yaml"
    threads: ALL_CORES
    params:
        settings=settings_of("epoch_jd", "propagator", "visibility"),
        max_satellites=ARCHITECTURE["max_satellites"],
    message:
        "Counting observations for every orbit and satellite count (scenario {wildcards.scenario})"
    script:
        "../scripts/visibility.py"


use rule visibility as observer_visibility with:
    input:
        orbits=rules.own_observers.output[0],
        targets=rules.static_targets.output[0],
        sun=shared("ephemeris/sun"),
    output:
        results("visibility/{scenario}_{observers}.nc"),
    log:
        log_of("visibility/{scenario}_{observers}"),
        times=benchmark_of("observer_visibility/{scenario}_{observers}"),
    threads: 1
    params:
        settings=settings_of("epoch_jd", "propagator", "visibility"),
        max_satellites=1,
    message:
        "Counting observations of the observers {wildcards.observers} (scenario {wildcards.scenario})"
