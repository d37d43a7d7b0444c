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
